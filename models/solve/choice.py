"""Which model answers for a scene: the reference, or a cheaper one that is predicted to be good enough for the request.

The reference is the cheapest solver, among those that leave out nothing of the machine, that takes the parameters of
the scene and meets the accuracy (``models.solve.registry.choose``). A mapping (``models.solve.mappings``) offers what
stands for it, where the assumptions of both coincide. It is taken if it is cheaper and the predicted error of the
exchange leaves the steps a share of the accuracy; otherwise the reference answers. So it does where what was taken says
that it missed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from models.solve.mappings.mapping import Mapped, Mapping
from models.solve.mappings.table import MAPPINGS
from models.solve.registry import AUTO, Solver, choose_priced, solvers
from models.words.request import Request

if TYPE_CHECKING:
    from models.machine.scene import Scene
    from models.solve.response import Response
    from models.words.request import Sensor

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
        missed = found.status == "not_periodic" and not found.error <= self.request.accuracy + self.error
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
    reference, why, cost = choose_priced(scene, request)
    plain = Choice(reference, scene, request, why)
    if scene.model != AUTO or request.steps_per_period is not None or reference.error > request.accuracy:
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
