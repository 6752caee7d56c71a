"""The cases that run to their end by themselves: replays, models and answers about histories."""

from __future__ import annotations

import csv
import html
import os
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.regression.machines import (
    BEGIN,
    BLOCK,
    CHANNEL,
    RATE,
    life,
    machine_text,
    save_csv,
    save_files,
    save_log,
    save_tdms,
    sound,
)
from benchmarks.regression.observe import Observation, of_json, of_netcdf, of_npz, of_store
from benchmarks.regression.trees import ROOT, Tree

LIFE_BLOCKS, LIFE_ONSET, LIFE_CUT = 72, 36, 56
"""Blocks of the life on which trackers are tried, where its damage begins, and where its store is cut."""
CALIBRATED = {"calibrated": "declared"}
"""Without the promise there is neither V_eq on an absolute scale nor a forecast."""


class SkippedError(Exception):
    """A case cannot be run on this machine; the message says why."""


@dataclass(frozen=True)
class Bench:
    """What a case is given.

    Attributes:
        tree: that is run.
        folder: for all that it writes.
        quick: whether long recordings are cut.
        kept: folder of the case's files that the present tree gets from the baseline.
    """

    tree: Tree
    folder: Path
    quick: bool
    kept: Path

    def call(self, *arguments: str | Path) -> dict[str, object]:
        """Run a command of the tree."""
        return self.tree.call(self.folder, *arguments)

    def write(self, text: str, name: str = "m.toml") -> Path:
        """Write a configuration and return its path."""
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def recording(self, name: str) -> Path:
        """Return a recording of the folder that SPALLWATCH_DATA names.

        Raises:
            SkippedError: it is not there.
        """
        path = Path(os.environ.get("SPALLWATCH_DATA", ROOT / "../shared/data")) / name
        if not path.exists():
            raise SkippedError(f"no {path}")
        return path.resolve()

    def replay(self, path: Path | str, config: Path, *options: str, out: str = "out") -> Observation:
        """Replay a recording; return what was printed, stored and published."""
        folder = self.folder / out
        printed = self.call("replay", path, "--config", config, "--out", folder, "--no-report", *options)
        return of_json(f"{out}/replay", printed) | outcome(out, folder / "state.db", folder / "records")


Case = Callable[[Bench], Observation]


def outcome(name: str, store: Path, records: Path) -> Observation:
    """Return what is stored and published."""
    return of_store(f"{name}/store", store) | of_netcdf(f"{name}/netcdf", records)


def demo(bench: Bench) -> Observation:
    """Run the demo; its map is built anew, and its library unless the tree ships it."""
    out, cache = bench.folder / "out", bench.folder / "cache" / "spallwatch"
    found = of_json("demo", bench.call("demo", "--out", out))
    found |= outcome("out", out / "state.db", out / "records") | of_netcdf("map", cache / "maps")
    shipped = bench.tree.root / "monitor" / "commands" / "demo_library.npz"
    for path in [shipped] if shipped.exists() else (cache / "libraries").glob("*.npz"):
        found |= of_npz("library", path)
    page = (out / "report.html").read_text(encoding="utf-8")
    bare = html.unescape(re.sub(r"<(style|script|svg).*?</\1>|<[^>]*>", "\n", page, flags=re.DOTALL))
    lines = [line.strip() for line in bare.splitlines() if line.strip() and not re.search(r"[0-9a-f]{12}|UTC", line)]
    return found | {"report/text": np.array(lines)}


def pronostia(run: str, file: str, config: str, quick_blocks: int) -> Case:
    """Return the case of a run to failure of the PRONOSTIA data."""

    def case(bench: Bench) -> Observation:
        limit = ["--limit", str(quick_blocks)] if bench.quick else []
        return bench.replay(bench.recording(f"femto/{file}"), ROOT / "examples" / f"{config}.toml", *limit)

    case.__name__ = f"pronostia_{run}"
    return case


def tdms(bench: Bench) -> Observation:
    """Replay a TDMS file of four channels."""
    names = ["acc_1", "acc_2", "acc_3", "acc_4"]
    save_tdms(bench.folder / "a.tdms", {name: life(48, 30 + 4 * i, i) for i, name in enumerate(names)})
    channels = [{"name": name, "key": f"run/{name}"} for name in names]
    config = bench.write(machine_text({"format": "tdms", "block_s": BLOCK / RATE, "range_g": 50}, *channels))
    return bench.replay(bench.folder / "a.tdms", config)


def csv_log(bench: Bench) -> Observation:
    """Replay a long dated text log of two channels, cut into blocks, with averaged spectra."""
    columns = {"x": life(60, 40, 1), "y": life(60, 61, 2)}
    save_csv(bench.folder / "log.csv", columns, BEGIN)
    channels = [{"name": name, "column": name, "average_blocks": 4} for name in columns]
    return bench.replay(bench.folder / "log.csv", bench.write(machine_text({"block_s": BLOCK / RATE}, *channels)))


LEVELS = (
    {"feature": "rms", "alert_sd": 6, "danger_g": 0.3, "on_delay_blocks": 2, "off_delay_blocks": 2},
    {"name": "held", "feature": "h_or", "alert_factor": 4.0, "on_delay_blocks": 1, "latch": True},
)


def alarms(bench: Bench) -> Observation:
    """Replay blocks that raise and clear alarms, with a dead sensor and files that cannot be read between them."""
    heights = [0.0] * 26 + [9.0] * 5 + [0.0] * 6 + [None] * 14 + [0.0] * 4 + [20.0] * 6 + [0.0] * 5
    save_files(bench.folder / "in", heights)
    for number in (30, 45, 46):
        (bench.folder / "in" / f"f{number:04d}.csv").write_text("x,y\nnone,of these\nis,a number\n", encoding="utf-8")
    channels = [{"name": name, "column": name} for name in ("x", "y")]
    source = {"block_s": "file", "format": "csv", "rate_hz": RATE}
    return bench.replay(bench.folder / "in", bench.write(machine_text(source, *channels, levels=LEVELS)))


def named(bench: Bench) -> Observation:
    """Replay seeded faults and healthy machines of public data sets: the names of the damaged parts."""
    folders = {"cwru_drive_end": "cwru", "cwru_fan_end": "cwru", "mfpt": "mfpt", "hit_sm": "hit_sm_mfs"}
    if not bench.quick:
        folders |= {"uestc": "uestc", "ims_test2": "ims_samples"}
    found: Observation = {}
    for config, folder in folders.items():
        found |= bench.replay(bench.recording(folder), ROOT / "examples" / f"{config}.toml", out=config)
    return found


def speed_estimated(bench: Bench) -> Observation:
    """Replay a machine whose speed is estimated, with an automatic band."""
    count, rate = 25600, 12800
    time = np.arange(count) / rate
    shaft = sum(np.cos(2 * np.pi * 40.3 * order * time) for order in range(1, 9))
    blocks = [sound(count, block, 4.0 * (block > 16), rate=rate) + 2.0 * shaft for block in range(1, 25)]
    np.save(bench.folder / "a.npy", np.concatenate(blocks).astype(np.float32))
    channel = {"name": "x", "column": 1, "band_hz": "auto", "rms_band_hz": [0, 5000]}
    operating = {"speed": "estimate", "speed_range_hz": [30, 50]}
    detect = {"learn_blocks": 12}
    text = machine_text({"block_s": count / rate, "rate_hz": rate}, channel, operating=operating, detect=detect)
    return bench.replay(bench.folder / "a.npy", bench.write(text))


def tracked(bench: Bench) -> Observation:
    """Build a small map and library; replay a life with each tracker; track, forecast and score its records."""
    found = build_map(bench) | _library(bench)
    answers = {
        "thesis": (("--map", "map.nc"), ()),
        "filter": (("--map", "map.nc"), ()),
        "library": (("--library", "library.npz"), ("--library", "library.npz")),
    }
    for method, (track, forecast) in answers.items():
        found |= bench.replay(*_life(bench, method), out=method)
        records = bench.folder / method / "records"
        for command, options in (("track", track), ("forecast", forecast)):
            if (command, method) == ("forecast", "filter"):
                continue
            named_files = [bench.folder / item if "." in item else item for item in options]
            printed = bench.call(command, records, "--method", method, *named_files)
            found |= of_json(f"{method}/{command}", printed)
        threshold = ("--end-utc", "2026-03-01T06:00:14Z", "--threshold-mm2", "0.05")
        scored = bench.call("score", bench.folder / method / "state.db", *threshold)
        found |= of_json(f"{method}/score", scored)
    return found


def histories(bench: Bench) -> Observation:
    """Track and forecast histories that are given as text."""
    found = build_map(bench)
    rng, time = np.random.default_rng(5), 300.0 * np.arange(60)
    rms = (0.3 + 0.5 * (time / time[-1]) ** 1.5) * np.exp(0.03 * rng.standard_normal(60))
    volume = (0.003 + 0.045 * (time / time[-1]) ** 2) * np.exp(0.05 * rng.standard_normal(60))
    for command, name, values, options in (
        ("track", "rms_g", rms, ("--map", bench.folder / "map.nc", "--other-load-newton", "4000", "--direct")),
        ("forecast", "v_eq_mm2", volume, ("--threshold-mm2", "0.05", "--threshold-mm2", "0.08")),
    ):
        path = bench.folder / f"{command}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            rows = zip(time.tolist(), values.tolist(), strict=True)
            csv.writer(file).writerows([("time_s", name), *rows])
        found |= of_json(command, bench.call(command, path, *options))
    return found


def models(bench: Bench) -> Observation:
    """Ask for scenes and bearings."""
    damage = ("--dphi-deg", "8", "--h-d-um", "10")
    questions: Sequence[tuple[str, ...]] = (
        ("simulate", *damage, "--tolerance", "1e-4"),
        ("simulate", *damage, "--floor", "rough", "--seed", "3", "--sensor", "mr", "--rms-band-hz", "0:5000"),
        ("simulate", *damage, "--fault", "inner", "--duration-s", "0.2", "--slip-deg", "1"),
        ("bearing", "--dphi-deg", "8"),
        ("bearing", "--bearing", "22207", "--clearance-um", "20"),
        ("check", "--config", str(ROOT / "examples" / "pronostia_1800rpm_4000n.toml")),
    )
    found: Observation = {}
    for number, question in enumerate(questions, 1):
        found |= of_json(f"{number} {question[0]}", bench.call(*question))
    return found


def store_migration(bench: Bench) -> Observation:
    """Go on in the present tree with a store of the baseline; the baseline takes the same life at once.

    The baseline keeps a store that ends amid the life. The records of the present tree after it must be those of the
    uninterrupted life.
    """
    kept = bench.kept
    if bench.tree.name == "baseline":
        kept.mkdir(parents=True)
        found = build_map(bench)
        path, config = _life(bench, "thesis")
        bench.replay(path, config, "--limit", str(LIFE_CUT), out="part")
        for file in (path, config, bench.folder / "map.nc", bench.folder / "part" / "state.db"):
            shutil.copy(file, kept)
        found = bench.replay(path, config)
    else:
        for file in kept.iterdir():
            folder = bench.folder / ("out" if file.name == "state.db" else "")
            folder.mkdir(exist_ok=True)
            shutil.copy(file, folder)
        found = bench.replay(bench.folder / "life.npy", bench.folder / "m.toml", "--resume")
    # Of its own blocks only: how many a call took.
    return {name: column for name, column in found.items() if not re.fullmatch(r"out/replay/(blocks|accepted)", name)}


def build_map(bench: Bench, rig: Mapping[str, object] = CALIBRATED) -> Observation:
    """Build the map ``map.nc`` of the lives in the folder of a case."""
    ranges = ("--load-newton", "4000", "--speed-hz", "40", "--dphi-deg", "0:40:6", "--h-d-um", "0:32:5")
    (bench.folder / "maps").mkdir()
    path = bench.folder / "maps" / "map.nc"
    config = bench.write(machine_text({"url": "folder:in"}, {**CHANNEL, "name": "x"}, rig=rig), "map.toml")
    options = ("--config", config, "--rms-band-hz", "10:1000", "--workers", "1", "--out", path)
    printed = bench.call("map", "build", *ranges, *options)
    shutil.copy(path, bench.folder)
    return of_json("map build", printed) | of_netcdf("map", path.parent)


def _library(bench: Bench) -> Observation:
    path = bench.folder / "library.npz"
    config = bench.write(machine_text({"url": "folder:in"}, {**CHANNEL, "name": "x"}, rig=CALIBRATED), "library.toml")
    options = ("--runs", "20", "--rms-band-hz", "10:1000", "--threshold-mm2", "0.05", "--threshold-mm2", "0.1")
    printed = bench.call("library", "build", "--config", config, *options, "--workers", "1", "--out", path)
    return of_json("library build", printed) | of_npz("library", path)


def _life(bench: Bench, method: str) -> tuple[Path, Path]:
    """Write a life and a configuration that tracks it; return the paths of both."""
    path = bench.folder / "life.npy"
    channel = save_log(path, LIFE_BLOCKS, LIFE_ONSET, 7) | {"name": "x", "track": True, "map": "map.nc"}
    if method == "library":
        channel["library"] = "library.npz"
    source = {"block_s": BLOCK / RATE, "rate_hz": RATE, "start_utc": BEGIN.isoformat()}
    forecast = {"method": "library" if method == "library" else "thesis", "threshold_mm2": [0.05, 0.1]}
    sections = {"rig": CALIBRATED, "track": {"method": method}, "forecast": forecast}
    text = machine_text(source, channel, **sections)
    return path, bench.write(text, "m.toml")
