"""Draw the picture of the README from a replay of PRONOSTIA's Bearing2_4.

python -m benchmarks.pictures        needs the recordings that SPALLWATCH_DATA names (default ../shared/data)
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from monitor.config.load import load_config
from monitor.records.store import Store
from monitor.service.replay import Replay, replay
from streams.block import STANDARD_GRAVITY

ROOT = Path(__file__).resolve().parents[1]
CHANNEL = "vertical"
BLUE, RED, ORANGE, GREY = "#0072b2", "#7b3f72", "#b84a00", "#5b6470"


def run() -> tuple[Replay, np.ndarray]:
    """Replay the run; return it and its rows (block, RMS in g, H_or in g, score)."""
    recording = (
        Path(os.environ.get("SPALLWATCH_DATA", ROOT.parent / "shared" / "data")) / "femto" / "Bearing2_4.tar.bz2"
    )
    config = load_config(ROOT / "examples" / "pronostia_1650rpm_4200n.toml")
    with tempfile.TemporaryDirectory() as folder:
        result = replay(config, str(recording), Path(folder))
        with Store.open(result.store_path, read_only=True) as store:
            values = [(record.sequence, record.channels[CHANNEL]) for record in store.records()]
    rows = [
        (block, v["rms"] / STANDARD_GRAVITY, v["h_or"] / STANDARD_GRAVITY, v.get("detect_score") or np.nan)
        for block, v in values
    ]
    return result, np.array(rows, dtype=float)


def draw(result: Replay, rows: np.ndarray, path: Path) -> None:
    """Draw RMS, H_or and the envelope spectrum."""
    found = result.summary["channels"][CHANNEL]
    figure, (top, middle, bottom) = plt.subplots(3, 1, figsize=(10, 7.2), layout="constrained")
    for axes, column, color, label in ((top, 1, BLUE, "RMS [g]"), (middle, 2, RED, "H_or [g]")):
        axes.semilogy(rows[:, 0], rows[:, column], color=color, lw=0.8)
        axes.axvspan(1, 130, color=GREY, alpha=0.10, lw=0)
        axes.axvline(found["t_fs_block"], color=ORANGE, lw=1.4)
        axes.axvline(found["t_fs_known_block"], color=ORANGE, lw=1.0, ls=":")
        axes.set(ylabel=label, xlim=(1, rows[-1, 0] + 5))
        axes.grid(alpha=0.25)
        axes.yaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_minor_formatter(lambda value, _: f"{value:g}" if f"{value:e}"[0] in "25" else "")
    top.text(4, top.get_ylim()[1] * 0.72, "run-in and learning", color=GREY, fontsize=9)
    top.annotate(
        f"final stage since block {found['t_fs_block']},\nknown at block {found['t_fs_known_block']}",
        (found["t_fs_block"], 0.8),
        xytext=(-12, 0),
        textcoords="offset points",
        ha="right",
        color=ORANGE,
    )
    middle.text(
        380,
        0.62,
        "an impulsive episode lifts H_or and the noise under it alike: no alarm",
        ha="center",
        fontsize=9,
        color=GREY,
    )
    middle.set_xlabel("block (one file of 0.1 s every 10 s)")
    frequency, amplitude, lines, label, *_ = result.spectra[CHANNEL]
    bottom.plot(frequency, amplitude, color=GREY, lw=1.0)
    for order in range(1, 6):
        bottom.axvline(order * lines["outer"], color=ORANGE, lw=0.9, ls=":")
    bottom.set(
        xlabel="frequency [Hz]",
        ylabel="envelope [g]",
        xlim=(0, 1000),
        ylim=(0, None),
        title=f"envelope spectrum, {label}: {found['fault']} race (dotted: multiples of BPFO, {lines['outer']:.1f} Hz)",
    )
    bottom.title.set_fontsize(10)
    bottom.grid(alpha=0.25)
    figure.suptitle("PRONOSTIA Bearing2_4, vertical accelerometer, replayed by spallwatch", fontsize=12)
    figure.savefig(path, dpi=110, pil_kwargs={"optimize": True})


if __name__ == "__main__":
    replayed, table = run()
    draw(replayed, table, ROOT / "docs" / "pictures" / "bearing2_4.png")
