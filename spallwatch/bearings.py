"""Bearings by designation, and their fault frequencies."""

from __future__ import annotations

from models.machine.bearing import Bearing, Kinematics, catalogue_entry, kinematics
from models.words.errors import WrongInputError


class BearingError(WrongInputError):
    """A bearing that is not in the catalogue; the message names those that are."""


def bearing(designation: str) -> Bearing:
    """Return a bearing of the catalogue, SI units.

    Suffixes such as ``6205-2RS/C3`` are understood. ``Bearing(...)`` describes any other one by its geometry.

    Raises:
        BearingError: it is not in the catalogue.
    """
    try:
        return catalogue_entry(designation).bearing
    except KeyError as error:
        raise BearingError(str(error.args[0])) from None


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
