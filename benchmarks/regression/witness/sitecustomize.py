"""Log from where every process of a case imports the product; Python runs this module at its start."""

import os
import sys
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path

# Where there is a spallwatch, it imports the others itself, from beside it.
PACKAGES = ("models", "monitor", "streams", "spallwatch")


class Witness:
    """A finder that finds nothing and writes a line for each package of the product: process and file."""

    @staticmethod
    def find_spec(name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Log what the next finder will find."""
        if name in PACKAGES:
            found = PathFinder.find_spec(name)
            with suppress(OSError), Path(os.environ["REGRESSION_IMPORTS"]).open("a", encoding="utf-8") as log:
                log.write(f"{os.getpid()} {found and found.origin}\n")
        return None


sys.meta_path.insert(0, Witness)
