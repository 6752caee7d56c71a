"""Parameters of each model for a bearing: the model's defaults, with what follows from the bearing's geometry."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from models.machine.contact_estimates import element_mass, estimate_stiffness
from models.machine.hertz import contact_exponent, in_series
from models.machine.rig import Rig
from models.solve.ball_inertia.rig import BallInertiaRig

if TYPE_CHECKING:
    from models.machine.bearing import CatalogueEntry
    from models.machine.rig import RigParameters


def nominal_rig(kind: type[RigParameters], entry: CatalogueEntry, **given: Any) -> RigParameters:
    """Return the parameters of a model for a bearing.

    Contact stiffness, rolling element and, of the six-degree-of-freedom model, its mass follow from the geometry.

    Args:
        kind: the type of the parameters.
        given: parameters by name that take precedence.

    Raises:
        ValueError: if the geometry does not give the contact stiffness, or a value is unusable.
    """
    known = {field.name: field for field in fields(kind)}
    values: dict[str, Any] = {}
    if "element" in known:
        values["element"] = entry.bearing.element
    if "k_c" in known and known["k_c"].default is not None:
        values["k_c"] = estimate_stiffness(entry).value
    if kind is Rig:
        values["m_b"] = element_mass(estimate_stiffness(entry).bearing)
    if kind is BallInertiaRig:
        # The contacts of both races, in the ratio of the model's own bearing, make the stiffness of the geometry.
        own = in_series(BallInertiaRig.k_ci, BallInertiaRig.k_co, contact_exponent(entry.bearing))
        share = estimate_stiffness(entry).value / own
        values |= {"k_ci": share * BallInertiaRig.k_ci, "k_co": share * BallInertiaRig.k_co}
    return kind(**(values | given))
