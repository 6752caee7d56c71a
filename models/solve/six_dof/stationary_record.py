"""Records of a bearing with a defect that turns (inner race or ball): how they begin, how long and how fine they are.

A record begins at rest; its beginning is dropped, and what remains is cut into turns, where the defect is opposite to
the load: turns of the shaft for the inner race, of the cage for a ball.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.machine.bearing import kinematics
from models.solve.response import HARMONICS
from models.solve.six_dof.kernels import time_domain as kernels
from models.solve.six_dof.kernels.step import STATUS_OK
from models.solve.six_dof.setup import default_settling, steps_for
from models.solve.six_dof.time_domain import prepare_plan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Kinematics
    from models.machine.scene import Scene

    Values = NDArray[np.float64]

# Turns of the defect through the load in a record, at least.
_TURNS = 10
# The steps of the coarsest grid that the rig allows are taken in so many parts; steps in half of a defect, at least;
# and the share of the step rate up to which a band may reach.
_PARTS = 2
_STEPS_IN_HALF = 4
_RESOLVED = 0.4
# Turns of the cage in a part of a record of which a line is taken: sidebands a turn of the cage away then lie on zeros
# of the window.
LINE_TURNS = 4
# Samples of a record, at most: they are held in memory.
MOST_SAMPLES = 20_000_000
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
# Records between those of two numbers, of which the phases are apart.
_APART = 37


def line_frequency(scene: Scene) -> float:
    """Return the frequency whose multiples are the lines of the damaged part, Hz: BPFO, BPFI, or twice BSF."""
    lines = kinematics(scene.bearing, scene.speed)
    return {"outer": lines.bpfo, "inner": lines.bpfi, "ball": 2.0 * lines.bsf}[scene.first_part]


def healthy(scene: Scene) -> Scene:
    """Return a scene without its defect."""
    return replace(scene.healthy, slip=None)


def turn_rate(scene: Scene, lines: Kinematics) -> float:
    """Return how often the defect turns through the load, Hz."""
    return lines.ftf if scene.defect is not None and scene.defect.part == "ball" else lines.speed


def cage_turns_of(scene: Scene, lines: Kinematics) -> int:
    """Return the measured length of a record in turns of the cage, which hold whole numbers of lines' records."""
    turns = math.ceil((_TURNS + 1) * lines.ftf / turn_rate(scene, lines))
    return LINE_TURNS * math.ceil(turns / LINE_TURNS)


def settling_turns(lines: Kinematics) -> int:
    """Return the length of the dropped beginning in turns of the cage."""
    return math.ceil(default_settling(lines) * lines.ftf)


def steps_in_turn(scene: Scene, lines: Kinematics, band: tuple[float, float] | None) -> int:
    """Return the steps in a turn of the cage, an even number, for the rig, the extent of the defect and the band."""
    defect = scene.defect
    assert defect is not None
    by_rig = _PARTS * math.ceil(steps_for(healthy(scene)) * lines.bpfo / lines.ftf)
    rate = lines.bsf if defect.part == "ball" else lines.speed - lines.ftf
    by_extent = _STEPS_IN_HALF * 4.0 * math.pi * rate / (defect.dphi_d * lines.ftf)
    by_band = 0.0 if band is None else band[1] / (_RESOLVED * lines.ftf)
    return 2 * math.ceil(0.5 * max(by_rig, by_extent, by_band))


@dataclass(frozen=True, eq=False)
class StationaryRecord:
    """One record, in a band where one was given.

    Attributes:
        turns: mean squares of its turns, m2/s4, shape (turns,).
        phase: phase of the balls, or of the spin, at each of them, rad.
        lines: powers of the lines in each part of the record, m2/s4, shape (parts, 6).
        beginning: what is not measured, m/s2.
        per_turn: steps in a turn of the cage.
    """

    turns: Values
    phase: Values
    lines: Values
    beginning: Values
    per_turn: int

    @property
    def finite(self) -> bool:
        """Whether the motion did not diverge."""
        return bool(np.all(np.isfinite(self.turns)))


def placed(scene: Scene, number: int, place: int) -> Scene:
    """Return a scene whose defect begins in a phase of its own, and whose slip is drawn anew.

    ``place`` counts the records of a scene from zero.
    """
    defect, slip = scene.defect, scene.slip
    assert defect is not None
    # The golden section fills all gaps evenly, whatever the number of records.
    phase = 2.0 * math.pi * ((_GOLDEN * (place + _APART * number)) % 1.0)
    if slip is not None and slip.redraws:
        seed = np.random.SeedSequence([slip.seed, number, place]).generate_state(1)[0]
        slip = replace(slip, seed=int(seed))
    return replace(scene, defect=replace(defect, position=(defect.position + phase) % (2.0 * math.pi)), slip=slip)


def run_from_rest(scene: Scene, per_turn: int, cage_turns: int) -> Values:
    """Return the acceleration of the casing from rest on, m/s2, shape (cage_turns * per_turn,); NaN if it diverges.

    Raises:
        ValueError: if these are too many.
    """
    samples = cage_turns * per_turn
    if samples > MOST_SAMPLES:
        raise ValueError(
            f"a record of {cage_turns} turns of the cage needs {samples} steps, at most {MOST_SAMPLES} are taken: "
            f"the speed, {scene.speed!r} Hz, is too low for it"
        )
    duration = cage_turns / kinematics(scene.bearing, scene.speed).ftf
    wave = np.empty((samples, 2))
    status = kernels.run(np.zeros((2, 6)), wave, duration / samples, prepare_plan(scene, duration))
    return wave[:, 0].copy() if status == STATUS_OK else np.full(samples, math.nan)


def take_record(scene: Scene, per_turn: int, cage_turns: int, band: tuple[float, float] | None) -> StationaryRecord:
    """Return a record of ``cage_turns`` turns of the cage with so many steps in each, its beginning apart."""
    lines = kinematics(scene.bearing, scene.speed)
    settling = settling_turns(lines)
    wave = run_from_rest(scene, per_turn, settling + cage_turns)
    beginning, kept = wave[: settling * per_turn], wave[settling * per_turn :]
    step = 1.0 / (lines.ftf * per_turn)
    window = _line_window(line_frequency(scene) * step, LINE_TURNS * per_turn)
    amplitude = np.abs(kept.reshape(-1, LINE_TURNS * per_turn) @ window.T)
    signal = kept if band is None else _in_band(kept, step, band)
    times, phase = _turns(scene, lines, settling / lines.ftf, (settling + cage_turns) / lines.ftf)
    energy = np.concatenate(([0.0], np.cumsum(signal * signal)))
    at = np.interp(times / step - len(beginning), np.arange(len(energy)), energy)
    return StationaryRecord(
        np.diff(at) * (turn_rate(scene, lines) * step), phase, amplitude * amplitude, beginning, per_turn
    )


def _turns(scene: Scene, lines: Kinematics, begin: float, end: float) -> tuple[Values, Values]:
    """Return when the defect is opposite to the load between two times, s, and the phase of each turn, rad.

    Of the times there is one more than of the turns.
    """
    defect, rate = scene.defect, turn_rate(scene, lines)
    assert defect is not None
    on_ball = defect.part == "ball"
    # The first ball of a row begins in the load direction, but for the offset of its row, which is the same each turn.
    ahead = 0.5 - (0.0 if on_ball else defect.position / (2.0 * math.pi))
    first, last = math.ceil(begin * rate - ahead), math.floor(end * rate - ahead)
    times = np.asarray((np.arange(first, last + 1) + ahead) / rate, dtype=np.float64)
    phase = 2.0 * math.pi * (lines.bsf if on_ball else lines.bpfo) * times[:-1] - (defect.position if on_ball else 0.0)
    return times, phase


def _in_band(signal: Values, step: float, band: tuple[float, float]) -> Values:
    """Return a signal without what lies outside a band, Hz."""
    spectrum = np.fft.rfft(signal)
    frequency = np.arange(len(spectrum)) / (len(signal) * step)
    spectrum[(frequency < band[0]) | (frequency > band[1])] = 0.0
    return np.fft.irfft(spectrum, len(signal))


@lru_cache(maxsize=16)
def _line_window(cycles: float, samples: int) -> NDArray[np.complex128]:
    """Return what gives the single-sided amplitudes of the lines at multiples of ``cycles`` a sample, (6, samples)."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(samples) / samples)
    order = np.arange(1, HARMONICS + 1)[:, None]
    return 2.0 / window.sum() * window * np.exp(-2j * np.pi * cycles * order * np.arange(samples))
