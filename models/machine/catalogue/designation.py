"""Designations of bearings: base number and suffixes, in the spellings that makers and users have."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from collections.abc import Mapping

Family = Literal["deep_groove", "angular_contact", "self_aligning", "cylindrical", "tapered", "spherical"]
ClearanceClass = Literal["C2", "N", "C3", "C4", "C5"]
Design = Literal["reinforced", "count", "narrow"]

BALLS: tuple[Family, ...] = ("deep_groove", "angular_contact", "self_aligning")
ROLLERS: tuple[Family, ...] = ("cylindrical", "tapered", "spherical")

_SEPARATORS = re.compile(r"[\s\-/._,]+")
_MAKERS = re.compile(r"^(SKF|FAG|INA|NSK|NTN|SNR|KOYO|NACHI|TIMKEN|NKE|ZKL|FBJ|NMB|ZVL)(?=[A-Z]{0,2}\d)")
_THIN_SECTIONS = re.compile(r"^6([89])(\d\d)")
"""68xx and 69xx, the Japanese numbers of 618xx and 619xx."""
_PREFIX = re.compile(r"^(NU|NJ)?(\d+)")


@dataclass(frozen=True)
class Suffix:
    """A suffix as it was written, and what it means for this family.

    Attributes:
        design: "reinforced": another internal design; "count": the number of elements is less certain; "narrow": the
            internal geometry of the narrower series (12 of 22, 13 of 23).
        angle_deg: contact angle that it sets, or None.
        clearance: class of radial clearance, or None.
    """

    text: str
    meaning: str
    design: Design | None = None
    angle_deg: float | None = None
    clearance: ClearanceClass | None = None


@dataclass(frozen=True)
class Designation:
    """A designation taken apart: the base number, such as "6205" or "NU205", and its suffixes in order."""

    base: str
    family: Family
    suffixes: tuple[Suffix, ...] = ()

    @property
    def clearance_class(self) -> ClearanceClass:
        """Class that a suffix states; N where none does."""
        stated: list[ClearanceClass] = [suffix.clearance for suffix in self.suffixes if suffix.clearance is not None]
        return stated[0] if stated else "N"


def compact(text: str) -> str:
    """Return a designation in capitals without separators and maker, by which spellings are compared."""
    return _MAKERS.sub("", _SEPARATORS.sub("", text.upper()))


def parse(text: str, families: Mapping[str, Family]) -> Designation:
    """Take a designation apart.

    Args:
        families: the known base numbers and their families.

    Raises:
        LookupError: if no base number is known.
        ValueError: if a suffix is unknown; the message names it and those that are known for the family.
    """
    written = _THIN_SECTIONS.sub(r"61\1\2", compact(text)) if _is_thin_section(text) else compact(text)
    found = _PREFIX.match(written)
    if found is not None:
        prefix, digits = found[1] or "", found[2]
        for length in range(len(digits), 2, -1):
            base = prefix + digits[:length]
            if base in families:
                rest = written[len(base) :]
                return Designation(base, families[base], _suffixes(text, rest, families[base]))
    raise LookupError(text)


def _is_thin_section(text: str) -> bool:
    first = _SEPARATORS.split(text.strip().upper())[0]
    return _THIN_SECTIONS.match(first) is not None


def _suffixes(text: str, rest: str, family: Family) -> tuple[Suffix, ...]:
    """Return the suffixes that make up ``rest``, the longest at each place first, or with fewer parts where that fails.

    Raises:
        ValueError: if a part is unknown.
    """
    known = suffixes(family)
    stack: list[tuple[int, tuple[Suffix, ...]]] = [(0, ())]
    furthest = 0
    while stack:
        place, taken = stack.pop()
        if place == len(rest):
            return taken
        furthest = max(furthest, place)
        fitting = [suffix for suffix in known if rest.startswith(suffix, place)]
        stack.extend((place + len(name), (*taken, known[name])) for name in sorted(fitting, key=len))
    raise ValueError(
        f"bearing {text!r}: unknown suffix {rest[furthest:]!r}; known for {family.replace('_', ' ')} bearings are: "
        f"{', '.join(sorted(known))}"
    )


@cache
def suffixes(family: Family) -> dict[str, Suffix]:
    """Return the suffixes that bearings of a family have, by their text."""
    table = tomllib.loads(
        resources.files("models.machine.catalogue").joinpath("suffixes.toml").read_text(encoding="utf-8")
    )
    found: dict[str, Suffix] = {}
    for entry in table["suffix"]:
        if family not in entry.get("families", (family,)):
            continue
        for text in entry["texts"]:
            suffix = Suffix(text, entry["meaning"], entry.get("design"), entry.get("angle_deg"), entry.get("clearance"))
            found.setdefault(compact(text), suffix)
    return found
