"""Modes of a casing, their damping, and frequency responses by superposition with the static part of what is left out.

A response of displacement over force is the sum of b_o'phi phi'b_i / (w_r^2 - w^2 + 2 i zeta_r w_r w) over the modes
with phi' M phi = 1, plus b_o' K^-1 b_i minus the same sum at w = 0, which is what the modes left out give at rest: the
error of each of them then is (w / w_r)^2 of its share instead of all of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from models.fe.solid.elastic import NotConvergedError
from models.gears.transfer.frf import MOTION_UNITS, FrequencyResponses

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.fe.solid.sparse import SparseMatrix

    Array = NDArray[np.float64]
_BLOCK = 12
# An eigenvalue of the inverse is known when its remainder is less than this share of it.
_CONVERGED = 1e-9
# Of the length of a block's vectors: what is left below it is rounding.
_DEPENDENT = 1e-12


def lowest_eigenpairs(
    mass: SparseMatrix,
    solve: Callable[[Array], Array],
    enough: Callable[[Array], bool],
    most: int,
) -> tuple[Array, Array]:
    """Return the least eigenvalues, ascending, and their vectors (unknowns, values) with x' M x = 1.

    The start is the same each time, so is the result.

    Args:
        solve: K^-1 times columns.
        enough: whether the eigenvalues found, ascending and without a gap, suffice.
        most: largest number of vectors of the basis.

    Raises:
        NotConvergedError: the basis is full before there are enough.
    """
    size = int(mass.shape[0])
    start = np.random.default_rng(0).standard_normal((size, min(_BLOCK, size)))
    start = solve(np.asarray(mass @ start, np.float64))
    block, _ = _orthonormal(start, mass, _squares(start, mass))
    basis, weighted = block, np.asarray(mass @ block, np.float64)
    projected = np.zeros((0, 0))
    while True:
        first = basis.shape[1] - block.shape[1]
        image = solve(weighted[:, first:])
        columns = weighted.T @ image
        projected = _bordered(projected, columns)
        scale = _squares(image, mass)
        # Twice is enough (Giraud, Langou and Rozloznik 2005).
        for _ in range(2):
            image -= basis @ (weighted.T @ image)
        block, coupling = _orthonormal(image, mass, scale)
        theta, parts = np.linalg.eigh(projected)
        theta, parts = theta[::-1], parts[:, ::-1]
        remainder = np.linalg.norm(coupling @ parts[first:], axis=0)
        known = int(np.argmin(np.append(remainder <= _CONVERGED * theta, False)))
        whole = block.shape[1] == 0
        if enough(1.0 / theta[:known]) or whole:
            return 1.0 / theta[:known], basis @ parts[:, :known]
        if basis.shape[1] + block.shape[1] > most:
            raise NotConvergedError(f"the casing: {known} modes found with {basis.shape[1]} vectors, more are needed")
        basis = np.concatenate((basis, block), axis=1)
        weighted = np.concatenate((weighted, np.asarray(mass @ block, np.float64)), axis=1)


def _bordered(matrix: Array, columns: Array) -> Array:
    """Return a symmetric matrix grown by its last columns."""
    grown = np.zeros((len(columns), len(columns)))
    before = len(matrix)
    grown[:before, :before] = matrix
    grown[:, before:] = columns
    grown[before:] = columns.T
    corner = columns[before:]
    grown[before:, before:] = 0.5 * (corner + corner.T)
    return grown


def _orthonormal(block: Array, mass: SparseMatrix, scale: Array) -> tuple[Array, Array]:
    """Return Q and R of block = Q R with Q' M Q = 1; columns that depend on others are left out of Q.

    ``scale``: squared lengths that the columns had before the basis was taken from them.
    """
    lengths = np.sqrt(_squares(block, mass))
    kept = lengths > _DEPENDENT * np.sqrt(scale)
    found: Array = block[:, kept] / lengths[kept]
    right: Array = np.diag(lengths)[kept]
    for _ in range(2):
        if not found.shape[1]:
            break
        values, vectors = np.linalg.eigh(found.T @ np.asarray(mass @ found, np.float64))
        good = values > _DEPENDENT * values[-1]
        root = np.sqrt(values[good])
        found, right = found @ (vectors[:, good] / root), (root[:, None] * vectors[:, good].T) @ right
    return found, right


def _squares(block: Array, mass: SparseMatrix) -> Array:
    """Return x' M x of columns."""
    return np.asarray(np.einsum("ij,ij->j", block, np.asarray(mass @ block, np.float64)), np.float64)


if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from models.fe.casing.model import Casing

    Array = NDArray[np.float64]
MAX_RESIDUAL = 1e-4
"""Of |K phi - w^2 M phi| by |K phi|, the largest that a mode may have."""
MAX_VECTORS = 1500
"""Vectors of the basis at most, three or four for each mode."""
_LINES_AT_ONCE = 512


class NoModesError(NotConvergedError):
    """There is no mode up to the frequency asked for; the message has the first one."""


@dataclass(frozen=True)
class Damping:
    """Share of critical damping by frequency, as measured: linear between the points, constant beyond them.

    Attributes:
        frequency: Hz, ascending.
        ratio: of critical damping, 0.01 for 1 percent, from 0 to below 1.
    """

    frequency: tuple[float, ...]
    ratio: tuple[float, ...]

    def __post_init__(self) -> None:
        """Raise a ValueError that names what is wrong."""
        if not self.ratio or len(self.frequency) != len(self.ratio):
            raise ValueError(
                f"damping: expected as many ratios as frequencies, got {len(self.ratio)} and {len(self.frequency)}"
            )
        for place, f in enumerate(self.frequency):
            if not (math.isfinite(f) and f >= 0.0 and (place == 0 or f > self.frequency[place - 1])):
                raise ValueError(
                    f"damping: frequencies must be finite, not negative, ascending, got {f!r} Hz in place {place + 1}"
                )
        for ratio in self.ratio:
            if not 0.0 <= ratio < 1.0:
                raise ValueError(f"damping: ratios must be from 0 to below 1, got {ratio!r}")

    @classmethod
    def constant(cls, ratio: float) -> Damping:
        """Return one ratio at all frequencies."""
        return cls((0.0,), (ratio,))

    def at(self, frequency: Array) -> Array:
        """Return the ratios at frequencies, Hz."""
        return np.asarray(np.interp(frequency, self.frequency, self.ratio), np.float64)


THESIS_DAMPING = Damping((562.0, 828.0, 1221.0, 1423.0, 2154.0, 2818.0), (0.076, 0.076, 0.037, 0.018, 0.005, 0.023))
"""Table 26 of the thesis, taken as shares of critical damping, which it does not say."""


@dataclass(frozen=True, eq=False)
class CasingModes:
    """Natural frequencies, Hz, shape (modes,), ascending, and shapes (unknowns, modes) with phi' M phi = 1.

    Attributes:
        residual: |K phi - w^2 M phi| by |K phi|, shape (modes,).
    """

    frequency: Array
    shapes: Array
    residual: Array

    def __len__(self) -> int:
        """Return the number of modes."""
        return len(self.frequency)

    def below(self, highest: float) -> CasingModes:
        """Return the modes up to a frequency, Hz."""
        kept = self.frequency <= highest
        return CasingModes(self.frequency[kept], self.shapes[:, kept], self.residual[kept])


def modes_below(casing: Casing, highest: float) -> CasingModes:
    """Return all modes of a casing up to a frequency, Hz.

    Raises:
        NoModesError: there is none.
        NotConvergedError: there are too many, or a mode is not one to :data:`MAX_RESIDUAL`.
    """
    limit = (math.tau * highest) ** 2
    found = _modes(casing, lambda values: bool(values.size) and float(values[-1]) > limit)
    kept = found.below(highest)
    if not len(kept):
        raise NoModesError(f"the casing has no mode up to {highest:g} Hz, the first is at {found.frequency[0]:.5g} Hz")
    return kept


def first_modes(casing: Casing, count: int) -> CasingModes:
    """Return so many modes of a casing from the lowest on.

    Raises:
        NotConvergedError: there are too many, or a mode is not one to :data:`MAX_RESIDUAL`.
    """
    found = _modes(casing, lambda values: values.size >= count)
    return CasingModes(found.frequency[:count], found.shapes[:, :count], found.residual[:count])


def _modes(casing: Casing, enough: Callable[[Array], bool]) -> CasingModes:
    """Return modes from the lowest on until there are enough, checked."""
    values, shapes = lowest_eigenpairs(casing.mass, casing.solve, enough, MAX_VECTORS)
    forces = np.asarray(casing.stiffness @ shapes, np.float64)
    missed = forces - np.asarray(casing.mass @ shapes, np.float64) * values
    residual = np.asarray(np.linalg.norm(missed, axis=0) / np.linalg.norm(forces, axis=0), np.float64)
    worst = int(np.argmax(residual))
    if residual[worst] > MAX_RESIDUAL:
        raise NotConvergedError(f"mode {worst + 1} of the casing has a residual of {residual[worst]:.2g}")
    return CasingModes(np.sqrt(values) / math.tau, shapes, residual)


def modal_responses(
    casing: Casing,
    modes: CasingModes,
    damping: Damping,
    frequency: Array,
    outputs: Mapping[str, Array],
    inputs: Mapping[str, Array],
    unit: str = "m/s2",
    *,
    static: bool = True,
) -> FrequencyResponses:
    """Return the responses of motions to forces, N.

    Args:
        modes: up to half as far again as the lines; one above the last line matters as much as one below.
        frequency: of the lines, Hz, ascending.
        outputs, inputs: name -> column b, shape (unknowns,), see :meth:`models.fe.casing.model.Casing.columns`.
        unit: of the outputs: "m", "m/s" or "m/s2".
        static: whether what modes left out give at rest is added.
    """
    out, into = (np.stack(list(columns.values()), axis=1) for columns in (outputs, inputs))
    omega, natural = math.tau * np.asarray(frequency, np.float64), math.tau * modes.frequency
    ratio = damping.at(modes.frequency)
    left, right = out.T @ modes.shapes, into.T @ modes.shapes
    rest = (
        out.T @ casing.solve(into) - (left / natural**2) @ right.T
        if static
        else np.zeros((out.shape[1], into.shape[1]))
    )
    h = np.empty((len(omega), out.shape[1], into.shape[1]), np.complex128)
    for start in range(0, len(omega), _LINES_AT_ONCE):
        part = omega[start : start + _LINES_AT_ONCE, None]
        gain = 1.0 / (natural**2 - part**2 + 2j * ratio * natural * part)
        h[start : start + _LINES_AT_ONCE] = np.einsum("or,fr,ir->foi", left, gain, right, optimize=True) + rest
    h *= ((1j * omega) ** MOTION_UNITS.index(unit))[:, None, None]
    return FrequencyResponses(np.asarray(frequency, np.float64), h, tuple(outputs), tuple(inputs), unit)
