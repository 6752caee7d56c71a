"""RMS maps as data and their interpolation; imports no numba."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.maps.plan import AXES, VOLUMES, MapError, MapPlan
from models.path.contour import part_radius
from models.solve.response import HARMONICS

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from models.machine.scene import Part

# Loads and speeds this close to the end of their axis count as on it.
_CONDITION_TOLERANCE = 0.01
RIG_COMMON = "rig_common_std"
"""Attribute of a map with the spread of its posterior that all nodes share."""
_SLICED = ("rms", "rms_error", "rms_std", "rms_rig_std", "harmonic_amplitude", "harmonic_std", "harmonic_rig_std")


class OutsideMapError(MapError):
    """Load or speed lie outside the axes of a map."""


@dataclass(frozen=True, eq=False)
class MapSlice:
    """A map at one load (N) and speed (Hz): fields of ``RmsMap`` without its first two dimensions.

    Attributes:
        rms_band: band of the RMS, Hz, or None for the full bandwidth.
        rig_common: that part of the spread over a posterior which all nodes share: standard deviation of the logarithm
            of the RMS and of the lines, shape (7,); zero without a posterior.
    """

    load: float
    speed: float
    h_d: NDArray[np.float64]
    dphi_d: NDArray[np.float64]
    rms: NDArray[np.float64]
    rms_error: NDArray[np.float64]
    harmonic_amplitude: NDArray[np.float64]
    rms_band: tuple[float, float] | None
    rms_std: NDArray[np.float64]
    harmonic_std: NDArray[np.float64]
    rms_rig_std: NDArray[np.float64]
    harmonic_rig_std: NDArray[np.float64]
    rig_common: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1 + HARMONICS))

    def inside(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.bool_]:
        """Return whether points lie on the map."""
        x, y = np.asarray(dphi_d, dtype=float), np.asarray(h_d, dtype=float)
        return (x >= self.dphi_d[0]) & (x <= self.dphi_d[-1]) & (y >= self.h_d[0]) & (y <= self.h_d[-1])

    def interpolate(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.float64]:
        """Return the RMS between the nodes, bilinearly, m/s2; NaN where ``inside`` is False."""
        return self._bilinear(self.rms, dphi_d, h_d)

    def interpolate_harmonics(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.float64]:
        """Return the six amplitudes between the nodes, m/s2, shape (..., 6); NaN where ``inside`` is False."""
        return self._bilinear(self.harmonic_amplitude, dphi_d, h_d)

    def _bilinear(self, values: NDArray[np.float64], dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.float64]:
        x, y = np.broadcast_arrays(np.asarray(dphi_d, dtype=float), np.asarray(h_d, dtype=float))
        i, u = _cell(self.dphi_d, x)
        j, v = _cell(self.h_d, y)
        extra = (...,) + (None,) * (values.ndim - 2)
        u, v = u[extra], v[extra]
        i1, j1 = np.minimum(i + 1, len(self.dphi_d) - 1), np.minimum(j + 1, len(self.h_d) - 1)
        low = values[j, i] * (1.0 - u) + values[j, i1] * u
        high = values[j1, i] * (1.0 - u) + values[j1, i1] * u
        result = low * (1.0 - v) + high * v
        return np.where(self.inside(x, y)[extra], result, np.nan)


def _cell(axis: NDArray[np.float64], x: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the index of the node below each point and the fraction of the way to the next."""
    if len(axis) == 1:
        return np.zeros(x.shape, dtype=np.int64), np.zeros(x.shape)
    index = np.clip(np.searchsorted(axis, x, side="right") - 1, 0, len(axis) - 2)
    return index, np.clip((x - axis[index]) / (axis[index + 1] - axis[index]), 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Nodes:
    """RMS and lines at all nodes of a map: L loads, S speeds, H depths, D extents.

    Attributes:
        rms: mean RMS of the casing in the map's band, m/s2, shape (L, S, H, D).
        rms_std: standard deviation of it, m/s2: over the floors where there are several, otherwise from period to
            period (zero where the motion repeats), or from turn to turn of a defect that turns.
        rms_se: standard error of ``rms`` as a mean over floors, m/s2; of one floor as a mean over turns, or zero where
            nothing turns.
        rms_error: estimated numerical error of ``rms``, m/s2 (steps and settling, not interpolation).
        harmonic_amplitude: mean single-sided amplitudes of lines 1..6 of the damaged part (BPFO, BPFI or twice BSF),
            m/s2, shape (L, S, H, D, 6).
        harmonic_std, harmonic_se, harmonic_error: the same of these amplitudes.
        status: index into STATUSES, int8, the worst of all floors.
    """

    rms: NDArray[np.float64]
    rms_std: NDArray[np.float64]
    rms_se: NDArray[np.float64]
    rms_error: NDArray[np.float64]
    harmonic_amplitude: NDArray[np.float64]
    harmonic_std: NDArray[np.float64]
    harmonic_se: NDArray[np.float64]
    harmonic_error: NDArray[np.float64]
    status: NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class RmsMap(Nodes):
    """A map: its nodes, and the axes on which they lie. SI units.

    Attributes:
        load, speed, h_d, dphi_d: N, Hz, m and rad, shapes (L,), (S,), (H,) and (D,).
        rms_rig_std, harmonic_rig_std: standard deviations over the plan's draws of the rig, m/s2; zero without draws.
        attributes: parameters in SI units, software version, hash.
    """

    load: NDArray[np.float64]
    speed: NDArray[np.float64]
    h_d: NDArray[np.float64]
    dphi_d: NDArray[np.float64]
    rms_rig_std: NDArray[np.float64]
    harmonic_rig_std: NDArray[np.float64]
    attributes: dict[str, Any]

    @property
    def plan(self) -> MapPlan:
        """The plan that the map was made from."""
        return MapPlan.from_json(str(self.attributes["parameters"]))

    @property
    def rms_band(self) -> tuple[float, float] | None:
        """Band of the RMS, Hz, or None for the full bandwidth."""
        return self.plan.rms_band

    @property
    def part(self) -> Part:
        """The damaged part."""
        return self.plan.part

    @property
    def part_radius(self) -> float:
        """The radius that turns an extent into a length, m: V_eq = radius * dphi_d * h_d."""
        return part_radius(self.plan.bearing, self.plan.part)

    @property
    def volume_words(self) -> str:
        """The formula of V_eq with the value of its radius."""
        return f"{VOLUMES[self.part]} * dphi_d * h_d, {VOLUMES[self.part]} = {1e3 * self.part_radius:.4g} mm"

    @property
    def hash(self) -> str:
        """Hash of the plan and the model's version."""
        return str(self.attributes["hash"])

    def falling(self, axis: Literal["h_d", "dphi_d"]) -> NDArray[np.bool_]:
        """Return the nodes at which the RMS falls to the next node along an axis of the damage, shape (L, S, H, D).

        A fall must exceed the sum of the numerical errors of both nodes and twice the standard error of the difference.
        The last node of the axis is False.
        """
        place = AXES.index(axis)
        step = np.diff(self.rms, axis=place, append=np.take(self.rms, [-1], axis=place))
        here = (slice(None),) * place + (slice(None, -1),)
        there = (slice(None),) * place + (slice(1, None),)
        error = np.zeros_like(step)
        error[here] = (
            self.rms_error[here] + self.rms_error[there] + 2.0 * np.hypot(self.rms_se[here], self.rms_se[there])
        )
        return step < -error

    def slice_at(self, load: float, speed: float) -> MapSlice:
        """Return the map at one load and speed, linear between the nodes of these axes.

        Raises:
            OutsideMapError: if load or speed lies more than 1 % outside its axis.
        """
        i, u = _condition("load", self.load, load)
        j, v = _condition("speed", self.speed, speed)

        def at(values: NDArray[np.float64]) -> NDArray[np.float64]:
            i1, j1 = min(i + 1, len(self.load) - 1), min(j + 1, len(self.speed) - 1)
            low = values[i, j] * (1.0 - v) + values[i, j1] * v
            high = values[i1, j] * (1.0 - v) + values[i1, j1] * v
            return low * (1.0 - u) + high * u

        return MapSlice(
            load,
            speed,
            self.h_d,
            self.dphi_d,
            rms_band=self.rms_band,
            rig_common=np.array(self.attributes.get(RIG_COMMON, np.zeros(1 + HARMONICS)), dtype=np.float64),
            **{name: at(getattr(self, name)) for name in _SLICED},
        )


def _condition(name: str, axis: NDArray[np.float64], value: float) -> tuple[int, float]:
    slack = _CONDITION_TOLERANCE
    if not axis[0] * (1.0 - slack) <= value <= axis[-1] * (1.0 + slack):
        raise OutsideMapError(f"the map covers {name} {axis[0]:g} to {axis[-1]:g}, asked for {value!r}")
    index, fraction = _cell(axis, np.array(value))
    return int(index), float(fraction)
