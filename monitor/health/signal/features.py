"""Features of one block: levels, time-domain indicators, raw BPFO harmonics and the fault lines of the envelope.

H_or (Eq. 96) is the sum of the first five BPFO lines in the spectrum of the envelope (Eqs. 94-95) of a band, and H_ir,
H_ball and H_cage the same for the other families. Each family has its own speed factor: the shaft has one speed, but
the cage slips, and BPFO is often 0.5 to 1.5 % low where the lines of the shaft are where they should be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.comb import FaultLines, LineSpectrum, beside_shaft, line_spectrum, over_shaft
from monitor.health.signal.floor import MIN_FLOOR_BINS
from monitor.health.signal.foreign import ForeignComb, beside_combs
from monitor.health.signal.indicators import TimeIndicators, sample_range, time_indicators
from monitor.health.signal.lines import FALSE_ALARM, CombQuery, fault_lines, find_lines, line_amplitudes
from monitor.health.signal.settings import (
    N_HARMONICS,
    N_RAW_HARMONICS,
    SOUGHT_MARGIN_BINS,
    FeatureSettings,
    envelope_limit,
    raw_limit,
    rounded_up,
    sought_limit,
)
from monitor.health.signal.settings import SPECTRUM_LINES as SPECTRUM_LINES
from monitor.health.signal.settings import fundamentals as fundamentals
from monitor.health.signal.settings import highest_rival as highest_rival
from monitor.health.signal.shaft import (
    MIN_TURNS,
    SEPARATED_TURNS,
    ShaftSpeed,
    highest_order,
    measurable,
    measure_shaft,
)
from monitor.health.signal.spectra import RawSpectra
from monitor.health.signal.transform import AmplitudeSpectrum, Band, EnvelopeSpectrum, get_transform
from monitor.health.signal.velocity import Velocity
from monitor.words.parts import FAULTS, PARTS

_DEEP = 0.75
"""Depth that impacts have; the four lines a turn of a healthy motor are 0.34 deep (CWRU 97)."""

Value = float | tuple[float | None, ...] | None


@dataclass(frozen=True, eq=False)
class BlockFeatures:
    """The features of one block, SI units.

    Attributes:
        velocity: as of samples in m/s2.
        n_used: samples used in the spectra (cut to a fast length); the indicators use all.
        rms: root mean square in the RMS band without the mean, m/s2.
        indicators: the time-domain indicators, full bandwidth.
        bpfo_amplitude: (6,) BPFO harmonics of the raw spectrum, m/s2; 0 where ``bpfo_resolved`` is False.
        bpfo_resolved: (6,) whether the raw spectrum shows the harmonic: inside it, in the RMS band, four bins apart.
        a_star: root of the sum of squares of the first five (Eq. 57), m/s2.
        lines: for each band, in order, the lines of each fault family in the block's own envelope spectrum, m/s2.
        envelopes: the envelope spectrum of each band, of this block alone.
        sought: for each band the spectrum in which the families were sought, relative to the mean envelope: that of
            the block, or its average with the recent ones.
        families: the families found in each of them.
        recent: the recent spectra, this block's included; none where blocks are not averaged.
        speed: shaft speed at which the families were sought, Hz, or None.
        shaft: the known speed of the shaft, found in the signal or stated, or None where it is nominal and not found.
        speed_factor: that speed over the stated one; where it was not found, that of the detected family that stands
            highest above its threshold, or None where none is detected.
        sought_at: settings at that speed, by which they were.
        view: raw spectrum to be looked at, where it is asked for; always over time.
        values: what each of ``FUNCTIONS`` gives, by name.
        domain: of all spectra but ``view``: "order" where they are over the angle of the shaft, with an axis in Hz of a
            shaft at the mean speed of the block (decision 0021), else "hertz".
    """

    velocity: Velocity
    n_used: int
    rms: float
    indicators: TimeIndicators
    bpfo_amplitude: NDArray[np.float64]
    bpfo_resolved: NDArray[np.bool_]
    a_star: float
    lines: tuple[Mapping[str, FaultLines], ...]
    envelopes: tuple[EnvelopeSpectrum, ...]
    sought: tuple[LineSpectrum, ...]
    families: tuple[Mapping[str, FaultLines], ...]
    recent: RecentSpectra
    speed: float | None
    shaft: ShaftSpeed | None
    speed_factor: float | None
    sought_at: FeatureSettings
    view: RawSpectra | None = None
    values: Mapping[str, Value] = field(default_factory=dict[str, Value])
    domain: str = "hertz"


FeatureFunction = Callable[[NDArray[np.number], BlockFeatures], Value]


def _indicator(name: str) -> FeatureFunction:
    """Return the function that gives a time-domain indicator."""
    return lambda x, found: getattr(found.indicators, name)


def _total(fault: str) -> FeatureFunction:
    """Return the function that sums the lines of a family: a number, or a tuple over several bands."""

    def total(x: NDArray[np.number], found: BlockFeatures) -> Value:
        sums = [band[fault].total if band[fault].resolved.any() else None for band in found.lines]
        return tuple(sums) if len(sums) > 1 else sums[0]

    return total


FUNCTIONS: dict[str, FeatureFunction] = {
    "rms": lambda x, found: found.rms,
    "velocity_rms": lambda x, found: found.velocity.rms,
    "velocity_floor": lambda x, found: found.velocity.floor,
    "a_star": lambda x, found: found.a_star,
    **{name: _indicator(name) for name in ("peak", "peak_half_range", "mean")},
    "speed_factor": lambda x, found: found.speed_factor,
    **{name: _indicator(name) for name in ("kurtosis", "skewness")},
    **{f"{name}_factor": _indicator(f"{name}_factor") for name in ("crest", "shape", "impulse", "clearance")},
    **{part.feature: _total(part.name) for part in PARTS},
}
"""The function of each feature of a block, by its name in ``monitor.words.features``.

It takes the samples, shape (n,), m/s2, and what was computed from them; it returns SI, None where there is no value.
"""


def block_features(
    x: NDArray[np.number],
    rate: float,
    settings: FeatureSettings,
    recent: RecentSpectra | None = None,
    span: tuple[float, float] | None = None,
) -> BlockFeatures:
    """Return the features of one block of one channel.

    Args:
        x: (n_samples,) acceleration, m/s2, any real type; not written to.
        rate: its sampling rate, Hz.
        settings: of the channel.
        recent: spectra of the neighbouring blocks to average with, or None.
        span: least and largest sample, where they are known.

    Raises:
        ValueError: if the rate is not the one of the settings, the block is too short for its bands, or a sample is not
            finite. The quality stage rejects such blocks before.
    """
    if rate != settings.rate:
        raise ValueError(f"the settings are for {settings.rate:g} Hz, the block has {rate:g} Hz")
    needed = raw_limit(settings, rate / x.size), envelope_limit(settings, rate / x.size)
    transform = get_transform(
        x.size,
        rate,
        settings.bands,
        rms_band=settings.rms_band,
        raw_limit=rounded_up(needed[0]),
        envelope_limit=rounded_up(needed[1]),
    )
    span = sample_range(x, span)
    indicators = time_indicators(x, span)
    spectra = transform(x, span, settings.interference, rotation=settings.rotation, needed=needed, view=settings.view)
    if settings.rotation is not None and spectra.warp is None:
        # The speed varies too much to be followed: its mean is no speed at which lines stand.
        settings = replace(settings, rotation=None, speed_sd=None)
    relative = tuple(_relative(envelope, settings) for envelope in spectra.envelopes)
    averages = settings.average_blocks > 1
    step = None if spectra.warp is None else spectra.warp.resolution / spectra.warp.mean_speed
    recent = (recent or RecentSpectra()).add(relative, settings.average_blocks, step) if averages else RecentSpectra()
    sought = tuple(
        line_spectrum(amplitude, envelope.resolution, speed=settings.speed, n_averages=max(1, recent.count))
        for amplitude, envelope in zip(
            recent.averages() if recent.count > 1 else relative, spectra.envelopes, strict=True
        )
    )
    shaft = _shaft(spectra.raw, sought[0], settings)
    at = settings.at_speed(settings.held)
    if shaft is not None and settings.speed is not None:
        at = settings.at_speed(shaft.speed / settings.speed, shaft.sd)
        if shaft.speed >= MIN_TURNS * spectra.raw.resolution:
            sought = tuple(beside_shaft(spectrum, shaft.speed, shaft.sd) for spectrum in sought)
    families = tuple(_families(spectrum, at, shaft) for spectrum in sought)
    lines = tuple(map(partial(_own_lines, at, averaged=recent.count > 1), spectra.envelopes, relative, families))
    amplitude, shown = _raw_lines(spectra.raw, _leader(families, ("outer",)), at)
    found = BlockFeatures(
        velocity=spectra.velocity,
        n_used=spectra.n_used,
        rms=indicators.rms if spectra.band_rms is None else spectra.band_rms,
        indicators=indicators,
        bpfo_amplitude=amplitude,
        bpfo_resolved=shown,
        a_star=float(np.sqrt(np.sum(np.square(amplitude[:N_HARMONICS])))),
        lines=lines,
        envelopes=spectra.envelopes,
        sought=sought,
        families=families,
        recent=recent,
        speed=at.speed,
        shaft=shaft,
        speed_factor=_speed_factor(settings, at, shaft, _leader(families, FAULTS)),
        sought_at=at,
        view=spectra.view,
        domain="hertz" if spectra.warp is None else "order",
    )
    return replace(found, values={name: function(x, found) for name, function in FUNCTIONS.items()})


def features_beside(
    x: NDArray[np.number],
    found: BlockFeatures,
    combs: Sequence[Sequence[ForeignComb]],
    stated: FeatureSettings,
    *,
    absolute: bool,
) -> BlockFeatures:
    """Return the features of a block with its families sought beside the combs of other bearings.

    RMS, A* and the raw lines stay as they are.

    Args:
        x: (n_samples,) as given to :func:`block_features`.
        found: what it gave.
        combs: for each band.
        stated: the settings that it was given.
        absolute: whether the unit of the samples is known.
    """
    means = [float(envelope.mean) if absolute else None for envelope in found.envelopes]
    sought = tuple(map(beside_combs, found.sought, means, combs))
    families = tuple(_families(spectrum, found.sought_at, found.shaft) for spectrum in sought)
    averaged = found.recent.count > 1
    lines = tuple(
        _own_lines(
            found.sought_at,
            envelope,
            _relative(envelope, stated),
            named,
            averaged=averaged,
            beside=lambda own, mean=mean, foreign=foreign: beside_combs(own, mean, foreign),
        )
        for envelope, mean, named, foreign in zip(found.envelopes, means, families, combs, strict=True)
    )
    factor = _speed_factor(stated, found.sought_at, found.shaft, _leader(families, FAULTS))
    found = replace(found, sought=sought, families=families, lines=lines, speed_factor=factor)
    return replace(found, values={name: function(x, found) for name, function in FUNCTIONS.items()})


def _shaft(raw: AmplitudeSpectrum, envelope: LineSpectrum, settings: FeatureSettings) -> ShaftSpeed | None:
    """Return the speed of the shaft: as stated where that is known, else as both spectra show it, else None."""
    if settings.speed is None:
        return None
    if settings.speed_sd is not None:
        return ShaftSpeed(settings.speed, settings.speed_sd)
    if not measurable(settings.speed, raw.resolution):
        return None
    needed = math.ceil(highest_order(settings.speed) / raw.resolution) + MIN_FLOOR_BINS
    lines = line_spectrum(raw.amplitude[:needed], raw.resolution, speed=settings.speed)
    return measure_shaft(lines, envelope, settings.speed)


def _speed_factor(
    stated: FeatureSettings, at: FeatureSettings, shaft: ShaftSpeed | None, leader: FaultLines | None
) -> float | None:
    if shaft is not None and stated.speed is not None and stated.speed_sd is None:
        return shaft.speed / stated.speed
    if leader is None or at.speed is None or stated.speed is None:
        return None if leader is None else leader.speed_factor
    return leader.speed_factor * at.speed / stated.speed


def _relative(envelope: EnvelopeSpectrum, settings: FeatureSettings) -> NDArray[np.float32]:
    """Return an envelope spectrum over the mean envelope, as far as combs are sought."""
    needed = math.ceil(sought_limit(settings, envelope.resolution) / envelope.resolution) + SOUGHT_MARGIN_BINS
    mean = max(envelope.mean, float(np.finfo(np.float32).tiny))
    return np.asarray(envelope.amplitude[:needed], dtype=np.float32) / np.float32(mean)


def _families(spectrum: LineSpectrum, settings: FeatureSettings, shaft: ShaftSpeed | None) -> dict[str, FaultLines]:
    """Return the lines of each fault family, beside those of the shaft where these are known.

    In few turns a comb near a multiple of the shaft is not beside it: it counts with what exceeds the shaft if it is as
    deep as impacts are.
    """
    found = _sought(spectrum, settings)
    if shaft is None or spectrum.beside is None or shaft.speed >= SEPARATED_TURNS * spectrum.resolution:
        return found
    over = _sought(over_shaft(spectrum, shaft.speed), settings)
    return {
        fault: lines if lines.depth - 2.0 * lines.depth_error > _DEEP else found[fault] for fault, lines in over.items()
    }


def _sought(spectrum: LineSpectrum, settings: FeatureSettings) -> dict[str, FaultLines]:
    """Return the lines of each fault family, each at its own speed factor: the highest comb of the places sought."""
    queries: list[tuple[str, CombQuery]] = []
    for fault, nominal in settings.fundamentals.items():
        search = settings.searches.get(fault)
        if search is None:
            queries.append((fault, CombQuery(nominal, settings.search)))
            continue
        alarm = FALSE_ALARM / len(search.places)
        queries += [
            (fault, CombQuery(nominal * place, search.width, false_alarm=alarm, centre=search.centre))
            for place in search.places
        ]
    lines = find_lines(spectrum, [query for _, query in queries], N_HARMONICS)
    found: dict[str, FaultLines] = {}
    for (fault, _), candidate in zip(queries, lines, strict=True):
        if fault not in found or candidate.comb_score > found[fault].comb_score:
            found[fault] = candidate
    return {fault: found[fault] for fault in FAULTS}


def _nominal(settings: FeatureSettings, fault: str, found: FaultLines | None) -> float:
    """Return the frequency to which the speed factor of a family refers, Hz: that of the number of elements found."""
    if found is None or fault not in settings.searches:
        return settings.fundamentals[fault]
    return found.fundamental / found.speed_factor


def _own_lines(
    settings: FeatureSettings,
    envelope: EnvelopeSpectrum,
    relative: NDArray[np.float32],
    families: Mapping[str, FaultLines],
    *,
    averaged: bool,
    beside: Callable[[LineSpectrum], LineSpectrum] | None = None,
) -> dict[str, FaultLines]:
    """Return the lines of the block itself, m/s2, at the speed factors of the families found in the average."""
    if not averaged:
        return {fault: found.scaled(envelope.mean) for fault, found in families.items()}
    own = line_spectrum(relative, envelope.resolution, speed=settings.speed)
    if beside is not None:
        own = beside(own)
    queries = [
        CombQuery(_nominal(settings, fault, found), speed_factor=found.speed_factor)
        for fault, found in families.items()
    ]
    lines = find_lines(own, queries, N_HARMONICS)
    return {fault: found.scaled(envelope.mean) for fault, found in zip(families, lines, strict=True)}


def _raw_lines(
    raw: AmplitudeSpectrum, found: FaultLines | None, settings: FeatureSettings
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the BPFO harmonics of the raw spectrum, (6,), 0 where not shown, and whether the RMS band shows them.

    They are at the speed of the envelope or the best one.
    """
    nominal, search = _nominal(settings, "outer", found), settings.searches.get("outer")
    if found is not None:
        factor = found.speed_factor
        amplitude, shown = line_amplitudes(raw.amplitude, raw.resolution, nominal, factor, N_RAW_HARMONICS)
    else:
        spectrum = line_spectrum(raw.amplitude, raw.resolution, speed=settings.speed)
        width, centre = (settings.search, 1.0) if search is None else (search.width, search.centre)
        lines = fault_lines(spectrum, nominal, n_harmonics=N_RAW_HARMONICS, search=width, centre=centre)
        factor, amplitude, shown = lines.speed_factor, lines.amplitude, lines.resolved
    shown = shown & _inside(settings.rms_band, nominal * factor)
    return np.where(shown, amplitude, 0.0), shown


def _leader(lines: Sequence[Mapping[str, FaultLines]], faults: Sequence[str]) -> FaultLines | None:
    """The detected family, of those asked for, that stands highest above its threshold in any band."""
    found = [band[fault] for band in lines for fault in faults if band[fault].detected]
    return max(found, key=lambda family: family.score / family.threshold, default=None)


def _inside(band: Band | None, fundamental: float) -> NDArray[np.bool_]:
    """(6,) which raw harmonics lie in the RMS band."""
    if band is None:
        return np.ones(N_RAW_HARMONICS, dtype=bool)
    frequency = fundamental * np.arange(1, N_RAW_HARMONICS + 1)
    return (frequency >= band[0]) & (frequency <= band[1])
