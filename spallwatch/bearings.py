"""Bearings by designation, their fault frequencies, and their stiffness by finite elements."""

from __future__ import annotations

from typing import TYPE_CHECKING

from models.machine.bearing import Bearing, CatalogueEntry, Kinematics, catalogue_entry, kinematics
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    import xarray as xr

    from models.fe.bearings.rings import Support
    from models.fe.meshes.sizing import MeshName


class BearingError(WrongInputError):
    """A bearing that is not in the catalogue; the message names those that are."""


def bearing(designation: str) -> Bearing:
    """Return a bearing of the catalogue, SI units.

    Suffixes such as ``6205-2RS/C3`` are understood. ``Bearing(...)`` describes any other one by its geometry.

    Raises:
        BearingError: it is not in the catalogue.
    """
    return _catalogue_entry(designation).bearing


def fault_frequencies(bearing: Bearing | str, speed_hz: float) -> Kinematics:
    """Return the kinematic frequencies of pure rolling, Hz: ``bpfo``, ``bpfi``, ``bsf``, ``ftf``.

    A damaged ball shows at twice ``bsf``. Source: Gabrielli's thesis, Eqs. 33 and 81.

    Args:
        bearing: geometry or designation.
        speed_hz: of the shaft.

    Raises:
        BearingError: the designation is not in the catalogue.
        ValueError: the speed is not positive.
    """
    return kinematics(as_bearing(bearing), speed_hz)


def as_bearing(given: Bearing | str) -> Bearing:
    """Return the geometry of a bearing that is given by it or by its designation; raises as ``bearing``."""
    return bearing(given) if isinstance(given, str) else given


def fe_stiffness(
    bearing: Bearing | str,
    *,
    load_newton: float,
    clearance_um: float = 0.0,
    support: Support = "rigid-shaft",
    mesh: MeshName = "default",
    dimensions_mm: tuple[float, float, float] | None = None,
    memory_gb: float | None = None,
    use_cache: bool = True,
) -> xr.Dataset:
    """Return what finite elements say of a bearing under a radial load; SI units, which attributes name.

    Stiffness over one spacing of the elements, (cage_angle, axis, axis_of_force), axis "along" or "across" the load;
    loads of the elements with one of them under the load; means over the spacing against the load. The first call for
    a bearing takes a minute or so and needs the extra ``fe``; later ones take the kept results.

    Args:
        bearing: geometry or designation.
        load_newton: radial load.
        clearance_um: radial clearance.
        support: what carries the inner ring.
        mesh: size of the elements by the width of the contact.
        dimensions_mm: bore, outside diameter and width, where the bearing is given by its geometry.
        memory_gb: most memory of this process.
        use_cache: whether results are kept and kept ones used.

    Raises:
        BearingError: the designation is not in the catalogue.
        WrongInputError: the extra is missing, a dimension unknown, the kind of bearing not modelled, or the memory too
            small; the message says which.
    """
    import numpy as np
    import xarray as xr

    from monitor.fe.command import FeOptions, fe_case
    from monitor.fe.values import contact_pressures, law_values, status_of

    for name, value in (("load_newton", load_newton), ("memory_gb", memory_gb)):
        if value is not None and not value > 0.0:
            raise WrongInputError(f"{name} must be positive, got {value!r}")
    options = FeOptions(support, mesh, memory_gb, use_cache)
    case = fe_case(_entry(bearing, dimensions_mm), load_newton, 1e-6 * clearance_um, options)
    first = case.first
    axes = ["along", "across"]
    pressures = contact_pressures(case)
    return xr.Dataset(
        {
            "stiffness": (("cage_angle", "axis", "axis_of_force"), case.passage.matrix, {"units": "N m-1"}),
            "mean_stiffness": (("load", "axis", "axis_of_force"), case.stiffness, {"units": "N m-1"}),
            "mean_displacement": (
                "load",
                case.displacement,
                {"units": "m", "long_name": "along the load"},
            ),
            "element_load": ("element", first.loads, {"units": "N"}),
            "pressure": (
                "race",
                [pressures[race] for race in pressures],
                {"units": "Pa", "long_name": "in the middle"},
            ),
        },
        {
            "cage_angle": ("cage_angle", case.passage.cage_angle, {"units": "rad"}),
            "axis": axes,
            "axis_of_force": axes,
            "load": ("load", np.array(case.loads), {"units": "N"}),
            "element_angle": ("element", first.angles, {"units": "rad", "long_name": "from the load"}),
            "race": list(pressures),
        },
        {
            "status": status_of(case.passage),
            "mesh_error": first.mesh_error,
            "displacement_m": float(first.displacement[0]),
            "support": support,
            "mesh": mesh,
            "estimated": ", ".join(case.estimated),
            **law_values(case, float(first.loads.max())),
        },
    )


def _catalogue_entry(designation: str) -> CatalogueEntry:
    try:
        return catalogue_entry(designation)
    except KeyError as error:
        raise BearingError(str(error.args[0])) from None


def _entry(bearing: Bearing | str, dimensions_mm: tuple[float, float, float] | None) -> CatalogueEntry:
    if isinstance(bearing, str):
        return _catalogue_entry(bearing)
    if dimensions_mm is None:
        return CatalogueEntry(bearing, {}, ((bearing.n_elements, 1.0),))
    bore, outside, width = (1e-3 * value for value in dimensions_mm)
    return CatalogueEntry(bearing, {}, ((bearing.n_elements, 1.0),), dimensions=(bore, outside, width))
