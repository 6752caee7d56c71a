"""The packages of the program, from the folder in which it is installed."""

from __future__ import annotations

import importlib.util
import sys
from importlib.machinery import PathFinder
from pathlib import Path

FLOORS = ("models", "streams", "monitor")


def import_own_floors() -> None:
    """Import the packages from beside this one, before a folder of the same name on ``sys.path`` is taken for them.

    Raises:
        ImportError: a module of one of these names that is not of this program has been imported before.
    """
    root = Path(__file__).resolve().parent.parent
    for name in FLOORS:
        loaded = sys.modules.get(name)
        if loaded is not None:
            place = Path(getattr(loaded, "__file__", None) or "unknown")
            if place.resolve().parent != root / name:
                raise ImportError(
                    f"spallwatch has a package {name!r} of its own, and {str(place)!r} is imported under that name; "
                    "import spallwatch first, or rename the other one"
                )
            continue
        spec = PathFinder.find_spec(name, [str(root)])
        if spec is None or spec.loader is None:
            raise ImportError(f"the package {name!r} of spallwatch is not in {str(root)!r}; install spallwatch again")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
