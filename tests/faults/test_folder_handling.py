"""Hands that copy, move, rename, touch, replace and delete files, and a reader that dies: each content counts once."""

from __future__ import annotations

import os
import random
import shutil
from collections import Counter
from pathlib import Path

import pytest

from streams.files.container import content_hash
from streams.types.block import Block
from tests.streams.folders import Rig, csv_bytes, noise
from tests.support.effort import effort_count


class Hands:
    """Does one thing after the other to the files of a folder."""

    def __init__(self, root: Path, generator: random.Random) -> None:
        self.root = root
        self.generator = generator
        self.contents = 0

    def files(self) -> list[Path]:
        return sorted(path for path in self.root.rglob("*.csv") if path.is_file())

    def fresh(self) -> bytes:
        self.contents += 1
        return csv_bytes(noise(self.generator.randrange(5, 1500), self.contents))

    def name(self) -> Path:
        folder = self.root / self.generator.choice(["", "one", "two"])
        folder.mkdir(exist_ok=True)
        return folder / f"{self.generator.choice('abcdef')}{self.generator.randrange(30)}.csv"

    def act(self) -> None:
        kind = self.generator.choice(["write"] * 4 + ["rename", "copy", "touch", "replace", "delete", "swap", "half"])
        files = self.files()
        if kind == "write" or not files:
            self.name().write_bytes(self.fresh())
            return
        path = self.generator.choice(files)
        match kind:
            case "rename":
                path.rename(self.name())
            case "copy":
                target = self.name()
                if target != path:
                    shutil.copy(path, target)
            case "touch":
                os.utime(path, (self.generator.randrange(10**9), self.generator.randrange(10**9)))
            case "replace":
                temporary = path.with_suffix(".tmp")
                temporary.write_bytes(self.fresh())
                temporary.rename(path)
            case "delete":
                path.unlink()
            case "swap":
                other = self.generator.choice(files)
                if other != path:
                    temporary = path.with_suffix(".tmp")
                    path.rename(temporary)
                    other.rename(path)
                    temporary.rename(other)
            case _:
                data = self.fresh()
                path.write_bytes(data[: len(data) // 2 // 8 * 8])
                path.write_bytes(data)


@pytest.mark.parametrize("seed", range(effort_count(quick=1, full=300)))
def test_each_content_is_accepted_once(tmp_path: Path, seed: int) -> None:
    generator = random.Random(seed)
    rig = Rig(tmp_path, format="csv", settle_s=1.0)
    hands = Hands(tmp_path, generator)
    settled: set[str] = set()
    for _ in range(effort_count(quick=20, full=40)):
        for _ in range(generator.choice([1, 1, 3, 12])):
            hands.act()
        rig.run(generator.choice([0.3, 2.0, 15.0]), most=generator.choice([None, None, 2]))
        if generator.random() < 0.2:
            rig.restart()
        if generator.random() < 0.2:
            rig.run(40.0)
            settled |= {content_hash(path.read_bytes()) for path in hands.files()}
    rig.run(1500.0)
    settled |= {content_hash(path.read_bytes()) for path in hands.files()}
    accepted = Counter(item.content_hash for item in rig.items if isinstance(item, Block))
    assert settled <= accepted.keys()
    assert max(accepted.values()) == 1
    assert rig.source.backlog().pending == 0
    ledger = rig.ledger.blocks("s")
    assert list(ledger) == list(range(1, len(ledger) + 1))
