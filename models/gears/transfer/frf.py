"""Frequency response functions from forces to vibration or sound, and their application.

With the time factor exp(+i omega t) a response is h (complex, output over input), so that h of an acceleration over a
force is -omega^2 times that of the displacement. Between the given lines h is interpolated linearly in its real and
imaginary parts; near a single resonance f_n of damping ratio zeta the error of that is at most (d / (2 zeta f_n))^2 of
the peak, d the distance of the lines. Outside the given band h is taken for zero, and every application says what share
of its input lies there.

An input or output that is a direction at a point is called ``POINT.x``, ``POINT.y`` or ``POINT.z``; a scalar, such as a
pressure, has a name without these ends.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from models.words.checks import check_positive
from models.words.numerics import fast_length

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Self

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

MOTION_UNITS = ("m", "m/s", "m/s2")
"""Units of a motion, each the rate of change of the one before."""
MAX_SAMPLES = 1 << 27
"""Most samples of one transform."""
_LINES_AT_ONCE = 2048


@dataclass(frozen=True, eq=False)
class FrequencyResponses:
    """Responses of some outputs to some inputs over one band.

    Attributes:
        frequency: of the lines, Hz, ascending, not negative, two at least, shape (f,).
        h: responses, output unit over input unit, shape (f, outputs, inputs).
        outputs, inputs: names, each once.
        output_unit, input_unit: of all outputs and all inputs, SI: "m/s2", "m/s", "m", "Pa"; "N", "m/s".
    """

    frequency: Array
    h: Complex
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    output_unit: str = "m/s2"
    input_unit: str = "N"

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field of an unusable value."""
        frequency, h = np.asarray(self.frequency, np.float64), np.asarray(self.h, np.complex128)
        object.__setattr__(self, "frequency", frequency)
        object.__setattr__(self, "h", h)
        if frequency.ndim != 1 or frequency.size < 2:
            raise ValueError(f"frequency must be of shape (f,) with two lines at least, got shape {frequency.shape}")
        rising = np.isfinite(frequency) & (np.diff(frequency, prepend=-1.0) > 0.0) & (frequency >= 0.0)
        if not rising.all():
            line = int(np.argmin(rising))
            raise ValueError(
                f"frequency must be finite, not negative and ascending, got {float(frequency[line])!r} Hz "
                f"in line {line + 1}"
            )
        for field in ("outputs", "inputs"):
            names: tuple[str, ...] = getattr(self, field)
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice or not names or "" in names:
                raise ValueError(f"{field} must be names, each once, got {names!r}")
        expected = (frequency.size, len(self.outputs), len(self.inputs))
        if h.shape != expected:
            raise ValueError(f"h must have shape (f, outputs, inputs) = {expected}, got {h.shape}")
        if not np.isfinite(h).all():
            line, output, given = (int(place[0]) for place in np.nonzero(~np.isfinite(h)))
            pair = f"{self.outputs[output]} over {self.inputs[given]}"
            raise ValueError(f"h must be finite, got {complex(h[line, output, given])!r} for {pair} in line {line + 1}")

    @property
    def band(self) -> tuple[float, float]:
        """First and last line, Hz."""
        return float(self.frequency[0]), float(self.frequency[-1])

    def inside(self, frequency: Array) -> NDArray[np.bool_]:
        """Return which frequencies, Hz, lie in the band, its ends included."""
        low, high = self.band
        return (frequency >= low) & (frequency <= high)

    def at(self, frequency: Array | float) -> Complex:
        """Return the responses at frequencies, Hz, shape (n, outputs, inputs), zero outside the band."""
        wanted = np.atleast_1d(np.asarray(frequency, np.float64))
        low, weight = self._places(wanted)
        share = weight[:, None, None]
        h = (1.0 - share) * self.h[low] + share * self.h[low + 1]
        return np.where(self.inside(wanted)[:, None, None], h, 0.0)

    def _places(self, frequency: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the line below each frequency and the weight of the one above."""
        low = np.clip(np.searchsorted(self.frequency, frequency, side="right") - 1, 0, self.frequency.size - 2)
        weight = (frequency - self.frequency[low]) / (self.frequency[low + 1] - self.frequency[low])
        return low, weight

    def interpolation_error(self) -> Array:
        """Return the estimated error of interpolation, of the greatest response of a pair, shape (outputs, inputs).

        It is a quarter of the error with which every other line is interpolated from its neighbours: the error falls
        with the square of the distance. Lines that are too far apart to show a resonance at all are not noticed.
        """
        if self.frequency.size < 3:
            return np.full(self.h.shape[1:], np.inf)
        f = self.frequency
        share = ((f[1:-1] - f[:-2]) / (f[2:] - f[:-2]))[:, None, None]
        missed = np.abs(self.h[1:-1] - (1.0 - share) * self.h[:-2] - share * self.h[2:]).max(axis=0)
        greatest = np.abs(self.h).max(axis=0)
        return 0.25 * missed / np.where(greatest > 0.0, greatest, 1.0)

    def apply(self, forces: Array, rate: float, *, periodic: bool = False) -> Transferred:
        """Return the outputs in time of inputs in time, through the Fourier transform of the whole record.

        Args:
            forces: shape (inputs, samples), in the unit and order of the inputs.
            rate: of the samples, Hz.
            periodic: whether the record is one period of what goes on for ever, so that its end meets its beginning.
                Otherwise there is nothing before it and the outputs begin at rest; zeros are appended for as long as
                the lines can tell, one over their least distance.

        Raises:
            ValueError: the shape does not fit, a value is not finite, the rate not positive or the lines too near.
        """
        check_positive(rate=rate)
        forces = np.asarray(forces, np.float64)
        if forces.ndim != 2 or forces.shape[0] != len(self.inputs) or forces.shape[1] < 2:
            raise ValueError(
                f"forces must have shape (inputs, samples) = ({len(self.inputs)}, 2 or more), got {forces.shape}"
            )
        if not np.isfinite(forces).all():
            raise ValueError("forces must be finite")
        samples = forces.shape[1]
        memory = 0 if periodic else int(np.ceil(rate / np.diff(self.frequency).min()))
        if samples + memory > MAX_SAMPLES:
            closest = np.diff(self.frequency).min()
            raise ValueError(
                f"lines {closest:g} Hz apart with {samples} samples at {rate:g} Hz need a transform of more than "
                f"{MAX_SAMPLES} samples"
            )
        length = samples if periodic else fast_length(samples + memory)
        spectrum = np.asarray(np.fft.rfft(forces, length), np.complex128)
        frequency = np.asarray(np.fft.rfftfreq(length, 1.0 / rate), np.float64)
        outside = _outside(spectrum, self.inside(frequency), length)
        answer = np.zeros((len(self.outputs), frequency.size), np.complex128)
        kept = np.nonzero(self.inside(frequency))[0]
        for start in range(0, kept.size, _LINES_AT_ONCE):
            part = kept[start : start + _LINES_AT_ONCE]
            answer[:, part] = np.einsum("foi,if->of", self.at(frequency[part]), spectrum[:, part])
        values = np.asarray(np.fft.irfft(answer, length)[:, :samples], np.float64)
        return Transferred(values, rate, self.outputs, self.output_unit, outside)

    def lines(self, frequency: Array, amplitudes: Complex) -> TransferredLines:
        """Return the complex amplitudes of the outputs for lines of the inputs.

        Args:
            frequency: of the lines, Hz, shape (n,).
            amplitudes: of the inputs, shape (n, inputs), with the time factor exp(+i omega t).

        Raises:
            ValueError: the shape does not fit.
        """
        frequency, amplitudes = np.asarray(frequency, np.float64), np.asarray(amplitudes, np.complex128)
        if amplitudes.shape != (frequency.size, len(self.inputs)) or frequency.ndim != 1:
            raise ValueError(
                f"amplitudes must have shape (n, inputs) = {(frequency.size, len(self.inputs))}, got {amplitudes.shape}"
            )
        found = np.einsum("foi,fi->fo", self.at(frequency), amplitudes)
        return TransferredLines(frequency, found, self.inside(frequency), self.outputs, self.output_unit)

    def select(self, outputs: Sequence[str] | None = None, inputs: Sequence[str] | None = None) -> Self:
        """Return the responses of some outputs to some inputs, in the order given.

        Raises:
            ValueError: a name is unknown; the message lists those that there are.
        """
        kept = _indices(self.outputs, outputs, "output"), _indices(self.inputs, inputs, "input")
        names = tuple(self.outputs[i] for i in kept[0]), tuple(self.inputs[i] for i in kept[1])
        return replace(self, h=self.h[:, kept[0]][:, :, kept[1]], outputs=names[0], inputs=names[1])

    def distributed(self, shares: Mapping[str, Mapping[str, float]]) -> Self:
        """Return the responses to new inputs, each of which is shared out to inputs of this.

        Such as a force on a shaft to its two bearings: ``{"shaft.x": {"left.x": 0.4, "right.x": 0.6}}``.

        Raises:
            ValueError: a share goes to an unknown input or is not finite.
        """
        matrix = np.zeros((len(self.inputs), len(shares)))
        for column, parts in enumerate(shares.values()):
            for name, row in zip(parts, _indices(self.inputs, tuple(parts), "input"), strict=True):
                matrix[row, column] = parts[name]
        if not np.isfinite(matrix).all():
            raise ValueError(f"shares must be finite, got {shares!r}")
        return replace(self, h=self.h @ matrix, inputs=tuple(shares))

    def then(self, after: FrequencyResponses) -> FrequencyResponses:
        """Return the chain of these responses and others whose inputs are outputs of these.

        It has the lines of these in the band that both have; the others are interpolated there.

        Raises:
            ValueError: units or names do not meet, or fewer than two lines are in both bands.
        """
        if after.input_unit != self.output_unit:
            raise ValueError(f"inputs that follow must be in {self.output_unit}, got {after.input_unit}")
        common = after.inside(self.frequency)
        if np.count_nonzero(common) < 2:
            raise ValueError("bands of a chain must have two lines in common, got {:g} to {:g} and {:g} to {:g} Hz"
                             .format(*self.band, *after.band))  # fmt: skip
        first = self.select(after.inputs).h[common]
        h = after.at(self.frequency[common]) @ first
        return FrequencyResponses(
            self.frequency[common], h, after.outputs, self.inputs, after.output_unit, self.input_unit
        )

    def in_unit(self, unit: str) -> Self:
        """Return the responses of a motion as displacement, velocity or acceleration.

        Raises:
            ValueError: either is no unit of a motion, or a line at 0 Hz would have to be integrated.
        """
        for name in (self.output_unit, unit):
            if name not in MOTION_UNITS:
                raise ValueError(f"unit of a motion must be one of {', '.join(MOTION_UNITS)}, got {name}")
        order = MOTION_UNITS.index(unit) - MOTION_UNITS.index(self.output_unit)
        if order < 0 and self.frequency[0] == 0.0:
            raise ValueError(f"responses in {self.output_unit} at 0 Hz do not tell those in {unit}")
        omega = 2j * np.pi * self.frequency
        return replace(self, h=self.h * (omega**order)[:, None, None], output_unit=unit)


@dataclass(frozen=True, eq=False)
class Transferred:
    """Outputs in time.

    Attributes:
        values: shape (outputs, samples).
        rate: Hz.
        outside: share of the mean square of each input, its mean left out, that lies outside the band and gives
            nothing, shape (inputs,).
    """

    values: Array
    rate: float
    outputs: tuple[str, ...]
    unit: str
    outside: Array


@dataclass(frozen=True, eq=False)
class TransferredLines:
    """Outputs of single lines.

    Attributes:
        frequency: Hz, shape (n,).
        amplitudes: complex, shape (n, outputs), zero where a line is outside the band.
        inside: which lines are in the band, shape (n,).
    """

    frequency: Array
    amplitudes: Complex
    inside: NDArray[np.bool_]
    outputs: tuple[str, ...]
    unit: str


def joined(parts: Sequence[FrequencyResponses]) -> FrequencyResponses:
    """Return responses of the same lines and inputs but different outputs as one.

    Raises:
        ValueError: there is none, or lines, inputs or units differ.
    """
    if not parts:
        raise ValueError("responses to join: expected one at least, got none")
    first = parts[0]
    for part in parts[1:]:
        if not np.array_equal(part.frequency, first.frequency):
            raise ValueError("responses to join must have the same lines")
        for field in ("inputs", "input_unit", "output_unit"):
            if getattr(part, field) != getattr(first, field):
                raise ValueError(
                    f"responses to join must have the same {field}, got {getattr(first, field)!r} "
                    f"and {getattr(part, field)!r}"
                )
    h = np.concatenate([part.h for part in parts], axis=1)
    return replace(first, h=h, outputs=tuple(name for part in parts for name in part.outputs))


def _indices(known: tuple[str, ...], wanted: Sequence[str] | None, kind: str) -> list[int]:
    def found() -> Iterator[int]:
        for name in known if wanted is None else wanted:
            if name not in known:
                raise ValueError(f"unknown {kind} {name!r}; there are {', '.join(known)}")
            yield known.index(name)

    return list(found())


def _outside(spectrum: Complex, inside: NDArray[np.bool_], length: int) -> Array:
    """Return the share of the variance of each input at frequencies that are not inside, shape (inputs,)."""
    power = np.abs(spectrum) ** 2
    power[:, 0] = 0.0
    # All but the first line, and the last of an even length, stand for two.
    power[:, 1 : (length - 1) // 2 + 1] *= 2.0
    total = power.sum(axis=1)
    return power[:, ~inside].sum(axis=1) / np.where(total > 0.0, total, 1.0)
