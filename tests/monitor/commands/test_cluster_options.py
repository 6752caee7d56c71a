"""The options --cluster, --workers, --resume and --chunks: which runner they give, what is kept, what is told."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from models.words.errors import WrongInputError
from models.work.errors import ChunksFailedError
from models.work.task import Progress, Work
from monitor.commands.cluster_options import Sharing, progress_text, sharing
from monitor.commands.common import InputError

MODULE = "monitor.commands.cluster_options"


def doubled(shared: int, task: int) -> int:
    if task == shared:
        raise RuntimeError(f"task {task} broke")
    return 2 * task


def interrupted(_shared: None, task: int) -> int:
    if task == 2:
        raise KeyboardInterrupt
    return task


def noted(folder: str, task: int) -> int:
    with Path(folder, "runs").open("a") as file:
        file.write(f"{task}\n")
    return task


DOUBLED = Work("doubles", doubled, memory=1000)
INTERRUPTED = Work("doubles", interrupted, memory=1000)
NOTED = Work("notes", noted, memory=1000)


@click.command
@click.option("--out", type=click.Path(path_type=Path))
@click.option("--broken", type=int, default=-1)
@sharing("Threads")
def command(out: Path | None, broken: int, sharing: Sharing) -> None:
    """Double some numbers."""
    with sharing.open(out, quiet=False) as shared:
        values = list(shared.runner.run(DOUBLED, broken, range(5)))
    click.echo(json.dumps({"values": values, "cluster": shared.values(), "lines": list(shared.lines())}))


def run(*arguments: str) -> dict:
    return json.loads(CliRunner().invoke(command, arguments, catch_exceptions=False).stdout)


def test_a_plain_run_keeps_nothing(tmp_path):
    found = run("--workers", "1", "--out", str(tmp_path / "map.npz"))
    assert found["values"] == [0, 2, 4, 6, 8]
    assert found["lines"] == []
    assert found["cluster"].pop("processors") is not None
    assert found["cluster"] == {"address": None, "workers": 1, "chunks": 5, "kept": 0, "failed": []}
    assert list(tmp_path.iterdir()) == []


def test_chunks_are_deleted_at_the_end_unless_their_place_was_named(tmp_path):
    run("--workers", "1", "--out", str(tmp_path / "map.npz"), "--resume")
    assert list(tmp_path.iterdir()) == []
    place = tmp_path / "chunks"
    assert run("--workers", "1", "--chunks", str(place), "--resume")["cluster"]["kept"] == 0
    again = run("--workers", "1", "--chunks", str(place), "--resume")
    assert again["cluster"]["kept"] == 5
    assert again["values"] == [0, 2, 4, 6, 8]
    assert again["lines"] == ["5 chunks on 1 worker, 5 of them found done"]
    # Without --resume nothing of an earlier run is used.
    assert run("--workers", "1", "--chunks", str(place))["cluster"]["kept"] == 0


def test_failed_chunks_are_told_with_their_log_and_the_others_kept(tmp_path):
    out = tmp_path / "map.npz"
    arguments = ["--workers", "1", "--out", str(out), "--resume", "--broken", "3"]
    found = CliRunner().invoke(command, arguments)
    assert isinstance(found.exception, ChunksFailedError)
    assert found.exception.exit_code == 1
    assert "doubles 4: task 3 broke" in str(found.exception)
    assert "log of doubles 4" in found.stderr
    assert "RuntimeError: task 3 broke" in found.stderr
    assert (tmp_path / "map.npz.chunks" / "failed").is_dir()


def test_an_interrupted_run_says_how_to_go_on(tmp_path, capsys):
    with (
        pytest.raises(KeyboardInterrupt),
        Sharing(workers=1, resume=True).open(tmp_path / "map.npz", quiet=True) as shared,
    ):
        list(shared.runner.run(INTERRUPTED, None, range(5)))
    told = capsys.readouterr().err
    assert "--resume" in told
    assert "map.npz.chunks" in told
    assert (tmp_path / "map.npz.chunks").is_dir()


def take(out: Path, seen: Path, most: int) -> int:
    """Take some results and fail; return how many were found done."""
    with Sharing(workers=1, resume=True).open(out, quiet=True) as shared:
        results = shared.runner.run(NOTED, str(seen), range(5))
        assert [next(results) for _ in range(most)] == list(range(most))
        raise RuntimeError(shared.runner.tally.kept)


def test_what_an_interrupted_run_left_is_not_run_again(tmp_path):
    for most, kept in ((3, 0), (5, 3)):
        with pytest.raises(RuntimeError, match=f"^{kept}$"):
            take(tmp_path / "out", tmp_path, most)
    assert (tmp_path / "runs").read_text().split() == ["0", "1", "2", "3", "4"]


@pytest.mark.parametrize(
    ("options", "named"), [({"resume": True}, "--resume"), ({"cluster": "tcp://127.0.0.1:1"}, "--cluster")]
)
def test_chunks_need_a_place(options, named):
    with pytest.raises(InputError, match=f"{named}: expected --chunks"), Sharing(**options).open(None, quiet=True):
        pass


@pytest.mark.parametrize(
    ("chunks", "words"),
    [
        ("", "expected a folder or URL, got ''"),
        ("file://host/x", "expected file:///FOLDER, got 'file://host/x'"),
        ("{}/file/x", " {}/file/x: cannot be written: "),
        ("{}/file", " {}/file: cannot be written: "),
        ("{}/map.nc", "{}/map.nc: is the output; expected another folder"),
    ],
)
def test_a_wrong_place_of_chunks_is_refused_by_its_option(tmp_path, chunks, words):
    (tmp_path / "file").touch()
    with pytest.raises(InputError) as error:
        Sharing(chunks=chunks.format(tmp_path)).open(tmp_path / "map.nc", quiet=True).__enter__()
    assert str(error.value).startswith("--chunks")
    assert words.format(tmp_path) in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_wrong_store_is_refused(tmp_path):
    with pytest.raises(WrongInputError), Sharing(chunks="nowhere://x").open(tmp_path / "out", quiet=True):
        pass


def test_progress_in_words():
    assert progress_text(Progress(3, 10, 1, 2, 400.0, "rows")) == "rows: 3 of 10, 1 found done, 2 failed, 7 min left"
    assert progress_text(Progress(10, 10, 0, 0, 0.0)) == "chunks: 10 of 10"


def test_progress_is_shown_on_a_terminal(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setattr(f"{MODULE}.PROGRESS_AFTER_S", 0.0)
    for quiet in (False, True):
        with Sharing(workers=1).open(tmp_path / "out", quiet=quiet) as shared:
            list(shared.runner.run(DOUBLED, -1, range(2)))
        told = capsys.readouterr().err
        assert ("doubles: 2 of 2" in told) is not quiet


def test_temporary_folders_of_killed_commands_are_removed(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / f"spallwatch-run-{'0' * 16}").mkdir()
    (tmp_path / f"spallwatch-run-{'0' * 16}.lock").touch()
    with Sharing(workers=1).open(None, quiet=True):
        assert list(tmp_path.iterdir()) == []


def test_a_folder_in_one_that_may_not_be_written_is_an_output(tmp_path, monkeypatch):
    monkeypatch.setattr("monitor.commands.shared_folders.may_write", lambda folder: folder != tmp_path)
    (tmp_path / "out").mkdir()
    with Sharing(workers=1).open(tmp_path / "out", quiet=True):
        assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_an_output_and_a_link_to_it_have_one_writer(tmp_path):
    real, link = tmp_path / "real" / "out", tmp_path / "links" / "out-2"
    real.mkdir(parents=True)
    link.parent.mkdir()
    link.symlink_to(real)
    for held, other in ((real, link), (link, real)):
        part = other.with_name(f".{other.name}.x.part")
        with Sharing(workers=1).open(held, quiet=True):
            part.touch()
            with pytest.raises(InputError, match=rf"--out {other}: another process"):
                Sharing(workers=1).open(other, quiet=True).__enter__()
        with Sharing(workers=1).open(other, quiet=True):
            assert not part.exists()
    assert [path.name for path in (*real.parent.iterdir(), *link.parent.iterdir())] == ["out", "out-2"]


def test_an_output_has_one_writer_at_a_time(tmp_path):
    out, other = tmp_path / "a" / "map.nc", tmp_path / "a" / "map.nc2"
    with Sharing(workers=1).open(out, quiet=True), Sharing(workers=1).open(other, quiet=True):
        for part in (".map.nc.x.part", ".map.nc2.x.part"):
            (tmp_path / "a" / part).touch()
        with (
            pytest.raises(InputError, match=rf"--out {out}: another process is writing it"),
            Sharing(workers=1).open(out, quiet=True),
        ):
            pass
        with Sharing(workers=1).open(out, quiet=True, locked=False):
            pass
    # What a killed one left half written goes, also after its lock was left.
    (tmp_path / "a" / ".map.nc.lock").touch()
    with Sharing(workers=1).open(out, quiet=True):
        assert {path.name for path in (tmp_path / "a").iterdir()} == {".map.nc.lock", ".map.nc2.x.part"}
    assert [path.name for path in (tmp_path / "a").iterdir()] == [".map.nc2.x.part"]
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"--out .*/file/map\.nc: cannot be written: "):
        Sharing(workers=1).open(tmp_path / "file" / "map.nc", quiet=True).__enter__()
