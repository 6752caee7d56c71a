"""A replay meets every file that a watched folder meets, with the same name and verdict; others are ignored alike."""

from __future__ import annotations

import errno
import gzip
import json
import os
import random
import shutil
import socket
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from streams.open import open_source
from streams.recording.source import Recording
from streams.types.block import Block, Rejected
from streams.types.source import MAX_IGNORED_NAMES, Backlog
from tests.streams.folders import RATE, Rig, csv_bytes, noise
from tests.support.effort import effort_count

COUNT = 200
"""Samples of a file: a block, where files are cut."""

WAITS_S = 700.0
"""Longer than a watched folder waits for a file without bytes."""


def put(folder: Path, name: str | bytes, seed: int = 1) -> bytes:
    path = os.fsencode(folder) + b"/" + os.fsencode(name)
    Path(os.fsdecode(path)).write_bytes(csv_bytes(noise(COUNT, seed)))
    return path


@dataclass(frozen=True)
class Kind:
    """A kind of file: how it is made, the verdict of each file by its printable name, and the files ignored."""

    make: Callable[[Path], object]
    verdicts: dict[str, str]
    ignored: tuple[str, ...] = ()


def many(*makers: Callable[[Path], object]) -> Callable[[Path], object]:
    return lambda folder: [make(folder) for make in makers]


def named(name: str | bytes, seed: int) -> Callable[[Path], object]:
    return lambda folder: put(folder, name, seed)


def below(name: str, seed: int) -> Callable[[Path], object]:
    def make(folder: Path) -> None:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        put(folder, name, seed)

    return make


def special(folder: Path) -> None:
    os.mkfifo(folder / "pipe.csv")
    here = Path.cwd()
    os.chdir(folder)  # The path of a socket has at most 108 bytes.
    try:
        with socket.socket(socket.AF_UNIX) as end:
            end.bind("socket.csv")
    finally:
        os.chdir(here)


def links(folder: Path) -> None:
    outside = folder.parent / "outside.csv"
    outside.write_bytes(csv_bytes(noise(COUNT, 90)))
    (folder / "link_out.csv").symlink_to(outside)
    (folder / "link_in.csv").symlink_to(folder / "a.csv")
    (folder / "link_to_nothing.csv").symlink_to(folder / "gone.csv")
    (folder / "link_to_folder.csv").symlink_to(folder.parent, target_is_directory=True)
    (folder / "link_to_folder").symlink_to(folder.parent, target_is_directory=True)


def copies(folder: Path) -> None:
    put(folder, "c1.csv", 20)
    for name in ("c2.csv", "c3.csv"):
        shutil.copy(folder / "c1.csv", folder / name)
    os.link(folder / "c1.csv", folder / "c4.csv")


def dead(folder: Path) -> None:
    for name in ("dead1.csv", "dead2.csv"):
        (folder / name).write_bytes(csv_bytes(np.zeros(COUNT)))


def sidecars(folder: Path) -> None:
    put(folder, "s.csv", 30)
    (folder / "s.csv.json").write_text(json.dumps({"speed_hz": 30}))
    (folder / "t.csv.json").write_text("{}")


def others(folder: Path) -> None:
    for name in ("notes.md", "photo.JPG", "more.npy", "archive.tar.gz"):
        (folder / name).write_bytes(b"x" * 50)
    (folder / os.fsdecode(b"\xfcber.md")).write_bytes(b"")


KINDS = {
    "plain": Kind(named("b.csv", 2), {"b.csv": "accepted"}),
    "latin-1 name": Kind(named(b"Pr\xfcfstand.csv", 3), {"Pr\\xfcfstand.csv": "accepted"}),
    "utf-8 name": Kind(named("Prüfstand.csv", 4), {"Prüfstand.csv": "accepted"}),
    "name of control characters": Kind(named("a\n\x1b[2J.csv", 5), {"a\\u000a\\u001b[2J.csv": "accepted"}),
    "name with a backslash": Kind(named("a\\b.csv", 6), {"a\\\\b.csv": "accepted"}),
    "latin-1 name, bad content": Kind(
        lambda folder: Path(os.fsdecode(os.fsencode(folder) + b"/\xe4.csv")).write_bytes(b"\0\1\2"),
        {"\\xe4.csv": "unreadable"},
    ),
    "empty": Kind(lambda folder: (folder / "empty.csv").write_bytes(b""), {"empty.csv": "empty"}),
    "locked": Kind(named("locked.csv", 7), {"locked.csv": "unreadable"}),
    "links": Kind(
        many(named("a.csv", 1), links),
        {"a.csv": "accepted"} | {f"link_{what}.csv": "refused" for what in ("out", "in", "to_nothing", "to_folder")},
        ("link_to_folder",),
    ),
    "pipe and socket": Kind(special, {"pipe.csv": "refused", "socket.csv": "refused"}),
    "hidden and temporary": Kind(
        many(*(named(name, 8) for name in (".h.csv", "~h.csv", "h.csv.tmp", "h.csv.PART", "h.csv.crdownload"))), {}
    ),
    "folders": Kind(
        many(below("sub/deep/x.csv", 9), below(".sub/x.csv", 10), below("sub.tmp/x.csv", 11), below("f.csv/x.csv", 12)),
        {"sub/deep/x.csv": "accepted", "f.csv/x.csv": "accepted"},
    ),
    "copies": Kind(copies, {"c1.csv": "accepted"} | {f"c{number}.csv": "duplicate" for number in (2, 3, 4)}),
    "copies of a dead sensor": Kind(dead, {"dead1.csv": "accepted", "dead2.csv": "accepted"}),
    "copies of what cannot be read": Kind(
        lambda folder: [(folder / name).write_bytes(b"\0\0") for name in ("u1.csv", "u2.csv")],
        {"u1.csv": "unreadable", "u2.csv": "unreadable"},
    ),
    "side-cars": Kind(sidecars, {"s.csv": "accepted"}, ("t.csv.json",)),
    "of another format": Kind(others, {}, ("archive.tar.gz", "more.npy", "notes.md", "photo.JPG", "\\xfcber.md")),
    "another case of the ending": Kind(named("UPPER.CSV", 13), {"UPPER.CSV": "accepted"}),
    "compressed": Kind(
        lambda folder: (folder / "z.csv.gz").write_bytes(gzip.compress(csv_bytes(noise(COUNT, 14)))),
        {"z.csv.gz": "accepted"},
    ),
}


@pytest.fixture(autouse=True)
def _locked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refuse to open ``locked.csv``, also to the superuser."""
    opened = os.open

    def guarded(path: Any, *arguments: Any, **options: Any) -> int:
        if str(path).endswith("locked.csv"):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
        return opened(path, *arguments, **options)

    monkeypatch.setattr(os, "open", guarded)


@dataclass(frozen=True)
class Met:
    """What became of the files: verdicts and reasons by name, files ignored, and the counts."""

    verdicts: dict[str, str]
    reasons: dict[str, str]
    ignored: dict[str, str]
    counts: Backlog


def met(items: list[Block | Rejected], ignored: Any, counts: Backlog) -> Met:
    verdicts = {item.name: item.status if isinstance(item, Rejected) else "accepted" for item in items}
    assert len(verdicts) == len(items)
    for item in items:
        item.name.encode()
    reasons = {item.name: item.reason for item in items if isinstance(item, Rejected)}
    for name, reason in reasons.items():
        assert name in reason
        reason.encode()
    return Met(verdicts, reasons, dict(ignored), counts)


def live(folder: Path, **spec: Any) -> Met:
    # A file is given up after 600 s; scans every ten seconds of them, not every one, find the same.
    rig = Rig(folder, **{"settle_s": 20.0, **spec})
    items = rig.run(WAITS_S)
    found = met(items, rig.source.ignored(), rig.source.backlog())
    rig.source.close()
    return found


def replayed(folder: Path, **spec: Any) -> Met:
    source = open_source(Rig(folder, **spec).spec)
    assert isinstance(source, Recording)
    items = list(source)
    assert len(source) == len(items)
    return met(items, source.ignored(), source.files())


@pytest.fixture(params=["file", COUNT / RATE], ids=["files", "cut"])
def block_s(request: pytest.FixtureRequest) -> Iterator[Any]:
    return request.param


def check(folder: Path, kinds: list[Kind], **spec: Any) -> None:
    expected = {name: verdict for kind in kinds for name, verdict in kind.verdicts.items()}
    ignored = {name for kind in kinds for name in kind.ignored}
    followed, read = live(folder, **spec), replayed(folder, **spec)
    assert read.verdicts == expected
    assert followed.verdicts == expected
    assert read.reasons == followed.reasons
    assert read.ignored == followed.ignored
    assert set(read.ignored) == ignored
    assert all("csv" in reason for reason in read.ignored.values())
    for counts in (read.counts, followed.counts):
        accepted = sum(verdict == "accepted" for verdict in expected.values())
        assert counts.offered == len(expected) + len(ignored)
        assert counts.offered == counts.accepted + counts.rejected + counts.ignored + counts.pending
        assert (counts.accepted, counts.ignored, counts.pending) == (accepted, len(ignored), 0)


@pytest.mark.parametrize("name", KINDS)
def test_a_kind_of_file_is_the_same_live_and_replayed(name: str, block_s: Any, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    put(folder, "0.csv", 100)
    KINDS[name].make(folder)
    check(folder, [Kind(lambda folder: None, {"0.csv": "accepted"}), KINDS[name]], block_s=block_s)


@pytest.mark.parametrize("seed", range(effort_count(quick=4, full=100)))
def test_so_is_any_mix_of_them(seed: int, block_s: Any, tmp_path: Path) -> None:
    generator = random.Random(seed)
    kinds = [kind for kind in KINDS.values() if generator.random() < 0.6]
    folder = tmp_path / "in"
    folder.mkdir()
    put(folder, "0.csv", 100)
    for kind in kinds:
        kind.make(folder)
    check(folder, [Kind(lambda folder: None, {"0.csv": "accepted"}), *kinds], block_s=block_s)


def test_the_first_file_with_content_decides_the_format_in_both(tmp_path: Path) -> None:
    (tmp_path / "0.npy").write_bytes(b"")
    (tmp_path / "00.npy").symlink_to("nothing")
    for name in ("1.log", "2.log", "3.log", "4.log"):
        (tmp_path / name).write_bytes(b"not numbers\n")
    put(tmp_path, "5.csv", 1)
    (tmp_path / "6.wav").write_bytes(b"RIFF")
    for found in (live(tmp_path), replayed(tmp_path)):
        assert found.verdicts == {"5.csv": "accepted"}
        assert set(found.ignored) == {"0.npy", "00.npy", "1.log", "2.log", "3.log", "4.log", "6.wav"}


def test_files_of_which_none_has_content_have_a_verdict_in_both(tmp_path: Path) -> None:
    (tmp_path / "0.npy").write_bytes(b"")
    (tmp_path / "1.npy").symlink_to("nothing")
    for found in (live(tmp_path), replayed(tmp_path)):
        assert found.verdicts == {"0.npy": "empty", "1.npy": "refused"}


def test_names_of_ignored_files_are_bounded_and_their_count_is_not(tmp_path: Path) -> None:
    put(tmp_path, "a.csv", 1)
    number = MAX_IGNORED_NAMES + 20
    for index in range(number):
        (tmp_path / f"{index}.md").touch()
    for found in (live(tmp_path), replayed(tmp_path)):
        assert list(found.ignored) == [f"{index}.md" for index in range(MAX_IGNORED_NAMES)]
        assert (found.counts.offered, found.counts.ignored) == (number + 1, number)


def test_an_ignored_file_that_is_removed_is_no_longer_counted(tmp_path: Path) -> None:
    put(tmp_path, "a.csv", 1)
    other = tmp_path / "b.md"
    other.touch()
    rig = Rig(tmp_path)
    rig.run(10.0)
    assert (set(rig.source.ignored()), rig.source.backlog().offered) == ({"b.md"}, 2)
    other.unlink()
    rig.run(10.0)
    assert (rig.source.ignored(), rig.source.backlog().offered) == ({}, 1)


def test_a_copy_is_one_too_while_its_original_waits_for_more_samples(tmp_path: Path) -> None:
    rig = Rig(tmp_path, block_s=0.6 * COUNT / RATE)
    put(tmp_path, "a.csv", 1)
    assert len(rig.run(10.0)) == 1
    assert rig.source.backlog().pending == 1
    shutil.copy(tmp_path / "a.csv", tmp_path / "b.csv")
    (item,) = rig.run(10.0)
    assert isinstance(item, Rejected)
    assert (item.name, item.status, item.reason) == ("b.csv", "duplicate", "b.csv: holds the same bytes as a.csv")
    rig.restart()
    put(tmp_path, "0.csv", 1)
    found = [(item.name, getattr(item, "status", "")) for item in rig.run(WAITS_S)]
    assert found == [("0.csv", "duplicate"), ("a.csv[0.12 s]", "short")]


def test_a_copy_with_other_numbers_takes_no_number(tmp_path: Path, block_s: Any) -> None:
    for name, seed in (("a.csv", 1), ("b.csv", 1), ("c.csv", 2), ("d.csv", 2), ("e.csv", 3)):
        put(tmp_path, name, seed)
    items = list(open_source(Rig(tmp_path, block_s=block_s).spec))
    assert [(item.name, item.sequence) for item in items if isinstance(item, Block)] == [
        ("a.csv", 1),
        ("c.csv", 2),
        ("e.csv", 3),
    ]
    copies = [(item.name, item.sequence) for item in items if isinstance(item, Rejected)]
    assert copies == [("b.csv", 1), ("d.csv", 2)]
    assert [item.sequence for item in Rig(tmp_path, block_s=block_s).run(10.0) if isinstance(item, Block)] == [1, 2, 3]


def test_numbers_that_come_twice_are_judged_alike(tmp_path: Path) -> None:
    lines = b"".join(b"9,39,39,%.3f,0.%03d,0.5\n" % (index / 0.0256, index % 997) for index in range(2560))
    (tmp_path / "acc_00001.csv").write_bytes(lines)
    (tmp_path / "acc_00001.csv.gz").write_bytes(gzip.compress(lines))
    (tmp_path / "acc_00002.csv").write_bytes(lines.replace(b"0.5", b"0.6"))
    for found in (live(tmp_path, rate=None, channels=()), replayed(tmp_path, rate=None, channels=())):
        assert found.verdicts == {
            "acc_00001.csv": "accepted",
            "acc_00001.csv.gz": "changed",
            "acc_00002.csv": "accepted",
        }


def test_the_format_stays_over_a_restart(tmp_path: Path) -> None:
    rig = Rig(tmp_path)
    put(tmp_path, "b.csv", 1)
    rig.run(10.0)
    rig.restart()
    np.save(tmp_path / "a.npy", noise(COUNT, 2))
    assert rig.run(10.0) == []
    assert set(rig.source.ignored()) == {"a.npy"}
    put(tmp_path, "c.csv", 3)
    assert [(item.name, type(item)) for item in rig.run(10.0)] == [("c.csv", Block)]
