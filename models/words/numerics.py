# pyright: standard
"""Numerical methods of SciPy with typed arguments and results, which its modules lack.

Each imports its part of SciPy when it is called: together they take longer to load than all else that a daemon with a
map needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

Function = Callable[[float], float]


def find_root(function: Function, low: float, high: float, *, xtol: float = 2e-12, rtol: float) -> float:
    """Return the root of a function that differs in sign at two places, by Brent's method."""
    from scipy.optimize import root_scalar

    return float(root_scalar(function, bracket=(low, high), xtol=xtol, rtol=rtol).root)


def integrate(function: Function, low: float, high: float, *, rtol: float) -> float:
    """Return an integral by adaptive quadrature."""
    from scipy.integrate import quad

    return float(quad(function, low, high, epsabs=0.0, epsrel=rtol)[0])


def carlson(complement: float) -> tuple[float, float]:
    """Return Carlson's R_F(0, k, 1) and R_D(0, k, 1) at a complementary parameter k = 1 - m."""
    from scipy.special import elliprd, elliprf

    return float(elliprf(0.0, complement, 1.0)), float(elliprd(0.0, complement, 1.0))


def gamma_quantile(shape: float, probability: float) -> float:
    """Return the quantile of the gamma distribution of scale one."""
    from scipy.special import gammaincinv

    return float(gammaincinv(shape, probability))


def f_quantile(freedom: float, other_freedom: float, probability: float) -> float:
    """Return the quantile of the F distribution, degrees of freedom of the numerator first."""
    from scipy.special import fdtri

    return float(fdtri(freedom, other_freedom, probability))


def generalised_eigenvalues(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the eigenvalues of a x = lambda b x, ascending, of symmetric matrices, b positive definite."""
    from scipy.linalg import eigh

    return np.asarray(eigh(a, b, eigvals_only=True))


def generalised_modes(
    a: NDArray[np.float64], b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return eigenvalues, ascending, and eigenvectors in columns, v b v = 1, as of ``generalised_eigenvalues``."""
    from scipy.linalg import eigh

    values, vectors = eigh(a, b)
    return np.asarray(values), np.asarray(vectors)


def periodic_spline(x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the cubic pieces, highest power first, shape (4, n - 1), and the extreme values of a periodic spline."""
    from scipy.interpolate import CubicSpline

    spline = CubicSpline(x, y, bc_type="periodic")
    return spline.c, spline(spline.derivative().roots(extrapolate=False))


def spline(x: NDArray[np.float64], y: NDArray[np.float64]) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Return the cubic spline through points of ascending x."""
    from scipy.interpolate import CubicSpline

    return CubicSpline(x, y)


def smooth_curve(
    x: NDArray[np.float64], y: NDArray[np.float64], *, flat_start: bool = False, flat_end: bool = False
) -> Any:
    """Return SciPy's cubic spline through points of ascending x, its slope zero at an end that is called flat."""
    from scipy.interpolate import CubicSpline

    method: Any = CubicSpline
    ends = tuple((1, 0.0) if flat else "not-a-knot" for flat in (flat_start, flat_end))
    return method(x, y, bc_type=ends)


def summed(signal: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return the integral of equally spaced values from the first on, by Simpson's rule; shape of the signal."""
    from scipy.integrate import cumulative_simpson

    return np.asarray(cumulative_simpson(signal, dx=step, initial=0.0))


def kaiser_order(attenuation: float, width: float) -> tuple[int, float]:
    """Return taps and beta of a Kaiser filter: attenuation, dB, and transition width over the Nyquist frequency."""
    from scipy.signal import kaiserord

    taps, beta = kaiserord(attenuation, width)
    return int(taps), float(beta)


def filter_valid(signal: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the convolution of a signal with taps where they overlap fully."""
    from scipy.signal import oaconvolve

    return oaconvolve(signal, taps, mode="valid")


def fast_length(length: int) -> int:
    """Return the least length of at least this much without prime factors above 5, which a transform is fast of."""
    best = 1 << (length - 1).bit_length()
    five = 1
    while five < best:
        three = five
        while three < best:
            two = three * (1 << max(-(-length // three) - 1, 0).bit_length())
            best = min(best, two)
            three *= 3
        five *= 5
    return best


def crests(before: NDArray[np.float64], at: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the largest absolute value along the first axis of what three equally spaced values each rise to.

    It is that of the middle ones, or of the vertex of the parabola where that lies between the outer ones.
    """
    slope, bend = 0.5 * (after - before), after - 2.0 * at + before
    inside = (at * bend < 0.0) & (np.abs(slope) < np.abs(bend))
    rise = np.where(inside, 0.5 * slope * slope / np.where(inside, np.abs(bend), 1.0), 0.0)
    return np.max(np.abs(at) + rise, axis=0, initial=0.0)


def low_discrepancy(count: int, dimensions: int, seed: int) -> NDArray[np.float64]:
    """Return points of a scrambled Sobol sequence in the unit cube, shape (count, dimensions); count a power of two."""
    from scipy.stats import qmc

    # Typed stubs know only the name that this argument has from SciPy 1.15 on.
    engine: Any = qmc.Sobol
    return np.asarray(engine(dimensions, seed=np.random.default_rng(seed)).random(count))


def least_squares_in_cube(
    residuals: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    jacobian: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    begin: NDArray[np.float64],
    *,
    ftol: float,
    xtol: float,
    calls: int,
) -> NDArray[np.float64]:
    """Return the point of the unit cube that a trust-region method finds for the least sum of squares.

    A point at which a residual is not finite is not taken. ``calls`` limits those of ``residuals``.
    """
    from scipy.optimize import least_squares

    method: Any = least_squares
    settings = {"method": "trf", "ftol": ftol, "xtol": xtol, "gtol": None, "max_nfev": calls}
    # Where no residual changes any more, the step is no number; its residuals are not finite, so it is not taken.
    with np.errstate(invalid="ignore", divide="ignore"):
        found = method(residuals, begin, jac=jacobian, bounds=(0.0, 1.0), **settings)
    return np.asarray(found.x)


def robust_fit(
    residuals: Callable[[NDArray[np.float64]], NDArray[np.float64]], begin: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return a fit in which outliers weigh little (soft L1), its residuals, and their derivatives there.

    ``residuals`` are in units of their standard deviation.
    """
    from scipy.optimize import least_squares

    method: Any = least_squares
    found = method(residuals, begin, loss="soft_l1", f_scale=2.0, max_nfev=200)
    return np.asarray(found.x), np.asarray(residuals(found.x)), np.asarray(found.jac)


def prominent_peaks(
    signal: NDArray[np.float64], prominence: float
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.float64]]:
    """Return the maxima that stand out by ``prominence``, their bases to the left and right, and by how much."""
    from scipy.signal import find_peaks

    places, found = find_peaks(signal, prominence=prominence)
    return np.asarray(places), found["left_bases"], found["right_bases"], np.asarray(found["prominences"])


def running_median(signal: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Return the median over an odd number of neighbouring values, the ends repeated."""
    from scipy.ndimage import median_filter

    return np.asarray(median_filter(signal, size=width, mode="nearest"))
