"""Manifests: what is taken from TOML and CSV, and each refusal with its file and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.work.folder_store import open_store
from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestError, read_manifest
from monitor.fleet.plan import Planner, check_unchanged, later_recordings, manifest_digest, signed_urls
from monitor.fleet.result import Later
from tests.monitor.fleet.fleet_files import CONFIG

TABLE = '[[machine]]\nname = "press"\nconfig = "m.toml"\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    for name in ("a", "b9", "b10"):
        (tmp_path / name).mkdir()
    return tmp_path


def write(folder: Path, text: str, name: str = "fleet.toml") -> Path:
    (folder / name).write_text(text)
    return folder / name


def planned(folder: Path, manifest: Path) -> list[tuple[str, ...]]:
    """Plan a manifest; return machine, name and URL of each row, those of a history behind it."""
    with Index(folder / "index.db") as index:
        Planner(index, open_store(folder / "work")).plan(manifest)
        return [(row.machine, row.name, row.url, *index.links(row.id, 0, 100)) for row in index.waiting()]


def test_a_glob_is_expanded_in_natural_order_and_names_are_unique(folder):
    listed = TABLE + 'recordings = ["b*", "rig:ferrara?seed=1", "s3://store/a.npy", "s3://other/a.npy"]\n'
    assert planned(folder, write(folder, listed)) == [
        ("press", "b9", f"{folder}/b9"),
        ("press", "b10", f"{folder}/b10"),
        ("press", "rig-ferrara-seed-1", "rig:ferrara?seed=1"),
        ("press", "a.npy", "s3://store/a.npy"),
        ("press", "a.npy-2", "s3://other/a.npy"),
    ]


def test_a_file_url_is_the_path_that_it_names(folder):
    (folder / "a b").mkdir()
    listed = TABLE + f'recordings = ["b9", "file://{folder}/a%20b"]\nhistory = "continued"\n'
    anew = f'[[machine.anew]]\nat = "file://{folder}/a%20b"\n'
    assert planned(folder, write(folder, listed + anew)) == [
        ("press", "history", f"{folder}/b9"),
        ("press", "history-2", f"{folder}/a b"),
    ]


def test_a_csv_says_what_a_toml_says(folder):
    toml = TABLE + 'recordings = ["b*", "a"]\nhistory = "continued"\n[[machine.anew]]\nat = "a"\n'
    head = "machine,config,recording,history,anew\n"
    csv = head + "press,m.toml,b*,continued,\n\npress,m.toml,a,continued,yes\n"
    found = planned(folder, write(folder, csv, "fleet.csv"))
    (folder / "index.db").unlink()
    assert found == planned(folder, write(folder, toml))
    assert found == [
        ("press", "history", f"{folder}/b9", f"{folder}/b10"),
        ("press", "history-2", f"{folder}/a"),
    ]


def test_what_a_pattern_names_since_an_archive_was_planned_is_counted(folder):
    text = TABLE + 'recordings = ["b*", "s3://store/a.npy"]\n'
    more = TABLE.replace("press", "fan") + 'history = "continued"\nrecordings = ["a*"]\n'
    manifest = write(folder, text + more)
    planned(folder, manifest)
    with Index(folder / "index.db") as index:
        assert later_recordings(index, manifest) == Later(0, "")
        for name in ("b11", "a1", "a2"):
            (folder / name).mkdir()
        assert later_recordings(index, manifest) == Later(3, f"{folder}/a1")
        # What is gone is said by its replay.
        for name in ("b9", "b10", "b11", "a1"):
            (folder / name).rmdir()
        assert later_recordings(index, manifest) == Later(1, f"{folder}/a2")


def test_a_pattern_that_names_nothing_any_more_hides_no_other_one(folder):
    manifest = write(folder, TABLE + 'recordings = ["a*", "b*"]\n')
    planned(folder, manifest)
    (folder / "a").rmdir()
    (folder / "b11").mkdir()
    with Index(folder / "index.db") as index:
        assert later_recordings(index, manifest) == Later(1, f"{folder}/b11")


def test_recordings_of_one_name_are_numbered_each_by_one_statement(folder):
    with Index(folder / "index.db") as index:
        machine = index.add_machine("press", "setup", "each")
        index.add_recording(machine, "raw-3", "/0/raw-3")
        for number in range(5):
            index.add_recording(machine, "raw", f"/{number}/raw")
        statements: list[str] = []
        index._connection.set_trace_callback(statements.append)
        index.add_recording(machine, "raw", "/5/raw")
        assert [row.name for row in index.waiting()] == ["raw-3", "raw", "raw-2", "raw-4", "raw-5", "raw-6", "raw-7"]
        assert sum("INSERT" in statement for statement in statements) == 1


def test_a_signature_is_neither_kept_nor_a_change(folder):
    signed = "https://store.example/a.npy?X-Amz-Signature={}"
    manifest = write(folder, TABLE + f'recordings = "{signed.format("0123456789abcdef")}"\n')
    assert planned(folder, manifest) == [("press", "a.npy", "https://store.example/a.npy")]
    assert b"0123456789abcdef" not in (folder / "index.db").read_bytes()
    assert signed_urls(manifest) == {"https://store.example/a.npy": signed.format("0123456789abcdef")}
    before = manifest_digest(manifest)
    write(folder, TABLE + f'recordings = "{signed.format("fedcba9876543210")}"\n')
    assert manifest_digest(manifest) == before
    with Index(folder / "index.db") as index:
        check_unchanged(index, manifest, open_store(folder / "work"))


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", None, "expected [[machine]] tables alone, got nothing"),
        ("x = 1\n" + TABLE + 'recordings = "a"', None, "tables alone, got x, machine"),
        (TABLE, 1, "recordings: expected a list of paths, globs or URLs, got None"),
        (TABLE + 'recordings = ["a", 3]', 1, "recordings: expected paths, globs or URLs, got 3"),
        (TABLE + 'recordings = "a"\nspeed = 3', 1, "unknown key 'speed'"),
        (TABLE + 'recordings = "c"', 1, "there is no"),
        (TABLE + 'recordings = "c*"', 1, "nothing is named"),
        (TABLE + 'recordings = ["a", "a"]', 1, "is given twice"),
        (TABLE + 'recordings = "a"\n' + TABLE + 'recordings = "a"', None, "/a is given twice for machine press"),
        (TABLE + 'recordings = ["a", "file://FOLDER/a"]', 1, "/a is given twice"),
        (
            TABLE + 'recordings = "a"\n' + TABLE + 'recordings = "file://FOLDER/[a]"',
            None,
            "/a is given twice for machine",
        ),
        (TABLE + 'recordings = "a"\nhistory = "some"', 1, "history: expected each or continued, got 'some'"),
        (TABLE + 'recordings = "a"\nanew = [{at = "a"}]', 1, 'with history = "each"'),
        (TABLE + 'recordings = "a"\nanew = [{since = 3}]', 1, "expected at = RECORDING"),
        (TABLE + 'recordings = ["a"]\nhistory = "continued"\nanew = [{at = "b9"}]', 1, "is none of the recordings"),
        (TABLE.replace("press", "../press") + 'recordings = "a"', 1, "name of the machine: expected letters"),
        (TABLE.replace("press", "archive-work") + 'recordings = "a"', 1, "none of archive-work, index.db"),
        (TABLE.replace("press", "index.db-wal") + 'recordings = "a"', 1, "got 'index.db-wal'"),
        (TABLE.replace("press", "Lease.json") + 'recordings = "a"', 1, "got 'Lease.json'"),
        (TABLE.replace("m.toml", "n.toml") + 'recordings = "a"', 1, "config: there is no file"),
        (TABLE.replace("m.toml", "~nobody-/m.toml") + 'recordings = "a"', 1, "config: '~nobody-/m.toml' is of a user"),
        (TABLE.replace("m.toml", "n" * 400) + 'recordings = "a"', 1, "File name too long"),
        (TABLE + 'recordings = "~nobody-/x"', 1, "recordings: '~nobody-/x' is of a user who has no home folder here"),
        (TABLE + 'recordings = "folder:~nobody-/x"', 1, "recordings: '~nobody-/x' is of a user"),
        (TABLE + f'recordings = "{"x" * 400}"', 1, "File name too long"),
        (TABLE + 'recordings = "nosuch://store/*"', 1, "recordings: nosuch://store/*: nosuch:// is not a kind"),
        (
            TABLE + 'recordings = "a"\n' + TABLE + 'recordings = "b*"\nhistory = "continued"',
            5,
            "history: machine press",
        ),
    ],
)
def test_a_refusal_of_toml_names_file_and_line(folder, text, line, words):
    manifest = write(folder, text.replace("FOLDER", str(folder)))
    with pytest.raises(ManifestError) as refused:
        planned(folder, manifest)
    assert str(refused.value).startswith(f"{manifest}:" if line is None else f"{manifest}:{line}: ")
    assert words in str(refused.value)
    # Nothing is planned by halves.
    with Index(folder / "index.db") as index:
        assert (index.left(), index.meta()) == (0, {})


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "expected the columns machine, config, recording"),
        ("machine,config,recording,speed\n", 1, "got machine, config, recording, speed"),
        ("machine,config,recording\npress,m.toml\n", 2, "expected 3 values, got 2"),
        ("machine,config,recording\npress,m.toml,a\npress,m.toml,\n", 3, "recording: expected a path"),
        ("machine,config,recording,anew\npress,m.toml,a,perhaps\n", 2, "anew: expected yes, no or nothing"),
        ('machine,config,recording\npress,m.toml,"a\n', 2, "not CSV"),
    ],
)
def test_a_refusal_of_csv_names_file_and_line(folder, text, line, words):
    manifest = write(folder, text, "fleet.csv")
    with pytest.raises(ManifestError) as refused:
        planned(folder, manifest)
    assert str(refused.value).startswith(f"{manifest}:{line}: ")
    assert words in str(refused.value)


def test_a_csv_is_read_as_it_is_taken(folder):
    rows = "press,m.toml,a\n" * 3
    entries = read_manifest(write(folder, f"machine,config,recording\n{rows}press,m.toml\n", "fleet.csv"))
    assert [next(entries).where.rpartition(":")[2] for _ in range(3)] == ["2", "3", "4"]
    with pytest.raises(ManifestError, match=":5: expected 3 values"):
        next(entries)


def test_other_files_are_no_manifests(folder):
    for name, words in (("fleet.yaml", "ends in .toml or .csv"), ("none.toml", "cannot be read")):
        with pytest.raises(ManifestError, match=words):
            list(read_manifest(folder / name))
