"""Predicted error of a model that stands for another: the cheap one is solved again with what it lacks, to first order.

What the ring on massless balls (``models.mappings.ring``) lacks of balls with inertia:

* a loaded ball moves by the outer contact's share of the approach, s = k_i^2/3 / (k_i^2/3 + k_o^2/3), with the ring:
  m_b s^2 cos^2 theta of added mass, averaged over the loaded zone;
* centrifugal force and weight press a ball against the outer race before the inner one meets it: a clearance of up to
  ((m_b r w_cage^2 + m_b g) / k_o)^2/3, which acts in full where a ball is hardly loaded;
* the direction of a contact turns as the ring moves across it: a clearance of up to u^2 / 2 r.

A scene whose motion repeats is solved for one ball period by the six-degree-of-freedom model, which takes about a
millisecond; any other is followed by the rotor for a few passages. ``benchmarks/scenes.py`` measures how true errors
compare with these; the factors in ``models.mappings.table`` are the bounds that its development seeds gave.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.bearing import kinematics
from models.hertz import BALL_EXPONENT, element_angles, static_equilibrium
from models.mappings.ring import Ring, bearing_stiffness, casing_of, gain_of, ring_of, rotor_of
from models.rigs.ball_inertia import BallInertiaRig
from models.rigs.rotor import RotorRig

if TYPE_CHECKING:
    from models.registry import Request
    from models.response import Response
    from models.scene import Defect, Scene

# Places around the race at which a ball's load is looked at, and shares of the clearance that are tried.
_PLACES = 64
_SHARES = (1.0, 0.5)
# Accuracy of the RMS with which both scenes are solved: the steps hardly affect their difference.
_PROBE = 5e-3
_HARMONICS = 6
# A motion that does not repeat is followed for so many passages over the defect and turns of the shaft.
_PASSAGES, _TURNS = 6.0, 1.5
# Share of the effect of the cage's turn in the rate of compression that the dampers of a ball in a row leave unsettled.
_SMOOTHED = 0.6
# Share of the dampers' force over that of the contacts by which a ball lags, and of that phase that a level feels.
_HELD_BACK = 0.5
_OF_LAG = 0.25
# Of the error of a waveform over a defect, where the inertia of the balls is what makes it.
_LINES_OF_WAVE = 0.25


@dataclass(frozen=True)
class Differences:
    """Relative differences of two motions: of the waveform, of the RMS, and of the first lines over the largest."""

    waveform: float
    rms: float
    lines: float

    def with_other(self, other: Differences, share: float = 1.0) -> Differences:
        """Return the root of the sum of squares with a share of others."""
        pairs = ((self.waveform, other.waveform), (self.rms, other.rms), (self.lines, other.lines))
        return Differences(*(math.hypot(one, share * two) for one, two in pairs))

    def larger(self, other: Differences) -> Differences:
        """Return the larger of each."""
        pairs = ((self.waveform, other.waveform), (self.rms, other.rms), (self.lines, other.lines))
        return Differences(*(max(pair) for pair in pairs))


def of_balls(scene: Scene, request: Request, *, cage_in_rate: bool = True) -> Differences:
    """Return what balls without mass change; ``cage_in_rate``: whether the cage's turn is in the stand-in's damping.

    Dampers in a row give way where a ball is hardly loaded, so that the jump of the force with which a ball begins to
    be damped, which the turn of the cage causes, is neither that of a single contact nor none.
    """
    ring, still = ring_of(scene), replace(scene.healthy, unbalance=0.0)
    rest = replace(ring, unbalance=0.0)
    both = {turn: _one_period(still, replace(rest, cage_in_rate=turn), request) for turn in (True, False)}
    base = both[cage_in_rate]
    found = _differences(base, _one_period(*with_balls(still, rest, _SHARES[0]), request))
    for share in _SHARES[1:]:
        found = found.larger(_differences(base, _one_period(*with_balls(still, rest, share), request)))
    found = found.with_other(_differences(base, both[not cage_in_rate]), _SMOOTHED)
    if scene.repeats and scene.defect is None:
        return found
    pair = rotor_of(scene, ring), rotor_of(*with_balls(scene, ring))
    level, followed = _followed(pair, scene, _LINES_OF_WAVE)
    lag = max((_lag(scene, ring, defect) for defect in scene.defects if defect.moves_balls), default=0.0)
    followed = followed.with_other(Differences(lag, _OF_LAG * lag, _OF_LAG * lag))
    return followed.with_other(found, base.rms / level if level > 0.0 else 1.0)


def _lag(scene: Scene, ring: Ring, defect: Defect) -> float:
    """Return by how much dampers, which feel the profile of a defect through the ball's motion, hold a ball back."""
    lines = kinematics(scene.bearing, scene.speed)
    rate = 2.0 * math.pi * (lines.ftf if defect.part == "outer" else scene.speed - lines.ftf)
    balls = scene.bearing.n_elements * scene.bearing.rows
    force = max(abs(ring.force) / balls, 1e-9)
    tangent = BALL_EXPONENT * ring.k_c ** (1.0 / BALL_EXPONENT) * force ** (1.0 - 1.0 / BALL_EXPONENT)
    return _HELD_BACK * ring.damping * math.pi * rate / (defect.dphi_d * tangent)


def of_shaft(scene: Scene) -> Differences:
    """Return what the bending of a shaft is to a rotor: to first order the disc is heavier by k_bearing / k_shaft."""
    rig = scene.rig_as(RotorRig)
    stiffness = bearing_stiffness(scene, rig.k_c, 0.5 * scene.load)
    soft = max(stiffness / spring for spring in rig.shaft_stiffness)
    bent = replace(scene, rig=replace(rig, m=rig.m * (1.0 + soft), j_t=rig.j_t * (1.0 + soft)))
    return _followed((scene, bent), scene, 1.0)[1]


def with_balls(scene: Scene, ring: Ring, share: float = 1.0) -> tuple[Scene, Ring]:
    """Return scene and ring with what massless balls lack; ``share`` of the clearance."""
    rig = scene.rig_as(BallInertiaRig)
    k_in, k_out = rig.k_ci ** (1.0 / BALL_EXPONENT), rig.k_co ** (1.0 / BALL_EXPONENT)
    moved = k_in / (k_in + k_out)
    angles = element_angles(scene.bearing, rig.cage_angle)
    size = float(np.hypot(*static_equilibrium(angles, abs(ring.force), ring.k_c, clearance=scene.clearance)))
    cosine = np.cos(2.0 * math.pi * np.arange(_PLACES) / _PLACES)
    loaded = np.where(size * cosine > scene.clearance, cosine**2, 0.0)
    ball, radius = rig.ball_mass(scene.bearing), 0.5 * scene.bearing.pitch_diameter
    cage = 2.0 * math.pi * kinematics(scene.bearing, scene.speed).ftf
    pressed = ball * (radius * cage**2 + scene.gravity)
    gap = (pressed / rig.k_co) ** (1.0 / BALL_EXPONENT) + size**2 / (2.0 * radius)
    mass = ring.mass + ball * moved**2 * len(angles) * float(np.mean(loaded))
    return replace(scene, clearance=scene.clearance + share * gap), replace(ring, mass=mass)


def _loose(request: Request) -> Request:
    return replace(request, accuracy=_PROBE, quantity="rms", sensor=None, tolerance=None, steps_per_period=None)


def _one_period(scene: Scene, ring: Ring, request: Request) -> Response:
    """Return one ball period of a healthy ring, in its own acceleration."""
    from models.dynamics.periodic import solve

    stand_in = casing_of(scene, ring)
    found = solve(replace(stand_in, model="auto"), _loose(request))
    gain = gain_of(stand_in)
    levels = tuple((abs(gain) * rms, abs(gain) * peak) for rms, peak in found.levels)
    return replace(found, levels=levels, coefficients=gain * found.coefficients)


def _differences(base: Response, other: Response) -> Differences:
    """Return how a motion that repeats differs from another."""
    count = min(base.coefficients.shape[1], other.coefficients.shape[1])
    one, two = base.coefficients[0, 1:count], other.coefficients[0, 1:count]
    level = math.sqrt(float(np.sum(np.abs(one) ** 2)))
    if not (level > 0.0 and base.rms > 0.0):
        return Differences(0.0, 0.0, 0.0)
    lines = np.abs(np.abs(one) - np.abs(two))[:_HARMONICS]
    return Differences(
        waveform=math.sqrt(float(np.sum(np.abs(one - two) ** 2))) / level,
        rms=abs(other.rms / base.rms - 1.0),
        lines=float(np.max(lines) / np.max(np.abs(one[:_HARMONICS]))),
    )


def _followed(pair: tuple[Scene, Scene], scene: Scene, of_wave: float) -> tuple[float, Differences]:
    """Return RMS and differences of the motion of two rotors, from rest, without the first third.

    Of so few passages no lines are taken: theirs is that of the RMS, or a share of the waveform's.
    """
    from models.dynamics.over_time import passage_rate
    from models.dynamics.rotor import LONGEST_STEP, trace

    duration = max(_PASSAGES / passage_rate(scene), _TURNS / scene.speed)
    waves = [trace(rotor, duration, 0.5 * LONGEST_STEP).acceleration[:, 0] for rotor in pair]
    one, two = (wave[len(wave) // 3 :] for wave in waves)
    level = float(np.sqrt(np.mean(one**2)))
    if not (math.isfinite(level) and level > 0.0):
        return 0.0, Differences(math.inf, math.inf, math.inf)
    wave = float(np.sqrt(np.mean((one - two) ** 2))) / level
    rms = abs(float(np.sqrt(np.mean(two**2))) / level - 1.0)
    return level, Differences(wave, rms, max(rms, of_wave * wave))
