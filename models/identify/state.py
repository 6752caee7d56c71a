"""Candidates that were simulated, kept in a file: a run that was stopped takes them from there and repeats the rest.

The search depends on its seed and on what the candidates gave, nothing else. So a resumed run takes the same way, and
ends with the same result as one that was not stopped.
"""

from __future__ import annotations

import os
import time
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.identify.evaluate import Evaluator, Key, Level
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

SAVE_EVERY_S = 20.0


class StateFile:
    """The state file of one identification."""

    def __init__(self, path: Path, problem: str) -> None:
        """``problem`` is a hash of all that the result depends on: a file of another problem is refused."""
        self._path, self._problem = path, problem
        self._part = path.with_name(path.name + ".part")
        self._saved = time.monotonic()

    def load(self) -> dict[Key, Level]:
        """Return what an earlier run found, nothing where there is no file.

        Raises:
            WrongInputError: the file is of another problem, or damaged; the message names it.
        """
        if not self._path.exists():
            return {}
        try:
            with np.load(self._path, allow_pickle=False) as file:
                problem = str(file["problem"])
                arrays = [np.asarray(file[name], dtype=np.float64) for name in ("keys", "features", "doubt")]
        except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
            raise WrongInputError(f"{self._path}: is no state of an identification ({error}); delete it") from None
        if problem != self._problem:
            raise WrongInputError(
                f"{self._path}: is the state of another identification: tests, configuration, options or the "
                "program have changed; delete it, or leave --resume out"
            )
        keys, features, doubt = arrays
        return {tuple(key): Level(f, d) for key, f, d in zip(keys.tolist(), features, doubt, strict=True)}

    def save_sometimes(self, evaluator: Evaluator) -> None:
        """Save what an evaluator has found, if the last time is long ago."""
        if time.monotonic() - self._saved >= SAVE_EVERY_S:
            self.save(evaluator)

    def save(self, evaluator: Evaluator) -> None:
        """Replace the file in one step by what an evaluator has found."""
        keys: NDArray[np.float64] = np.array(list(evaluator.kept))
        with self._part.open("wb") as file:
            np.savez(
                file,
                problem=np.array(self._problem),
                keys=keys,
                features=np.array([level.features for level in evaluator.kept.values()]),
                doubt=np.array([level.doubt for level in evaluator.kept.values()]),
            )
            file.flush()
            os.fsync(file.fileno())
        self._part.replace(self._path)
        self._saved = time.monotonic()

    def remove(self) -> None:
        """Remove the file, and what a killed process left half written."""
        self._path.unlink(missing_ok=True)
        self._part.unlink(missing_ok=True)
