"""The unknown parameters of a rig as a unit cube, of which every point meets the constraints of Eq. 80.

The parameters stand in an order in which each has an interval that follows from those before it (and from those that
are known): a coordinate between 0 and 1 is a place in it. So the limits of the natural frequency f_r, which couple m_r
and k_r, and those of the damping ratios hold by construction. What cannot be built in (f_r where neither m_r nor k_r is
free) is checked, and such points are refused before anything is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING

import numpy as np

from models.identify.limits import AdmissibleLimits, Interval, alpha_c_interval, beta_c_interval, intersection
from models.machine.hertz import contact_exponent, mean_bearing_stiffness
from models.machine.rig import Rig, resonator_stiffness
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.bearing import Bearing

ORDER = ("m_i", "m_o", "k_i", "k_c", "clearance", "m_b", "m_r", "k_r", "beta_c", "alpha_c", "c_i", "c_r")
"""Parameters that can be free, each after those that its interval depends on."""
DEFAULT_FREE = ("m_r", "k_r", "c_i", "beta_c", "c_r", "alpha_c")
FREE_WITHOUT_TESTS = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "beta_c", "c_i", "c_r")
"""Parameters of a rig of which no test at a known defect exists: all that its resonances depend on."""
ALIASES = {"zeta_1": "alpha_c", "zeta_2": "beta_c", "zeta_i": "c_i", "zeta_r": "c_r"}
"""Damping ratios of the study and the coefficients that they stand for (Eqs. 70, 75 and 76)."""

_LINEAR = ("clearance", "alpha_c")
_RESONATOR = ("m_i", "m_o", "k_i", "k_c", "clearance", "m_r", "k_r")
# Relative rounding of a limit.
_ROUNDING = 1e-9
# Cage angles of the mean stiffness; it varies by 7.5 % over a passage, smoothly.
_ANGLES = 16


class SpaceError(WrongInputError):
    """The constraints leave nothing to search in; the message names the parameter."""


@dataclass(frozen=True)
class Space:
    """The admissible values of some parameters of a rig.

    Attributes:
        rig, clearance: the known parameters; those that are free do not matter. Clearance in m.
        bearing: whose stiffness enters the natural frequencies.
        loads: radial loads of the tests, N, at each of which f_r is limited.
        free: names of the unknown parameters, of ``ORDER``.
        limits: of Eq. 80.
    """

    rig: Rig
    bearing: Bearing
    loads: tuple[float, ...]
    clearance: float = 0.0
    free: tuple[str, ...] = DEFAULT_FREE
    limits: AdmissibleLimits = field(default_factory=AdmissibleLimits)

    def __post_init__(self) -> None:
        """Put the free parameters in order; raise a SpaceError for names that cannot be free."""
        names = [ALIASES.get(name, name) for name in self.free]
        for given, name in zip(self.free, names, strict=True):
            if name not in ORDER:
                raise SpaceError(f"{given!r} cannot be free; expected names of {', '.join((*ORDER, *ALIASES))}")
            if names.count(name) > 1:
                raise SpaceError(f"{given!r} is free twice ({', '.join(self.free)})")
        object.__setattr__(self, "free", tuple(sorted(names, key=ORDER.index)))

    @cached_property
    def known(self) -> dict[str, float]:
        """The parameters of the rig, those that are free as well, SI."""
        return {name: self.clearance if name == "clearance" else float(getattr(self.rig, name)) for name in ORDER}

    def is_linear(self, name: str) -> bool:
        """Return whether a parameter is searched as it is, not by its logarithm: zero is among its values."""
        return name in _LINEAR

    def fix(self, name: str, value: float) -> Space:
        """Return the space with one parameter fewer, which is then known."""
        free = tuple(other for other in self.free if other != name)
        if name == "clearance":
            return replace(self, clearance=value, free=free)
        return replace(self, rig=replace(self.rig, **{name: value}), free=free)

    def decode(self, point: NDArray[np.float64]) -> dict[str, float] | None:
        """Return all parameters at a point of the cube, shape (free,), SI; None where Eq. 80 does not hold there."""
        values = dict(self.known)
        for name, place in zip(self.free, point.tolist(), strict=True):
            low, high = self._interval(name, values)
            if not low <= high:
                return None
            share = min(max(place, 0.0), 1.0)
            value = low + share * (high - low) if self.is_linear(name) else low * (high / low) ** share
            values[name] = min(max(value, low), high)
        return values if self.admits(values) else None

    def encode(self, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the point of the cube nearest to parameters, shape (free,); its values before decide each interval.

        Raises:
            SpaceError: if the constraints leave a parameter no interval; the message names it.
        """
        decoded, point = {**self.known, **values}, np.empty(len(self.free))
        for i, name in enumerate(self.free):
            low, high = self._interval(name, decoded)
            if not low <= high:
                raise SpaceError(f"no admissible value of {name} is left: {low:g} to {high:g}")
            value = min(max(decoded[name], low), high)
            decoded[name] = value
            ends = (low, high, value) if self.is_linear(name) else tuple(map(math.log, (low, high, value)))
            # The logarithms of neighbouring numbers may be the same.
            point[i] = (ends[2] - ends[0]) / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.5
        return point

    def rig_of(self, values: Mapping[str, float]) -> Rig:
        """Return the rig with such parameters."""
        return replace(self.rig, **{name: values[name] for name in ORDER if name != "clearance"})

    def admits(self, values: Mapping[str, float]) -> bool:
        """Return whether parameters meet all constraints of Eq. 80 that a free parameter enters."""
        return not self.violations(values)

    def violations(self, values: Mapping[str, float]) -> list[str]:
        """Return in words which constraints with a free parameter are not met."""
        return [
            f"{name} = {value:.6g} is outside {low:g} to {high:g}"
            for name, value, (low, high) in self._constrained(values)
            if not low - _ROUNDING * abs(low) <= value <= high * (1.0 + _ROUNDING)
        ]

    def bounds(self, name: str) -> Interval:
        """Return the smallest and the largest value that a parameter has anywhere in the space, SI, nearly.

        The interval is that of the parameter's own limits and of those that couple it, each taken at its widest.
        """
        if name == "k_r":
            return self._k_r_bounds()
        if name in ("c_i", "c_r"):
            which = name[-1]
            low, high = self.bounds(f"k_{which}") if f"k_{which}" in self.free else (self.known[f"k_{which}"],) * 2
            damping = self._damping_interval(which, 1.0)
            return intersection(getattr(self.limits, name), (damping[0] * low, damping[1] * high))
        if name == "alpha_c":
            least = self.bounds("beta_c")[0] if "beta_c" in self.free else self.known["beta_c"]
            return alpha_c_interval(self.limits, least)
        return self._interval(name, self.known)

    def _k_r_bounds(self) -> Interval:
        """Return the extremes of k_r over m_r, which rise with it."""
        if "m_r" not in self.free:
            return self._interval("k_r", self.known)
        low, high = self._interval("m_r", self.known)
        ends = [self._interval("k_r", {**self.known, "m_r": m_r}) for m_r in (low, high)]
        return ends[0][0], ends[1][1]

    def _interval(self, name: str, values: Mapping[str, float]) -> Interval:
        """Return the interval of a free parameter that those before it in ``ORDER`` leave."""
        limits = self.limits
        if name == "m_r":
            return intersection(limits.m_r, self._m_r_interval(values))
        if name == "k_r":
            return intersection(self._k_r_own(), self._k_r_interval(values))
        if name == "beta_c":
            return beta_c_interval(limits, None if "alpha_c" in self.free else values["alpha_c"])
        if name == "alpha_c":
            return alpha_c_interval(limits, values["beta_c"])
        if name in ("c_i", "c_r"):
            return intersection(getattr(limits, name), self._damping_interval(name[-1], values[f"k_{name[-1]}"]))
        if name == "clearance":
            return limits.clearance
        own = limits.known[0] * self._nominal(name), limits.known[1] * self._nominal(name)
        return intersection(own, self._stiffness_interval("i")) if name == "k_i" else own

    def _nominal(self, name: str) -> float:
        return self.known[name]

    def _k_r_own(self) -> Interval:
        return intersection(self.limits.k_r, self._stiffness_interval("r"))

    def _damping_interval(self, which: str, stiffness: float) -> Interval:
        """Return the interval of c_i or c_r for a stiffness, N s/m (Eqs. 75 to 78)."""
        frequency, (low, high) = self._damping_of(which)
        factor = stiffness / (math.pi * frequency)
        return low * factor, high * factor

    def _stiffness_interval(self, which: str) -> Interval:
        """Return the interval that a known c_i or c_r leaves to its stiffness, N/m; all where it is free."""
        name = f"c_{which}"
        if name in self.free:
            return 0.0, math.inf
        frequency, (low, high) = self._damping_of(which)
        factor = self.known[name] * math.pi * frequency
        return factor / high, factor / low

    def _damping_of(self, which: str) -> tuple[float, Interval]:
        limits = self.limits
        return (limits.f_i, limits.zeta_i) if which == "i" else (limits.f_d, limits.zeta_r)

    def _k_r_interval(self, values: Mapping[str, float]) -> Interval:
        """Return the k_r whose natural frequency is within its limits at all loads, N/m (Eq. 69)."""
        rig, (low, high) = self.rig_of(values), self.limits.f_r
        stiffness = self._bearing(values)
        return max(_k_r_at(rig, k_b, low) for k_b in stiffness), min(_k_r_at(rig, k_b, high) for k_b in stiffness)

    def _m_r_interval(self, values: Mapping[str, float]) -> Interval:
        """Return the m_r for which k_r, known or any of its own limits, can meet Eq. 69, kg."""
        rig, (low, high) = self.rig_of(values), self.limits.f_r
        least, most = self._k_r_own() if "k_r" in self.free else (values["k_r"], values["k_r"])
        stiffness = self._bearing(values)
        return (
            max(_m_r_at(replace(rig, k_r=least), k_b, high) for k_b in stiffness),
            min(_m_r_at(replace(rig, k_r=most), k_b, low) for k_b in stiffness),
        )

    def _bearing(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return k_xx and k_yy at each load, N/m."""
        return tuple(
            k_b
            for load in self.loads
            for k_b in bearing_directions(self.bearing, load, values["k_c"], values["clearance"])
        )

    def _constrained(self, values: Mapping[str, float]) -> list[tuple[str, float, Interval]]:
        """Return name, value and limits of each constraint that a free parameter enters."""
        limits, found = self.limits, list[tuple[str, float, Interval]]()
        free = set(self.free)
        for name in ("m_r", "k_r", "beta_c", "alpha_c", "c_i", "c_r", "clearance"):
            if name in free:
                found.append((name, values[name], getattr(limits, name)))
        for name in ("m_i", "m_o", "m_b", "k_i", "k_c"):
            if name in free:
                nominal = self._nominal(name)
                found.append((name, values[name], (limits.known[0] * nominal, limits.known[1] * nominal)))
        if free & {"alpha_c", "beta_c"}:
            zeta_1, zeta_2 = contact_ratios(values, limits)
            found += [("zeta_1", zeta_1, limits.zeta_1), ("zeta_2", zeta_2, limits.zeta_2)]
        for which in ("i", "r"):
            if free & {f"c_{which}", f"k_{which}"}:
                frequency, interval = self._damping_of(which)
                ratio = values[f"c_{which}"] * math.pi * frequency / values[f"k_{which}"]
                found.append((f"zeta_{which}", ratio, interval))
        if free & set(_RESONATOR):
            found += [("f_r", frequency, limits.f_r) for frequency in self.resonances(values)]
        return found

    def resonances(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Return the highest natural frequency at each load, across and along it, Hz (Eqs. 59 and 60)."""
        return tuple(self.modes(values)[:, -1].tolist())

    def modes(
        self,
        values: Mapping[str, float],
        m_r: NDArray[np.float64] | None = None,
        k_r: NDArray[np.float64] | None = None,
    ) -> NDArray[np.float64]:
        """Return all natural frequencies, Hz (Eqs. 59 and 60), shape (..., 2 * loads, 3), ascending.

        Those of one load are those across and those along it. ``m_r`` (kg) and ``k_r`` (N/m), of one shape (...), take
        the place of those among ``values``.
        """
        m_r, k_r = np.broadcast_arrays(
            np.asarray(values["m_r"] if m_r is None else m_r), np.asarray(values["k_r"] if k_r is None else k_r)
        )
        k_b, k_i = np.array(self._bearing(values)), values["k_i"]
        k_r = k_r[..., np.newaxis]
        matrices = np.zeros((*m_r.shape, len(k_b), 3, 3))
        matrices[..., 0, 0], matrices[..., 1, 1], matrices[..., 2, 2] = k_b + k_i, k_b + k_r, k_r
        matrices[..., 0, 1] = matrices[..., 1, 0] = -k_b
        matrices[..., 1, 2] = matrices[..., 2, 1] = -k_r
        masses = np.stack([np.full(m_r.shape, values["m_i"]), np.full(m_r.shape, values["m_o"]), m_r], axis=-1)
        roots = np.sqrt(masses)
        scaled = matrices / (roots[..., :, np.newaxis] * roots[..., np.newaxis, :])[..., np.newaxis, :, :]
        # Rounding can make a zero eigenvalue negative.
        return np.sqrt(np.maximum(np.linalg.eigvalsh(scaled), 0.0)) / (2.0 * math.pi)


def contact_ratios(values: Mapping[str, float], limits: AdmissibleLimits) -> tuple[float, float]:
    """Return zeta_1 and zeta_2 of the contact damping (Eq. 70)."""
    first, second = (
        0.5 * (values["alpha_c"] / w + values["beta_c"] * w)
        for w in (2.0 * math.pi * limits.f_1, 2.0 * math.pi * limits.f_2)
    )
    return first, second


@lru_cache(maxsize=256)
def bearing_directions(bearing: Bearing, load: float, k_c: float, clearance: float) -> tuple[float, float]:
    """Return the mean stiffness of a bearing across and along its load, N/m."""
    if clearance == 0.0 and (load, k_c) != (1.0, 1.0):
        # All displacements then grow with (load / k_c)^(1 / n).
        power = 1.0 / contact_exponent(bearing)
        scale = k_c**power * load ** (1.0 - power)
        across, along = bearing_directions(bearing, 1.0, 1.0, 0.0)
        return across * scale, along * scale
    matrix = mean_bearing_stiffness(bearing, load, k_c, clearance=clearance, points=_ANGLES)
    return float(matrix[1, 1]), float(matrix[0, 0])


def _without_resonator(rig: Rig, k_b: float, frequency: float) -> tuple[float, float]:
    """Return Lambda of Eq. 65, and (lambda m_i - k_i - k_b) of Eq. 64.

    Both are positive above all natural frequencies of the rig without its resonator, and one is not below.
    """
    lam = (2.0 * math.pi * frequency) ** 2
    constant = lam**2 * rig.m_i * rig.m_o - lam * (rig.k_i * rig.m_o + k_b * rig.m_i + k_b * rig.m_o) + rig.k_i * k_b
    return constant, lam * rig.m_i - rig.k_i - k_b


def _k_r_at(rig: Rig, k_b: float, frequency: float) -> float:
    """Return the k_r of which a frequency is the highest natural one, N/m; 0 where the rig without it has higher."""
    if min(_without_resonator(rig, k_b, frequency)) <= 0.0:
        return 0.0
    return resonator_stiffness(rig, k_b, frequency)


def _m_r_at(rig: Rig, k_b: float, frequency: float) -> float:
    """Return the m_r of which a frequency is the highest natural one, kg (Eq. 62 solved for it); infinite for none.

    The natural frequency falls as m_r grows; with no m_r it falls to this one.
    """
    constant, inner = _without_resonator(rig, k_b, frequency)
    rest = constant - rig.k_r * inner
    if min(constant, inner, rest) <= 0.0:
        return math.inf
    return rig.k_r * constant / ((2.0 * math.pi * frequency) ** 2 * rest)
