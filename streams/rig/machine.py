"""The machine that a simulated rig is: its model, its bearing, and in what it differs from the bench of the thesis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

from models.machine.bearing import Bearing, CatalogueEntry, catalogue_entry, from_catalogue
from models.machine.rig import Rig, RigParameters
from models.solve.nominal_rigs import nominal_rig
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.solve.response import CASING
from models.words.request import Sensor

BEARING = "1205 ETN9"
"""The bearing of the bench."""
RADIAL_BEARING = "6205"
"""One with the same bore, for models that do not take the contact angle of the bench's."""


@dataclass(frozen=True)
class Machine:
    """What a rig simulates.

    Attributes:
        nominal: parameters from which the true ones deviate; they name the model.
        bearing: that wears out.
        sensor: of the model, whose acceleration the accelerometer shows, or None for the model's first.
        gain: share of that acceleration which reaches the accelerometer.
    """

    nominal: RigParameters
    bearing: Bearing
    sensor: Sensor | None = None
    gain: float = 1.0

    @property
    def model(self) -> str:
        """Name of the model."""
        return self.nominal.model

    @property
    def is_bench(self) -> bool:
        """Whether it is the bench of the thesis."""
        return self == Machine(Rig(), from_catalogue(BEARING))

    @cached_property
    def effects(self) -> frozenset[str]:
        """What the model describes, names in ``models.machine.scene.EFFECTS``."""
        from models.solve.registry import solvers

        return frozenset().union(*(solver.effects for solver in solvers(self.model)))

    def limits(self, sensor: Sensor) -> Iterator[str]:
        """Yield what is different from the bench of the thesis, in sentences; ``sensor`` is the one that is shown."""
        if self.bearing.designation != BEARING:
            yield f"its bearing is a {self.bearing.designation}"
        if sensor not in CASING:
            yield f"its accelerometer shows sensor {sensor} of {self.model}, which has no casing"
        if "rough_floor" not in self.effects:
            yield "the floor of its defect is smooth"
        if self.model in IGNORES_DEPTH:
            yield f"no map gives its V_eq: {IGNORES_DEPTH[self.model]}"


def machine_of(
    model: str = Rig.model, bearing: str | None = None, sensor: Sensor | None = None, gain: float = 1.0
) -> Machine:
    """Return a machine by the name of its model and the designation of its bearing.

    Without a designation the bearing is that of the bench, or ``RADIAL_BEARING`` where the model does not take it.

    Raises:
        ValueError: model or bearing are unknown, or the model does not take the bearing.
    """
    if model not in RIGS:
        raise ValueError(f"unknown model {model!r}; known are: {', '.join(RIGS)}")
    kind = RIGS[model]
    if bearing is None:
        bearing = BEARING if _refusal(kind, catalogue_entry(BEARING)) is None else RADIAL_BEARING
    try:
        entry = catalogue_entry(bearing)
    except KeyError as error:
        raise ValueError(f"bearing: {error.args[0]}") from None
    if (refusal := _refusal(kind, entry)) is not None:
        others = ", ".join(name for name, other in RIGS.items() if _refusal(other, entry) is None)
        raise ValueError(f"{refusal}; models that take it: {others or 'none'}")
    own = kind is Rig and entry.bearing.designation == BEARING
    return Machine(Rig() if own else nominal_rig(kind, entry), entry.bearing, sensor, gain)


def _refusal(kind: type[RigParameters], entry: CatalogueEntry) -> str | None:
    """Return why a model does not take a bearing, None where it does."""
    try:
        nominal_rig(kind, entry).check_bearing(entry.bearing)
    except ValueError as error:
        return str(error)
    return None
