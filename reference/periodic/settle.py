"""Simulation from rest until the level settles, with its own error estimate from a run at a tenth of the tolerance."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from reference.periodic import kernel, period
from reference.periodic.path import intervals, pieces_of, profile_of
from reference.periodic.rig import OracleScene

TOLERANCE = 1e-9
# Two halves of a window whose levels differ by less are the same level.
SETTLED = 1e-6
# States a period apart that differ by less, relative to the largest of the period, are the same motion.
REPEATS = 1e-4
MULTIPLES = 12
FEWEST_PERIODS, STILL_PERIODS, MOST_PERIODS = 4, 400, 4000
MOST_STEPS = 8_000_000
# A motion that does not repeat is averaged in so many blocks, over so many periods at least, until the standard error
# of its RMS is this small (relative) or a cap is met.
BLOCKS, FEWEST_AVERAGED, ENOUGH = 20, 60, 3e-3
# State a period earlier, relative to the largest of the period, from which on a motion is restless.
RESTLESS = 1e-2


@dataclass(frozen=True)
class Caps:
    """Largest number of ball periods, of steps and of seconds of the processor of one run."""

    periods: int = MOST_PERIODS
    steps: int = MOST_STEPS
    seconds: float = math.inf


@dataclass
class History:
    """One run: what every ball period gave, and the state at its end, (12,)."""

    power: list[float] = field(default_factory=list)
    lines: list[NDArray[np.float64]] = field(default_factory=list)
    peaks: list[float] = field(default_factory=list)
    driven: list[float] = field(default_factory=list)
    lost: list[float] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)
    widest: list[float] = field(default_factory=list)
    instants: list[int] = field(default_factory=list)
    grazes: list[int] = field(default_factory=list)
    state: NDArray[np.float64] = field(default_factory=lambda: np.zeros(12))
    multiple: int = 0
    settled: bool = False
    steps: int = 0


@dataclass(frozen=True)
class OracleResult:
    """The settled vibration of the casing along the load, SI units.

    Attributes:
        status: "settled" (the level no longer changes), "not_periodic" (stationary mean with a standard error) or
            "unresolved" (a cap was met before either, or the state left the finite numbers).
        rms: root of the mean power over the settled window (its last period where each is like the one before), m/s2;
            ``standard_error`` that of its mean where the motion does not repeat, else 0; ``spread`` the standard
            deviation of the RMS of single periods.
        repeats: whether one ball period is like the next; ``multiple`` after how many periods the motion repeats, 0 if
            after none up to MULTIPLES.
        lines: single-sided amplitudes of BPFO lines 1..6 (of the mean power), m/s2.
        instants, grazes: contacts that opened or closed in the last period, and extrema of gaps near zero.
        motion_resonance: highest resonance over the ball rate, linearised at the largest displacement of the window.
        imbalance: work put in less work of damping over the window, relative to the latter.
        error, peak_error, line_errors: differences, relative, relative and in m/s2, between this and what had settled
            at ten times the tolerance before; NaN or empty without it, and where the motion does not repeat (two runs
            of it are two samples of one mean).
    """

    status: str
    rms: float
    spread: float
    standard_error: float
    repeats: bool
    multiple: int
    lines: tuple[float, ...]
    peak: float
    motion_resonance: float
    imbalance: float
    periods: int
    steps: int
    seconds: float
    instants: int = 0
    grazes: int = 0
    error: float = math.nan
    peak_error: float = math.nan
    line_errors: tuple[float, ...] = ()


class Problem:
    """One scene as an initial value problem in the kernel's arrays."""

    def __init__(self, scene: OracleScene) -> None:
        """Find the kinks of the path and the static equilibrium."""
        self.scene = scene
        paths, rough = pieces_of(scene), profile_of(scene)[0]
        self.bounds, self.codes, self.middles = intervals(scene, paths)
        g, rig, p = scene.geometry, scene.parameters, np.zeros(kernel.PARAMETERS)
        p[kernel.P_M_I], p[kernel.P_M_O], p[kernel.P_M_R] = rig.m_i, rig.m_o, rig.m_r
        p[kernel.P_K_I], p[kernel.P_C_I] = rig.k_i, rig.c_i
        p[kernel.P_K_R], p[kernel.P_C_R] = rig.k_r, rig.c_r
        p[kernel.P_K_C], p[kernel.P_EXPONENT] = rig.k_c, scene.exponent
        p[kernel.P_DAMPING], p[kernel.P_BETA] = rig.alpha_c * rig.m_b, rig.beta_c * rig.k_c
        p[kernel.P_CLEARANCE], p[kernel.P_OMEGA] = scene.clearance, scene.omega_c
        p[kernel.P_LOAD], p[kernel.P_APPROACH], p[kernel.P_PITCH] = scene.load, scene.approach, scene.pitch
        p[kernel.P_RACE], p[kernel.P_ELEMENT] = g.outer_race_radius, g.element_radius
        p[kernel.P_COSINE] = math.cos(g.contact_angle)
        p[kernel.P_SPACING] = 2.0 * math.pi / max(1, len(rough))
        pits = [[0.5 * path.pit.extent, path.pit.depth, path.pit.position, path.roughness] for path in paths]
        waves = [[w.amplitude * p[kernel.P_COSINE], w.order, w.phase] for w in scene.waves]
        self.model = kernel.Model(
            p=p,
            directions=np.stack((np.cos(scene.angles), np.sin(scene.angles), scene.angles), axis=1),
            pits=np.array(pits, dtype=float).reshape(-1, 4),
            waves=np.array(waves, dtype=float).reshape(-1, 3),
            rough=rough,
        )
        rates = scene.rates()
        self.fastest = float(np.max(np.abs(rates)))
        self.slowest = float(np.min(-rates.real[-rates.real > 1e-9 * self.fastest], initial=self.fastest))
        squeeze = scene.approach - scene.clearance
        sizes = np.array([squeeze, scene.load / rig.k_i, scene.load / rig.k_r])
        # A provisional scale of the first period: small against any motion that matters.
        self.first_scale = np.concatenate((1e-3 * sizes, 1e-3 * sizes * self.fastest, [math.inf]))

    def run(self, tolerance: float, caps: Caps, start: NDArray[np.float64] | None = None) -> History:
        """Simulate on from rest, or from a deviation from it (12), until the level settles or a cap is met."""
        history, scale, until = History(), self.first_scale, time.thread_time() + caps.seconds
        y = np.zeros(12) if start is None else start.copy()
        sums, largest, counts = np.zeros(period.SUMS), np.zeros(6), np.zeros(2, dtype=np.int64)
        h = min(0.01 / self.fastest, self.scene.period)
        last: list[NDArray[np.float64]] = [y.copy()]
        while len(history.power) < caps.periods and time.thread_time() < until:
            status, steps, h, peak = period.ball_period(
                y,
                h,
                tolerance,
                scale,
                self.bounds,
                self.codes,
                self.middles,
                self.model,
                caps.steps - history.steps,
                history.peaks[-1] if history.peaks else math.inf,
                sums,
                largest,
                counts,
            )
            history.steps += steps
            if status != period.NO_ERROR:
                break
            self._record(history, sums, peak, counts)
            history.widest.append(float(largest[0]))
            largest = np.maximum(largest, 1e-12 * self.first_scale[:6])
            size = np.repeat(largest, 2)
            gaps = [float(np.max(np.abs(y - before) / size)) for before in last]
            history.distances.append(gaps[0])
            history.multiple = next((k + 1 for k, gap in enumerate(gaps) if gap < REPEATS), 0)
            last = [y.copy(), *last[: MULTIPLES - 1]]
            # Sizes may fall only slowly, so that a quiet period does not tighten the next one.
            quiet = np.concatenate((largest, [max(10.0 * sums[0], 1e-300)]))
            scale = quiet if scale is self.first_scale else np.maximum(quiet, 0.9 * scale)
            history.settled = is_settled(history, self.scene.period * self.slowest)
            if history.settled or is_averaged(history, self.scene.period * self.slowest):
                break
        history.state = y
        return history

    def _record(self, history: History, sums: NDArray[np.float64], peak: float, counts: NDArray[np.int64]) -> None:
        duration = self.scene.period
        history.power.append(float(sums[0]) / duration)
        history.driven.append(float(sums[1]))
        history.lost.append(float(sums[2]))
        history.lines.append(2.0 / duration * np.hypot(sums[3::2], sums[4::2]))
        history.peaks.append(peak)
        history.instants.append(int(counts[period.INSTANTS]))
        history.grazes.append(int(counts[period.GRAZES]))


def is_settled(history: History, decay: float) -> bool:
    """Return whether the level of a run no longer changes; free vibrations lose ``decay`` e-folds in a period."""
    n = len(history.power)
    if n < FEWEST_PERIODS or n % max(1, n // 16) != 0:
        return False
    # A direction that no contact holds at rest drifts slowly there; where it does, the states tell.
    recent = history.distances[n // 2 :]
    still = max(recent) < 1e-7 and min(recent) < 1e-3 * decay
    still = still or (n >= STILL_PERIODS and max(recent) < 1e-6)
    if n * decay < 5.0 and not still:
        return False
    if _is_steady(history, 12):
        return True
    quarter = n // 4
    late, early, earlier = (float(np.mean(history.power[n - (k + 1) * quarter : n - k * quarter])) for k in range(3))
    close = max(abs(late - early), abs(late - earlier)) <= 2.0 * SETTLED * late
    return close and history.multiple > 0


def is_averaged(history: History, decay: float) -> bool:
    """Return whether a motion that does not repeat has been simulated for long enough to know its mean level."""
    n = len(history.power)
    if n < 400 or n % 50 != 0 or n * decay < 10.0 or not is_restless(history):
        return False
    power = np.array(history.power[n // 2 :])
    blocks = np.array([np.mean(block) for block in np.array_split(power, BLOCKS)])
    away = np.abs(blocks - np.median(blocks))
    # The end of a transient is a block unlike all others; a mean over it would be neither of the two levels.
    transient = float(np.max(away)) > 8.0 * float(np.median(away))
    error, drift = _standard_error(power)
    return error < ENOUGH and drift < 3.0 and not transient


def is_restless(history: History) -> bool:
    """Return whether the states of successive periods stay apart, and by no less than before."""
    n = len(history.distances)
    before, now = (float(np.median(history.distances[a:b])) for a, b in ((n // 4, n // 2), (3 * n // 4, n)))
    return history.multiple == 0 and now > RESTLESS and now > 0.3 * before


def _is_steady(history: History, count: int) -> bool:
    """Return whether the states of the last periods agree so well that what is left to decay is negligible."""
    if len(history.distances) < 2 * count:
        return False
    now, before = max(history.distances[-3:]), max(history.distances[-3 - count : -count])
    if now >= 1e-7 or before <= 0.0:
        return now == 0.0
    fall = min((now / before) ** (1.0 / count), 1.0 - 1e-12)
    return now * fall / (1.0 - fall) < SETTLED


def summarise(scene: OracleScene, history: History, seconds: float) -> OracleResult:
    """Return the level of the last part of a run, with what it can be trusted for."""
    n = len(history.power)
    if n < 4:
        nothing = math.nan
        return OracleResult(
            "unresolved",
            nothing,
            nothing,
            nothing,
            False,
            0,
            (),
            nothing,
            nothing,
            nothing,
            n,
            history.steps,
            seconds,
        )
    # A settled run needs its end only; one that does not repeat may begin with a long transient.
    settled = history.settled
    window = max(2, n // 4 if settled else n // 2)
    power = np.array(history.power[-window:])
    mean, levels = float(np.mean(power)), np.sqrt(power)
    rms, spread = math.sqrt(mean), float(np.std(levels))
    error, drift = _standard_error(power)
    status = "settled"
    if not settled:
        status = "not_periodic" if window >= FEWEST_AVERAGED and drift < 4.0 and is_restless(history) else "unresolved"
    # Where each period is like the one before, the last is the nearest to the limit.
    if settled and history.distances[-1] < SETTLED:
        window, rms = 1, math.sqrt(history.power[-1])
    lines = np.sqrt(np.mean(np.square(history.lines[-window:]), axis=0))
    lost = float(np.sum(history.lost[-window:]))
    imbalance = (float(np.sum(history.driven[-window:])) - lost) / lost if lost > 0.0 else 0.0
    return OracleResult(
        status=status,
        rms=rms,
        spread=spread,
        standard_error=0.0 if settled else error * rms,
        repeats=history.multiple == 1 and spread < 1e-4 * rms,
        multiple=history.multiple,
        lines=tuple(float(a) for a in lines),
        peak=float(np.max(history.peaks[-window:])),
        motion_resonance=scene.highest_resonance(scene.approach + max(history.widest[-window:])) * scene.period,
        imbalance=imbalance,
        periods=n,
        steps=history.steps,
        seconds=seconds,
        instants=history.instants[-1],
        grazes=history.grazes[-1],
    )


def _standard_error(power: NDArray[np.float64]) -> tuple[float, float]:
    """Return the relative standard error of the RMS from means of blocks, and how many of its own standard errors the
    means of both halves differ by.
    """
    size = max(1, len(power) // BLOCKS)
    blocks = power[len(power) % size :].reshape(-1, size).mean(axis=1)
    early, late = np.array_split(blocks, 2)
    if len(late) < 2 or not np.mean(blocks) > 0.0:
        return 0.0, 0.0
    error = float(np.std(blocks, ddof=1)) / math.sqrt(len(blocks))
    apart = math.hypot(*(float(np.std(half, ddof=1)) / math.sqrt(len(half)) for half in (early, late)))
    drift = abs(float(np.mean(early) - np.mean(late))) / apart if apart > 0.0 else 0.0
    return 0.5 * error / float(np.mean(blocks)), drift


def simulate_oracle(
    scene: OracleScene, *, tolerance: float = TOLERANCE, caps: Caps | None = None, estimate: bool = True
) -> OracleResult:
    """Return the settled response of a scene.

    ``estimate`` goes on from where it settled at a tenth of the tolerance, which gives what is returned then, and its
    errors.
    """
    caps = Caps() if caps is None else caps
    begun = time.thread_time()
    problem = Problem(scene)
    history = problem.run(tolerance, caps)
    result = summarise(scene, history, time.thread_time() - begun)
    if not estimate or result.status != "settled":
        return result
    fine = summarise(scene, problem.run(0.1 * tolerance, replace(caps, steps=2 * caps.steps), history.state), 0.0)
    if fine.status != "settled":
        return result
    return replace(
        fine,
        error=abs(fine.rms - result.rms) / fine.rms if fine.rms > 0.0 else 0.0,
        peak_error=abs(fine.peak - result.peak) / fine.peak if fine.peak > 0.0 else 0.0,
        line_errors=tuple(abs(a - b) for a, b in zip(fine.lines, result.lines, strict=True)),
        periods=result.periods + fine.periods,
        steps=result.steps + fine.steps,
        seconds=time.thread_time() - begun,
    )


def other_levels(scene: OracleScene, count: int = 6, caps: Caps | None = None) -> list[float]:
    """Return the settled RMS, m/s2, from ``count`` random starts: a rig with clearance may have several motions.

    A start displaces inner and outer ring by up to the static approach, with velocities of the slower resonances.
    """
    problem, caps = Problem(scene), Caps() if caps is None else caps
    rng = np.random.default_rng(0)
    rate = float(np.median(np.abs(scene.rates())))
    found: list[float] = []
    for _ in range(count):
        start = np.zeros(12)
        start[:4] = scene.approach * rng.uniform(-1.0, 1.0, 4)
        start[6:10] = rate * scene.approach * rng.uniform(-1.0, 1.0, 4)
        result = summarise(scene, problem.run(TOLERANCE, caps, start), 0.0)
        if result.status != "unresolved":
            found.append(result.rms)
    return found
