"""The vibration of a simulated bearing: RMS, peak, lines, and the signal at any sampling rate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from models.words.checks import check_positive
from models.words.numerics import crests, summed
from models.words.request import Quantity, Request, Sensor, check_band

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from models.machine.speed_profile import SpeedProfile

Status = Literal["converged", "not_periodic", "not_converged", "inaccurate", "uncalibrated"]
STATUSES: tuple[Status, ...] = ("converged", "not_periodic", "not_converged", "inaccurate", "uncalibrated")

HARMONICS = 6
# Share of the Nyquist frequency below the transition band of a recorder's anti-alias filter.
PASSBAND = 0.9
CASING: tuple[Sensor, ...] = ("mo", "mr")
_CHUNK = 8192
_PEAK_OVERSAMPLING = 8


@dataclass(frozen=True, eq=False)
class SignalRecord:
    """Signals of a motion that was simulated over time, as a recorder would sample them.

    Attributes:
        rate: sampling rate, Hz.
        signal: m/s2 ("ias": rad/s), shape (sensors, samples), passed through a linear-phase filter that ends at the
            Nyquist frequency (flat to 0.9 of it, then 80 dB down).
        sensors: of the rows of ``signal``.
    """

    rate: float
    signal: NDArray[np.float64]
    sensors: tuple[Sensor, ...] = CASING

    def of(self, sensor: Sensor | None = None) -> NDArray[np.float64]:
        """Return the signal of a sensor, None for the first, shape (samples,)."""
        return self.signal[row_of(self.sensors, sensor)]

    def in_band(self, low: float, high: float, sensor: Sensor | None = None) -> NDArray[np.float64]:
        """Return the part of a signal between two frequencies, Hz, both included, in its unit, shape (samples,).

        Raises:
            ValueError: if the band is empty or reaches beyond 0.9 of the Nyquist frequency.
        """
        check_band((low, high))
        passed = PASSBAND * 0.5 * self.rate
        if high > passed:
            raise ValueError(f"the band ends at {high!r} Hz, the signal is flat up to {passed:g} Hz")
        return band_passed(self.of(sensor), self.rate, (low, high))

    def levels_in_band(self, low: float, high: float, sensor: Sensor | None = None) -> tuple[float, float]:
        """Return RMS and peak of the sampled signal between two frequencies, Hz; errors as ``in_band``."""
        inside = self.in_band(low, high, sensor)
        peak = max(float(np.max(np.abs(inside))), float(crests(inside[:-2], inside[1:-1], inside[2:])))
        return float(np.sqrt(np.mean(inside**2))), peak

    def line(self, frequency: float, sensor: Sensor | None = None) -> float:
        """Return the single-sided amplitude at one frequency, Hz, through a Hann window."""
        return float(2.0 * np.abs(self.coefficients(frequency, 1)[row_of(self.sensors, sensor), 1]))

    def coefficients(self, fundamental: float, count: int) -> NDArray[np.complex128]:
        """Return the Fourier coefficients 0..count at multiples of a frequency, Hz, through a Hann window.

        The amplitude of line k is 2 |c_k|; shape (sensors, count + 1). Lines closer than four over the duration of
        the signal are not told apart.
        """
        samples = self.signal.shape[1]
        window = np.hanning(samples + 2)[1:-1]
        return _at_multiples(self.signal * (window / np.sum(window)), fundamental / self.rate, count)


class LeftOut(NamedTuple):
    """An effect of a scene (``models.machine.scene.EFFECTS``) that was left out because it is too small to matter.

    ``bound``: relative change of ``Response.quantity`` that it can make at most; every stated error contains its own.
    """

    effect: str
    bound: float


class Added(NamedTuple):
    """Effects of a scene whose lines stand beside those of the ball passage, at m * frequency + k * bpfo.

    Attributes:
        effects: names in ``models.machine.scene.EFFECTS``.
        frequency: Hz.
        coefficients: c_mk of exp(2 pi i (m frequency + k bpfo) t), m = 1..M, k = -K..K, m/s2, shape (sensors, M,
            2 K + 1); the amplitude of a line is twice that. M is zero where the motion repeats with the ball passage.
    """

    effects: tuple[str, ...]
    frequency: float
    coefficients: NDArray[np.complex128]

    def lines(self, bpfo: float, row: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return frequencies, Hz, and amplitudes of the lines of a sensor."""
        orders, half = self.coefficients.shape[1], self.coefficients.shape[2] // 2
        shaft = self.frequency * np.arange(1.0, orders + 1.0, dtype=np.float64)
        frequency = np.abs(shaft[:, None] + bpfo * np.arange(-half, half + 1.0, dtype=np.float64))
        return frequency.ravel(), 2.0 * np.abs(self.coefficients[row]).ravel()


@dataclass(frozen=True, eq=False)
class Derivative:
    """How a settled vibration changes by one parameter, m/s2 over the SI unit of that parameter.

    Attributes:
        rms: of the RMS of the first sensor in ``Response.rms_band``.
        harmonics: of the amplitudes of the first lines, (HARMONICS,); NaN of a line that is silent.
        rms_error, harmonics_error: their errors, estimated from two grids of steps, in the same units.
        status: "checked" (two grids of steps agree within the accuracy), "inaccurate" (they do not, or not beyond what
            is stated) or "withheld" (unknown, NaN).
        why: it is withheld, "" where it is not.
    """

    rms: float
    harmonics: NDArray[np.float64]
    rms_error: float
    harmonics_error: NDArray[np.float64]
    status: Literal["checked", "inaccurate", "withheld"]
    why: str


@dataclass(frozen=True, eq=False)
class Response:
    """The settled vibration of one scene, in m/s2 (sensor "ias": rad/s).

    What is said of errors, harmonics and spread is that of the first sensor. Each quantity has an error of its own,
    whatever was asked for; the status is that of the quantity that was.

    Attributes:
        levels: RMS (over several periods where the motion does not repeat) and largest absolute value of each sensor
            in ``rms_band``; ``rms`` and ``peak`` are those of the first.
        rms_error: relative error of ``rms``, estimated: that of the steps from halving them (and a second opinion:
            models.solve.six_dof.kernels.settled), and where the motion does not repeat ``averaging_error`` beside it.
        averaging_error: the part of ``rms_error`` that is left by the length of the time averaged; where the motion
            does not repeat, 95 % of such errors are within it.
        rms_se: the standard error of that mean, m/s2; zero where the motion repeats, or its speed changes.
        peak_error: relative error of ``peak``, estimated: that of the steps; where the motion does not repeat, the
            standard deviation over parts of the run, over ``peak``.
        waveform_error: RMS of the error due to the steps of the waveform over its RMS, estimated: at the steps
            where the motion repeats, of the record over time, NaN where it was not looked at.
        bpfo: ball-pass frequency over the outer race, Hz.
        harmonics: single-sided amplitudes of the first six lines k * bpfo, m/s2, shape (6,).
        harmonics_error: their estimated errors, m/s2: of the steps, and over time, of the length (95 %); NaN where the
            speed changes, or one period does not repeat.
        periods: ball periods that were simulated.
        period_change: relative change of the full-bandwidth RMS by the last of them, or expected by the next; NaN where
            the motion was simulated over time.
        spread: standard deviation of that RMS from period to period (over time: from block to block, a block being the
            slowest of turn of the shaft, turn of the cage and ball period that drives the motion), m/s2; zero if the
            motion repeats, NaN if it diverged (then the status is "not_converged").
        multiplier: largest absolute Floquet multiplier of the motion that repeats; beyond 1 it is unstable, and what is
            simulated instead is given. NaN where none was found or looked for.
        model, solver: what answered (models.solve.registry).
        status: "converged" (it repeats, is stable, and the error of the quantity that was asked for is within the
            accuracy), "not_periodic" (a mean and a spread are given, and that error is), "inaccurate" (it is not, of
            either), "uncalibrated" (levels without a unit) or "not_converged" (unusable).
        rms_band: the band (lo, hi), Hz, to which RMS and peak refer, or None for the full bandwidth.
        coefficients: complex Fourier coefficients c_k of exp(2 pi i k bpfo t), k = 0..K, m/s2, shape
            (sensors, K + 1). The amplitude of line k is twice that of c_k. Where the motion does not repeat, their
            amplitudes are those of the mean power and their phases those of the last period; over time, those of
            ``record``.
        record: the signal where the motion was simulated over time, else None.
        why: why this model and solver answered, or None where the scene names its model.
        sensors: of the rows of ``coefficients``.
        quantity: for which the accuracy was asked.
        lines_error: largest error of the first six lines of the scene's defect (of BPFO where it has none) over the
            largest of them, estimated from the steps; NaN where it was not looked at.
        v_eq_error: relative error of the equivalent volume that the RMS stands for, NaN where it was not asked for.
        model_error: predicted relative error of the quantity against the reference model (models.solve.mappings), 0
            where the reference itself answered.
        profile: how the shaft turned over the record, from its first sample on; of a model with an angular speed of its
            own, "ias" is beyond it. None where the motion was not simulated over time, or the model does not say. Where
            the speed changes, lines are those over the angle, of a shaft that turns at the speed of the scene, and
            there are HARMONICS of them.
        left_out: effects that are not in the answer.
        added: effects that were added to the motion that repeats, with lines of their own; None where there are none.
        derivatives: by the parameters that were asked for, by name.
    """

    levels: tuple[tuple[float, float], ...]
    rms_error: float
    rms_se: float
    peak_error: float
    waveform_error: float
    bpfo: float
    harmonics: NDArray[np.float64]
    harmonics_error: NDArray[np.float64]
    periods: int
    period_change: float
    spread: float
    multiplier: float
    model: str
    solver: str
    status: Status
    rms_band: tuple[float, float] | None
    coefficients: NDArray[np.complex128]
    record: SignalRecord | None = None
    why: str | None = None
    sensors: tuple[Sensor, ...] = CASING
    quantity: Quantity = "rms"
    lines_error: float = math.nan
    v_eq_error: float = math.nan
    model_error: float = 0.0
    profile: SpeedProfile | None = None
    left_out: tuple[LeftOut, ...] = ()
    averaging_error: float = 0.0
    added: Added | None = None
    derivatives: Mapping[str, Derivative] = field(default_factory=dict[str, Derivative])

    def turns(self) -> NDArray[np.float64]:
        """Return how far the shaft has turned at the samples of the record since the first, revolutions, (samples,).

        The angular speed of sensor "ias" is summed by Simpson's rule: at that sensor, not at the drive.

        Raises:
            ValueError: if there is no record, or nothing is known of the rotation.
        """
        if self.record is None or self.profile is None:
            raise ValueError(f"{self.model} {self.solver}: this response does not say how the shaft turned")
        time: NDArray[np.float64] = np.arange(self.record.signal.shape[1], dtype=np.float64) / self.record.rate
        turns = self.profile.turns_at(time)
        if "ias" in self.record.sensors:
            turns = turns + summed(self.record.of("ias"), 1.0 / self.record.rate) / (2.0 * math.pi)
        return turns

    def error_of(self, quantity: Quantity) -> float:
        """Return the relative error of a quantity that steps and averaging leave, NaN where it is unknown."""
        return {
            "waveform": self.waveform_error,
            "rms": self.rms_error,
            "lines": self.lines_error,
            "v_eq": self.v_eq_error,
        }[quantity]

    @property
    def error(self) -> float:
        """Relative error of the quantity that was asked for: of steps, averaging and model."""
        return self.error_of(self.quantity) + self.model_error

    @property
    def repeats(self) -> bool:
        """Whether the motion repeats with the ball passage; else levels are means over time."""
        return self.spread == 0.0

    def led_by(self, sensor: Sensor | None) -> Response:
        """Return the response with a sensor as the first, None for the first as it is; errors then apply relatively.

        Raises:
            ValueError: if the model has no such sensor.
        """
        row = row_of(self.sensors, sensor)
        if row == 0:
            return self
        order = [row, *(k for k in range(len(self.sensors)) if k != row)]
        share = self.levels[row][0] / self.rms if self.rms > 0.0 else 0.0
        coefficients = self.coefficients[order]
        return replace(
            self,
            levels=tuple(self.levels[k] for k in order),
            sensors=tuple(self.sensors[k] for k in order),
            coefficients=coefficients,
            harmonics=2.0 * np.abs(coefficients[0, 1 : HARMONICS + 1]),
            harmonics_error=self.harmonics_error * share,
            rms_se=self.rms_se * share,
            spread=self.spread * share,
            added=self.added and self.added._replace(coefficients=self.added.coefficients[order]),
        )

    @property
    def rms(self) -> float:
        """RMS of the first sensor in ``rms_band``."""
        return self.levels[0][0]

    @property
    def peak(self) -> float:
        """Largest absolute value of the first sensor in ``rms_band``."""
        return self.levels[0][1]

    @property
    def accelerometer(self) -> Sensor:
        """The first sensor of an acceleration."""
        return next(sensor for sensor in self.sensors if sensor != "ias")

    def levels_of(self, sensor: Sensor | None = None) -> tuple[float, float]:
        """Return RMS and peak of a sensor in ``rms_band``; raise a ValueError where the model has no such sensor."""
        return self.levels[row_of(self.sensors, sensor)]

    def lines(self, sensor: Sensor | None = None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return frequencies, Hz, and single-sided amplitudes of the lines k * bpfo, k = 1..K."""
        amplitude = 2.0 * np.abs(self.coefficients[row_of(self.sensors, sensor), 1:])
        return np.arange(1.0, len(amplitude) + 1.0) * self.bpfo, amplitude

    def all_lines(self, sensor: Sensor | None = None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what ``lines`` does, and behind them those of the effects that were added."""
        frequency, amplitude = self.lines(sensor)
        if self.added is None:
            return frequency, amplitude
        beside = self.added.lines(self.bpfo, row_of(self.sensors, sensor))
        return np.append(frequency, beside[0]), np.append(amplitude, beside[1])

    def rms_in_band(self, low: float, high: float, sensor: Sensor | None = None) -> float:
        """Return the RMS between two frequencies, both included, Hz: of the lines, or of the record.

        Raises:
            ValueError: if the band is empty or reaches beyond the lines that were computed, or what was recorded.
        """
        check_band((low, high))
        if self.record is not None:
            return self.record.levels_in_band(low, high, sensor)[0]
        frequency, amplitude = self.all_lines(sensor)
        if high > (highest := self.bpfo * (self.coefficients.shape[1] - 1)) + self.bpfo:
            raise ValueError(f"band ends at {high!r} Hz, the response was computed up to {highest:.0f} Hz")
        inside = (frequency >= low) & (frequency <= high)
        return math.sqrt(0.5 * float(np.sum(amplitude[inside] ** 2)))

    def acceleration(
        self,
        rate: float,
        duration: float,
        phase: float = 0.0,
        *,
        sensor: Sensor | None = None,
        band: tuple[float, float] | None = None,
    ) -> NDArray[np.float64]:
        """Return the signal as a recorder would sample it, shape (round(rate * duration),).

        Lines above 0.9 of the Nyquist frequency are left out, as by an ideal anti-alias filter; the others are exact
        at every sample. ``phase`` shifts the ball passages, rad: 2 pi is one ball period. Of a motion that was
        simulated over time it is the beginning of the record, at the rate of the record and without a shift.

        Raises:
            ValueError: if rate or duration is not positive and finite, the band is empty, or the record has no such
                signal.
        """
        check_positive(rate=rate, duration=duration)
        if self.record is not None:
            return self._recorded(self.record, rate, duration, phase, sensor=sensor, band=band)
        row, (low, high) = row_of(self.sensors, sensor), (0.0, math.inf) if band is None else check_band(band)
        high = min(high, PASSBAND * 0.5 * rate)
        # Orders of a frequency beside the ball passage, and the lines of each from a lowest multiple of it on.
        orders: list[tuple[float, int, NDArray[np.complex128]]] = [(0.0, 0, self.coefficients[row])]
        if self.added is not None:
            half = self.added.coefficients.shape[2] // 2
            beside = enumerate(self.added.coefficients[row], 1)
            orders += [(m * self.added.frequency, -half, lines) for m, lines in beside]
        samples = round(rate * duration)
        signal = np.zeros(samples)
        for frequency, first, lines in orders:
            at = np.abs(frequency + self.bpfo * np.arange(first, first + len(lines)))
            keep = (at >= low) & (at <= high) & (at > 0.0)
            kept = np.where(keep, 2.0 * lines, 0.0)[: int(np.flatnonzero(keep)[-1]) + 1 if keep.any() else 1]
            for start in range(0, samples, _CHUNK):
                n = np.arange(start, min(start + _CHUNK, samples))
                # The phase is reduced to one turn before it is multiplied by k, so that long signals lose no digits.
                turn = 2.0 * np.pi * np.mod(n * (self.bpfo / rate), 1.0) + phase
                found = _series(kept, np.exp(1j * turn))
                if frequency > 0.0:
                    other = 2.0 * np.pi * np.mod(n * (frequency / rate), 1.0) + frequency / self.bpfo * phase
                    found *= np.exp(1j * (first * turn + other))
                signal[start : start + len(n)] += np.real(found)
        return signal

    @staticmethod
    def _recorded(
        record: SignalRecord,
        rate: float,
        duration: float,
        phase: float,
        *,
        sensor: Sensor | None,
        band: tuple[float, float] | None,
    ) -> NDArray[np.float64]:
        """Return the beginning of a record; raise a ValueError that names what it does not have."""
        samples, most = round(rate * duration), record.signal.shape[1]
        if rate != record.rate:
            raise ValueError(f"rate must be that of the simulation over time, {record.rate:g} Hz, got {rate!r}")
        if samples > most:
            raise ValueError(f"duration must be within the {most / rate:g} s that were simulated, got {duration!r}")
        if phase != 0.0:
            raise ValueError(f"phase must be 0 where the motion was simulated over time, got {phase!r}")
        signal = record.of(sensor) if band is None else record.in_band(*band, sensor)
        return signal[:samples].copy()


def lines_error(harmonics: NDArray[np.float64], errors: NDArray[np.float64]) -> float:
    """Return the largest error of lines over the largest line, 0 where there are none."""
    largest = float(np.max(harmonics))
    return float(np.max(errors)) / largest if largest > 0.0 else 0.0


def judged(response: Response, request: Request) -> Response:
    """Return a response with the quantity of a request, and the status that this deserves.

    "not_converged" and "uncalibrated" stay; of all else the error decides, and whether the motion repeats. An error
    that is unknown is not within the accuracy.
    """
    found = replace(response, quantity=request.quantity)
    if found.status in ("not_converged", "uncalibrated"):
        return found
    good: Status = "converged" if found.repeats else "not_periodic"
    return replace(found, status=good if found.error <= request.accuracy else "inaccurate")


def row_of(sensors: tuple[Sensor, ...], sensor: Sensor | None) -> int:
    """Return the row of a sensor, None for the first; raise a ValueError that names those that there are."""
    if sensor is None:
        return 0
    if sensor not in sensors:
        raise ValueError(f"sensor {sensor!r}: this model has {', '.join(sensors)}")
    return sensors.index(sensor)


def _series(coefficients: NDArray[np.complex128], unit: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the sum of c_k unit**k by Horner's rule."""
    total = np.full(unit.shape, coefficients[-1], dtype=np.complex128)
    for c in coefficients[-2::-1]:
        np.multiply(total, unit, out=total)
        np.add(total, c, out=total)
    return total


def _at_multiples(values: NDArray[np.float64], turn: float, count: int) -> NDArray[np.complex128]:
    """Return sum_n x_n exp(-2 pi i k n turn), k = 0..count, of each row, by Bluestein's convolution."""
    samples = values.shape[1]
    n = np.arange(max(samples, count + 1), dtype=np.float64)
    # exp(-i pi turn n^2): k n = (k^2 + n^2 - (k - n)^2) / 2; reduced to one turn, so that no digits are lost.
    chirp = np.exp(-2j * np.pi * np.mod(0.5 * turn * n * n, 1.0))
    size = 1 << (samples + count).bit_length()
    kernel = np.zeros(size, dtype=np.complex128)
    kernel[: count + 1] = np.conj(chirp[: count + 1])
    kernel[size - samples + 1 :] = np.conj(chirp[1:samples])[::-1]
    folded = np.fft.ifft(np.fft.fft(values * chirp[:samples], size) * np.fft.fft(kernel))
    return folded[:, : count + 1] * chirp[: count + 1]


def band_passed(signal: NDArray[np.float64], rate: float, band: tuple[float, float]) -> NDArray[np.float64]:
    """Return a sampled signal without what lies outside a band (lo, hi), Hz, both ends included."""
    frequency = np.fft.rfftfreq(len(signal), 1.0 / rate)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    return np.fft.irfft(np.where(inside, np.fft.rfft(signal), 0.0), len(signal))


def band_lines(fundamental: float, band: tuple[float, float]) -> tuple[int, int]:
    """Return the first and the last multiple of a frequency, Hz, within a band; the mean value is left out."""
    return max(1, math.ceil(band[0] / fundamental)), math.floor(band[1] / fundamental)


def levels_of_lines(
    coefficients: NDArray[np.complex128], fundamental: float, band: tuple[float, float]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return RMS and peak of each sensor, (sensors,), from the lines within a band at multiples of a frequency, Hz."""
    low, high = band_lines(fundamental, band)
    rms = np.sqrt(2.0 * np.sum(np.abs(coefficients[:, low : high + 1]) ** 2, axis=1))
    return rms, np.array([peak_in_band(row, low, high) for row in coefficients])


def peak_in_band(coefficients: NDArray[np.complex128], low: int, high: int) -> float:
    """Return the largest absolute value of the lines low..high (multiples of the fundamental) over one period."""
    size = 1 << max(6, (_PEAK_OVERSAMPLING * (high + 1) - 1).bit_length())
    spectrum = np.zeros(size // 2 + 1, dtype=np.complex128)
    spectrum[low : high + 1] = coefficients[low : high + 1]
    signal = np.fft.irfft(spectrum, size) * size
    return float(crests(np.roll(signal, 1), signal, np.roll(signal, -1)))
