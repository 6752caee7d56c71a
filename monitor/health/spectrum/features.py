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

from models.bearing import Kinematics
from monitor.health.spectrum.average import RecentSpectra
from monitor.health.spectrum.comb import LineSpectrum, line_spectrum
from monitor.health.spectrum.indicators import TimeIndicators, sample_range, time_indicators
from monitor.health.spectrum.interference import Comb
from monitor.health.spectrum.lines import (
    FALSE_ALARM,
    SEARCH,
    CombQuery,
    FaultLines,
    fault_lines,
    find_lines,
    line_amplitudes,
)
from monitor.health.spectrum.plans import Effort, Precision
from monitor.health.spectrum.search import FamilySearch
from monitor.health.spectrum.transform import (
    AmplitudeSpectrum,
    Band,
    EnvelopeSpectrum,
    get_transform,
)

Value = float | tuple[float | None, ...] | None

FAULTS = ("outer", "inner", "ball", "cage")
"""The fault families, in the order of the ``fault`` dimension of the records."""

N_HARMONICS = 5
"""Harmonics of each family in the envelope spectrum (Eq. 96)."""

N_RAW_HARMONICS = 6
"""BPFO harmonics of the raw spectrum; A* takes the first five (Eq. 57)."""

SPECTRUM_LINES = 6.5
"""An envelope spectrum that is kept or drawn reaches this many times the first line of the highest family."""

_RAW_MARGIN_BINS, _SOUGHT_MARGIN_BINS = 210, 10


@dataclass(frozen=True)
class FeatureSettings:
    """What has to be known about a channel to compute its features.

    Attributes:
        rate: sampling rate, Hz.
        bands: bands to demodulate, (lo, hi) in Hz; the first is the one whose sums are the channel's H_or and so on.
        fundamentals: frequency of the first line of each of ``FAULTS``, Hz (2 BSF of a ball: it meets both races).
        rms_band: band of RMS and A*, Hz, or None for the full bandwidth.
        speed: stated shaft speed, Hz, or None: then lines of the shaft are not separated.
        average_blocks: neighbouring blocks in whose mean envelope spectrum the families are sought.
        search: half width of the range of the speed factor.
        searches: range of each family whose nominal frequency is an estimate; the others have ``search``.
        interference: combs that are removed before the envelopes, at the speed of the block.
        precision: arithmetic of the transforms.
        effort: planning of the transforms; "estimate" gives the same bits everywhere and every time.
    """

    rate: float
    bands: tuple[Band, ...]
    fundamentals: Mapping[str, float]
    rms_band: Band | None = None
    speed: float | None = None
    average_blocks: int = 1
    search: float = SEARCH
    searches: Mapping[str, FamilySearch] = field(default_factory=dict[str, FamilySearch])
    interference: tuple[Comb, ...] = ()
    precision: Precision = "float32"
    effort: Effort = "estimate"

    def __post_init__(self) -> None:
        """Refuse settings without a band or with a missing or senseless frequency."""
        if not self.bands:
            raise ValueError("bands: at least one band is needed, got none")
        if set(self.fundamentals) != set(FAULTS):
            raise ValueError(f"fundamentals: expected {', '.join(FAULTS)}, got {', '.join(sorted(self.fundamentals))}")
        for fault, frequency in self.fundamentals.items():
            if not (math.isfinite(frequency) and frequency > 0.0):
                raise ValueError(f"fundamentals: {fault} must be positive and finite, got {frequency!r} Hz")


@dataclass(frozen=True, eq=False)
class BlockFeatures:
    """The features of one block, SI units.

    Attributes:
        n_used: samples used in the spectra (the end is cut to a fast length); the indicators use all.
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
        speed_factor: that of the detected family that stands highest above its threshold, or None where none is
            detected.
        values: what each of ``FUNCTIONS`` gives, by name.
    """

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
    speed_factor: float | None
    values: Mapping[str, Value] = field(default_factory=dict[str, Value])


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
    "a_star": lambda x, found: found.a_star,
    "peak": _indicator("peak"),
    "peak_half_range": _indicator("peak_half_range"),
    "mean": _indicator("mean"),
    "speed_factor": lambda x, found: found.speed_factor,
    "kurtosis": _indicator("kurtosis"),
    "skewness": _indicator("skewness"),
    "crest_factor": _indicator("crest_factor"),
    "shape_factor": _indicator("shape_factor"),
    "impulse_factor": _indicator("impulse_factor"),
    "clearance_factor": _indicator("clearance_factor"),
    "h_or": _total("outer"),
    "h_ir": _total("inner"),
    "h_ball": _total("ball"),
    "h_cage": _total("cage"),
}
"""The function of each feature of a block, by its name in ``monitor.words.features``.

It takes the samples, shape (n,), m/s2, and what was computed from them; it returns SI, None where there is no value.
"""


def fundamentals(kinematics: Kinematics) -> dict[str, float]:
    """Return the frequency of the first line of each fault family, Hz."""
    return {"outer": kinematics.bpfo, "inner": kinematics.bpfi, "ball": 2.0 * kinematics.bsf, "cage": kinematics.ftf}


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
    outer = settings.fundamentals["outer"]
    raw_limit = N_RAW_HARMONICS * outer * _reach(settings, "outer") + _RAW_MARGIN_BINS * rate / x.size
    transform = get_transform(
        x.size,
        rate,
        settings.bands,
        settings.precision,
        rms_band=settings.rms_band,
        raw_limit=_rounded_up(raw_limit),
        envelope_limit=_rounded_up(_envelope_limit(settings, rate / x.size)),
        effort=settings.effort,
    )
    span = sample_range(x, span)
    indicators = time_indicators(x, span)
    spectra = transform(x, span, settings.interference)
    relative = tuple(_relative(envelope, settings) for envelope in spectra.envelopes)
    averages = settings.average_blocks > 1
    recent = (recent or RecentSpectra()).add(relative, settings.average_blocks) if averages else RecentSpectra()
    sought = tuple(
        line_spectrum(amplitude, envelope.resolution, speed=settings.speed, n_averages=max(1, recent.count))
        for amplitude, envelope in zip(
            recent.averages() if recent.count > 1 else relative, spectra.envelopes, strict=True
        )
    )
    families = tuple(_families(spectrum, settings) for spectrum in sought)
    lines = tuple(map(partial(_own_lines, settings, averaged=recent.count > 1), spectra.envelopes, relative, families))
    amplitude, shown = _raw_lines(spectra.raw, _leader(families, ("outer",)), settings)
    leader = _leader(families, FAULTS)
    found = BlockFeatures(
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
        speed_factor=None if leader is None else leader.speed_factor,
    )
    return replace(found, values={name: function(x, found) for name, function in FUNCTIONS.items()})


def highest_rival(fundamentals: Mapping[str, float], speed: float | None) -> float:
    """Return the highest fundamental that competes with the families: ten shaft speeds, or a tenth above them, Hz."""
    return max(10.0 * (speed or 0.0), 1.1 * max(fundamentals.values()))


def _rounded_up(limit: float) -> float:
    """Return the next power of two: a speed that varies from block to block must not ask for ever new plans."""
    return 2.0 ** math.ceil(math.log2(limit))


def _sought_limit(settings: FeatureSettings) -> float:
    """Return the highest frequency of the envelope at which combs are sought, Hz."""
    families = {fault: line * _margin(settings, fault) for fault, line in settings.fundamentals.items()}
    return N_HARMONICS * highest_rival(families, settings.speed) * 1.05


def _envelope_limit(settings: FeatureSettings, resolution: float) -> float:
    """Return the highest frequency of the envelope that is used, Hz, with a margin for the floor under it."""
    shown = SPECTRUM_LINES * max(settings.fundamentals.values())
    return max(_sought_limit(settings), shown) + 2 * _SOUGHT_MARGIN_BINS * resolution


def _relative(envelope: EnvelopeSpectrum, settings: FeatureSettings) -> NDArray[np.float32]:
    """Return an envelope spectrum over the mean envelope, as far as combs are sought."""
    needed = math.ceil(_sought_limit(settings) / envelope.resolution) + _SOUGHT_MARGIN_BINS
    mean = max(envelope.mean, float(np.finfo(np.float32).tiny))
    return np.asarray(envelope.amplitude[:needed], dtype=np.float32) / np.float32(mean)


def _margin(settings: FeatureSettings, fault: str) -> float:
    """Return by how much a family of estimated frequency can stand above its nominal one."""
    return _reach(settings, fault) if fault in settings.searches else 1.0


def _reach(settings: FeatureSettings, fault: str) -> float:
    """Return the highest factor of the nominal frequency at which a family is sought."""
    search = settings.searches.get(fault)
    return 1.0 + settings.search if search is None else max(search.places) * (1.0 + search.width)


def _families(spectrum: LineSpectrum, settings: FeatureSettings) -> dict[str, FaultLines]:
    """Return the lines of each fault family, each at its own speed factor: the highest comb of the places sought."""
    queries: list[tuple[str, CombQuery]] = []
    for fault, nominal in settings.fundamentals.items():
        search = settings.searches.get(fault)
        if search is None:
            queries.append((fault, CombQuery(nominal, settings.search)))
            continue
        alarm = FALSE_ALARM / len(search.places)
        queries += [(fault, CombQuery(nominal * place, search.width, false_alarm=alarm)) for place in search.places]
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
) -> dict[str, FaultLines]:
    """Return the lines of the block itself, m/s2, at the speed factors of the families found in the average."""
    if not averaged:
        return {fault: found.scaled(envelope.mean) for fault, found in families.items()}
    own = line_spectrum(relative, envelope.resolution, speed=settings.speed)
    queries = [
        CombQuery(_nominal(settings, fault, found), speed_factor=found.speed_factor)
        for fault, found in families.items()
    ]
    lines = find_lines(own, queries, N_HARMONICS)
    return {fault: found.scaled(envelope.mean) for fault, found in zip(families, lines, strict=True)}


def _raw_lines(
    raw: AmplitudeSpectrum, found: FaultLines | None, settings: FeatureSettings
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the BPFO harmonics of the raw spectrum, at the speed of the envelope or the best one, 0 where not shown.

    Returns:
        Amplitude, and whether the spectrum shows the line inside the RMS band, both (6,).
    """
    nominal, search = _nominal(settings, "outer", found), settings.searches.get("outer")
    if found is not None:
        factor = found.speed_factor
        amplitude, shown = line_amplitudes(raw.amplitude, raw.resolution, nominal, factor, N_RAW_HARMONICS)
    else:
        spectrum = line_spectrum(raw.amplitude, raw.resolution, speed=settings.speed)
        width = settings.search if search is None else search.width
        lines = fault_lines(spectrum, nominal, n_harmonics=N_RAW_HARMONICS, search=width)
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
