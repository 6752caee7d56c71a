"""Lives on which something happens that V_eq and TT must not pass over, for ``benchmarks.unseen.nonsense``.

Where only the measured levels change, the lives are those of ``benchmarks.unseen.judge``; stalls, steps of the load,
the law of its own and the damage of the inner race are simulated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.unseen.cache import kept, lives_of
from benchmarks.unseen.laws import LAWS, THRESHOLD, Floats, Rng, draw_growth
from benchmarks.unseen.lives import (
    BAND,
    INTERVAL,
    LifeOptions,
    Machine,
    UnseenLife,
    draw_machine,
    machine_bearing,
    measure,
    simulate_life,
)
from models.machine.scene import Defect, Scene
from models.path.defect import race_radius
from models.solve.response import HARMONICS
from models.solve.simulate import simulate

WATCHED = 50
"""Blocks after the cause in which a flag counts."""
GAP_S = 20.0 * 3600.0
"""Length of the gap in the logging, s."""
_BEFORE = 12
"""Least number of blocks before a cause."""
_LONG = (7.0 * 3600.0, 20.0 * 3600.0)
"""Durations of simulated lives, s: there are blocks enough on both sides of the cause."""
_INNER_RIGS, _INNER_VOLUMES = 8, np.geomspace(0.6e-9, THRESHOLD, 6)


@dataclass(frozen=True, eq=False)
class Case:
    """One life and the first block of the cause; ``fault`` is what the envelope names, or None."""

    life: UnseenLife
    cause: int
    fault: str | None = None


def sound(count: int, first_seed: int) -> list[Case]:
    """Return lives without a cause, of all laws in turn."""
    return [Case(life, 0) for life in _in_turn(count, first_seed, 1)]


def _in_turn(count: int, first_seed: int, least: int) -> list[UnseenLife]:
    """Return lives with at least so many blocks, the first of each law, then the second of each, and so on."""
    found: list[UnseenLife] = []
    chunk, most = 10, 20 * (-(-count // len(LAWS)) + 1)
    for first in range(0, most, chunk):
        of_laws = [lives_of(law, first + chunk, first_seed)[first:] for law in LAWS]
        found += [life for number in zip(*of_laws, strict=True) for life in number if life.t.size >= least]
        if len(found) >= count:
            break
    return found[:count]


def changed(count: int, first_seed: int, change: Callable[[Rng, UnseenLife, int], UnseenLife]) -> list[Case]:
    """Return lives whose measurement changes ``WATCHED`` blocks before their last."""
    cases: list[Case] = []
    for k, life in enumerate(_in_turn(count, first_seed, _BEFORE + WATCHED)):
        cause = life.t.size - WATCHED
        cases.append(Case(change(np.random.default_rng([first_seed, 77, k]), life, cause), cause))
    return cases


def _with_levels(life: UnseenLife, cause: int, rms: Floats, harmonics: Floats) -> UnseenLife:
    """Return a life whose levels from a block on are others."""
    return replace(
        life,
        rms=np.concatenate([life.rms[:cause], rms]),
        harmonics=np.concatenate([life.harmonics[:cause], harmonics]),
    )


def noise(rng: Rng, life: UnseenLife, cause: int) -> UnseenLife:
    """Return levels that are log-normal noise about those before, one sigma a factor e."""
    blocks = life.t.size - cause
    factors = np.exp(rng.standard_normal((blocks, 1 + HARMONICS)))
    before = slice(max(0, cause - 10), cause)
    rms, lines = np.median(life.rms[before]), np.median(life.harmonics[before], axis=0)
    return _with_levels(life, cause, rms * factors[:, 0], lines * factors[:, 1:])


def gain(_: Rng, life: UnseenLife, cause: int) -> UnseenLife:
    """Return levels three times as large."""
    return _with_levels(life, cause, 3.0 * life.rms[cause:], 3.0 * life.harmonics[cause:])


def dead(rng: Rng, life: UnseenLife, cause: int) -> UnseenLife:
    """Return the noise of a cable without a sensor: 2 mg, and 0.02 mg in a line."""
    blocks = life.t.size - cause
    scatter = np.exp(0.02 * rng.standard_normal((blocks, 1 + HARMONICS)))
    return _with_levels(life, cause, 9.80665 * 2e-3 * scatter[:, 0], 9.80665 * 2e-5 * scatter[:, 1:])


def gap(_: Rng, life: UnseenLife, cause: int) -> UnseenLife:
    """Return a life in whose logging 20 h are missing, while the machine, unknown to the monitor, stood."""
    late = np.where(np.arange(life.t.size) >= cause, GAP_S, 0.0)
    return replace(life, t=life.t + late, crossing=life.crossing + GAP_S)


def stall(count: int, first_seed: int) -> list[Case]:
    """Return lives whose damage stands still from a share of .3 to .6 of its nominal time on."""

    def options(rng: Rng) -> LifeOptions:
        return LifeOptions((4.0 * 3600.0, 20.0 * 3600.0), hold_share=rng.uniform(0.3, 0.6), hold_s=60.0 * INTERVAL)

    cases: list[Case] = []
    for life in _simulated(count, first_seed, options):
        still = int(np.searchsorted(life.v_eq, life.v_eq[-1] * (1.0 - 1e-9)))
        cases.append(Case(life, still))
    return cases


def load_step(count: int, first_seed: int, *, known: bool) -> list[Case]:
    """Return lives whose load changes at .4 of the time: by 10 %, known, or by 30 to 60 %, unknown."""

    def options(rng: Rng) -> LifeOptions:
        factor = rng.uniform(1.08, 1.12) if known else rng.uniform(1.3, 1.6)
        return LifeOptions(_LONG, load_step=(0.4, factor if rng.uniform() < 0.5 else 1.0 / factor, known))

    return [_at_share(life, 0.4) for life in _simulated(count, first_seed, options)]


def decelerating(count: int, first_seed: int) -> list[Case]:
    """Return lives that grow ever slower, which may be a law that the library has not met; the cause is the onset."""
    return [Case(life, 0) for life in lives_of("decelerating", count, first_seed)]


def _at_share(life: UnseenLife, share: float) -> Case:
    return Case(life, int(np.searchsorted(life.t, share * life.crossing)))


def _simulated(count: int, first_seed: int, options: Callable[[Rng], LifeOptions]) -> list[UnseenLife]:
    """Return lives of the laws in turn, numbers from 1000 on, each with options of its own, kept."""
    found: list[UnseenLife] = []
    for k in range(count):
        law, number = list(LAWS)[k % len(LAWS)], 1000 + k // len(LAWS)
        own = options(np.random.default_rng([first_seed, 78, k]))
        found += kept(
            f"{law} {number} {first_seed} {own}",
            lambda law=law, number=number, own=own: [simulate_life(law, number, first_seed, own)],
        )
    return found


def _inner_levels(first_seed: int, number: int) -> tuple[Machine, Floats]:
    """Return a machine and the RMS of its casing with the inner race damaged by ``_INNER_VOLUMES``, m/s2, kept."""
    rng = np.random.default_rng([first_seed, 80, number])
    machine, bearing = draw_machine(rng), machine_bearing()
    deep = rng.uniform(6e-6, 15e-6) * (_INNER_VOLUMES / THRESHOLD) ** 0.4
    radius = race_radius(bearing) - bearing.element_diameter

    def make() -> list[UnseenLife]:
        rms = np.empty(_INNER_VOLUMES.size)
        for k, (v_eq, h_d) in enumerate(zip(_INNER_VOLUMES.tolist(), deep.tolist(), strict=True)):
            defect = Defect(v_eq / (radius * h_d), h_d, machine.floor, part="inner")
            scene = Scene(machine.speed, machine.load, bearing, machine.rig, defect=defect)
            rms[k] = simulate(scene, accuracy=1e-2, band=BAND).rms
        still = np.zeros(rms.size)
        return [UnseenLife("inner", number, still, still, still, rms, np.zeros((rms.size, HARMONICS)), still, 0.0)]

    (found,) = kept(f"inner race {first_seed} {number}", make)
    return machine, found.rms


def inner_race(count: int, first_seed: int, *, named: bool) -> list[Case]:
    """Return lives whose damage is on the inner race: the RMS rises, BPFO lines stay in the background.

    Levels are read between six volumes on each of a few rigs; ``named`` is whether the envelope names the part.
    """
    bank = [_inner_levels(first_seed, k) for k in range(_INNER_RIGS)]
    cases: list[Case] = []
    for k in range(count):
        rng = np.random.default_rng([first_seed, 79, k])
        growth = draw_growth(list(LAWS)[k % len(LAWS)], rng, _LONG)
        t = np.arange(0.0, 0.75 * growth.crossing, INTERVAL)
        v_eq, _, edge = growth.at(t)
        machine, levels = bank[k % _INNER_RIGS]
        rms = edge * np.exp(np.interp(np.log(v_eq), np.log(_INNER_VOLUMES), np.log(levels)))
        rms, lines = measure(rng, machine, t / growth.crossing, rms, np.zeros((t.size, HARMONICS)))
        known = np.full(t.size, machine.load), np.full(t.size, machine.speed)
        life = UnseenLife(growth.law, k, t, *known, rms, lines, v_eq, growth.crossing)
        cases.append(Case(life, 0, "inner" if named else None))
    return cases
