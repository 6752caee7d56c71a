"""A recording that is read in parts: from any item on, the rest is that of one pass, and files behind stay closed."""

from __future__ import annotations

import tempfile
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.work.codec import decode, encode
from streams.files import container as files
from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block, Rejected
from streams.types.large import Data
from streams.types.spec import ChannelSpec, SourceError, SourceSpec

RATE = 100.0
KINDS = ("samples", "samples", "samples", "constant", "copy", "damaged", "empty", "other format")
DATED = {"time_from": "name", "time_name": "%Y%m%d-%H%M%S"}
SETTINGS: tuple[dict[str, Any], ...] = (
    {"block_s": "file", **DATED},
    {"block_s": "file", "interval": 3600.0},
    # Files of 4 to 16 s continue each other or leave gaps; blocks of 5 s begin in one and end in another.
    {"block_s": 5.0, **DATED},
    {"block_s": 5.0},
)


def write(folder: Path, listed: list[tuple[str, int]]) -> None:
    """Write files of some kinds and lengths (s), each dated by its name from the end of the one before."""
    rng = np.random.default_rng(len(listed))
    second, before = 0, b""
    for kind, length in listed:
        name = f"20240301-{second // 3600:02}{second // 60 % 60:02}{second % 60:02}"
        # A length of 16 s leaves a gap.
        second += length if length < 16 else length + 40
        path = folder / f"{name}.npy"
        if kind == "other format":
            path.with_suffix(".rtf").write_text("no samples")
        elif kind in ("damaged", "empty") or (kind == "copy" and not before):
            path.write_bytes(b"" if kind == "empty" else b"no numbers")
        elif kind == "copy":
            path.write_bytes(before)
        else:
            values = rng.standard_normal(int(length * RATE)) if kind == "samples" else np.ones(int(length * RATE))
            np.save(path, values.astype(np.float32))
            before = path.read_bytes()


def opened(folder: Path, settings: dict[str, Any], state: bytes | None = None) -> Recording:
    channels = (ChannelSpec("a", column=1, unit="g"),)
    spec = SourceSpec("s", f"folder:{folder}", rate=RATE, channels=channels, **settings)
    source = open_source(spec, begin=None if state is None else decode(state))
    assert isinstance(source, Recording)
    return source


def seen(item: Block | Rejected) -> tuple[Any, ...]:
    if isinstance(item, Rejected):
        return tuple(getattr(item, field.name) for field in fields(item))
    own = [field.name for field in fields(item) if field.name not in ("samples", "pulses")]
    values = {name: getattr(item, name) for name in own}
    pulses = None if item.pulses is None else (item.pulses.times.tobytes(), item.pulses.per_revolution)
    return (*values.values(), pulses, item.samples.dtype.str, item.samples.shape, item.samples.tobytes())


def is_repetition(item: Block | Rejected) -> bool:
    return isinstance(item, Rejected) and item.is_repetition


def in_parts(folder: Path, settings: dict[str, Any], length: int) -> tuple[list[Block | Rejected], Recording]:
    """Read parts of some items each, every one from the state that the one before left as bytes."""
    taken: list[Block | Rejected] = []
    state: bytes | None = None
    while True:
        source = opened(folder, settings, state)
        items = iter(source)
        repeated = [next(items) for item in taken if is_repetition(item)]
        assert list(map(seen, repeated)) == [seen(item) for item in taken if is_repetition(item)]
        new = [item for _, item in zip(range(length), items, strict=False)]
        taken += new
        if len(new) < length:
            return taken, source
        state = encode(source.state())


@given(
    st.lists(st.tuples(st.sampled_from(KINDS), st.sampled_from((4, 7, 16))), min_size=1, max_size=8),
    st.sampled_from(SETTINGS),
    st.integers(1, 4),
)
def test_parts_give_what_one_pass_gives(listed, settings, length):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Without a file that can be recognised there is no recording.
        write(folder, [("samples", 7), *listed])
        whole = opened(folder, settings)
        wanted = list(map(seen, whole))
        found, last = in_parts(folder, settings, length)
        assert list(map(seen, found)) == wanted
        assert last.files() == whole.files()
        assert (last.dating, last.remarks) == (whole.dating, whole.remarks)
        assert len(whole) == len(wanted)
        assert [whole.has_blocks(count) for count in (len(wanted), len(wanted) + 1)] == [True, False]


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the files that are opened."""
    found: list[str] = []
    read = files.read_regular

    def noted(root: Path, path: str) -> Data:
        found.append(path)
        return read(root, path)

    monkeypatch.setattr(files, "read_regular", noted)
    return found


@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_files_behind_are_not_opened(tmp_path, reads, settings):
    write(tmp_path, [("samples", 7)] * 20)
    source = opened(tmp_path, settings)
    for _ in zip(range(12), source, strict=False):
        pass
    state = source.state()
    assert state is not None
    reads.clear()
    assert sum(1 for _ in opened(tmp_path, settings, encode(state)))
    behind = sorted(path.name for path in tmp_path.iterdir())[: state.files]
    assert len(behind) >= 6
    assert len(reads) == 20 - len(behind)
    assert not set(behind) & set(reads)


def test_other_files_than_those_that_were_read_are_refused(tmp_path):
    write(tmp_path, [("samples", 7)] * 4)
    source = opened(tmp_path, SETTINGS[0])
    for _ in zip(range(3), source, strict=False):
        pass
    state = encode(source.state())
    # A file that comes behind is no harm.
    np.save(tmp_path / "20240302-000000.npy", np.arange(700, dtype=np.float32))
    assert [item.sequence for item in opened(tmp_path, SETTINGS[0], state)] == [4, 5]
    np.save(tmp_path / "20240229-000000.npy", np.arange(700, dtype=np.float32))
    with pytest.raises(SourceError, match="the names of its first 3 files are others than when they were read"):
        list(opened(tmp_path, SETTINGS[0], state))


def test_a_state_of_another_version_reads_from_the_beginning(tmp_path):
    write(tmp_path, [("samples", 7)] * 3)
    source = opened(tmp_path, SETTINGS[0])
    next(iter(source))
    state = source.state()
    object.__setattr__(state, "version", 0)
    assert [item.sequence for item in opened(tmp_path, SETTINGS[0], encode(state))] == [1, 2, 3]
