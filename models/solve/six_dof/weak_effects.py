"""How much effects that only a simulation over time shows can change a motion that repeats with the ball passage.

A bound is the RMS of the change of the acceleration over the RMS of that motion.

* Force on the shaft, wave of the inner race: the response at their frequencies of the rig linearised at rest, for a
  range of stiffnesses of the contacts. A wave of order w and amplitude A pushes at |m Z w_cage - w w_shaft|, for all m,
  by A Z times the Fourier coefficient m Z - w of the stiffness of the contacts around the bearing.
* Slip: a passage that comes later by e changes its part g of the waveform by g(t - e) - g(t), whose line at w is below
  than min(2, w |e|) times that of g; beyond the lines that are known, power falls as 1/w^2 (a jump of the force). Parts
  of passages may cancel in the motion that repeats, and no longer where they are drawn; with a multiplier m their power
  is at most (1 + m) / (1 - m) of it.
* Defect: a pulse of the force of one ball for each passage, d deep and t long, whose transform is below
  (k + w c) min(d t, 2 d / w): what it pushes at once, and the modes that it leaves ringing.
* All but slip press the balls otherwise as well, by x over their approach at rest: what the motion has already changes
  by _MODULATION times that share, over one less its multiplier, at which it forgets.

By the inequality of the triangle the RMS changes by no more. Where what is added has no line in common with the motion
(shaft frequency, drawn times), its power alone adds, and what the second order changes of the motion: the RMS changes
by the square. The amplitude of a line changes by sqrt(2) times the change of the waveform at most.

``benchmarks.scenes.weak`` compares them with simulations over time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from models.machine.bearing import kinematics
from models.machine.hertz import contact_exponent
from models.machine.rig import Rig
from models.path.contour import part_paths
from models.path.defect import BallPath, edge_path
from models.solve.registry import EffectBound, WeakEffects
from models.solve.six_dof.kernels.step import P_ALPHA, P_BETA, P_K_C, P_U_1, P_U_2
from models.solve.six_dof.quasi_periodic import add
from models.solve.six_dof.setup import LANE_EFFECTS, PERIODIC_EFFECTS, TIME_EFFECTS, check_scene, operating_point

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from models.machine.scene import Defect, Scene, Waviness
    from models.solve.response import Response

    Values = NDArray[np.float64]

# A speed that changes asks for a record and its angle, which one period does not have.
NAMES = (TIME_EFFECTS | LANE_EFFECTS) - PERIODIC_EFFECTS - {"changing_speed"}
# Of linear responses, which are those at rest; stiffness of the contacts over that at rest, and share of their damping.
_SAFETY = 2.0
_STIFFNESSES = np.geomspace(0.4, 2.5, 9)
_DAMPED = 0.5
# Response at a resonance that nothing damps.
_UNDAMPED = 1e30
# Relative change of the waveform over that of the approach of the balls.
_MODULATION = 20.0
# Of the stiffness of a ball in the motion over that at rest.
_STIFFENED = 2.0
# Angles around the bearing at which the stiffness of the contacts is taken.
_AROUND = 2048
# Highest line that is needed to tell what slip does, over the resonance of the casing.
_RESOLVED = 1.5
# Change of the RMS over the square of that of the waveform, where that alone counts; of an unbalance, where balls pass
# so much more often than the shaft turns.
_SQUARED = {"unbalance": 2.0, "slip": 1.0, "mean_force_slip": 1.0}
_APART = 1.1
# A smaller vibration counts as none, m/s2.
_SILENCE = 1e-9
# Angles beyond the edge of a defect, rad: they are fixed, so that a larger defect has no smaller bound.
_BEYOND_EDGE = 0.5 * math.pi * 2.0 ** (-0.25 * np.arange(160.0)[::-1])


def without(scene: Scene) -> Scene:
    """Return a scene without the effects that are bounded here; defects of the outer race stay.

    Raises:
        ValueError: if the model does not describe the scene; the message names what.
    """
    check_scene(scene, TIME_EFFECTS | LANE_EFFECTS)
    outer = [defect for defect in scene.defects if defect.part == "outer" and defect.moves_balls]
    return replace(
        scene,
        defect=outer[0] if outer else None,
        more_defects=tuple(outer[1:]),
        slip=None,
        unbalance=0.0,
        waviness=tuple(wave for wave in scene.waviness if wave.race == "outer"),
    )


def bounds(scene: Scene, found: Response) -> dict[str, EffectBound]:
    """Return how much each effect of NAMES in a scene changes its motion at most, by name; infinite where unknown.

    Args:
        found: the response to the scene ``without`` them.
    """
    kept = without(scene)
    rest = _at_rest(kept.healthy)
    if not (rest.approach > 0.0 and found.multiplier < 1.0 and found.rms > _SILENCE):
        return {name: EffectBound(math.inf, math.inf) for name in scene.effects if name in NAMES}
    motion = _Motion(scene.rig_as(Rig), rest, found)
    waves: dict[str, float] = {}
    if scene.unbalance != 0.0:
        waves["unbalance"] = _by_unbalance(scene, motion)
    for wave in scene.waviness:
        if wave.race == "inner" and wave.amplitude != 0.0:
            waves["inner_waviness"] = waves.get("inner_waviness", 0.0) + _by_wave(scene, wave, motion)
    for defect in scene.defects:
        if defect.moves_balls and defect.part != "outer":
            name = f"{defect.part}_defect"
            waves[name] = waves.get(name, 0.0) + _by_defect(scene, defect, motion)
    for name in ("slip", "mean_force_slip"):
        if name in scene.effects:
            waves[name] = _by_slip(scene, kept.defect, motion)
    return {name: _change(scene, name, wave / found.rms) for name, wave in waves.items()}


def _change(scene: Scene, name: str, wave: float) -> EffectBound:
    """Return the bounds of waveform and RMS from that of the waveform."""
    apart = name != "unbalance" or kinematics(scene.bearing, scene.speed).bpfo > _APART * scene.speed
    if name in _SQUARED and apart:
        return EffectBound(wave, min(wave, _SQUARED[name] * wave * wave))
    return EffectBound(wave, wave)


@dataclass(frozen=True, eq=False)
class _Rest:
    """The contacts of a bearing at rest, as if its elements stood everywhere.

    Attributes:
        approach: of the most loaded element, m, not positive where none is loaded.
        stiffness, damping: of all, along the load and across it, N/m and N s/m, (2,).
        single: the same of the most loaded element.
        stiffness_around, damping_around: Fourier coefficients of the force along and across the load of one element by
            its own approach and its rate, N/m and N s/m, (2, _AROUND).
    """

    approach: float
    stiffness: Values
    damping: Values
    single: tuple[float, float]
    stiffness_around: Values
    damping_around: Values


@lru_cache(maxsize=64)
def _at_rest(healthy: Scene) -> _Rest:
    parameter, bearing = operating_point(healthy).parameter, healthy.bearing
    power = contact_exponent(bearing) - 1.0
    angle = np.linspace(0.0, 2.0 * math.pi, _AROUND, endpoint=False)
    normal = np.stack((np.cos(angle), np.sin(angle)))
    u = np.array([parameter[P_U_1], parameter[P_U_2]])
    approach = math.hypot(*u) - healthy.clearance
    pressed = np.maximum(u @ normal - healthy.clearance, 0.0)
    root = pressed**power
    stiffness = (1.0 + power) * parameter[P_K_C] * root
    damping = parameter[P_ALPHA] * (pressed > 0.0) + parameter[P_BETA] * root
    count = bearing.n_elements * bearing.rows
    stiffest = (_STIFFENED * max(approach, 0.0)) ** power
    return _Rest(
        approach=approach,
        stiffness=count * np.mean(stiffness * normal**2, axis=1),
        damping=count * np.mean(damping * normal**2, axis=1),
        single=((1.0 + power) * parameter[P_K_C] * stiffest, parameter[P_ALPHA] + parameter[P_BETA] * stiffest),
        stiffness_around=np.abs(np.fft.fft(stiffness * normal, axis=1)) / _AROUND,
        damping_around=np.abs(np.fft.fft(damping * normal, axis=1)) / _AROUND,
    )


@dataclass(frozen=True, eq=False)
class _Motion:
    """The motion that repeats, at its first sensor, and its rig."""

    rig: Rig
    rest: _Rest
    found: Response

    def pressed_otherwise(self, moved: float) -> float:
        """Return what a displacement of the rings against each other, m, changes of it (RMS), m/s2."""
        whole = max(self.found.rms, math.sqrt(2.0 * float(np.sum(np.abs(self.found.coefficients[0, 1:]) ** 2))))
        return _MODULATION * moved / (self.rest.approach * (1.0 - self.found.multiplier)) * whole


class _Gains(NamedTuple):
    """The largest linear responses at some angular frequencies, each (frequencies,).

    Attributes:
        shaft, shaft_moves: acceleration of a sensor, 1/kg, and displacement of the rings against each other, m/N, by a
            force on the shaft.
        pair, pair_moves: the same by a force of the contacts on the outer ring and against it on the inner one.
    """

    shaft: Values
    shaft_moves: Values
    pair: Values
    pair_moves: Values


def _gains(motion: _Motion, omega: Values) -> _Gains:
    """Return the responses, the largest over both directions and all stiffnesses of the contacts."""
    rig, rest = motion.rig, motion.rest
    s, square = 1j * omega, omega * omega
    stiffness = np.outer(_STIFFNESSES, rest.stiffness).reshape(-1, 1)
    damping = np.outer(np.full_like(_STIFFNESSES, _DAMPED), rest.damping).reshape(-1, 1)
    contact = stiffness + s * damping
    inner, spring = rig.k_i - rig.m_i * square + s * rig.c_i, rig.k_r + s * rig.c_r
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        follows = spring / (spring - rig.m_r * square)
        outer = -square * (rig.m_o + rig.m_r * follows)
        whole = inner * outer + contact * (inner + outer)
        seen = square * (follows if motion.found.sensors[0] == "mr" else 1.0)
        found = [np.max(np.abs(one / whole), axis=0) for one in (seen * contact, outer, seen * inner, inner + outer)]
    return _Gains(*(np.where(np.isfinite(one), one, _UNDAMPED) for one in found))


# What an effect changes of the acceleration at most, RMS, m/s2.


def _by_unbalance(scene: Scene, motion: _Motion) -> float:
    omega = 2.0 * math.pi * scene.speed
    force, gains = scene.unbalance * omega * omega, _gains(motion, np.array([omega]))
    direct, moved = force * float(gains.shaft[0]) / math.sqrt(2.0), force * float(gains.shaft_moves[0])
    return _SAFETY * direct + motion.pressed_otherwise(moved)


def _by_wave(scene: Scene, wave: Waviness, motion: _Motion) -> float:
    bearing, lines, rest = scene.bearing, kinematics(scene.bearing, scene.speed), motion.rest
    amplitude, order, count, farthest = abs(wave.amplitude), wave.order, bearing.n_elements, _AROUND // 2 - 1
    passages = np.arange(math.ceil((order - farthest) / count), (order + farthest) // count + 1)
    place = passages * count - order
    omega = 2.0 * math.pi * np.abs(passages * (count * lines.ftf) - order * lines.speed)
    rate = 2.0 * math.pi * order * abs(lines.ftf - lines.speed)
    around = rest.stiffness_around[:, place] + rate * rest.damping_around[:, place]
    force = amplitude * count * bearing.rows * np.sqrt(np.sum(around**2, axis=0))
    gains = _gains(motion, omega)
    direct = math.sqrt(0.5 * float(np.sum((force * gains.pair) ** 2)))
    moved = amplitude + float(np.sum(force * gains.pair_moves))
    return _SAFETY * direct + motion.pressed_otherwise(moved)


def _by_slip(scene: Scene, defect: Defect | None, motion: _Motion) -> float:
    assert scene.slip is not None
    rig, found = motion.rig, motion.found
    rows, extent = (1, 0.0) if defect is None else (defect.rows, defect.dphi_d)
    power = 2.0 * np.abs(found.coefficients[0, 1:]) ** 2
    omega = 2.0 * math.pi * found.bpfo * np.arange(1.0, len(power) + 1.0)
    resolved = omega[-1] >= _RESOLVED * math.sqrt(rig.k_r * (1.0 / rig.m_o + 1.0 / rig.m_r))
    # One ball that enters and another that leaves may cancel while they do so at once.
    if not resolved or rows * extent >= 2.0 * math.pi / scene.bearing.n_elements:
        return math.inf
    # Of a power that falls as 1 / w^2, as much is beyond the last line as in the octave before it.
    beyond = float(np.sum(power[len(power) // 2 :]))
    if found.rms_band is None:
        beyond = max(beyond, found.rms**2 - float(np.sum(power)))
    later = scene.slip.phi_slip / (2.0 * math.pi * kinematics(scene.bearing, scene.speed).ftf)
    change = float(np.sum(power * np.minimum(4.0, (omega * later) ** 2 / 3.0)))
    change += beyond * min(4.0, 4.0 * later * float(omega[-1]))
    left = max(found.multiplier, 0.0) ** (1.0 / rows)
    return _SAFETY * math.sqrt((1.0 + left) / (1.0 - left) * change)


def _by_defect(scene: Scene, defect: Defect, motion: _Motion) -> float:
    if defect.floor.kind == "rough" and defect.floor.sd > 0.0:
        return math.inf
    lines = kinematics(scene.bearing, scene.speed)
    turns, passages = {
        "outer": (lines.ftf, lines.bpfo),
        "inner": (lines.speed - lines.ftf, lines.bpfi),
        "ball": (lines.bsf, lines.bsf),
    }[defect.part]
    omega, change = 2.0 * math.pi * turns, 0.0
    for depth, slope in _edges(scene, defect):
        pulse = _Pulse(depth, slope * omega, defect.dphi_d / omega, defect.rows * passages)
        moved = pulse.depth * math.sqrt(min(1.0, pulse.passages * pulse.duration))
        change += _SAFETY * (pulse.at_once(motion) + pulse.ringing(motion)) + motion.pressed_otherwise(moved)
    return change


def _edges(scene: Scene, defect: Defect) -> Iterator[tuple[float, float]]:
    """Yield how deep a ball sinks into a defect, m, and the steepest slope of its path, m/rad, of each path over it."""
    half = 0.5 * defect.dphi_d
    beyond = np.append(_BEYOND_EDGE[half > _BEYOND_EDGE], half)
    for path in part_paths(scene.bearing, defect):
        edge = partial(edge_path, r_o=path.r_o, r_b=path.r_b) if isinstance(path, BallPath) else path.edge
        depths, slopes = edge(beyond)
        reached = np.flatnonzero(depths >= defect.h_d)
        last = int(reached[0]) if len(reached) else len(beyond) - 1
        yield min(defect.h_d, float(depths[last])), float(np.max(slopes[: last + 1]))


@dataclass(frozen=True)
class _Pulse:
    """What a ball does that passes a defect.

    Attributes:
        depth: by which it sinks, m.
        speed: with which it does so at most, m/s.
        duration: s.
        passages: a second.
    """

    depth: float
    speed: float
    duration: float
    passages: float

    def at_once(self, motion: _Motion) -> float:
        """Return the RMS of the acceleration of the casing by the force itself, m/s2."""
        k, c = motion.rest.single
        # The integral of the squared rate is at most its largest value times the way, down and up.
        squares = (k * self.depth) ** 2 * self.duration + c * c * self.speed * 2.0 * self.depth
        return math.sqrt(2.0 * self.passages * squares) / motion.rig.m_o

    def ringing(self, motion: _Motion) -> float:
        """Return the RMS of the acceleration of the modes that it leaves ringing, m/s2."""
        (k, c), worst = motion.rest.single, 0.0
        for axis in range(2):
            omega, decay, gain = _modes(motion, axis)
            push = (k + omega * c) * np.minimum(self.depth * self.duration, 2.0 * self.depth / omega)
            with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
                # Each rings as exp(-decay t) and meets what earlier passages left.
                power = self.passages * (gain * omega * push) ** 2 / (4.0 * decay)
                power /= np.tanh(0.5 * decay / self.passages)
            worst = max(worst, float(np.sum(np.sqrt(power))))
        return worst


def _modes(motion: _Motion, axis: int) -> tuple[Values, Values, Values]:
    """Return angular frequency, rad/s, and decay, 1/s, of the modes in one direction, and the velocity of the sensor in
    each by an impulse of the contacts, 1/kg, (3,) each.
    """
    rig, rest = motion.rig, motion.rest
    scale = 1.0 / np.sqrt(np.array([rig.m_i, rig.m_o, rig.m_r]))

    def coupled(ground: float, contact: float, spring: float) -> Values:
        return np.array(
            [[ground + contact, -contact, 0.0], [-contact, contact + spring, -spring], [0.0, -spring, spring]]
        )

    squares, vectors = np.linalg.eigh(scale[:, None] * coupled(rig.k_i, float(rest.stiffness[axis]), rig.k_r) * scale)
    shapes = scale[:, None] * vectors
    omega = np.sqrt(np.maximum(squares, np.finfo(float).tiny))
    damping = coupled(rig.c_i, _DAMPED * float(rest.damping[axis]), rig.c_r)
    decay = 0.5 * np.einsum("im,ij,jm->m", shapes, damping, shapes)
    seen = shapes[2] if motion.found.sensors[0] == "mr" else shapes[1]
    return omega, np.maximum(decay, 0.0), np.abs(seen * (shapes[1] - shapes[0]))


WEAK = WeakEffects(NAMES, without, bounds, add)
