"""What is known of a rig without tests at known defects: its resonances, and priors of its parameters.

Frequencies and damping ratios do not tell the scale of a rig. With all masses, stiffnesses and dampings times a factor,
and k_c times its power n, every mode at every load stays as it is. What tells the scale: an accelerance, whose unit
has the force in it; a prior of any mass or stiffness, k_c among them; a test at a defect of known size.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from models.errors import WrongInputError
from models.identify.modes import MODES, accelerance, modes
from models.identify.space import ORDER, bearing_directions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.identify.space import Space
    from models.rigs.six_dof import Rig

Direction = Literal["along", "across", ""]
DIRECTIONS: tuple[Direction, ...] = ("along", "across")
SCALES = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r")
"""Parameters of which each, known, fixes the scale of masses and stiffnesses."""

_Group = tuple[float, Direction, bool]

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
class Evidence:
    """Peaks and priors that enter the likelihood beside the tests."""

    peaks: tuple[Peak, ...] = ()
    priors: tuple[Prior, ...] = ()

    def __post_init__(self) -> None:
        """Raise a WrongInputError where there are more stated peaks than the model has resonances."""
        for (load, direction, extracted), peaks in self._groups:
            most = MODES if direction else MODES * len(DIRECTIONS)
            if len(peaks) > most and not extracted:
                where = f"{load:g} N" + (f" {direction} it" if direction else "")
                raise WrongInputError(f"{len(peaks)} peaks at {where}; the model has {most} resonances there")

    @cached_property
    def _groups(self) -> tuple[tuple[_Group, tuple[Peak, ...]], ...]:
        """The peaks of one load and direction, ascending."""
        groups: dict[_Group, list[Peak]] = {}
        for peak in sorted(self.peaks, key=lambda peak: peak.frequency):
            groups.setdefault((peak.load, peak.direction, peak.extracted), []).append(peak)
        return tuple((key, tuple(peaks)) for key, peaks in groups.items())

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
        for (load, direction, _), peaks in self._groups:
            across, along = bearing_directions(space.bearing, load, values["k_c"], values["clearance"])
            k_b = np.array([k for k, name in ((along, "along"), (across, "across")) if direction in ("", name)])
            found += _group_residuals(rig, space, k_b, peaks)
        return np.array([*found, *_prior_residuals(self.priors, values)])

    def facts(self) -> dict[str, Any]:
        """Return all that a result depends on, as JSON has it."""
        return {"peaks": [asdict(peak) for peak in self.peaks], "priors": [asdict(prior) for prior in self.priors]}


def _prior_residuals(priors: Sequence[Prior], values: Mapping[str, float]) -> Iterator[float]:
    for prior in priors:
        difference = math.log(values[prior.name] / prior.value) / prior.sd
        yield min(difference, 0.0) if prior.at_least else difference


def _group_residuals(rig: Rig, space: Space, k_b: NDArray[np.float64], peaks: Sequence[Peak]) -> list[float]:
    """Return the residuals of peaks of one load and direction for the likeliest of their assignments to modes.

    Stated peaks keep the order of the modes; each extracted one takes the nearest mode, or is none of them.
    """
    found = modes(rig, space.bearing, k_b)
    order = np.argsort(found.frequency, axis=None)
    frequency, damping = found.frequency.ravel()[order], found.damping.ravel()[order]
    levels: NDArray[np.float64] | None = None
    if any(peak.accelerance is not None for peak in peaks):
        levels = np.abs(accelerance(rig, space.bearing, k_b, found.frequency)).ravel()[order]

    def differences(peak: Peak, mode: int) -> list[float]:
        values = [(float(frequency[mode]) - peak.frequency) / peak.frequency_sd]
        if peak.damping is not None and peak.damping_sd is not None:
            # Damping ratios and levels spread by factors.
            values.append(math.log(max(float(damping[mode]), 1e-12) / peak.damping) * peak.damping / peak.damping_sd)
        if peak.accelerance is not None and peak.accelerance_sd is not None and levels is not None:
            values.append(
                math.log(max(float(levels[mode]), 1e-300) / peak.accelerance) * peak.accelerance / peak.accelerance_sd
            )
        return values

    if peaks[0].extracted:
        chosen = [_nearest([differences(peak, mode) for mode in range(len(frequency))]) for peak in peaks]
    else:
        options = (
            [differences(peak, mode) for peak, mode in zip(peaks, taken, strict=True)]
            for taken in combinations(range(len(frequency)), len(peaks))
        )
        chosen = min(options, key=lambda rows: sum(value * value for row in rows for value in row))
    return [value for row in chosen for value in row]


def _nearest(rows: Sequence[list[float]]) -> list[float]:
    """Return the residuals of the nearest mode, of a length that does not exceed that of a peak which is no mode."""
    row = min(rows, key=lambda row: sum(value * value for value in row))
    length = math.sqrt(sum(value * value for value in row))
    shortened = _FOREIGN * math.tanh(length / _FOREIGN) / length if length > 0.0 else 1.0
    return [value * shortened for value in row]
