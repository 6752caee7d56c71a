"""``spallwatch gear`` on examples/gearbox.toml: its chain in time against lines, the rate, and what it costs.

python -m benchmarks.gear_command [--json FILE]

The command passes forces through the responses of a casing in time and takes third octaves of the result. Beside it the
mesh lines of the forces go through the same responses one by one, and their mean squares are added. Both must agree
where lines carry the level. The rate has no filter against aliasing: what lies above half of it folds back, which
a rate four times as high shows.
"""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.gears.sound.levels import level_db
from models.gears.sound.third_octave import Bands
from models.gears.transfer.frf import FrequencyResponses
from monitor.gears.casing import casing_by_elements
from monitor.gears.forces import GearRun, amplitudes, build_train, run_train
from monitor.gears.kinematics import read_gears
from monitor.gears.transfer import REFERENCE_ACCELERATION, felt

ROOT = Path(__file__).resolve().parents[1]
CONFIG, BOX = ROOT / "examples" / "gearbox.toml", ROOT / "benchmarks" / "gear_casing.toml"
RATE, HIGH_RATE = 51200.0, 204800.0
HARMONICS = 6
LEAD = 0.1
NEAR_EDGE = 2.0
"""Hz between a mesh line and the edge of a band within which both bands share it."""


def train_run(rate: float, duration: float) -> tuple[GearRun, float]:
    """Return the motion at a rate, Hz, and the processor time of a second call, which compiles nothing, s."""
    builder = build_train(given := read_gears(CONFIG, ()), given.config.operating.speed_hz)
    run_train(builder, 0.1, rate)
    began = time.process_time()
    run = run_train(builder, duration, rate)
    return run, time.process_time() - began


def resonances(supports: list[str]) -> FrequencyResponses:
    """Return responses of a point with the modal damping of the thesis' Table 26 at its frequencies, shares drawn."""
    frequency = np.linspace(100.0, 4500.0, 4401)
    modes = ((562.0, 0.076), (828.0, 0.076), (1221.0, 0.037), (1423.0, 0.018), (2154.0, 0.005), (2818.0, 0.023))
    inputs = tuple(f"{name}.{axis}" for name in supports for axis in "xy")
    shares = np.random.default_rng(7).standard_normal((len(modes), len(inputs)))
    h = np.zeros((frequency.size, 1, len(inputs)), np.complex128)
    for (natural, ratio), share in zip(modes, shares, strict=True):
        over = frequency / natural
        gain = -(over**2) / (1.0 - over**2 + 2j * ratio * over) / 50.0
        h += gain[:, None, None] * share
    return FrequencyResponses(frequency, h, ("point",), inputs)


def by_lines(run: GearRun, responses: FrequencyResponses, bands: Bands) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the mean squares of the bands from the mesh lines of the forces alone."""
    lines = run.lines_hz[run.lines_hz < responses.band[1]]
    forces = _all(run)
    found = responses.lines(lines, amplitudes(forces, run.motion.rate, lines)).amplitudes[:, 0]
    squares = 0.5 * np.abs(found) ** 2
    inside = (lines >= bands.lower[:, None]) & (lines < bands.upper[:, None])
    return np.asarray(inside @ squares, dtype=np.float64)


def measure() -> list[Row]:
    """Return the rows of the table."""
    rows: list[Row] = []
    run, seconds = train_run(RATE, 2.0)
    high, _ = train_run(HIGH_RATE, 2.0)
    rows.append({"what": "processor time a simulated second", "value": seconds / 2.0, "unit": "s"})
    responses = resonances(list(run.forces))
    found = felt(run, responses, LEAD)
    lines = by_lines(run, responses, found.bands)
    loud = lines > 1e-4 * lines.max()
    levels, expected = (level_db(values[loud], REFERENCE_ACCELERATION) for values in (found.squares[0], lines))
    rows.append({"what": "bands with lines, in time against lines", "value": _worst(levels - expected), "unit": "dB"})
    edges = np.abs(found.bands.edges[:, None] - run.lines_hz).min(axis=1)
    clear = np.minimum(edges[:-1], edges[1:])[loud] > NEAR_EDGE
    rows.append({"what": "the same, no line near an edge", "value": _worst((levels - expected)[clear]), "unit": "dB"})
    forces = [np.abs(amplitudes(_all(one), one.motion.rate, run.lines_hz)) for one in (run, high)]
    strong = forces[1] > 0.01 * forces[1].max()
    change = 20.0 * np.log10(forces[0][strong] / forces[1][strong])
    rows.append({"what": "mesh lines of forces, 51.2 kHz against 204.8 kHz", "value": _worst(change), "unit": "dB"})
    squares = [felt(one, responses, LEAD).squares[0] for one in (run, high)]
    gaps = level_db(squares[0][loud], REFERENCE_ACCELERATION) - level_db(squares[1][loud], REFERENCE_ACCELERATION)
    rows.append({"what": "levels of bands, 51.2 kHz against 204.8 kHz", "value": _worst(gaps), "unit": "dB"})
    began = time.process_time()
    _, known = casing_by_elements(run.builder.gear, BOX, lambda text: None)
    rows.append({"what": "processor time of the box and its sound", "value": time.process_time() - began, "unit": "s"})
    rows.append({"what": "unknowns of the box", "value": float(known["unknowns"]), "unit": "1"})
    rows.append({"what": "elements of its surface", "value": float(known["radiation"]["elements"]), "unit": "1"})
    return rows


def _all(run: GearRun) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.concatenate(list(run.forces.values()), axis=1)


def _worst(values: np.ndarray[Any, np.dtype[np.float64]]) -> float:
    worst = float(np.max(np.abs(values)))
    assert math.isfinite(worst)
    return worst


def main() -> None:
    """Print the table, and keep it where asked."""
    options = arguments(str(__doc__))
    title, rows = "spallwatch gear", measure()
    print_table(title, rows)
    write_json(options.json, {title: rows})


if __name__ == "__main__":
    main()
