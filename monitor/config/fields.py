"""The base of all sections, and the types that their keys share."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from models.words.errors import WrongInputError

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1, le=100000)]
Blocks = Annotated[int, Field(ge=1, le=1000)]
NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
Band = tuple[NotNegative, Positive]
_LETTERS = {"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"}


def _check_scale(value: float) -> float:
    if not math.isfinite(value) or value == 0.0:
        raise ValueError("must be a finite number other than 0")
    return value


Scale = Annotated[float, AfterValidator(_check_scale)]


class LocatedError(WrongInputError, ValueError):
    """Several problems of one table: each with its place below the table, and what was expected and what came."""

    def __init__(self, problems: Sequence[tuple[tuple[str | int, ...], str]]) -> None:
        """Keep the problems; the message has one line for each."""
        super().__init__("\n".join(text for _, text in problems))
        self.problems = tuple(problems)


class ConfigSection(BaseModel):
    """A table of the configuration: frozen, and unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, str_strip_whitespace=True)

    def with_absolute_paths(self, folder: Path) -> Self:
        """Return a copy in which relative paths, also those of sections inside, are taken from ``folder``.

        Keys without a path stay given or not: ``model_fields_set`` holds those of the file.
        """
        moved = {key: _absolute(value, folder) for key, value in self}
        given = self.model_fields_set
        return self.model_copy(update={k: v for k, v in moved.items() if k in given or v != getattr(self, k)})


def _absolute(value: Any, folder: Path) -> Any:
    if isinstance(value, Path):
        return folder / value
    if isinstance(value, ConfigSection):
        return value.with_absolute_paths(folder)
    return tuple(_absolute(item, folder) for item in value) if isinstance(value, tuple) else value


def plain_name(title: str) -> str:
    """Return a name that the configuration takes for what a file calls it, "" where nothing is left of it."""
    for letter, plain in _LETTERS.items():
        title = title.replace(letter, plain)
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", title).strip("_.-")[:56]
