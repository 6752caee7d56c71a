"""Draws of the uncertain parameters of a rig: the posterior of an identification, and its file.

The hash of the identification is that of the text of the file, so that a file that was edited or belongs to another
identification is told from the right one by the hash that ``[rig]`` holds.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from models.machine.rig import Rig
from models.words.errors import WrongInputError

CLEARANCE = "clearance"
"""The radial clearance, m: the one parameter that is not a field of ``Rig``."""
# Significant digits in the file; what is drawn is rounded to them first.
_DIGITS = 12
_SAME = 1e-9
_TITLE = "# posterior of a rig (SI): equally likely draws, one a line; a changed file is refused"
_HASH = "# identification "
_NAMES = (*(f.name for f in fields(Rig) if f.name not in ("element", "calibrated", "identification")), CLEARANCE)


class PosteriorError(WrongInputError, ValueError):
    """Draws of a rig, or their file, cannot be used; the message says why."""


@dataclass(frozen=True)
class RigDraws:
    """Equally likely values of the uncertain parameters of a rig, SI.

    Attributes:
        identification: hash of the identification whose posterior they are drawn from.
        names: of the parameters: fields of ``Rig``, or "clearance", m.
        rows: their values, a row per draw, in random order: the first of them are draws as good as all.
    """

    identification: str
    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        """Raise a PosteriorError for names that are no parameters, or rows that are no numbers for them."""
        wrong = [name for name in self.names if name not in _NAMES]
        if wrong or not self.names or len(set(self.names)) < len(self.names):
            raise PosteriorError(f"parameters of a posterior: expected some of {', '.join(_NAMES)}, got {self.names!r}")
        if not self.rows or any(len(row) != len(self.names) or not all(map(math.isfinite, row)) for row in self.rows):
            raise PosteriorError(f"a posterior needs rows of {len(self.names)} finite numbers")

    @classmethod
    def from_dict(cls, data: Mapping[str, Any] | None) -> RigDraws | None:
        """Return the draws whose fields JSON gave back, None for None."""
        if data is None:
            return None
        rows = tuple(tuple(float(value) for value in row) for row in data["rows"])
        return cls(str(data["identification"]), tuple(data["names"]), rows)

    def first(self, count: int) -> RigDraws:
        """Return the first draws; PosteriorError where there are not so many."""
        if count > len(self.rows):
            raise PosteriorError(f"the posterior has {len(self.rows)} draws, asked for {count}")
        return replace(self, rows=self.rows[:count])

    def rig(self, rig: Rig, number: int) -> Rig:
        """Return a rig with the parameters of a draw."""
        drawn = dict(zip(self.names, self.rows[number], strict=True))
        drawn.pop(CLEARANCE, None)
        return replace(rig, **drawn)

    def clearance(self, otherwise: float, number: int) -> float:
        """Return the clearance of a draw, m, ``otherwise`` where it is not among the parameters."""
        return dict(zip(self.names, self.rows[number], strict=True)).get(CLEARANCE, otherwise)

    def check(self, rig: Rig) -> None:
        """Raise a PosteriorError unless a rig is the one that was identified, by the hash that it bears."""
        if not (rig.identification and self.identification.startswith(rig.identification.removeprefix("sha256:"))):
            raise PosteriorError(
                f"the posterior is of identification {self.identification[:16]}, "
                f"the rig of {rig.identification[:23] or 'none'}"
            )


@dataclass(frozen=True)
class RigPosterior:
    """The posterior of an identification as its file holds it, SI.

    Attributes:
        best: (name, value) of all parameters at the best fit, the known ones too.
        names, rows: as in ``RigDraws``.
        result: hash of tests, space and result.
        effective: effective number of independent candidates that the draws come from.
        candidates: that were simulated for them.
    """

    best: tuple[tuple[str, float], ...]
    names: tuple[str, ...]
    rows: tuple[tuple[float, ...], ...]
    result: str
    effective: float
    candidates: int

    @cached_property
    def identification(self) -> str:
        """SHA-256 of the text of the file, hexadecimal."""
        return hashlib.sha256("\n".join(self._lines()).encode()).hexdigest()

    @property
    def draws(self) -> RigDraws:
        """The draws with the hash of the identification."""
        return RigDraws(self.identification, self.names, self.rows)

    def text(self) -> str:
        """Return the text of the file."""
        return "\n".join([f"{_HASH}{self.identification}", *self._lines(), ""])

    def _lines(self) -> Iterator[str]:
        yield _TITLE
        yield f"# tests and result {self.result}"
        yield f"# effective {self.effective:.1f} of {self.candidates} candidates"
        yield "# best " + " ".join(f"{name}={_text(value)}" for name, value in self.best)
        yield ",".join(self.names)
        for row in self.rows:
            yield ",".join(map(_text, row))

    def differences(self, rig: Rig, clearance: float) -> list[str]:
        """Return in words which parameters of a rig are not those of the best fit; SI.

        The clearance, m, which belongs to the bearing, counts only where it was identified.
        """
        found: list[str] = []
        for name, value in self.best:
            if name == CLEARANCE and name not in self.names:
                continue
            given = clearance if name == CLEARANCE else float(getattr(rig, name))
            if not math.isclose(given, value, rel_tol=_SAME, abs_tol=1e-15):
                found.append(f"{name} is {given:.12g}, identified was {value:.12g}")
        return found


def rounded(value: float) -> float:
    """Return a number as the file of a posterior holds it."""
    return float(_text(value))


def _text(value: float) -> str:
    return f"{value:.{_DIGITS}g}"


def read_posterior(path: Path) -> RigPosterior:
    """Return the posterior in a file.

    Raises:
        PosteriorError: it cannot be read, is no posterior, or was changed since it was written.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise PosteriorError(f"{path}: cannot be read: {error}") from None
    try:
        found = _parse(lines)
        found.draws.check(Rig(calibrated=True, identification=lines[0].removeprefix(_HASH)))
    except (ValueError, IndexError, StopIteration) as error:
        raise PosteriorError(
            f"{path}: is not the posterior that was written, or was changed; run identify again ({error})"
        ) from None
    return found


def _parse(lines: list[str]) -> RigPosterior:
    """Return what the lines of a file say; a ValueError or IndexError where they are of another form."""
    if not lines[0].startswith(_HASH) or lines[1] != _TITLE:
        raise PosteriorError("its first lines are not those of a posterior")
    effective, _, candidates = lines[3].removeprefix("# effective ").removesuffix(" candidates").split(" ")
    best = (item.split("=") for item in lines[4].removeprefix("# best ").split(" "))
    return RigPosterior(
        best=tuple((name, float(value)) for name, value in best),
        names=tuple(lines[5].split(",")),
        rows=tuple(tuple(float(value) for value in line.split(",")) for line in lines[6:]),
        result=lines[2].removeprefix("# tests and result "),
        effective=float(effective),
        candidates=int(candidates),
    )


def without_draws(data: dict[str, Any], draws: RigDraws | None) -> dict[str, Any]:
    """Return the fields of a plan or population for JSON: without draws, as before there were any, by their hash."""
    rest = {name: value for name, value in data.items() if name != "rig_posterior"}
    return rest if draws is None else rest | {"rig_posterior": asdict(draws)}
