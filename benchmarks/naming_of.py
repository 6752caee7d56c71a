"""What the program names from the features of one block, at the speed at which it sought the families."""

from __future__ import annotations

from dataclasses import asdict

from models.machine.bearing import Kinematics
from monitor.health.name.naming import Naming, name_fault
from monitor.health.signal.features import BlockFeatures


def namings_of(features: BlockFeatures, stated: Kinematics) -> tuple[Naming, ...]:
    """Return the name in each band; ``stated`` are the frequencies at the stated speed."""
    factor = 1.0 if features.speed is None else features.speed / stated.speed
    lines = Kinematics(**{name: value * factor for name, value in asdict(stated).items()})
    return tuple(
        name_fault(spectrum, lines, families, verified=features.shaft is not None)
        for spectrum, families in zip(features.sought, features.families, strict=True)
    )
