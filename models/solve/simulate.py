"""Simulate the vibration of a scene with the model that it names, or the cheapest that is good enough for it.

Which model answers for a scene: the reference, or a cheaper one that is predicted to be good enough for the request.

The reference is the cheapest solver, among those that leave out nothing of the machine, that takes the parameters of
the scene and meets the accuracy (``choose``). A mapping (``models.solve.mappings``) offers what
stands for it, where the assumptions of both coincide. It is taken if it is cheaper and the predicted error of the
exchange leaves the steps a share of the accuracy; otherwise the reference answers. So it does where what was taken says
that it missed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.machine.scene import EFFECTS
from models.solve.mappings.table import MAPPINGS, Mapped, Mapping
from models.solve.registry import AUTO, EffectBound, Solver, solvers, weak_effects
from models.solve.response import LeftOut, judged, lines_error
from models.words.request import Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Quantity, Sensor


def choose(scene: Scene, request: Request) -> tuple[Solver, str | None, float | None]:
    """Return the cheapest solver that has all effects of a scene, its parameters and the accuracy asked for, why, and
    its expected cost, s.

    It is a reference: what stands for it with parameters of another model is chosen in ``select``. The reason is None
    where the scene names its model and that has one way only, the cost where it had no need to be known. If none
    reaches the accuracy, the most accurate is taken, and the status of its response says so.

    Raises:
        ValueError: if no solver has all the effects, or none of those that have takes the parameters of the machine;
            the message names those that lack, and who has them.
    """
    known = solvers(scene.model)
    needed = frozenset(scene.effects)
    able = [s for s in known if needed <= s.effects]
    if not able:
        raise ValueError(_refusal(scene, known))
    described = len({s.model for s in able})
    able = _of_the_rig(scene, able)
    able = [s for s in able if s.whole is None or s.whole(scene)] or able
    accurate = [s for s in able if s.error <= request.accuracy]
    cost: float | None = None
    if len(accurate) > 1:
        costs = [s.cost(scene, request) for s in accurate]
        cost = min(costs)
        best = accurate[costs.index(cost)]
    else:
        best = accurate[0] if accurate else min(able, key=lambda s: s.error)
    if scene.model != AUTO:
        return best, None, cost
    return best, _reason(best, scene, len({s.model for s in able}), described), cost


def _reason(best: Solver, scene: Scene, models: int, described: int) -> str:
    """Return why a solver is taken, of so many models that take its parameters, and that describe it with their own."""
    named = " with " + ", ".join(EFFECTS[name] for name in scene.effects) if scene.effects else ""
    only = "the only model" if described == 1 else "the only model of these parameters"
    rank = only if models == 1 else f"the cheapest of {models} models"
    return f"{best.model} is {rank}{named}; {best.reason}"


def _of_the_rig(scene: Scene, able: list[Solver]) -> list[Solver]:
    """Return the solvers that take the parameters of a scene; raise the first refusal where none does."""
    found: list[Solver] = []
    refusals: list[ValueError] = []
    for solver in able:
        try:
            scene.rig_as(solver.rig)
        except ValueError as error:
            refusals.append(error)
        else:
            found.append(solver)
    if not found:
        if scene.model != AUTO:
            raise refusals[0]
        models = sorted({f"{solver.model} ({solver.rig.__name__})" for solver in able})
        named = ", ".join(scene.effects) or "rig"
        raise ValueError(
            f"{named}: {scene.rig.model}, whose parameters these are, does not describe this; models that do, "
            f"with parameters of their own: {', '.join(models)}"
        )
    return found


def _refusal(scene: Scene, known: tuple[Solver, ...]) -> str:
    """Return why a scene is refused: what the closest solver lacks, and which models have all of it."""
    needed = frozenset(scene.effects)
    closest = min(known, key=lambda s: len(needed - s.effects))
    missing = [name for name in scene.effects if name not in closest.effects]
    rest = [name for name in scene.effects if name in closest.effects]
    together = f" together with {', '.join(rest)}" if rest else ""
    model = "no model" if scene.model == AUTO else scene.model
    able = sorted({s.model for s in solvers() if needed <= s.effects})
    others = "" if scene.model == AUTO else f"; models that describe it: {', '.join(able) or 'none'}"
    verb = "describes" if scene.model == AUTO else "does not describe"
    return f"{', '.join(missing)}: {model} {verb} this{together}{others}"


# Share of the accuracy that is left to the steps of what stands for a reference.
LEFT_TO_STEPS = 0.1
# What stands for a reference is only looked at where it is expected to cost at most this share of it: expected costs
# are no better than this.
WORTH = 0.8


@dataclass(frozen=True, eq=False)
class Choice:
    """What answers for a scene.

    Attributes:
        solver: that is called, with ``scene`` and ``request``.
        why: in words, None where the scene names a model that has one way only.
        reference: what it stands for, None where it is the reference.
        mapped: the scene with the parameters of ``solver``, None as before.
        error: bound of the error of the exchange, relative, of the quantity that is asked for.
        cost, reference_cost: expected processor time of both, s.
        refused: what could not stand for the reference, and why.
        sensor: that is asked for, of the reference; None is its first.
        instead: the choice of the reference, where this is none.
    """

    solver: Solver
    scene: Scene
    request: Request
    why: str | None
    reference: Solver | None = None
    mapped: Mapped | None = None
    error: float = 0.0
    cost: float = 0.0
    reference_cost: float = 0.0
    refused: tuple[tuple[str, str], ...] = ()
    sensor: Sensor | None = None
    instead: Choice | None = None

    def answer(self) -> Response:
        """Return the response, as one of the reference; raise a ValueError that names what is not described.

        Where its own estimate of the error exceeds the accuracy, ``why`` says so.
        """
        found = self.solver.solve(self.scene, self.request).led_by(self.request.sensor)
        if self.mapped is not None:
            found = replace(self.mapped.back(found, self.sensor), model_error=self.error)
        if self.why is None:
            return found
        missed = found.status == "inaccurate" and not found.repeats
        missed = missed and not found.error <= self.request.accuracy + self.error
        said = f"; its own estimate of the error, {found.error:.1g}, is beyond the accuracy" if missed else ""
        return replace(found, why=self.why + said)


@dataclass(frozen=True, eq=False)
class StandIn:
    """A solver that may stand for a reference.

    Attributes:
        solver, mapped, request: what is called.
        cost: expected processor time, s.
        mapping: whose error is predicted.
    """

    solver: Solver
    mapped: Mapped
    request: Request
    cost: float
    mapping: Mapping


def stand_ins(scene: Scene, request: Request, reference: Solver) -> tuple[list[StandIn], list[tuple[str, str]]]:
    """Return what may stand for a reference, the cheapest first, and what may not with the reason.

    Assumptions coincide and the sensor is there; whether it is accurate enough is not looked at.
    """
    found: list[StandIn] = []
    refused: list[tuple[str, str]] = []
    for mapping in MAPPINGS:
        if not isinstance(scene.rig, mapping.rig) or (mapping.model, mapping.solver) == (
            reference.model,
            reference.name,
        ):
            continue
        solver = next(one for one in solvers(mapping.model) if one.name == mapping.solver)
        name = f"{solver.model} {solver.name}"
        try:
            mapped = mapping.adapt(scene)
            missing = [effect for effect in mapped.scene.effects if effect not in solver.effects]
            if missing:
                raise ValueError(f"{', '.join(missing)}: {solver.model} does not describe this")
            sensor = _sensor(scene, request)
            asked = mapped.request_of(request, sensor)
            found.append(StandIn(solver, mapped, asked, solver.cost(mapped.scene, asked), mapping))
        except ValueError as error:
            refused.append((name, str(error)))
    return sorted(found, key=lambda one: one.cost), refused


def _sensor(scene: Scene, request: Request) -> Sensor:
    """Return the sensor that is asked for, by default the first of the model whose parameters the scene has."""
    return scene.rig.first_sensor if request.sensor is None else request.sensor


def select(scene: Scene, request: Request) -> Choice:
    """Return what answers for a scene.

    Raises:
        ValueError: if no model describes it; the message names what is missing, and who has it.
    """
    reference, why, cost = choose(scene, request)
    plain = Choice(reference, scene, request, why)
    given = request.steps_per_period is not None or len(request.derivatives) > 0
    if scene.model != AUTO or given or reference.error > request.accuracy:
        return plain
    found, refused = stand_ins(scene, request, reference)
    dear = reference.cost(scene, request) if cost is None else cost
    plain = replace(plain, cost=dear, reference_cost=dear)
    for one in found:
        if one.cost > WORTH * dear:
            refused.append((f"{one.solver.model} {one.solver.name}", "it is not expected to be cheaper"))
            continue
        try:
            error = one.mapping.error(scene, request)
        except ValueError as refusal:
            refused.append((f"{one.solver.model} {one.solver.name}", str(refusal)))
            continue
        left = request.accuracy - error
        if left < max(LEFT_TO_STEPS * request.accuracy, one.solver.error):
            refused.append((f"{one.solver.model} {one.solver.name}", f"its error would be {error:.2g}"))
            continue
        why = (
            f"{one.solver.model} ({one.solver.name}) stands for {reference.model} ({reference.name}); they differ by "
            f"{one.mapping.neglected}, at most {error:.1g} of the {_WORDS[request.quantity]}, and it takes "
            f"{_time(one.cost)} instead of {_time(dear)}; {one.solver.reason}"
        )
        asked = replace(one.request, accuracy=left)
        return Choice(
            solver=one.solver,
            scene=one.mapped.scene,
            request=asked,
            why=why,
            reference=reference,
            mapped=one.mapped,
            error=error,
            cost=one.cost,
            reference_cost=dear,
            refused=tuple(refused),
            sensor=_sensor(scene, request),
            instead=plain,
        )
    return replace(plain, refused=tuple(refused))


_WORDS = {"rms": "RMS", "waveform": "waveform", "lines": "largest line", "v_eq": "RMS"}


def _time(seconds: float) -> str:
    return f"{seconds:.2g} s" if seconds >= 1.0 else f"{1e3 * seconds:.2g} ms"


# The slope of RMS by volume is taken over twice the accuracy of the volume, within these limits, from responses whose
# error is this share of that change.
_LEAST_CHANGE, _MOST_CHANGE = 0.02, 0.1
_SLOPE_ACCURACY = 0.05
# Below this slope the RMS does not tell the volume.
_LEAST_SLOPE = 0.02
# A finer accuracy is not asked for.
_LEAST_ACCURACY = 1e-7


def simulate(
    scene: Scene,
    *,
    accuracy: float = Request.accuracy,
    tolerance: float | None = None,
    steps_per_period: int | None = None,
    max_periods: int = Request.max_periods,
    band: tuple[float, float] | None = None,
    lines_to: float | None = None,
    direction: float = 0.0,
    duration: float | None = None,
    rate: float = Request.rate,
    quantity: Quantity = "rms",
    sensor: Sensor | None = None,
    derivatives: Sequence[str] = (),
) -> Response:
    """Return the settled vibration of a scene.

    A motion that nothing but the ball passages drives is solved for one ball period; any other is simulated over time
    and averaged. Effects that make it such a one, but are bound to change ``quantity`` by less than a third of the
    accuracy, are left out (``Response.left_out``); what else the shaft drives, and further defects of the outer race,
    are added as lines of their own where their error is known (``Response.added``). ``Response.why`` says what was
    taken.

    Args:
        accuracy: relative error of ``quantity`` that is asked for. Steps are halved until its estimate,
            ``Response.error``, is below it; the status ``inaccurate`` says that it is not met, whether the motion
            repeats or not.
        tolerance: relative change of the RMS from period to period at which the motion counts as settled, by default
            a hundredth of the accuracy.
        steps_per_period: least steps in a ball period, instead of those that the accuracy asks for.
        max_periods: ball periods to simulate where the motion does not settle, at least 20; up to four times as many
            where its level still drifts, and up to 4000 beside an orbit in which the rings part.
        band: frequencies (lo, hi), Hz, in which RMS and peak are taken; None is the full bandwidth.
        lines_to: frequency up to which the lines of the spectrum are computed, Hz, raised to the end of the band; by
            default 30 kHz and at most 10,000 lines, or as far as the steps or the signal resolve.
        direction: angle of the sensor from the load, rad.
        duration: time to simulate where the motion is not driven by the ball passages alone, s. By default, a level is
            averaged until its error is within the accuracy (for 4 s at most, or 8 of the slowest periods with which it
            swings), and all else, or a changing speed, takes 1 s.
        rate: sampling rate of ``Response.record`` then, Hz.
        quantity: what the accuracy is for: "waveform" (RMS of its error over its RMS), "rms", "lines" (the first six of
            the passages over the defect) or "v_eq": the equivalent volume that a monitor would find from the RMS, whose
            error is that of the RMS over the local slope of ln RMS by ln V (``volume_slope``), which needs two more
            responses. That one RMS may belong to several volumes is not in it.
        sensor: the first of the response, to which its errors apply; None is the first of the model.
        derivatives: parameters by which those of RMS and lines are given (``Response.derivatives``), of a motion that
            repeats with the ball passage: fields of the rig, "load", "speed", "clearance", "gravity",
            "gravity_angle", "direction", and "dphi_d", "h_d", "position" of the defect.

    Raises:
        ValueError: if the scene or an argument is outside what the model describes; the message names it.
    """
    request = Request(
        accuracy=accuracy,
        tolerance=tolerance,
        steps_per_period=steps_per_period,
        max_periods=max_periods,
        band=band,
        lines_to=lines_to,
        direction=direction,
        duration=duration,
        rate=rate,
        quantity=quantity,
        sensor=sensor,
        derivatives=tuple(derivatives),
    )
    if quantity != "v_eq":
        return _answer(scene, request)
    slope = abs(volume_slope(scene, request))
    finer = max(accuracy * max(slope, _LEAST_SLOPE), _LEAST_ACCURACY)
    found = _answer(scene, replace(request, quantity="rms", accuracy=finer))
    known = slope > _LEAST_SLOPE
    error, model = (value / slope if known else math.inf for value in (found.rms_error, found.model_error))
    return judged(replace(found, v_eq_error=error, model_error=model if known else 0.0), request)


def volume_slope(scene: Scene, request: Request) -> float:
    """Return the slope of ln RMS by ln V where the defect of a scene grows in extent and depth alike.

    Raises:
        ValueError: if the scene has not exactly one defect that a ball can feel.
    """
    defect = scene.defect
    if defect is None or not defect.moves_balls or scene.more_defects:
        raise ValueError("quantity 'v_eq' needs a scene with one defect of some extent and depth")
    change = min(max(2.0 * request.accuracy, _LEAST_CHANGE), _MOST_CHANGE)
    finer = replace(request, quantity="rms", accuracy=min(request.accuracy, _SLOPE_ACCURACY * change), derivatives=())
    # Each of extent and depth takes half of the change of the volume in logarithm, to either side.
    share = math.exp(0.25 * math.log1p(change))
    sizes = [(min(k * defect.dphi_d, 2.0 * math.pi), k * defect.h_d) for k in (1.0 / share, share)]
    levels = [_answer(replace(scene, defect=replace(defect, dphi_d=d, h_d=h)), finer).rms for d, h in sizes]
    if not min(levels) > 0.0:
        return 0.0
    (d_1, h_1), (d_2, h_2) = sizes
    return math.log(levels[1] / levels[0]) / math.log(d_2 * h_2 / (d_1 * h_1))


def _answer(scene: Scene, request: Request) -> Response:
    """Return the response of what is chosen, or of the reference where a stand-in says that it missed the accuracy."""
    chosen = select(scene, request)
    found = _without_weak(scene, request, chosen.solver)
    if found is not None:
        return found
    if request.derivatives and not chosen.solver.derivatives:
        able = [f"{one.model} ({one.name})" for one in solvers() if one.derivatives]
        raise ValueError(
            f"derivatives: {chosen.solver.model} ({chosen.solver.name}) has none; {', '.join(able)} has, of a motion "
            "that nothing but the ball passages drives"
        )
    found = chosen.answer()
    if chosen.instead is None:
        return found
    found = judged(found, request)
    usable = found.status == "converged" or (found.status == "not_periodic" and not scene.repeats)
    return found if usable and found.error <= request.accuracy else chosen.instead.answer()


# Share of the accuracy that effects which are left out, or added, may have in all.
_LEFT_OUT = 1.0 / 3.0
# Relative change of the peak over that of the waveform, and change of the amplitude of a line over its RMS.
_OF_PEAK, _OF_LINE = 2.0, math.sqrt(2.0)
# A smaller line counts as none, m/s2.
_LEAST_LINE = 1e-300


def _without_weak(scene: Scene, request: Request, solver: Solver) -> Response | None:
    """Return the response without the effects of a scene that are too small to matter, None where they may matter.

    It is taken where another solver is cheaper without them, all that are left out together change what is asked for by
    a share of the accuracy at most, and the others can be added to it.
    """
    weak = weak_effects(solver.model)
    if weak is None or request.steps_per_period is not None or weak.names.isdisjoint(scene.effects):
        return None
    asked = replace(request, accuracy=(1.0 - _LEFT_OUT) * request.accuracy)
    try:
        lighter = weak.without(scene)
        plain = select(lighter, asked)
        # The first lines are those of the first defect's part.
        other_lines = request.quantity == "lines" and scene.first_part != lighter.first_part
        if other_lines or plain.solver.cost(lighter, asked) > WORTH * solver.cost(scene, request):
            return None
        found = plain.answer()
        if found.status != "converged":
            return None
        changes = weak.bounds(scene, found)
        small = _small(found, changes, request)
        others = [name for name in changes if name not in small]
        if others:
            left = replace(request, accuracy=_LEFT_OUT * request.accuracy - sum(small.values()))
            added = weak.add(scene, lighter, found, left, others)
            if added is None:
                return None
            named = ", ".join(EFFECTS[name] for name in others)
            why = f"{'' if found.why is None else f'{found.why}; '}added to it, with lines of their own: {named}"
            found = replace(added, why=why)
    except ValueError:
        return None
    found = judged(_leaving_out(found, changes, small, request) if small else found, request)
    return None if others and found.status == "inaccurate" else found


def _small(found: Response, changes: dict[str, EffectBound], request: Request) -> dict[str, float]:
    """Return the bounds of what is asked for of those effects that may be left out together, the smallest first."""
    line = _OF_LINE * found.rms / max(float(np.max(found.harmonics)), _LEAST_LINE)
    factor = {"waveform": 1.0, "lines": line}.get(request.quantity)
    names = sorted(changes, key=lambda name: (changes[name].wave, changes[name].rms))
    for count in range(len(names), 0, -1):
        waves = {name: changes[name] for name in names[:count]}
        parts = _of_rms(waves) if factor is None else {name: factor * one.wave for name, one in waves.items()}
        if sum(parts.values()) <= _LEFT_OUT * request.accuracy:
            return parts
    return {}


def _of_rms(changes: dict[str, EffectBound]) -> dict[str, float]:
    """Return what effects change of the RMS together: the square of a sum is at most their number times the squares."""
    return {name: min(change.wave, len(changes) * change.rms) for name, change in changes.items()}


def _leaving_out(
    found: Response, changes: dict[str, EffectBound], parts: dict[str, float], request: Request
) -> Response:
    """Return a response whose errors contain those of what it leaves out, with its ``parts`` of what is asked for."""
    left = {name: changes[name] for name in changes if name in parts}
    wave = sum(change.wave for change in left.values())
    of_what = _WORDS[request.quantity]
    names = ", ".join(f"{EFFECTS[name]} (at most {parts[name]:.1g} of the {of_what})" for name in left)
    harmonics_error = found.harmonics_error + _OF_LINE * wave * found.rms
    return replace(
        found,
        rms_error=found.rms_error + sum(_of_rms(left).values()),
        peak_error=found.peak_error + _OF_PEAK * wave,
        waveform_error=found.waveform_error + wave,
        harmonics_error=harmonics_error,
        lines_error=lines_error(found.harmonics, harmonics_error),
        left_out=tuple(LeftOut(name, parts[name]) for name in left),
        why=f"{'' if found.why is None else f'{found.why}; '}left out, as too small to matter: {names}",
    )
