"""Files of pulses beside those of a watched folder: waited for, in order, and the same in a replay."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streams.files.sidecar import is_pulse_file, pulse_file_of
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block, Rejected
from streams.types.spec import SourceError, SourceSpec
from tests.streams.folders import CHANNELS, RATE, Rig, csv_bytes, noise
from tests.streams.makers import tar_file

PATTERN = "{stem}.pulses.csv"
COUNT = 250
BLOCK_S = 0.1
T0 = 1_700_000_000.0


def times_of(number: int) -> list[float]:
    return [0.01 + 0.02 * k + 1e-4 * number for k in range(12)]


def put(folder: Path, number: int, *, pulses: bool = True) -> None:
    head = f"Start: {datetime.fromtimestamp(T0 + COUNT / RATE * number, UTC):%Y-%m-%dT%H:%M:%S.%f}Z\n".encode()
    (folder / f"{number}.csv").write_bytes(head + csv_bytes(noise(COUNT, number)))
    if pulses:
        put_pulses(folder, number)


def put_pulses(folder: Path, number: int) -> None:
    text = "".join(f"{time:.4f}\n" for time in times_of(number))
    (folder / f"{number}.pulses.csv").write_text(text)


def seen(items: list[Block | Rejected]) -> list[tuple[str, list[float] | str | None]]:
    return [
        (
            item.name,
            item.status
            if isinstance(item, Rejected)
            else None
            if item.pulses is None
            else np.round(item.pulses.times, 9).tolist(),
        )
        for item in items
    ]


def replayed(folder: Path, **spec: Any) -> list[Block | Rejected]:
    base: dict[str, Any] = {"rate": RATE, "channels": CHANNELS, "pulses": PATTERN, "format": "csv"}
    return list(open_source(SourceSpec(name="s", url=f"folder:{folder}", **{**base, **spec})))


def check_same(live: list[Block | Rejected], replay: list[Block | Rejected]) -> None:
    assert len(live) == len(replay)
    for one, two in zip(live, replay, strict=True):
        assert (one.name, one.content_hash) == (two.name, two.content_hash)
        if isinstance(one, Block) and one.pulses is not None:
            assert isinstance(two, Block)
            assert two.pulses is not None
            np.testing.assert_array_equal(one.pulses.times, two.pulses.times)


def test_files_beside_belong_to_their_recordings() -> None:
    assert pulse_file_of(PATTERN, "run/a.b.csv.xz") == "run/a.b.pulses.csv"
    assert pulse_file_of("p_{name}", "a.csv") == "p_a.csv"
    assert pulse_file_of(None, "a.csv") is None
    assert is_pulse_file(PATTERN, "run/a.b.pulses.csv")
    assert not is_pulse_file(PATTERN, "run/.pulses.csv")
    assert not is_pulse_file(PATTERN, "run/a.csv")
    assert not is_pulse_file("tacho", "tacho")


@pytest.mark.parametrize("kind", ["csv", "auto"])
@pytest.mark.parametrize("before", [True, False])
def test_pulses_that_come_before_or_after_their_file(tmp_path: Path, before: bool, kind: str) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format=kind)
    for number in (1, 2):
        if before:
            put_pulses(tmp_path, number)
            rig.run(3.0)
        put(tmp_path, number, pulses=False)
        assert rig.run(1.5) == []
        put_pulses(tmp_path, number)
        rig.run(3.0)
    assert seen(rig.items) == [(f"{number}.csv", pytest.approx(times_of(number))) for number in (1, 2)]
    assert rig.source.backlog().ignored == 0
    check_same(rig.items, replayed(tmp_path, block_s="file"))


def test_files_wait_in_order_for_pulses_that_come_late(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv")
    put(tmp_path, 1, pulses=False)
    put(tmp_path, 2)
    assert rig.run(15.0) == []
    put_pulses(tmp_path, 1)
    rig.run(5.0)
    assert [name for name, _ in seen(rig.items)] == ["1.csv", "2.csv"]
    assert all(times is not None for _, times in seen(rig.items))


def test_a_file_whose_pulses_never_come_is_read_without(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv")
    put(tmp_path, 1, pulses=False)
    put(tmp_path, 2)
    rig.run(30.0)
    assert seen(rig.items) == [("1.csv", None), ("2.csv", pytest.approx(times_of(2)))]
    check_same(rig.items, replayed(tmp_path, block_s="file"))


def test_pulses_of_no_bytes_are_waited_for_and_then_left_out(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv")
    for number in (1, 2):
        put(tmp_path, number, pulses=False)
        (tmp_path / f"{number}.pulses.csv").touch()
    assert rig.run(10.0) == []
    put_pulses(tmp_path, 1)
    rig.run(30.0)
    assert seen(rig.items) == [("1.csv", pytest.approx(times_of(1))), ("2.csv", None)]
    check_same(rig.items, replayed(tmp_path, block_s="file"))


def test_pulses_that_break_off_are_read_again_before_their_file_is_rejected(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv")
    put(tmp_path, 1, pulses=False)
    (tmp_path / "1.pulses.csv").write_text("0.01\n0.0x")
    assert rig.run(15.0) == []
    rig.run(20.0)
    assert seen(rig.items) == [("1.csv", "unreadable")]


def test_half_written_pulses_are_not_read(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv")
    put(tmp_path, 1, pulses=False)
    for k in range(1, 5):
        (tmp_path / "1.pulses.csv").write_text("".join(f"{time:.4f}\n" for time in times_of(1)[: 3 * k]))
        assert rig.run(1.0) == []
    rig.run(4.0)
    assert seen(rig.items) == [("1.csv", pytest.approx(times_of(1)))]


def test_cut_blocks_are_those_of_a_replay_whenever_the_process_died(tmp_path: Path) -> None:
    rig = Rig(tmp_path, pulses=PATTERN, format="csv", block_s=BLOCK_S)
    for number in (1, 2, 3):
        put(tmp_path, number)
        rig.run(5.0, most=1)
        rig.restart()
    rig.run(30.0)
    expected = replayed(tmp_path, block_s=BLOCK_S)
    assert len(rig.items) == 7
    check_same(rig.items, expected[:7])
    assert [len(times or "") for _, times in seen(rig.items)] == [5, 5, 4, 5, 5, 5, 5]


def test_pulses_that_fall_reject_their_file_by_both_names(tmp_path: Path) -> None:
    put(tmp_path, 1)
    (tmp_path / "1.pulses.csv").write_text("0.5\n0.1\n")
    (found,) = replayed(tmp_path, block_s="file")
    assert isinstance(found, Rejected)
    assert found.status == "wrong_rate"
    assert found.reason.startswith("1.csv: 1.pulses.csv: the times of pulses fall: pulse 2")


def test_a_replay_ignores_no_file_of_pulses(tmp_path: Path) -> None:
    put(tmp_path, 1)
    source = open_source(
        SourceSpec("s", f"folder:{tmp_path}", rate=RATE, channels=CHANNELS, pulses=PATTERN, format="csv")
    )
    assert isinstance(source, Recording)
    assert (len(source), source.ignored()) == (1, {})


def test_archives_have_no_files_beside_files(tmp_path: Path) -> None:
    path = tar_file(tmp_path / "x.tar", [("1.csv", csv_bytes(noise(COUNT, 1)))])
    with pytest.raises(SourceError, match="archives have no files beside"):
        open_source(SourceSpec("s", str(path), rate=RATE, channels=CHANNELS, pulses=PATTERN))
