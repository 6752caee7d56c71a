"""Sets of modes at named places, measured or computed, and how far they agree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    # Real or complex.
    Shapes = NDArray[Any]


@dataclass(frozen=True, eq=False)
class ModeSet:
    """Modes in ascending order of frequency.

    Attributes:
        frequency: Hz, shape (modes,).
        names: of places and directions, ``POINT.x`` ...
        shapes: displacements to any scale, shape (names, modes), complex.
        damping: shares of critical damping, shape (modes,), NaN where not known.
    """

    frequency: Array
    names: tuple[str, ...]
    shapes: NDArray[np.complex128]
    damping: Array

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        frequency = np.asarray(self.frequency, np.float64)
        shapes, damping = np.asarray(self.shapes, np.complex128), np.asarray(self.damping, np.float64)
        for field, value in (("frequency", frequency), ("shapes", shapes), ("damping", damping)):
            object.__setattr__(self, field, value)
        if frequency.ndim != 1 or not frequency.size or not (np.diff(frequency, prepend=0.0) >= 0.0).all():
            raise ValueError(f"frequency must be one or more ascending numbers above 0 Hz, got {frequency.tolist()!r}")
        if len(set(self.names)) < len(self.names) or not self.names:
            raise ValueError(f"names must be given, each once, got {self.names!r}")
        if shapes.shape != (len(self.names), frequency.size) or damping.shape != frequency.shape:
            raise ValueError(
                f"shapes must have shape (names, modes) = {(len(self.names), frequency.size)} and damping (modes,), "
                f"got {shapes.shape} and {damping.shape}"
            )
        if not np.isfinite(shapes).all():
            raise ValueError("shapes must be finite")


@dataclass(frozen=True)
class ModePair:
    """A given mode and the computed one that agrees with it best.

    Attributes:
        given, computed: their numbers, from 0 on.
        given_frequency, computed_frequency: Hz.
        assurance: modal assurance criterion of the two, from 0 to 1.
    """

    given: int
    computed: int
    given_frequency: float
    computed_frequency: float
    assurance: float

    @property
    def difference(self) -> float:
        """Difference of the frequencies, of the given one."""
        return self.computed_frequency / self.given_frequency - 1.0


def assurance(first: Shapes, second: Shapes) -> Array:
    """Return the modal assurance criterion of two sets of shapes at the same places, shape (first, second).

    |a* b|^2 / (a* a b* b) with a* the conjugate transpose (Allemang and Brown, Proc. IMAC 1 (1982) 110).

    Args:
        first, second: shapes (places and directions, modes).

    Raises:
        ValueError: the places differ, or a shape is zero throughout.
    """
    if first.shape[0] != second.shape[0]:
        raise ValueError(f"shapes must be at the same places, got {first.shape[0]} and {second.shape[0]}")
    sizes = [np.sum(np.abs(shapes) ** 2, axis=0) for shapes in (first, second)]
    if not all(size.all() for size in sizes):
        raise ValueError("a shape is zero at all places")
    return np.asarray(np.abs(first.conj().T @ second) ** 2 / np.outer(*sizes), np.float64)


def paired(given: ModeSet, computed: ModeSet, band: float = 0.3) -> list[ModePair | None]:
    """Return for each given mode the computed one with the highest assurance among those near it in frequency.

    A computed mode may be the best of two given ones: where they are hard to tell apart, the assurance says so.

    Args:
        band: largest difference of the frequencies, of the given one; None stands for a mode without any in it.

    Raises:
        ValueError: the computed set lacks a name of the given one.
    """
    shapes = computed.shapes[_rows(computed.names, given.names)]
    # A mode with a node at each of the places agrees with none.
    moving = np.asarray(np.abs(shapes).any(axis=0), np.bool_)
    match = np.zeros((len(given.frequency), len(moving)))
    match[:, moving] = assurance(given.shapes, shapes[:, moving])
    found: list[ModePair | None] = []
    for number, frequency in enumerate(given.frequency.tolist()):
        near = np.abs(computed.frequency / frequency - 1.0) <= band
        if not near.any():
            found.append(None)
            continue
        best = int(np.argmax(np.where(near, match[number], -1.0)))
        found.append(ModePair(number, best, frequency, float(computed.frequency[best]), float(match[number, best])))
    return found


def _rows(known: tuple[str, ...], wanted: Sequence[str]) -> list[int]:
    missing = [name for name in wanted if name not in known]
    if missing:
        raise ValueError(f"modes are not computed at {missing[0]!r}; there are {', '.join(known[:20])}")
    return [known.index(name) for name in wanted]
