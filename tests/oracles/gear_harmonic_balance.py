"""Periodic motions of one pair of gears with backlash, by harmonic balance: an oracle for the solver in time.

    d'' + 2 zeta d' + k(phi) g(d) = F + W^2 sum_j j^2 E_j cos(j phi - psi_j),        phi = W t

d is the deflection of the teeth over half the backlash, t the time times the natural frequency, W the mesh frequency
over it, k the stiffness over its mean, F the static deflection and E_j the harmonics of the error. g(d) is d in
contact, d > 0; nothing down to -B; and d + B at the flanks behind. B = 2 makes this Eqs. 5 and 6 of Kahraman & Singh
(Journal of Sound and Vibration 142, 1990) with x = d + 1; the damping acts in and out of contact, as there.

The force of the teeth is formed in time and the balance in frequency (alternating frequency and time, Cameron &
Griffin 1989), branches are followed by arc length (Keller 1977), and stability is that of Floquet: the product of the
exact transitions of pieces of the period. Nothing here integrates in time, and nothing of ``models`` is used.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]
TOLERANCE = 1e-11
MAX_ITERATIONS = 12


def constant(phase: Array) -> Array:
    """Return a stiffness that does not vary."""
    return np.ones_like(phase)


@dataclass(frozen=True)
class Pair:
    """A pair without dimensions.

    Attributes:
        zeta: damping ratio.
        force: static deflection F.
        error: harmonics of the error, (E_j, psi_j) for j = 1 ...
        stiffness: k at phases of the mesh, turns.
        backlash: B.
    """

    zeta: float
    force: float
    error: tuple[tuple[float, float], ...] = ()
    stiffness: Callable[[Array], Array] = constant
    backlash: float = 2.0

    def elastic(self, d: Array) -> Array:
        """Return g(d)."""
        return np.maximum(d, 0.0) + np.minimum(d + self.backlash, 0.0)

    def slope(self, d: Array) -> Array:
        """Return the derivative of g."""
        return ((d > 0.0) | (d < -self.backlash)).astype(float)

    def excitation(self, phase: Array, frequency: float) -> Array:
        """Return the right side at phases, turns."""
        found = np.full_like(phase, self.force)
        for j, (amplitude, shift) in enumerate(self.error, 1):
            found += (frequency * j) ** 2 * amplitude * np.cos(2.0 * math.pi * j * phase - shift)
        return found


@dataclass(frozen=True)
class Motion:
    """A periodic motion.

    Attributes:
        frequency: W.
        coefficients: mean, then cosine and sine of each harmonic, shape (2 H + 1,).
        tangent: of the branch, of coefficients and frequency, shape (2 H + 2,), norm 1.
        multipliers: of Floquet, shape (2,).
    """

    frequency: float
    coefficients: Array
    tangent: Array
    multipliers: NDArray[np.complex128]

    @property
    def stable(self) -> bool:
        """Whether small disturbances die out."""
        return bool(np.abs(self.multipliers).max() < 1.0)


@dataclass(frozen=True)
class Balance:
    """The balance of a pair.

    Attributes:
        harmonics: H, those of the motion.
        periods: of the mesh in one period of the motion; 2 allows for motions of twice the period.
        samples: of a period of the motion, even; the places where flanks part are known to about one of them.
    """

    pair: Pair
    harmonics: int = 32
    periods: int = 1
    samples: int = 4096

    @cached_property
    def phase(self) -> Array:
        """Turns of the mesh at the samples."""
        return self.periods * np.arange(self.samples) / self.samples

    @cached_property
    def _orders(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Differences and sums of the numbers of two harmonics, shape (H + 1, H + 1)."""
        h = np.arange(self.harmonics + 1)
        return h[:, None] - h, h[:, None] + h

    @cached_property
    def derivative(self) -> Array:
        """The derivative by the angle of one mesh, shape (2 H + 1, 2 H + 1)."""
        found = np.zeros((2 * self.harmonics + 1,) * 2)
        for h in range(1, self.harmonics + 1):
            found[2 * h - 1, 2 * h] = h / self.periods
            found[2 * h, 2 * h - 1] = -h / self.periods
        return found

    @cached_property
    def stiffness(self) -> Array:
        """The stiffness at the samples."""
        return self.pair.stiffness(self.phase % 1.0)

    def signal(self, terms: Array) -> Array:
        """Return a series at the samples."""
        lines = np.zeros(self.samples // 2 + 1, complex)
        lines[0] = terms[0] * self.samples
        lines[1 : self.harmonics + 1] = (terms[1::2] - 1j * terms[2::2]) * (0.5 * self.samples)
        return np.fft.irfft(lines, self.samples)

    def terms(self, signal: Array) -> Array:
        """Return the terms of a signal from its samples, shape (2 H + 1,)."""
        lines = np.fft.rfft(signal)[: self.harmonics + 1] * (2.0 / self.samples)
        found = np.empty(2 * self.harmonics + 1)
        found[0], found[1::2], found[2::2] = 0.5 * lines[0].real, lines[1:].real, -lines[1:].imag
        return found

    def product(self, factor: Array) -> Array:
        """Return the matrix that a factor over the period is among the terms, shape (2 H + 1, 2 H + 1)."""
        lines = np.fft.rfft(factor)[: 2 * self.harmonics + 1] / self.samples
        apart, summed = self._orders
        cosine, sine = lines.real, -lines.imag
        near, odd = cosine[np.abs(apart)], np.sign(apart) * sine[np.abs(apart)]
        found = np.empty((2 * self.harmonics + 1,) * 2)
        cosines = near + cosine[summed]
        cosines[0] *= 0.5
        mixed = sine[summed] - odd
        mixed[0] *= 0.5
        found[1::2, 1::2], found[2::2, 2::2] = cosines[1:, 1:], (near - cosine[summed])[1:, 1:]
        found[1::2, 2::2], found[2::2, 1::2] = mixed[1:, 1:], (sine[summed] + odd)[1:, 1:]
        found[0, 0], found[0, 1::2], found[0, 2::2] = cosines[0, 0], cosines[0, 1:], mixed[0, 1:]
        # Terms of a mean are those of the factor itself.
        found[1::2, 0], found[2::2, 0] = 2.0 * cosine[1 : self.harmonics + 1], 2.0 * sine[1 : self.harmonics + 1]
        return found

    def residual(self, coefficients: Array, frequency: float) -> tuple[Array, Array, Array]:
        """Return what is out of balance, and its derivatives by the coefficients and by the frequency."""
        d = self.signal(coefficients)
        first = self.derivative
        linear = frequency**2 * (first @ first) + 2.0 * self.pair.zeta * frequency * first
        outside = self.pair.excitation(self.phase, frequency)
        unbalanced = linear @ coefficients + self.terms(self.stiffness * self.pair.elastic(d) - outside)
        by_terms = linear + self.product(self.stiffness * self.pair.slope(d))
        turned = (2.0 * frequency * (first @ first) + 2.0 * self.pair.zeta * first) @ coefficients
        by_frequency = turned - self.terms(2.0 / frequency * (outside - self.pair.force))
        return unbalanced, by_terms, by_frequency

    def motion(self, frequency: float, guess: Array | None = None) -> Motion:
        """Return the motion at a frequency that Newton's iteration finds from a guess, or from the static deflection.

        Raises:
            RuntimeError: if it does not converge.
        """
        terms = np.zeros(2 * self.harmonics + 1) if guess is None else guess.copy()
        if guess is None:
            terms[0] = self.pair.force
        for _ in range(MAX_ITERATIONS):
            unbalanced, by_terms, _ = self.residual(terms, frequency)
            if np.abs(unbalanced).max() < TOLERANCE:
                return self._completed(terms, frequency, None)
            terms -= np.linalg.solve(by_terms, unbalanced)
        raise RuntimeError(f"no balance found at frequency {frequency}")

    def branch(self, start: Motion, stop: tuple[float, float], step: float = 0.05, most: int = 5000) -> list[Motion]:
        """Follow a branch by arc length until the frequency leaves an interval.

        Args:
            start: first motion; its tangent gives the direction.
            stop: least and highest frequency.
            step: arc length at most.
            most: motions at most.

        Raises:
            RuntimeError: if the steps become too small, or the motions too many.
        """
        found, length = [start], step
        while stop[0] <= found[-1].frequency <= stop[1]:
            if len(found) > most or length < 1e-7:
                raise RuntimeError(f"the branch stops at frequency {found[-1].frequency}")
            following = self._step(found[-1], length)
            if following is None or following.tangent @ found[-1].tangent < math.cos(0.35):
                length *= 0.5
                continue
            found.append(following)
            length = min(step, 1.5 * length)
        return found

    def folds(self, branch: list[Motion]) -> list[Motion]:
        """Return the motions of a branch at which the frequency turns back: where a slow sweep jumps."""
        return self._crossings(branch, lambda motion: float(motion.tangent[-1]))

    def flips(self, branch: list[Motion]) -> list[Motion]:
        """Return the motions of a branch from which one of twice the period departs: a multiplier is -1."""
        return self._crossings(branch, lambda motion: 1.0 + float(motion.multipliers.real.min()))

    def doubled(self, flip: Motion) -> tuple[Balance, Motion]:
        """Return a balance over two periods, and a flip in it with the direction of the motions of twice the period."""
        double = Balance(self.pair, 2 * self.harmonics, 2 * self.periods, 2 * self.samples)
        terms = np.zeros(4 * self.harmonics + 1)
        terms[0], terms[3::4], terms[4::4] = flip.coefficients[0], flip.coefficients[1::2], flip.coefficients[2::2]
        _, by_terms, _ = double.residual(terms, flip.frequency)
        direction = np.append(np.linalg.svd(by_terms)[2][-1], 0.0)
        return double, Motion(flip.frequency, terms, direction, double.multipliers(terms, flip.frequency))

    def _crossings(self, branch: list[Motion], measure: Callable[[Motion], float]) -> list[Motion]:
        """Return the motions of a branch at which a measure changes its sign."""
        found: list[Motion] = []
        for before, after in itertools.pairwise(branch):
            if measure(before) * measure(after) >= 0.0:
                continue
            apart = after.coefficients - before.coefficients
            whole = float(apart @ before.tangent[:-1])
            whole += (after.frequency - before.frequency) * float(before.tangent[-1])

            def value(length: float, before: Motion = before) -> float:
                return measure(self._reached(before, length))

            found.append(self._reached(before, float(np.asarray(brentq(value, 0.0, whole, xtol=1e-10)))))
        return found

    def _reached(self, before: Motion, length: float) -> Motion:
        following = self._step(before, length)
        if following is None:
            raise RuntimeError(f"no balance found near frequency {before.frequency}")
        return following

    def _step(self, before: Motion, length: float) -> Motion | None:
        """Return the motion at an arc length from another, or None if Newton's iteration does not converge."""
        start = np.append(before.coefficients, before.frequency)
        place = start + length * before.tangent
        for _ in range(MAX_ITERATIONS):
            unbalanced, by_terms, by_frequency = self.residual(place[:-1], float(place[-1]))
            away = before.tangent @ (place - start) - length
            if max(np.abs(unbalanced).max(), abs(away)) < TOLERANCE:
                return self._completed(place[:-1], float(place[-1]), before.tangent)
            matrix = np.vstack([np.column_stack([by_terms, by_frequency]), before.tangent])
            place = place - np.linalg.solve(matrix, np.append(unbalanced, away))
            if not place[-1] > 0.0:
                return None
        return None

    def _completed(self, terms: Array, frequency: float, along: Array | None) -> Motion:
        _, by_terms, by_frequency = self.residual(terms, frequency)
        if along is None:
            along = np.append(np.zeros_like(terms), 1.0)
        matrix = np.vstack([np.column_stack([by_terms, by_frequency]), along])
        tangent = np.linalg.solve(matrix, np.append(np.zeros_like(terms), 1.0))
        tangent = np.asarray(tangent / np.linalg.norm(tangent), np.float64)
        return Motion(frequency, terms, tangent, self.multipliers(terms, frequency))

    def multipliers(self, terms: Array, frequency: float) -> NDArray[np.complex128]:
        """Return the multipliers of Floquet: disturbances a period later over those now."""
        touching = 1.0 - _share_between(self.signal(terms), -self.pair.backlash)
        stiffness = 0.5 * (self.stiffness + np.roll(self.stiffness, -1)) * touching
        step = 2.0 * math.pi * self.periods / (frequency * self.samples)
        zeta = self.pair.zeta
        root = np.sqrt(stiffness - zeta**2 + 1e-18 + 0j)
        # exp(A h) of A = [[0, 1], [-k, -2 zeta]], all pieces at once.
        cosine, sine = np.cos(root * step), np.sin(root * step) / root
        pieces = np.empty((self.samples, 2, 2), complex)
        pieces[:, 0, 0], pieces[:, 0, 1] = cosine + zeta * sine, sine
        pieces[:, 1, 0], pieces[:, 1, 1] = -stiffness * sine, cosine - zeta * sine
        pieces *= math.exp(-zeta * step)
        while len(pieces) > 1:
            if len(pieces) % 2:
                pieces = np.concatenate([pieces, np.eye(2)[None]])
            pieces = pieces[1::2] @ pieces[0::2]  # the later one acts on what the earlier one leaves
        return np.linalg.eigvals(pieces[0])


def _share_between(d: Array, low: float) -> Array:
    """Return the share of each step between samples in which low <= d <= 0, d taken as straight."""
    after = np.roll(d, -1)
    least, most = np.minimum(d, after), np.maximum(d, after)
    inside = np.minimum(most, 0.0) - np.maximum(least, low)
    return np.clip(inside / np.maximum(most - least, 1e-300), 0.0, 1.0)


def root_mean_square(motion: Motion) -> float:
    """Return the RMS of the deflection about its mean."""
    return math.sqrt(0.5 * float(motion.coefficients[1:] @ motion.coefficients[1:]))


def out_of_contact(balance: Balance, motion: Motion) -> float:
    """Return the share of a period in which no flanks touch."""
    return float(_share_between(balance.signal(motion.coefficients), -balance.pair.backlash).mean())
