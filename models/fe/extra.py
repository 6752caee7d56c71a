"""The packages of the extra ``fe``: scikit-fem for all finite elements, gmsh for tetrahedra alone.

They are imported when they are used; what cannot be imported is said with the command that installs it.
"""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from models.words.errors import WrongInputError

INSTALL = 'pip install "spallwatch[fe]"'


class MissingExtraError(WrongInputError):
    """A package of the extra ``fe``, or a system library that it needs, is missing; the message says how to get it."""


def require_skfem() -> Any:
    """Return the module ``skfem``.

    Raises:
        MissingExtraError: scikit-fem cannot be imported.
    """
    return _module("skfem", "finite elements need scikit-fem")


def require_gmsh() -> Any:
    """Return the module ``gmsh``, which makes tetrahedra (GPL; nothing else needs it).

    Raises:
        MissingExtraError: it is not installed, or a system library that it loads (libGLU, libXft) is missing.
    """
    return _module("gmsh", "tetrahedra need gmsh")


def has_extra() -> bool:
    """Return whether scikit-fem is installed, without importing it."""
    return importlib.util.find_spec("skfem") is not None


def _module(name: str, need: str) -> Any:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = "" if error.name == name else f" ({error.name} is missing)"
        raise MissingExtraError(f"{need}: {INSTALL}{missing}") from None
    except OSError as error:
        # ctypes loads a library of the system: "libGLU.so.1: cannot open shared object file".
        raise MissingExtraError(
            f"{need}, which is installed, but a library of the system is missing ({error}); "
            "on Debian and Ubuntu: apt-get install libglu1-mesa libxft2 libxcursor1 libxinerama1"
        ) from None
