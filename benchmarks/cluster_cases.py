"""Commands that a cluster runs, small enough for two cores, and what their results hold: a digest without dates."""

from __future__ import annotations

import argparse
import datetime
import hashlib
import os
import statistics
import sys
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from netCDF4 import Dataset

from models.work.codec import decode
from tests.support.small_machine import small_machine

_DATED = frozenset({"created"})
"""Attributes of a map that differ from run to run."""
_RATE_HZ = 25_600
_BLOCKS = 40
_RECORDINGS = 24
_BEGIN = datetime.datetime(2024, 3, 1, 12, tzinfo=datetime.UTC)
_DETECTION = "[detect]\nrun_in_blocks = 1\nlearn_blocks = 10\npersist_blocks = 2"
_CHUNK_S = 0.3
_PROGRAM = f"""
import models.work.task
import monitor.fleet.replaying
models.work.task.CHUNK_SECONDS = monitor.fleet.replaying.TASK_SECONDS = {_CHUNK_S}
from monitor.cli import main
main()
"""
"""Short chunks, so that small cases have many; the caller alone cuts them."""


def command(arguments: list[str]) -> list[str]:
    """Return the command line of ``spallwatch`` of this tree."""
    return [sys.executable, "-c", _PROGRAM, *arguments, "--json", "--quiet"]


def chunk_files(chunks: Path) -> list[Path]:
    """Return the files of the chunks that are done, without those that are being written."""
    return [path for path in chunks.glob("chunks/*/*") if path.name.isalnum()]


@dataclass(frozen=True)
class Case(ABC):
    """A command.

    Attributes:
        name: of the case.
        suffix: of its output.
        memory: limit of a worker.
        size: rows, lives or recordings.
    """

    name: str
    suffix: str
    memory: str
    size: int

    @abstractmethod
    def arguments(self, folder: Path, out: Path, *options: str) -> list[str]:
        """Return the arguments of the command, which writes to ``out``."""

    @abstractmethod
    def content(self, out: Path) -> str:
        """Return a digest of all values of the result."""

    def prepare(self, folder: Path) -> None:
        """Write what the command reads."""
        folder.mkdir(exist_ok=True)

    def chunk_seconds(self, chunks: Path) -> float:
        """Return the median of the seconds of work of the chunks in a folder."""
        return statistics.median(decode(path.read_bytes()).seconds for path in chunk_files(chunks))


class Map(Case):
    """A map of one load and speed: a row along the extent a task."""

    def arguments(self, folder: Path, out: Path, *options: str) -> list[str]:
        """Return the arguments of the command, which writes to ``out``."""
        floors = ["--floor", "rough", "--floors", "20", "--interpolation-tolerance", "0"]
        axes = ["--dphi-deg", "0:50:51", "--h-d-um", f"0:32:{self.size}", *floors]
        where = ["--bearing", "1205 ETN9", "--load-newton", "4000", "--speed-hz", "40"]
        return ["map", "build", *where, *axes, *options, "--out", str(out)]

    def content(self, out: Path) -> str:
        """Return a digest of all values of the result."""
        digest = hashlib.sha256()
        with Dataset(out) as dataset:
            for name in sorted(dataset.variables):
                _add(digest, name, np.ma.getdata(dataset[name][...]))
            for name in sorted(set(dataset.ncattrs()) - _DATED):
                _add(digest, name, np.asarray(dataset.getncattr(name)))
        return digest.hexdigest()


class Library(Case):
    """A library of lives: a life a task."""

    def arguments(self, folder: Path, out: Path, *options: str) -> list[str]:
        """Return the arguments of the command, which writes to ``out``."""
        where = ["--bearing", "1205 ETN9", "--load-newton", "3800:4200", "--speed-hz", "39:41"]
        return ["library", "build", *where, "--runs", str(self.size), *options, "--out", str(out)]

    def content(self, out: Path) -> str:
        """Return a digest of all values of the result."""
        digest = hashlib.sha256()
        with np.load(out) as arrays:
            for name in sorted(arrays.files):
                _add(digest, name, arrays[name])
        return digest.hexdigest()


class Archive(Case):
    """Recordings of three machines, into one Zarr store: a recording a task."""

    def prepare(self, folder: Path) -> None:
        """Write recordings, a configuration and a manifest."""
        super().prepare(folder)
        rng = np.random.default_rng(23)
        lines = ["machine,config,recording"]
        (folder / "m.toml").write_text(small_machine(rate=_RATE_HZ, block_s="1.0", channel="", more=_DETECTION))
        for number in range(self.size):
            growth = np.repeat(np.linspace(1.0, 3.0, _BLOCKS), _RATE_HZ)
            path = folder / f"recording-{number:03}.npy"
            np.save(path, (growth * rng.standard_normal(len(growth))).astype(np.float32))
            moment = (_BEGIN + datetime.timedelta(hours=number)).timestamp()
            os.utime(path, (moment, moment))
            lines.append(f"machine-{number % 3},m.toml,{path.name}")
        (folder / "manifest.csv").write_text("\n".join(lines) + "\n")

    def arguments(self, folder: Path, out: Path, *options: str) -> list[str]:
        """Return the arguments of the command, which writes to ``out``."""
        manifest = str(folder / "manifest.csv")
        return ["archive", "replay", manifest, "--records", "zarr", *options, "--out", str(out)]

    def content(self, out: Path) -> str:
        """Return a digest of all files of the store, which hold no time of writing."""
        digest = hashlib.sha256()
        store = out / "records.zarr"
        for path in sorted(path for path in store.rglob("*") if path.is_file()):
            digest.update(f"{path.relative_to(store).as_posix()}\n".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def _add(digest: Any, name: str, values: np.ndarray[Any, Any]) -> None:
    """Add an array to a digest, bit for bit; strings as they are printed."""
    data = values.tobytes() if values.dtype.kind in "biufcSU" else repr(values.tolist()).encode()
    digest.update(f"{name}\n{values.dtype}\n{values.shape}\n".encode())
    digest.update(data)


CASES: tuple[Case, ...] = (
    Map("map", ".nc", "1500MB", 33),
    Library("library", ".npz", "1500MB", 40),
    Archive("archive", "", "1500MB", _RECORDINGS),
)


def chosen_cases(description: str) -> tuple[Path | None, list[Case]]:
    """Return the file for the figures and the cases that the command line asks for, by default all."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--only", choices=[case.name for case in CASES], action="append", help="run these cases alone")
    options = parser.parse_args()
    return options.json, [case for case in CASES if not options.only or case.name in options.only]
