"""Archives that are extended: their records are those of a new archive of the longer manifest, bit for bit."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from models.work.folder_store import FolderStore, open_store
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestError
from monitor.fleet.plan import Planner, extend, grown_folders
from monitor.fleet.result import DONE, Later, RecordingOutcome
from tests.monitor.fleet.fleet_files import CONFIG, assert_same_records, make_archive, result_of, write_files
from tests.support.effort import effort_count
from tests.support.small_machine import BAND

AUTO = CONFIG.replace(BAND, 'band_hz = "auto"').replace("speed_hz = 30", "speed_hz = 10")
"""At a speed at which the rate suffices to choose a band."""
HOURS = (range(22), range(22, 26), range(26, 30))


def machine(*recordings: str, name: str = "m", history: str = "continued", anew: str = "") -> str:
    listed = ", ".join(f'"{one}"' for one in recordings)
    keys = f'name = "{name}"\nconfig = "m.toml"\nrecordings = [{listed}]\nhistory = "{history}"\n'
    return f"[[machine]]\n{keys}" + (f'[[machine.anew]]\nat = "{anew}"\n' if anew else "")


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of 30 blocks as three recordings, and the archives ``whole`` and ``two`` of them, and ``out`` of one.

    The second recording begins within the last day of the first.
    """
    folder = tmp_path_factory.mktemp("growth") / "now"
    for number, (name, hours) in enumerate(zip("abc", HOURS, strict=True)):
        write_files(folder / name, len(hours), begin=hours[0], seed=number)
    make_archive(folder, machine("a", "b", "c"), "whole")
    make_archive(folder, machine("a", "b"), "two", part_blocks=8)
    make_archive(folder, machine("a"))
    return folder.rename(folder.with_name("template"))


@pytest.fixture
def history(template: Path) -> Iterator[Path]:
    """A copy of the folder for one test, at the path that stands in its archives."""
    folder = shutil.copytree(template, template.with_name("now"))
    yield folder
    shutil.rmtree(folder)


def test_a_history_goes_on_from_its_end_without_the_recordings_before(history):
    for last, count in (("b", 26), ("c", 30)):
        # Earlier recordings must be named, and are not opened.
        for name in sorted({"a", "b"} - {last}):
            shutil.rmtree(history / name)
            (history / name).mkdir()
        runner = Runner(SerialExecutor())
        counts = make_archive(history, machine(*"abc"[: "abc".index(last) + 1]), extend=True, runner=runner)
        assert (counts.done, counts.rows, runner.tally.chunks) == (1, count, 1)
    assert_same_records(history / "out/m/history", history / "whole/m/history")
    found, whole = (result_of(history / name / "m/history") for name in ("out", "whole"))
    keys = ("blocks", "accepted", "rejected", "offered", "channels", "reasons")
    assert [found.summary[key] for key in keys] == [whole.summary[key] for key in keys]
    assert (found.files, found.first, found.last, found.shape) == (whole.files, whole.first, whole.last, whole.shape)
    assert len(list((history / "out/archive-work/states").iterdir())) == 1


def test_a_history_too_short_to_learn_its_bands_is_replayed_from_its_beginning(tmp_path, kept_band_choices):
    later = effort_count(quick=12, full=24)
    write_files(tmp_path / "a", 6)
    write_files(tmp_path / "b", later, begin=6, seed=2)
    make_archive(tmp_path, machine("a", "b"), "whole", config=AUTO)
    make_archive(tmp_path, machine("a"), config=AUTO)
    assert not list((tmp_path / "out/archive-work/states").glob("*"))
    assert make_archive(tmp_path, machine("a", "b"), config=AUTO, extend=True).rows == 6 + later
    assert_same_records(tmp_path / "out/m/history", tmp_path / "whole/m/history")


def test_a_killed_extension_goes_on(history):
    with pytest.raises(KeyboardInterrupt):
        make_archive(
            history, machine("a", "b", "c"), extend=True, runner=Runner(Killed(), open_store(history / "chunks"))
        )
    with Index(history / "out/index.db") as index:
        assert (index.left(), index.last_link(1)) == (1, 2)
    assert make_archive(history, machine("a", "b", "c"), resume=True).rows == 30
    assert_same_records(history / "out/m/history", history / "whole/m/history")


def test_files_that_come_into_a_recording_after_its_replay_are_told(history):
    with Index(history / "two/index.db") as index:
        assert dict(index.folders_read()) == {f"{history}/a": 22, f"{history}/b": 4}
        assert grown_folders(index) == Later()
        write_files(history / "b/late", 1, begin=40)
        # What is gone by now was read.
        next((history / "a").iterdir()).unlink()
        assert grown_folders(index) == Later(1, f"{history}/b")


class Killed(SerialExecutor):
    def submit(self, call):
        raise KeyboardInterrupt


def test_recordings_and_machines_are_added_and_one_that_fails_harms_no_other(tmp_path):
    for number, name in enumerate(("in/a", "in/c", "fan")):
        write_files(tmp_path / name, 2, seed=number)
    make_archive(tmp_path, machine("in/*", history="each"))
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out/m").rglob("*")}
    # Between the others, and one that is no recording.
    write_files(tmp_path / "in/b", 2, seed=7)
    (tmp_path / "in/bad").mkdir()
    (tmp_path / "in/bad/readme.rtf").write_text("no samples")
    longer = machine("in/*", history="each") + machine("fan", name="fan")
    counts = make_archive(tmp_path, longer, extend=True)
    assert (counts.done, counts.failed) == (4, 1)
    make_archive(tmp_path, longer, "whole")
    for name in ("m/a", "m/b", "m/c", "fan/history"):
        assert_same_records(tmp_path / "out" / name, tmp_path / "whole" / name)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    with Index(tmp_path / "out/index.db") as index:
        assert [*index.folders()] == [("m", "a"), ("m", "c"), ("m", "b"), ("m", "bad"), ("fan", "history")]
        assert [name for name, _ in index.wrong()] == ["m/bad"]


def test_a_history_whose_new_recording_fails_keeps_its_records_and_goes_on_once_it_is_repaired(history):
    files = sorted((history / "b").iterdir())
    kept = {path: path.read_bytes() for path in files}
    for path in files:
        path.rename(path.with_suffix(".rtf"))
    counts = make_archive(history, machine("a", "b"), extend=True)
    assert (counts.failed, counts.rows) == (1, 22)
    assert result_of(history / "out/m/history").status == "failed"
    assert len(list((history / "out/m/history").glob("*.nc"))) == 3
    for path, data in kept.items():
        path.write_bytes(data)
    assert make_archive(history, machine("a", "b"), extend=True).done == 1
    assert_same_records(history / "out/m/history", history / "two/m/history")


@pytest.fixture
def planned(tmp_path):
    """A function that plans a manifest into an index, or extends it; all recordings are done then."""
    (tmp_path / "m.toml").write_text(CONFIG)
    for name in "abcde":
        (tmp_path / name).mkdir()
    with Index(tmp_path / "index.db") as index:

        def plan(text: str) -> tuple[Later, list[tuple[str, str, int, list[str]]]]:
            (tmp_path / "manifest.toml").write_text(text)
            store, added = FolderStore(tmp_path / "work"), Later()
            if index.planned:
                added = extend(index, tmp_path / "manifest.toml", store)
            else:
                Planner(index, store).plan(tmp_path / "manifest.toml")
            rows = [
                (row.machine, row.name, row.attempt, [Path(url).name for url in (row.url, *index.links(row.id, 0, 9))])
                for row in index.waiting()
            ]
            index.note(RecordingOutcome(row.id, DONE) for row in [*index.waiting()])
            return added, rows

        yield plan


def test_what_waits_after_an_extension(planned, tmp_path):
    each = machine("a", name="n", history="each")
    planned(machine("a", "b") + each)
    assert planned(machine("a", "b") + each) == (Later(), [])
    longer = machine("a", "b", "c", "d", "e", anew="d") + machine("b", name="n", history="each") + each
    added, rows = planned(machine("d", "e", name="first") + longer)
    assert added == Later(6, str(tmp_path / "c"))
    assert rows == [
        # Without a state at its end: it is replayed anew.
        ("m", "history", 1, ["a", "b", "c"]),
        ("first", "history", 0, ["d", "e"]),
        ("m", "history-2", 0, ["d", "e"]),
        ("n", "b", 0, ["b"]),
    ]
    with pytest.raises(ManifestError, match="machine first: is in the archive, and is not named any more"):
        planned(longer)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            machine("c", "a", "b", "d", anew="d"),
            "recording 1 of history: expected {}/a, .* got {}/c; a history goes on",
        ),
        (machine("a", "c", "b", "d", anew="d"), "recording 2 of history: expected {}/b, .* got {}/c"),
        (machine("a", "b", "c", "d", anew="d"), "recording 3 of history: expected nothing, .* got {}/c"),
        (machine("a", "b", "d"), "recording 1 of history-2: expected {}/d, .* got nothing"),
        (machine("a", "b"), "recording 1 of history-2: expected {}/d, .* got nothing"),
        (machine("a", "d", anew="d"), "recording 2 of history: expected {}/b, .* got nothing"),
        (machine("a", "b", "d", history="each"), 'history: expected "continued", .* got "each"'),
        (machine("a", name="n"), "is in the archive, and is not named any more"),
    ],
)
def test_an_archive_is_extended_at_the_ends_of_its_histories_alone(planned, tmp_path, text, said):
    planned(machine("a", "b", "d", anew="d"))
    with pytest.raises(ManifestError, match="manifest.toml: machine m: " + said.replace("{}", str(tmp_path))):
        planned(text)
    # Nothing has changed.
    assert planned(machine("a", "b", "d", anew="d")) == (Later(), [])


def test_a_recording_that_is_not_named_any_more_and_another_configuration_are_refused(planned, tmp_path):
    planned(machine("a", "b", history="each"))
    with pytest.raises(ManifestError, match=f"machine m: {tmp_path}/a is in the archive, and is not named any more"):
        planned(machine("b", "c", history="each"))
    (tmp_path / "m.toml").write_text(CONFIG.replace("6205", "6206"))
    with pytest.raises(ManifestError, match="machine m: its configuration or its maps have changed"):
        planned(machine("a", "b", "c", history="each"))
