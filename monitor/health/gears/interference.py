"""The meshes of the gears beside a bearing, as lines that are removed before the envelope.

What stands around each harmonic of a mesh comes once in a turn of either wheel (eccentricity, unequal teeth): sidebands
of both, and their sums and differences.
"""

from __future__ import annotations

from monitor.health.gears.settings import GearSettings
from monitor.health.signal.interference import Interference

SIDEBANDS = 3
"""Steps of the turns of the wheels on either side of a harmonic."""
_SAME = 1e-6


def gear_interference(gears: GearSettings, tolerance: float = Interference.tolerance) -> tuple[Interference, ...]:
    """Return the lines of each mesh order, with sidebands of all wheels that mesh at it.

    Args:
        gears: wheels and pairs.
        tolerance: relative error of the speed of the bearing's shaft.
    """
    found: list[Interference] = []
    for order in gears.mesh_orders():
        names: list[str] = []
        turns: list[float] = []
        for pair in gears.pairs:
            if abs(gears.by_name[pair.driver].mesh_order / order - 1.0) > _SAME:
                continue
            for name in (pair.driver, pair.driven):
                wheel = gears.by_name[name]
                if name not in names:
                    names.append(name)
                if not any(abs(wheel.turns / other - 1.0) <= _SAME for other in turns):
                    turns.append(wheel.turns)
        found.append(
            Interference(
                orders=(order,),
                sidebands=SIDEBANDS,
                spacing=turns[0],
                tolerance=tolerance,
                name=f"gear {', '.join(names)}",
                beside=tuple(turns[1:]),
            )
        )
    return tuple(found)
