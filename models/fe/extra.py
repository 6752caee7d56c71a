"""The package of the extra ``fe``, scikit-fem: imported when it is used, and asked for where it is missing."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any

from models.words.errors import WrongInputError

INSTALL = 'pip install "spallwatch[fe]"'


class MissingExtraError(WrongInputError):
    """scikit-fem, or a package that it needs, is missing; the message says how to get it."""


def require_skfem() -> Any:
    """Return the module ``skfem``.

    Raises:
        MissingExtraError: scikit-fem cannot be imported.
    """
    try:
        return importlib.import_module("skfem")
    except ModuleNotFoundError as error:
        missing = "" if error.name == "skfem" else f" ({error.name} is missing)"
        raise MissingExtraError(f"finite elements need scikit-fem: {INSTALL}{missing}") from None


def has_extra() -> bool:
    """Return whether scikit-fem is installed, without importing it."""
    return importlib.util.find_spec("skfem") is not None
