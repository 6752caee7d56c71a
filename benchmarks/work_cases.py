"""Every command that shares its work, small enough for a second or two, and what its result holds, without dates."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import cluster_cases
from monitor.records.store import Store
from streams.block import STANDARD_GRAVITY
from tests.models.identify.cases import CONDITIONS, simulated_trials
from tests.oracles.lives import life
from tests.support.small_machine import BLOCK, small_machine

_RUNS = 9
"""Runs of a score or a batch: below eight, a score stays in one process."""
_RECORDINGS = 4
_BLOCKS = 40
_IDENTIFIED = """
[[bearing]]
name = "test"
designation = "1205 ETN9"
[[source]]
name = "logger"
block_s = 1
rate_hz = 25600
[[channel]]
name = "casing"
source = "logger"
column = 1
unit = "g"
bearing = "test"
rms_band_hz = [0, 9500]
track = true
"""
_DATED = frozenset({"seconds", "cpu_seconds", "blocks_per_second", "cluster", "out", "records"})
"""Keys of an answer that differ from run to run."""
_DATES = 'start_utc = "2026-03-01T12:00:00Z"\ninterval_s = 60.0'
_WHERE = ("--bearing", "1205 ETN9", "--load-newton", "4000", "--speed-hz", "40")


@dataclass(frozen=True)
class WorkCase(ABC):
    """A command with its inputs.

    Attributes:
        name: of the case.
        suffix: of its output, "" for a folder, None where it writes none.
    """

    name: str
    suffix: str | None

    @abstractmethod
    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command without its options of output and workers."""

    @abstractmethod
    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of the result, by its output and what ``--json`` said."""

    def prepare(self, folder: Path) -> None:
        """Write what the command reads."""
        folder.mkdir(parents=True, exist_ok=True)


class Map(WorkCase):
    """Rows of a map on threads."""

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        floors = ["--floor", "rough", "--floors", "16", "--interpolation-tolerance", "0"]
        return ["map", "build", *_WHERE, "--dphi-deg", "0:50:26", "--h-d-um", "0:32:17", *floors]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of all values."""
        return cluster_cases.Map("map", ".nc", "", 0).content(out)


class SlipMap(Map):
    """Groups of scenes with slip, in processes."""

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        slip = ["--slip-deg", "1", "--floors", "2", "--interpolation-tolerance", "0"]
        return ["map", "build", *_WHERE, "--dphi-deg", "0:50:11", "--h-d-um", "0:32:9", *slip]


class MapCheck(WorkCase):
    """Points of a map, which is built before; no output but the answer."""

    def prepare(self, folder: Path) -> None:
        """Build the map."""
        from models.machine.bearing import from_catalogue
        from models.maps.build import build_map
        from models.maps.file import save_map
        from models.maps.plan import MapPlan

        super().prepare(folder)
        plan = MapPlan(
            load=(4000.0,),
            speed=(40.0,),
            h_d=tuple(np.linspace(0.0, 32e-6, 9).tolist()),
            dphi_d=tuple(np.radians(np.linspace(0.0, 50.0, 11)).tolist()),
            bearing=from_catalogue("1205 ETN9"),
        )
        save_map(build_map(plan), folder / "map.nc")

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        return ["map", "check", str(folder / "map.nc"), "--points", "40"]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of the figures."""
        return _digest({key: value for key, value in answer.items() if key not in _DATED})


class Library(WorkCase):
    """Lives on threads."""

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        where = ["--bearing", "1205 ETN9", "--load-newton", "3800:4200", "--speed-hz", "39:41"]
        return ["library", "build", *where, "--runs", "20", "--interval-s", "1200", "--duration-min", "120:300"]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of all values."""
        return cluster_cases.Library("library", ".npz", "", 0).content(out)


class Identify(WorkCase):
    """Candidates of an identification, whose state is kept beside its output."""

    def prepare(self, folder: Path) -> None:
        """Write simulated tests with 1 % of noise, and a machine."""
        super().prepare(folder)
        rows = ["load_newton,speed_hz,defect_deg,h_d_um,fault,rms_g,a_star_g"]
        for condition, (rms, a_star) in zip(CONDITIONS, simulated_trials(0.01).mean.tolist(), strict=True):
            cells = (
                condition.load,
                condition.speed,
                math.degrees(condition.dphi_d),
                500,
                "outer",
                rms / STANDARD_GRAVITY,
                a_star / STANDARD_GRAVITY,
            )
            rows.append(",".join(map(str, cells)))
        (folder / "tests.csv").write_text("\n".join(rows) + "\n")
        (folder / "rig-machine.toml").write_text(_IDENTIFIED)

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        where = [str(folder / "tests.csv"), "--config", str(folder / "rig-machine.toml")]
        return ["identify", *where, "--free", "m_r_kg", "--seed", "4"]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of the table and of the draws."""
        files = [out, out.with_suffix(".posterior.csv")]
        return hashlib.sha256(b"\0".join(path.read_bytes() for path in files if path.exists())).hexdigest()


class Replays(WorkCase):
    """Recordings, each replayed in a process."""

    def prepare(self, folder: Path) -> None:
        """Write recordings of noise that grows."""
        super().prepare(folder)
        (folder / "m.toml").write_text(small_machine(source=_DATES))
        for number in range(_RECORDINGS):
            place = folder / f"recording-{number}"
            place.mkdir(exist_ok=True)
            rng = np.random.default_rng(number)
            for block in range(_BLOCKS):
                samples = (1.0 + block / _BLOCKS) * rng.standard_normal(BLOCK)
                np.save(place / f"b{block:03}.npy", samples.astype(np.float32))

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        places = [str(folder / f"recording-{number}") for number in range(_RECORDINGS)]
        return ["replay", *places, "--config", str(folder / "m.toml")]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of all records, and of which files there are."""
        names = sorted(path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file())
        found: list[Any] = [[name for name in names if not name.endswith(("-wal", "-shm"))]]
        for number in range(_RECORDINGS):
            with Store.open(out / f"recording-{number}" / "state.db", read_only=True) as store:
                found += [store.check(), *map(repr, store.records())]
        return _digest(found)


class Reports(WorkCase):
    """Pages of runs, each made in a process."""

    def prepare(self, folder: Path) -> None:
        """Write stores of simulated lives."""
        super().prepare(folder)
        for number in range(_RUNS):
            place = folder / "runs" / f"run-{number}"
            place.mkdir(parents=True, exist_ok=True)
            records = life(150, start=1.7e9, onset=90 + number, learn=40, seed=number)
            with Store.open(place / "state.db", machine=f"m-{number}") as store:
                store.commit_many([(record, {}) for record in records])

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        return ["report", "--batch", str(folder / "runs")]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of all tables and summaries, and of which files there are."""
        found: list[Any] = []
        for path in sorted(path for path in out.rglob("*") if path.is_file()):
            found.append(path.relative_to(out).as_posix())
            if path.suffix == ".csv":
                found.append(path.read_text())
            elif path.name == "run.json":
                found.append(json.loads(path.read_text())["runs"])
        return _digest(found)


class Scores(Reports):
    """Scores of runs; no output but the answer."""

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        places = [str(folder / "runs" / f"run-{number}") for number in range(_RUNS)]
        ends = ["--end-utc", "2023-11-16T00:00:00Z"] * _RUNS
        return ["score", *places, *ends]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of the scores."""
        return _digest({key: value for key, value in answer.items() if key not in _DATED})


class Archive(Replays):
    """Recordings of two machines into an archive of daily files."""

    def prepare(self, folder: Path) -> None:
        """Write recordings and a manifest."""
        super().prepare(folder)
        lines = [f"machine-{number % 2},m.toml,recording-{number}" for number in range(_RECORDINGS)]
        (folder / "manifest.csv").write_text("\n".join(["machine,config,recording", *lines]) + "\n")

    def arguments(self, folder: Path) -> list[str]:
        """Return the arguments of the command."""
        return ["archive", "replay", str(folder / "manifest.csv")]

    def content(self, out: Path, answer: dict[str, Any]) -> str:
        """Return a digest of all records, and of which files there are."""
        import netCDF4

        found: list[Any] = []
        for path in sorted(path for path in out.rglob("*") if path.is_file()):
            found.append(path.relative_to(out).as_posix())
            if path.suffix == ".nc":
                with netCDF4.Dataset(path) as file:
                    file.set_auto_maskandscale(False)
                    for name, variable in file.variables.items():
                        values = np.asarray(variable[...])
                        found.append((name, hashlib.sha256(_bytes(values)).hexdigest()))
        return _digest(found)


def _bytes(values: np.ndarray[Any, Any]) -> bytes:
    return repr(values.tolist()).encode() if values.dtype.kind == "O" else values.tobytes()


def _digest(values: object) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


CASES: tuple[WorkCase, ...] = (
    Map("map build, threads", ".nc"),
    SlipMap("map build, processes", ".nc"),
    MapCheck("map check", None),
    Library("library build", ".npz"),
    Identify("identify", ".toml"),
    Replays("replay A B ...", ""),
    Reports("report --batch", ""),
    Scores("score", None),
    Archive("archive replay", ""),
)
