"""The six-degree-of-freedom model simulated over time, for scenes whose motion has no ball period.

Defects that turn (inner race, ball), a force that turns (unbalance) and balls that slip have no common period; they are
simulated from rest at the static equilibrium, the beginning is dropped, and what remains is averaged with its standard
error. Waviness and gravity are modelled here too. ``models/kernels/time_domain.py`` describes the integration.

Readings: the path coordinate is an angle on the damaged part, kinematics those of pure rolling (``Kinematics``). Slip
shifts when a ball meets the defect, not where it presses: the angle is small. Gravity changes the static equilibrium
and nothing else, because the rest of the model is linear in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.dynamics.six_dof import check_scene
from models.dynamics.time_plan import prepare_plan
from models.kernels import time_domain as kernels
from models.kernels.step import P_DIRECTION_1, P_DIRECTION_2, STATUS_OK
from models.numerics import filter_valid, kaiser_order
from models.response import PASSBAND, SENSORS, Status, check_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.bearing import Kinematics
    from models.response import Sensor
    from models.scene import Scene

# Default step, s: benchmarks/effects.py prints the error that it leaves.
DEFAULT_STEP = 10e-6
# Dropped at the beginning: ball periods, and the minimum in seconds.
SETTLE_PERIODS = 40
SETTLE_SECONDS = 0.2
_LEAST_BLOCKS = 4.0
_STOPBAND_DB = 80.0
# A smaller change of the RMS from the first to the second half is ignored at any standard error.
_SAME_LEVEL = 3e-3
# A smaller spread of the RMS from ball period to ball period is due to the steps.
_SAME_PERIOD = 2e-2
# A smaller vibration counts as zero, m/s2.
SILENCE = 1e-9


@dataclass(frozen=True, eq=False)
class TimeResponse:
    """The vibration of a scene over time. SI units; sensor "mo" is the casing, "mr" the resonator.

    Attributes:
        rate: sampling rate of ``acceleration``, Hz.
        acceleration: signals of both sensors as a recorder would sample them, m/s2, shape (2, samples): passed through
            a linear-phase filter that ends at the Nyquist frequency (flat to 0.9 of it, then 80 dB down).
        rms: RMS of a_o over full bandwidth (not the recorder's) and whole blocks, m/s2.
        rms_se: its standard error from means over blocks, m/s2.
        spread: standard deviation of the RMS from block to block, m/s2.
        peak: largest absolute value of a_o, m/s2; ``rms_resonator`` and ``peak_resonator`` are those of a_r.
        blocks: number of blocks: turns of the shaft, of the cage for a damaged ball, or ball passages where nothing but
            them drives the motion; 4 parts where fewer would fit.
        status: "converged" (the motion repeats with the ball passage), "not_periodic" (it does not; mean and spread are
            given) or "not_converged" (the level still drifts, or left the finite numbers: do not use).
    """

    rate: float
    acceleration: NDArray[np.float64]
    rms: float
    rms_se: float
    spread: float
    peak: float
    rms_resonator: float
    peak_resonator: float
    blocks: int
    kinematics: Kinematics
    step: float
    model: str
    status: Status

    def levels_in_band(self, low: float, high: float, sensor: Sensor = "mo") -> tuple[float, float]:
        """Return RMS and peak of the sampled signal between two frequencies, Hz, in m/s2.

        Raises:
            ValueError: if the band is empty or reaches beyond 0.9 of the Nyquist frequency.
        """
        check_band((low, high))
        if high > PASSBAND * 0.5 * self.rate:
            raise ValueError(
                f"the band ends at {high!r} Hz, the signal is flat up to {PASSBAND * 0.5 * self.rate:g} Hz"
            )
        signal = self.acceleration[SENSORS[sensor]]
        spectrum = np.fft.rfft(signal)
        frequency = np.fft.rfftfreq(len(signal), 1.0 / self.rate)
        inside = np.fft.irfft(np.where((frequency >= low) & (frequency <= high), spectrum, 0.0), len(signal))
        return float(np.sqrt(np.mean(inside**2))), float(np.max(np.abs(inside)))

    def line(self, frequency: float, sensor: Sensor = "mo") -> float:
        """Return the single-sided amplitude at one frequency, Hz, in m/s2, through a Hann window."""
        signal = self.acceleration[SENSORS[sensor]]
        window = np.hanning(len(signal))
        turn = np.exp(-2j * np.pi * frequency / self.rate * np.arange(len(signal)))
        return float(2.0 * np.abs(np.sum(signal * window * turn)) / np.sum(window))


def simulate_time(
    scene: Scene,
    duration: float,
    rate: float,
    *,
    settle: float | None = None,
    direction: tuple[float, float] = (1.0, 0.0),
    step: float = DEFAULT_STEP,
) -> TimeResponse:
    """Return ``duration`` seconds of the vibration of a scene with all effects that it names, sampled at ``rate`` Hz.

    Args:
        settle: time that is simulated before and dropped, s; by default 40 ball periods, and 0.2 s at least.
        direction: of the sensor, along the load and across it; made a unit vector.
        step: longest step of the integration, s; taken so that a sample has a whole number of steps, at least 2.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    _check(scene)
    unit = _check_arguments(duration, rate, step, direction)
    lines = kinematics(scene.bearing, scene.speed)
    settle = _settling(settle, lines)
    oversampling = max(2, math.ceil(1.0 / (rate * step) - 1e-9))
    h = 1.0 / (rate * oversampling)
    samples = max(1, round(duration * rate))
    taps = anti_alias_filter(oversampling)
    margin = len(taps) // 2
    begin = max(margin, math.ceil(settle * rate) * oversampling)
    wave = np.empty((begin + samples * oversampling + margin, 2))
    plan = prepare_plan(scene, len(wave) * h)
    plan.parameter[P_DIRECTION_1], plan.parameter[P_DIRECTION_2] = unit
    status = kernels.run(np.zeros((2, 6)), wave, h, plan)
    settled = wave[begin : begin + samples * oversampling]
    window = wave[begin - margin : begin + (samples - 1) * oversampling + margin + 1]
    signals = [filter_valid(window[:, k], taps)[::oversampling] for k in (0, 1)]
    blocks = max(samples / rate * _block_rate(scene, lines), _LEAST_BLOCKS)
    levels, resonator = (_levels(settled[:, k], blocks) for k in (0, 1))
    peak, peak_resonator = np.max(np.abs(settled), axis=0).tolist()
    return TimeResponse(
        rate=rate,
        acceleration=np.array(signals),
        rms=levels.rms,
        rms_se=levels.error,
        spread=levels.spread,
        peak=peak,
        rms_resonator=resonator.rms,
        peak_resonator=peak_resonator,
        blocks=levels.blocks,
        kinematics=lines,
        step=h,
        model=scene.model,
        status=_status(scene, levels, finite=status == STATUS_OK),
    )


def _block_rate(scene: Scene, lines: Kinematics) -> float:
    """Return how many blocks a second has: the slowest of the frequencies with which the level swings, Hz."""
    if scene.repeats:
        return lines.bpfo
    return lines.ftf if scene.defect is not None and scene.defect.part == "ball" else lines.speed


def _settling(settle: float | None, lines: Kinematics) -> float:
    """Return the time to drop, s: the given one, or the longer of 40 ball periods and 0.2 s."""
    if settle is None:
        return max(SETTLE_SECONDS, SETTLE_PERIODS / lines.bpfo)
    if not (math.isfinite(settle) and settle >= 0.0):
        raise ValueError(f"settle must be finite and not negative, got {settle!r}")
    return settle


def _check_arguments(duration: float, rate: float, step: float, direction: tuple[float, float]) -> NDArray[np.float64]:
    """Return the direction as a unit vector; raise ValueError that names an invalid argument."""
    for name, value in (("duration", duration), ("rate", rate), ("step", step)):
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be positive and finite, got {value!r}")
    length = math.hypot(*direction)
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"direction must be a vector of finite length other than zero, got {direction!r}")
    return np.array(direction, dtype=np.float64) / length


@dataclass(frozen=True)
class _Levels:
    rms: float
    error: float
    spread: float
    drift: float
    blocks: int


def _levels(signal: NDArray[np.float64], blocks: float) -> _Levels:
    """Return the levels over ``blocks`` blocks; the last, broken one is left out, because it would bias the mean."""
    count = math.floor(blocks + 1e-9)
    energy = np.concatenate(([0.0], np.cumsum(signal**2)))
    edges = np.arange(count + 1) * (len(signal) / blocks)
    means = np.maximum(np.diff(np.interp(edges, np.arange(len(energy)), energy)) / (len(signal) / blocks), 0.0)
    rms, half = math.sqrt(np.mean(means)), count // 2
    drift = abs(math.sqrt(np.mean(means[-half:])) - math.sqrt(np.mean(means[:half])))
    error = float(np.std(means, ddof=1)) / math.sqrt(count) / (2.0 * rms) if rms > 0.0 else 0.0
    return _Levels(rms, error, float(np.std(np.sqrt(means), ddof=1)), drift, count)


def _status(scene: Scene, levels: _Levels, *, finite: bool) -> Status:
    if not finite or not math.isfinite(levels.rms):
        return "not_converged"
    if levels.rms <= SILENCE:
        return "converged"
    # The difference of two halves has twice the standard error of the whole.
    if levels.drift > max(8.0 * levels.error, _SAME_LEVEL * levels.rms):
        return "not_converged"
    return "converged" if scene.repeats and levels.spread <= _SAME_PERIOD * levels.rms else "not_periodic"


def anti_alias_filter(oversampling: int) -> NDArray[np.float64]:
    """Return the taps (an odd number) of the filter before every ``oversampling``-th sample is kept."""
    width = (1.0 - PASSBAND) / oversampling
    count, beta = kaiser_order(_STOPBAND_DB, width)
    half = count // 2 + 1
    cutoff = 0.5 * (1.0 + PASSBAND) / oversampling
    taps = cutoff * np.sinc(cutoff * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return taps / taps.sum()


def _check(scene: Scene) -> None:
    """Raise a ValueError that names a field which the model does not describe, its value and the expected one."""
    if scene.model != "six_dof":
        raise ValueError(f"unknown model {scene.model!r}; known are: six_dof")
    check_scene(replace(scene, defect=None, waviness=(), unbalance=0.0, slip=None))
    defect = scene.defect
    if defect is None:
        return
    if scene.slip is None or scene.slip.phi_slip == 0.0:
        return
    if scene.slip.rule != "per_passage":
        raise ValueError(f"slip.rule {scene.slip.rule!r}: models.dynamics.lanes models this, on the outer race")
    if defect.part == "ball":
        raise ValueError("slip moves a ball to or from a defect of a race; the defect is of a ball")
