"""RMS maps as data: what a map is made from, what it holds, and how it is read between its nodes. No numba here."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from models.bearing import Bearing, from_catalogue
from models.defect import race_radius
from models.scene import Floor, Rig

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

# Raise it whenever the model's figures change: maps made before are then built anew.
MODEL_VERSION = 2
SCHEMA_VERSION = 1
HARMONICS = 6
STATUSES = ("converged", "not_periodic", "not_converged")
AXES = ("load", "speed", "h_d", "dphi_d")
# Loads and speeds this close to the end of their axis count as on it.
_CONDITION_TOLERANCE = 0.01


class MapError(ValueError):
    """A map or a plan of one is unusable; the message names the file or field and what is wrong."""


class OutsideMapError(MapError):
    """A map was asked for a load or a speed outside its axes."""


@dataclass(frozen=True)
class MapPlan:
    """Everything that makes a map, SI units and radians; two equal plans give the same map.

    Attributes:
        load: axis of radial loads, N, ascending.
        speed: axis of shaft speeds, Hz, ascending.
        h_d: axis of depths, m, ascending.
        dphi_d: axis of extents, rad, ascending.
        bearing: the bearing.
        rig: lumped parameters around it.
        clearance: radial clearance, m.
        floor: the bottom of the defect; of several floors, the first.
        floors: how many rough floors are averaged (seeds floor.seed, floor.seed + 1, ...).
        rows: how many rows the defect spans.
        position: angle of the defect's centre from the load direction, rad.
        rms_band: band in which RMS is taken, Hz, or None for the full bandwidth.
        steps_per_period: steps of the integration per ball period, or None for the model's choice.
        model: the model.
    """

    load: tuple[float, ...]
    speed: tuple[float, ...]
    h_d: tuple[float, ...]
    dphi_d: tuple[float, ...]
    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: Rig = field(default_factory=Rig)
    clearance: float = 0.0
    floor: Floor = field(default_factory=Floor)
    floors: int = 1
    rows: int = 1
    position: float = 0.0
    rms_band: tuple[float, float] | None = None
    steps_per_period: int | None = None
    model: str = "six_dof"

    def __post_init__(self) -> None:
        """Refuse axes that are none.

        Raises:
            MapError: naming the axis and what is wrong with it.
        """
        for name in AXES:
            values = getattr(self, name)
            if len(values) == 0 or not all(math.isfinite(v) and v >= 0.0 for v in values):
                raise MapError(f"map axis {name} needs finite values that are not negative, got {values!r}")
            if any(b <= a for a, b in pairwise(values)):
                raise MapError(f"map axis {name} must ascend, got {values!r}")
        if self.speed[0] <= 0.0:
            raise MapError(f"map axis speed must be positive, got {self.speed!r}")
        if self.floors < 1 or (self.floors > 1 and self.floor.kind == "smooth"):
            raise MapError(f"floors must be 1 for a smooth floor and at least 1 for a rough one, got {self.floors!r}")

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Number of nodes along load, speed, h_d and dphi_d."""
        return len(self.load), len(self.speed), len(self.h_d), len(self.dphi_d)

    def as_json(self) -> str:
        """Return the plan as canonical JSON; ``from_json`` reads it back exactly."""
        return json.dumps(asdict(self), sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> MapPlan:
        """Return the plan that ``as_json`` wrote.

        Raises:
            MapError: if it is not one.
        """
        try:
            data: dict[str, Any] = json.loads(text)
            for name in AXES:
                data[name] = tuple(data[name])
            data["rms_band"] = None if data["rms_band"] is None else tuple(data["rms_band"])
            for name, kind in (("bearing", Bearing), ("rig", Rig), ("floor", Floor)):
                data[name] = kind(**data[name])
            return cls(**data)
        except (TypeError, KeyError, json.JSONDecodeError) as error:
            raise MapError(f"the parameters of the map are not those of this version: {error}") from error

    def hash(self) -> str:
        """Return a hash of the plan and the model's version: equal hashes, equal maps."""
        return hashlib.sha256(f"{self.model} {MODEL_VERSION} {self.as_json()}".encode()).hexdigest()


@dataclass(frozen=True, eq=False)
class MapSlice:
    """A map at one load and speed.

    Attributes:
        load: N.
        speed: Hz.
        h_d: depths, m, shape (H,).
        dphi_d: extents, rad, shape (D,).
        rms: m/s2, shape (H, D).
        rms_error: estimated numerical error of ``rms``, m/s2, shape (H, D).
        harmonic_amplitude: lines 1..6 of BPFO, m/s2, shape (H, D, 6).
        rms_band: band of the RMS, Hz, or None for the full bandwidth.
    """

    load: float
    speed: float
    h_d: NDArray[np.float64]
    dphi_d: NDArray[np.float64]
    rms: NDArray[np.float64]
    rms_error: NDArray[np.float64]
    harmonic_amplitude: NDArray[np.float64]
    rms_band: tuple[float, float] | None

    def inside(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.bool_]:
        """Say where points lie on the map."""
        x, y = np.asarray(dphi_d, dtype=float), np.asarray(h_d, dtype=float)
        return (x >= self.dphi_d[0]) & (x <= self.dphi_d[-1]) & (y >= self.h_d[0]) & (y <= self.h_d[-1])

    def interpolate(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.float64]:
        """Return the RMS between the nodes, bilinearly, m/s2; NaN exactly where ``inside`` says no.

        Args:
            dphi_d: extents, rad; broadcast against ``h_d``.
            h_d: depths, m.
        """
        return self._bilinear(self.rms, dphi_d, h_d)

    def interpolate_harmonics(self, dphi_d: ArrayLike, h_d: ArrayLike) -> NDArray[np.float64]:
        """Return the six amplitudes between the nodes, m/s2, shape (..., 6); NaN exactly where ``inside`` says no."""
        return self._bilinear(self.harmonic_amplitude, dphi_d, h_d)

    def _bilinear(
        self,
        values: NDArray[np.float64],
        dphi_d: ArrayLike,
        h_d: ArrayLike,
    ) -> NDArray[np.float64]:
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
class RmsMap:
    """RMS and BPFO lines over load, speed, depth and extent, SI units.

    Attributes:
        load: N, shape (L,).
        speed: Hz, shape (S,).
        h_d: m, shape (H,).
        dphi_d: rad, shape (D,).
        rms: mean RMS of the casing in the map's band, m/s2, shape (L, S, H, D).
        rms_std: standard deviation of it, m/s2: over the floors where there are several, otherwise from period to
            period (zero where the motion repeats).
        rms_se: standard error of ``rms`` as a mean over floors, m/s2; zero for one floor.
        rms_error: estimated numerical error of ``rms``, m/s2 (steps and settling, not interpolation).
        harmonic_amplitude: mean single-sided amplitudes of lines 1..6 of BPFO, m/s2, shape (L, S, H, D, 6).
        harmonic_std: standard deviation of them over the floors, m/s2.
        status: index into STATUSES, int8, the worst of all floors.
        attributes: everything that made it: flat parameters in SI units, software version, hash.
    """

    load: NDArray[np.float64]
    speed: NDArray[np.float64]
    h_d: NDArray[np.float64]
    dphi_d: NDArray[np.float64]
    rms: NDArray[np.float64]
    rms_std: NDArray[np.float64]
    rms_se: NDArray[np.float64]
    rms_error: NDArray[np.float64]
    harmonic_amplitude: NDArray[np.float64]
    harmonic_std: NDArray[np.float64]
    status: NDArray[np.int8]
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
    def outer_race_radius(self) -> float:
        """r_o of the map's bearing, m, which turns an extent into a length (Eq. 90)."""
        return race_radius(self.plan.bearing)

    @property
    def hash(self) -> str:
        """Hash of the plan and the model's version."""
        return str(self.attributes["hash"])

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
            at(self.rms),
            at(self.rms_error),
            at(self.harmonic_amplitude),
            self.rms_band,
        )


def _condition(name: str, axis: NDArray[np.float64], value: float) -> tuple[int, float]:
    slack = _CONDITION_TOLERANCE
    if not axis[0] * (1.0 - slack) <= value <= axis[-1] * (1.0 + slack):
        raise OutsideMapError(f"the map covers {name} {axis[0]:g} to {axis[-1]:g}, asked for {value!r}")
    index, fraction = _cell(axis, np.array(value))
    return int(index), float(fraction)
