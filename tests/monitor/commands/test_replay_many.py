"""``replay`` over several recordings: each as by itself, kept where unchanged, continued where it grew."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from models.work.folder_store import FolderStore
from models.work.pool import SerialExecutor
from models.work.runner import Runner
from monitor.commands import replay_many as replay_many_module
from monitor.commands.common import InputError
from monitor.commands.replay import command
from monitor.commands.replay_many import ReplayRecording, Replays, find_recordings, replay_many
from monitor.commands.shared_folders import SharedFolderError, remove_leftovers, replaced
from monitor.config.load import ConfigError
from monitor.records.store import Store
from tests.support.small_machine import small_machine

CONFIG = small_machine()


def put(folder: Path, number: int, first: int = 0) -> None:
    samples = np.random.default_rng(1000 * first + number).standard_normal(256)
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / f"b{number}.npy", samples.astype(np.float32))


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    for first, place in enumerate(("a/run", "b/run", "c")):
        for number in range(2):
            put(tmp_path / place, number, first)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def replay(*arguments: str) -> tuple[int, dict[str, Any]]:
    given = [*arguments, "--config", "m.toml", "--json", "--quiet", "--no-report", "--workers", "1"]
    found = CliRunner().invoke(command, given)
    if found.exception is not None and not isinstance(found.exception, SystemExit):
        raise found.exception
    return found.exit_code, json.loads(found.stdout)


def records(folder: Path) -> list[object]:
    with Store.open(folder / "state.db", read_only=True) as store:
        assert store.check() == []
        return list(store.records())


def test_each_of_several_is_what_it_is_by_itself(fleet: Path) -> None:
    code, told = replay("a/run", "b/run", "c", "--out", "all")
    assert code == 0
    assert [run["name"] for run in told["runs"]] == ["run", "run-2", "c"]
    assert told["failed"] == told["kept"] == 0
    assert told["cluster"]["chunks"] == 3
    for path, run in zip(("a/run", "b/run", "c"), told["runs"], strict=True):
        _, alone = replay(path, "--out", f"alone-{run['name']}")
        assert records(fleet / "all" / run["name"]) == records(fleet / f"alone-{run['name']}")
        same = set(alone) - {"seconds", "blocks_per_second", "records"}
        assert {key: run[key] for key in same} == {key: alone[key] for key in same}
        assert all(Path(file).is_file() for file in run["records"])
    assert {path.name for path in (fleet / "all").iterdir()} == {"run", "run-2", "c"}


def test_what_is_complete_is_kept_and_what_grew_is_continued(fleet: Path) -> None:
    replay("a/run", "c", "--out", "all")
    with pytest.raises(InputError, match=r"has a folder run; use --resume"):
        replay("a/run", "c", "--out", "all")
    put(fleet / "c", 2, 2)
    (fleet / "all" / ".run.01234567").mkdir()
    code, told = replay("a/run", "c", "--out", "all", "--resume")
    assert code == 0
    assert [(run["kept"], run["blocks"]) for run in told["runs"]] == [(True, 2), (False, 3)]
    replay("c", "--out", "alone")
    assert records(fleet / "all" / "c") == records(fleet / "alone")
    assert {path.name for path in (fleet / "all").iterdir()} == {"run", "c"}


def test_one_that_fails_does_not_stop_the_others(fleet: Path) -> None:
    (fleet / "d").mkdir()
    (fleet / "d" / "b0.npy").write_bytes(b"no samples")
    code, told = replay("none", "d", "c", "--out", "all")
    assert code == 1
    assert told["failed"] == 2
    assert "none" in told["runs"][0]["error"]
    assert told["runs"][1]["error"] == "every block is rejected"
    assert told["runs"][2]["error"] is None
    assert not (fleet / "all" / "none").exists()


def test_a_store_of_another_recording_is_not_continued(fleet: Path) -> None:
    replay("a/run", "b/run", "--out", "all")
    _, told = replay("b/run", "a/run", "--out", "all", "--resume")
    assert "holds the replay of a/run, expected b/run" in told["runs"][0]["error"]
    assert told["failed"] == 2


def test_a_store_of_another_configuration_is_not_continued(fleet: Path) -> None:
    replay("a/run", "c", "--out", "all")
    (fleet / "all" / "run" / "replay.json").write_text("[]")
    (fleet / "m.toml").write_text(CONFIG.replace("speed_hz = 30", "speed_hz = 31"))
    put(fleet / "c", 2, 2)
    _, told = replay("a/run", "c", "--out", "all", "--resume")
    assert told["runs"][0]["error"] is None
    assert told["runs"][1]["error"].endswith(
        "with another configuration, or other maps or libraries; use another --out"
    )
    assert len(records(fleet / "all" / "c")) == 2


def test_what_a_lost_worker_has_put_in_place_is_not_replayed_again(fleet: Path) -> None:
    replays = Replays(fleet / "m.toml", fleet / "out", limit=1, report=False)
    recordings = find_recordings(["c"])
    twice = _Twice(SerialExecutor())
    (outcome,) = replay_many(recordings, replays, twice)
    assert outcome.summary is not None
    assert twice.first == outcome.summary
    assert outcome.summary["blocks"] == len(records(fleet / "out" / "c")) == 1


class _Twice(Runner):
    """A runner that runs each task again after its worker was lost."""

    first: object = None

    def outcomes(self, work: Any, shared: Any, tasks: Any, **named: Any) -> Any:
        for i, task in enumerate(tasks):
            self.first = work.function(shared, task).summary
            yield i, work.function(shared, task)


def test_a_folder_that_another_command_made_meanwhile_is_left_alone(fleet: Path) -> None:
    replays = Replays(fleet / "m.toml", fleet / "out", report=False)

    class Late(Runner):
        def outcomes(self, *arguments: Any, **named: Any) -> Any:
            replay("a/run", "b/run", "c", "--out", "out")
            return super().outcomes(*arguments, **named)

    (outcome,) = replay_many(find_recordings(["c"]), replays, Late(SerialExecutor()))
    assert outcome.error.endswith("another command has made it meanwhile; use another --out")
    assert len(records(fleet / "out" / "c")) == 2


def test_a_configuration_that_changes_meanwhile_ends_the_command(fleet: Path) -> None:
    class Changed(Runner):
        def outcomes(self, *arguments: Any, **named: Any) -> Any:
            (fleet / "m.toml").write_text(CONFIG.replace("speed_hz = 30", "speed_hz = 31"))
            return super().outcomes(*arguments, **named)

    replays = Replays(fleet / "m.toml", fleet / "out", report=False)
    with pytest.raises(SharedFolderError, match=r"m\.toml: worker .* sees another configuration"):
        replay_many(find_recordings(["c"]), replays, Changed(SerialExecutor()))


def test_a_map_that_is_missing_is_named_before_anything_is_replayed(
    fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("monitor.commands.shared_folders.files_of", lambda config: [fleet / "no.nc"])
    with pytest.raises(ConfigError, match=r"m\.toml: names .*no\.nc, which cannot be read: No such file"):
        replay("a/run", "c", "--out", "all")
    assert not (fleet / "all" / "c").exists()


def test_no_signature_is_kept_in_a_chunk(fleet: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    signed = "https://plant.example/c.npy?X-Amz-Signature=planted"

    @contextmanager
    def fetched(_url: str, _scratch: Path, _pulses: str | None) -> Iterator[str]:
        yield str(fleet / "c")

    monkeypatch.setattr(replay_many_module, "local_source", fetched)
    store = FolderStore(fleet / "chunks")
    recording = ReplayRecording("c", signed, "https://plant.example/c.npy")
    replays = Replays(fleet / "m.toml", fleet / "out", report=False)
    (outcome,) = replay_many([recording], replays, Runner(SerialExecutor(), store))
    assert outcome.summary is not None
    assert outcome.recording.url == signed
    kept = [path.read_bytes() for path in (fleet / "chunks").rglob("*") if path.is_file()]
    assert len(kept) > 2
    assert not any(b"planted" in data for data in kept)


def test_several_at_a_pace_or_a_cluster_of_nothing_are_refused(fleet: Path) -> None:
    with pytest.raises(InputError, match="--pace: expected one PATH"):
        replay("a/run", "c", "--pace", "1")
    with pytest.raises(InputError, match="--cluster: expected the PATHs"):
        replay("--cluster", "local")


def test_workers_elsewhere_must_see_the_same_folders(fleet: Path) -> None:
    replays = Replays(fleet / "m.toml", fleet / "out", report=False)
    with Runner(SerialExecutor(), FolderStore(fleet / "chunks")) as runner:
        (outcome,) = replay_many(find_recordings(["c"]), replays, runner, elsewhere=True)
        assert outcome.summary is not None
        assert outcome.summary["blocks"] == 2
        gone = ReplayRecording("gone", str(fleet / "c"), "c")
        shadow = _Forgetful(runner, fleet / "out2")
        with pytest.raises(SharedFolderError, match="does not see this folder of the caller"):
            replay_many([gone], Replays(fleet / "m.toml", fleet / "out2"), shadow, elsewhere=True)


class _Forgetful(Runner):
    """A runner whose workers do not see the mark of the caller."""

    def __init__(self, runner: Runner, out: Path) -> None:
        self._inner, self._out = runner, out

    def outcomes(self, *arguments: Any, **named: Any) -> Any:
        for mark in self._out.glob(".spallwatch-*"):
            mark.unlink()
        return self._inner.outcomes(*arguments, **named)


def no_space(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_folder_takes_its_place_whole_or_not_at_all(tmp_path: Path) -> None:
    place = tmp_path / "out" / "run"
    for text in ("first", "second"):
        with replaced(place) as folder:
            (folder / "state.db").write_text(text)
        assert (place / "state.db").read_text() == text
    with pytest.raises(RuntimeError, match="half"), replaced(place):
        raise RuntimeError("half")
    assert (place / "state.db").read_text() == "second"
    assert [path.name for path in place.parent.iterdir()] == ["run"]
    with pytest.MonkeyPatch.context() as full:
        full.setattr("shutil.copy2", no_space)
        with pytest.raises(InputError, match=r"/state\.db: cannot be written: No space"), replaced(place) as folder:
            (folder / "state.db").write_text("third")
    assert [path.name for path in place.parent.iterdir()] == ["run"]
    assert (place / "state.db").read_text() == "second"
    # Killed between the two renames.
    place.rename(place.with_name(".run.01234567.old"))
    # Of the user, or of a run of another name.
    others = [place.with_name(name) for name in (".run.my-own-files", ".run.b.01234567", ".run.0123456789")]
    for other in others:
        other.mkdir()
    remove_leftovers(place.parent, ["run"])
    assert (place / "state.db").read_text() == "second"
    assert set(place.parent.iterdir()) == {place, *others}


def test_a_folder_of_the_user_is_not_replaced(fleet: Path) -> None:
    """It is called as a recording, and --resume takes what stands there for an earlier replay."""
    mine = fleet / "out" / "c" / "notes.txt"
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    replays = Replays(fleet / "m.toml", fleet / "out", report=False, resume=True)
    (outcome,) = replay_many(find_recordings(["c"]), replays)
    assert outcome.error == f"{mine.parent}: holds files and no state.db; use another --out"
    assert [path.name for path in mine.parent.iterdir()] == ["notes.txt"]
    mine.parent.rename(fleet / "elsewhere")
    (fleet / "out" / "c").symlink_to(fleet / "elsewhere")
    (outcome,) = replay_many(find_recordings(["c"]), replays)
    assert outcome.error == f"{mine.parent}: expected a folder, or nothing yet"
    assert (fleet / "elsewhere" / "notes.txt").read_text() == "mine"
