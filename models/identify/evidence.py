"""What is known of a rig without tests at known defects: its resonances, and priors of its parameters.

Frequencies and damping ratios do not tell the scale of a rig. With all masses, stiffnesses and dampings times a factor,
and k_c times its power n, every mode at every load stays as it is. What tells the scale: an accelerance, whose unit
has the force in it; a prior of any mass or stiffness, k_c among them; a test at a defect of known size.

Natural frequencies, damping ratios and accelerance of a rig at rest under a load (thesis, Eqs. 39, 59 and 60).

Each direction has three modes: shaft and rings on the shaft's stiffness, the rings against each other on the contacts,
and the casing against the resonator. The contacts enter with their mean stiffness over a ball passage, and with the
damping of Eq. 39 at rest, ``alpha_c m_b`` a pressed element and ``beta_c k_c delta^(n - 1)``, which is ``beta_c / n``
of their stiffness.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.identify.space import ORDER, bearing_directions
from models.machine.contact_estimates import STEEL_DENSITY, estimate_stiffness
from models.machine.hertz import contact_exponent
from models.words.errors import WrongInputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space
    from models.machine.bearing import Bearing, CatalogueEntry
    from models.machine.rig import Rig

MODES = 3
"""Modes of one direction."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of several directions or loads, ascending, shapes (directions, modes).

    Attributes:
        frequency: absolute value of the eigenvalue, Hz.
        damping: damping ratio; 1 or more where the mode does not oscillate.
    """

    frequency: NDArray[np.float64]
    damping: NDArray[np.float64]


def contact_coefficients(rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the damping of the contacts, N s/m, for a stiffness of the bearing, N/m, same shape.

    Half of the elements are taken as pressed, as without clearance; ``alpha_c`` has next to no effect.
    """
    pressed = 0.25 * bearing.n_elements * bearing.rows
    return rig.beta_c / contact_exponent(bearing) * k_b + rig.alpha_c * rig.m_b * pressed


def modes(rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]) -> Modes:
    """Return the modes of a rig for stiffnesses of its bearing, N/m, shape (directions,)."""
    mass, damping, stiffness = _matrices(rig, bearing, k_b)
    state = np.zeros((len(k_b), 2 * MODES, 2 * MODES))
    state[:, :MODES, MODES:] = np.eye(MODES)
    state[:, MODES:, :MODES] = -stiffness / mass[:, None]
    state[:, MODES:, MODES:] = -damping / mass[:, None]
    found = [_pairs(values) for values in np.linalg.eigvals(state)]
    frequency, ratio = np.array([f for f, _ in found]), np.array([z for _, z in found])
    return Modes(frequency / (2.0 * math.pi), ratio)


def accelerance(
    rig: Rig, bearing: Bearing, k_b: NDArray[np.float64], frequency: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Return the acceleration of the casing for a force on it, m/s2 per N, shape (directions, frequencies).

    ``frequency`` in Hz, shape (frequencies,), or (directions, frequencies) where each direction has its own.
    """
    mass, damping, stiffness = _matrices(rig, bearing, k_b)
    omega = 2.0 * math.pi * np.broadcast_to(frequency, (len(k_b), np.shape(frequency)[-1]))[..., None, None]
    dynamic = stiffness[:, None] + 1j * omega * damping[:, None] - omega**2 * np.diag(mass)
    force = np.broadcast_to(np.array([[0.0], [1.0], [0.0]]), (*dynamic.shape[:-1], 1))
    response = np.linalg.solve(dynamic, force)[..., 1, 0]
    return -(omega[..., 0, 0] ** 2) * response


def _matrices(
    rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the masses, shape (3,), and damping and stiffness, shape (directions, 3, 3): shaft, casing, resonator."""
    mass = np.array([rig.m_i, rig.m_o, rig.m_r])
    damping = _coupled(contact_coefficients(rig, bearing, k_b), rig.c_i, rig.c_r)
    return mass, damping, _coupled(k_b, rig.k_i, rig.k_r)


def _coupled(between: NDArray[np.float64], to_ground: float, to_resonator: float) -> NDArray[np.float64]:
    matrix = np.zeros((len(between), MODES, MODES))
    matrix[:, 0, 0], matrix[:, 1, 1], matrix[:, 2, 2] = between + to_ground, between + to_resonator, to_resonator
    matrix[:, 0, 1] = matrix[:, 1, 0] = -between
    matrix[:, 1, 2] = matrix[:, 2, 1] = -to_resonator
    return matrix


def _pairs(eigenvalues: NDArray[np.complex128]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return angular frequency and damping ratio of the pairs, ascending; real ones are paired in their order."""
    complex_ones = eigenvalues[eigenvalues.imag > 0.0]
    real_ones = np.sort(np.abs(eigenvalues[eigenvalues.imag == 0.0].real))
    first, second = real_ones[0::2], real_ones[1::2]
    overdamped = np.sqrt(first * second)
    omega = np.concatenate([np.abs(complex_ones), overdamped])
    ratio = np.concatenate(
        [-complex_ones.real / np.abs(complex_ones), 0.5 * (first + second) / np.maximum(overdamped, 1e-300)]
    )
    order = np.argsort(omega)
    return omega[order], ratio[order]


# Standard uncertainty of the logarithm: of Hertz' theory with the simplified coefficients against printed and exact
# values (2 to 7 %), and of the mass of a plain shaft, which has steps, nuts and a part beyond the other bearing that
# moves less.
_HERTZ, _SHAFT = 0.05, 0.25
# Rings fill so much of the space between their race and the bore or the outside; as a lower limit of what moves.
_RING = 0.8
_LIMIT = 0.1


def geometry_priors(entry: CatalogueEntry, shaft: tuple[float, float] | None = None) -> list[Prior]:
    """Return what geometry tells of a rig.

    k_c follows from Hertz (balls) or Palmgren (rollers) with the bound of what is not known of the contacts. The mass
    of a plain steel shaft and the inner ring is that of m_i. The rings alone are lower limits of m_i and m_o: a casing
    is not part of the bearing.

    Args:
        entry: the bearing; without its dimensions nothing is said of its rings.
        shaft: diameter and length of the shaft that belongs to this bearing, m: about half of that between bearings.

    Raises:
        ValueError: if a known radius of the bearing does not conform.
    """
    stiffness = estimate_stiffness(entry)
    formula = "Hertz" if entry.bearing.element == "ball" else "Palmgren"
    bound = 0.25 * math.log(stiffness.high / stiffness.low)
    words = f"{formula}, contacts of {entry.bearing.designation}"
    if stiffness.estimated:
        words += f", {', '.join(stiffness.estimated)} estimated"
    priors = [Prior("k_c", stiffness.value, math.hypot(_HERTZ, bound), words)]
    inner, outer = _ring_masses(entry)
    if outer is not None:
        priors.append(Prior("m_o", outer, _LIMIT, f"outer ring of {entry.bearing.designation}", at_least=True))
    if shaft is not None:
        diameter, length = shaft
        mass = STEEL_DENSITY * 0.25 * math.pi * diameter**2 * length + (inner or 0.0)
        words = f"steel shaft of {diameter * 1e3:g} mm x {length * 1e3:g} mm and inner ring"
        priors.append(Prior("m_i", mass, _SHAFT, words))
    elif inner is not None:
        priors.append(Prior("m_i", inner, _LIMIT, f"inner ring of {entry.bearing.designation}", at_least=True))
    return priors


def _ring_masses(entry: CatalogueEntry) -> tuple[float | None, float | None]:
    """Return the masses of inner and outer ring, kg, None where dimensions are not known."""
    if entry.dimensions is None:
        return None, None
    bore, outside, width = entry.dimensions
    bearing = entry.bearing
    reach = bearing.element_diameter * math.cos(bearing.contact_angle)
    inner_race, outer_race = bearing.pitch_diameter - reach, bearing.pitch_diameter + reach
    scale = _RING * STEEL_DENSITY * 0.25 * math.pi * width
    inner, outer = scale * (inner_race**2 - bore**2), scale * (outside**2 - outer_race**2)
    return (inner if inner > 0.0 else None), (outer if outer > 0.0 else None)


Direction = Literal["along", "across", ""]
DIRECTIONS: tuple[Direction, ...] = ("along", "across")
SCALES = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r")
"""Parameters of which each, known, fixes the scale of masses and stiffnesses."""
# An extracted peak that is so many standard deviations from every mode counts as none of them.
_FOREIGN = 3.0


@dataclass(frozen=True)
class Peak:
    """A resonance that was measured, with standard uncertainties.

    Attributes:
        load: radial load during the measurement, N.
        direction: of force and sensor to the load, "" where it is not known.
        frequency, frequency_sd: Hz.
        damping, damping_sd: damping ratio, or None; the uncertainty is absolute.
        accelerance, accelerance_sd: largest acceleration of the casing for a force on it, m/s2 per N, or None; the
            uncertainty is absolute.
        extracted: whether a program found it in a recording, so that it may be no resonance of this model.
    """

    load: float
    direction: Direction
    frequency: float
    frequency_sd: float
    damping: float | None = None
    damping_sd: float | None = None
    accelerance: float | None = None
    accelerance_sd: float | None = None
    extracted: bool = False


@dataclass(frozen=True)
class Prior:
    """What is known of a parameter beforehand.

    Attributes:
        name: of ``models.identify.space.ORDER``.
        value: SI.
        sd: standard uncertainty of its logarithm.
        source: where it comes from, in words.
        at_least: whether the value is a lower limit: the rig has this and more.
    """

    name: str
    value: float
    sd: float
    source: str
    at_least: bool = False

    def __post_init__(self) -> None:
        """Raise a WrongInputError that names a prior of no use."""
        if self.name not in ORDER or self.name == "clearance":
            raise WrongInputError(f"{self.name!r} cannot have a prior; expected a mass, a stiffness or a damping")
        for name in ("value", "sd"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise WrongInputError(f"prior of {self.name}: {name} must be positive, got {value!r}")


@dataclass(frozen=True)
class _Group:
    """Stated or extracted peaks of one load and direction, ascending."""

    load: float
    direction: Direction
    extracted: bool
    peaks: tuple[Peak, ...]

    @cached_property
    def _measured(self) -> NDArray[np.float64]:
        """Frequencies, damping ratios and accelerances, shape (peaks, 3); NaN where they are not known."""
        rows = [(peak.frequency, peak.damping, peak.accelerance) for peak in self.peaks]
        return np.array(rows, dtype=np.float64)

    @cached_property
    def _deviations(self) -> NDArray[np.float64]:
        """Their standard uncertainties, those of damping ratios and accelerances relative."""
        rows = [(peak.frequency_sd, peak.damping_sd, peak.accelerance_sd) for peak in self.peaks]
        found = np.array(rows, dtype=np.float64)
        found[:, 1:] /= self._measured[:, 1:]
        return found

    def residuals(self, rig: Rig, bearing: Bearing, k_b: NDArray[np.float64]) -> list[float]:
        """Return the residuals for the likeliest assignment of the peaks to the modes.

        Stated peaks keep the order of the modes; each extracted one takes the nearest mode, or is none of them.
        ``k_b`` is the stiffness of the bearing in the directions that are possible, N/m.
        """
        found = modes(rig, bearing, k_b)
        order = np.argsort(found.frequency, axis=None)
        known = ~np.isnan(self._measured)
        model = np.ones((3, len(order)))
        model[0], model[1] = found.frequency.ravel()[order], found.damping.ravel()[order]
        if np.any(known[:, 2]):
            model[2] = np.abs(accelerance(rig, bearing, k_b, found.frequency)).ravel()[order]
        # Damping ratios and levels spread by factors.
        away = np.empty((len(self.peaks), len(order), 3))
        away[..., 0] = model[0] - self._measured[:, None, 0]
        away[..., 1:] = np.log(np.maximum(model[1:].T, 1e-300) / self._measured[:, None, 1:])
        away = np.where(known[:, None], away / self._deviations[:, None], 0.0)
        costs = np.sum(np.square(away), axis=-1)
        if self.extracted:
            taken = np.argmin(costs, axis=1)
        else:
            every = np.array(list(combinations(range(len(order)), len(self.peaks))))
            taken = every[np.argmin(np.sum(costs[np.arange(len(self.peaks)), every], axis=1))]
        numbers = np.arange(len(self.peaks))
        chosen = away[numbers, taken]
        if self.extracted:
            # No longer than that of a peak which is no mode.
            length = np.maximum(np.sqrt(costs[numbers, taken]), 1e-9)
            chosen *= (_FOREIGN * np.tanh(length / _FOREIGN) / length)[:, None]
        return chosen[known].tolist()


@dataclass(frozen=True)
class Evidence:
    """Peaks and priors that enter the likelihood beside the tests."""

    peaks: tuple[Peak, ...] = ()
    priors: tuple[Prior, ...] = ()

    def __post_init__(self) -> None:
        """Raise a WrongInputError where there are more stated peaks than the model has resonances."""
        for group in self._groups:
            most = MODES if group.direction else MODES * len(DIRECTIONS)
            if len(group.peaks) > most and not group.extracted:
                where = f"{group.load:g} N" + (f" {group.direction} it" if group.direction else "")
                raise WrongInputError(f"{len(group.peaks)} peaks at {where}; the model has {most} resonances there")

    @cached_property
    def _groups(self) -> tuple[_Group, ...]:
        """The peaks of one load and direction, ascending."""
        groups: dict[tuple[float, Direction, bool], list[Peak]] = {}
        for peak in sorted(self.peaks, key=lambda peak: peak.frequency):
            groups.setdefault((peak.load, peak.direction, peak.extracted), []).append(peak)
        return tuple(_Group(*key, tuple(peaks)) for key, peaks in groups.items())

    @property
    def loads(self) -> tuple[float, ...]:
        """Loads of the peaks, N, ascending."""
        return tuple(sorted({peak.load for peak in self.peaks}))

    @property
    def size(self) -> int:
        """Number of residuals."""
        measured = sum(1 + (peak.damping is not None) + (peak.accelerance is not None) for peak in self.peaks)
        return measured + len(self.priors)

    @property
    def observations(self) -> int:
        """Number of measured values and priors, without lower limits."""
        return self.size - sum(prior.at_least for prior in self.priors)

    def residuals(self, space: Space, values: Mapping[str, float]) -> NDArray[np.float64]:
        """Return the differences of a candidate over their standard uncertainties: of the peaks, then of the priors."""
        rig = space.rig_of(values)
        found: list[float] = []
        for group in self._groups:
            across, along = bearing_directions(space.bearing, group.load, values["k_c"], values["clearance"])
            stiffness = ((along, "along"), (across, "across"))
            k_b = np.array([k for k, name in stiffness if group.direction in ("", name)])
            found += group.residuals(rig, space.bearing, k_b)
        return np.array([*found, *_prior_residuals(self.priors, values)])

    def facts(self) -> dict[str, Any]:
        """Return all that a result depends on, as JSON has it."""
        return {"peaks": [asdict(peak) for peak in self.peaks], "priors": [asdict(prior) for prior in self.priors]}


def _prior_residuals(priors: Sequence[Prior], values: Mapping[str, float]) -> Iterator[float]:
    for prior in priors:
        difference = math.log(values[prior.name] / prior.value) / prior.sd
        yield min(difference, 0.0) if prior.at_least else difference
