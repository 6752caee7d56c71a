"""One block of one channel through all stages: quality, features, t_fs, the damaged part, V_eq, TT.

The same function serves the live daemon, a restarted one and a replay: state in, block in, state and result out. It
reads no clock and no file, so that the same blocks give the same records.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from models.bearing import Bearing, Kinematics, kinematics
from monitor.health import detect
from monitor.health.damage import tracker as damage
from monitor.health.naming import Naming, bins_needed, name_fault
from monitor.health.quality import Verdict, check_samples
from monitor.health.spectrum.bands import candidate_bands
from monitor.health.spectrum.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.spectrum.transform import Band
from monitor.health.spectrum.votes import BandVotes
from monitor.health.state import ChannelState, Named, Spectra


@dataclass(frozen=True)
class ChannelSettings:
    """What is configured of one channel, SI.

    Attributes:
        name: of the channel.
        bearing: the bearing that it listens to.
        absolute: whether its unit is known, so that levels mean something.
        bands: bands to demodulate, Hz, or None: to be chosen on the learning window.
        rms_band: band of RMS and A*, Hz, or None for the full bandwidth.
        average_blocks: envelope spectra averaged to name the damaged part.
        signal_range: full scale, in the unit of the samples, or None where unknown.
        samples: nominal samples of a block, or None where blocks have no nominal length.
        speed: shaft speed where the block does not say it, Hz, or None where unknown.
        load: radial load where the block does not say it, N, or None where unknown.
        detect: settings of the onset detector.
        damage: how V_eq and TT are found, or None where they are not.
    """

    name: str
    bearing: Bearing
    absolute: bool = True
    bands: tuple[Band, ...] | None = None
    rms_band: Band | None = None
    average_blocks: int = 1
    signal_range: float | None = None
    samples: int | None = None
    speed: float | None = None
    load: float | None = None
    detect: detect.DetectSettings = field(default_factory=detect.DetectSettings)
    damage: damage.DamageSettings | None = None


@dataclass(frozen=True)
class BlockInfo:
    """What is known of a block besides its samples.

    Attributes:
        sequence: its number in the source's own unit, from 1.
        time: seconds of its first sample, UTC where dated, else since the first block; None where unknown.
        rate: sampling rate, Hz.
        duration: seconds.
        speed: shaft speed that the source states, Hz, or None.
        load: load that the source states, N, or None.
    """

    sequence: int
    time: float | None
    rate: float
    duration: float
    speed: float | None = None
    load: float | None = None


@dataclass(frozen=True)
class ChannelOutput:
    """What one block said about one channel; None wherever an earlier verdict left nothing to say.

    Attributes:
        verdict: on the samples.
        stage: stage of life after the block.
        absolute: whether levels are in m/s2.
        speed: shaft speed used, Hz, or None.
        load: load used, N, or None.
        bands: bands that were demodulated, Hz.
        band_source: "configured", "learning", "recording" (chosen from a single short recording) or "provisional".
        features: of the block.
        leading: place, among the bands, of that on which the fault was named; 0 where none was.
        naming: of the damaged part, from the averaged envelope spectrum.
        detection: score and alarms.
        damage: equivalent damaged volume, or None where the channel is not tracked.
        forecasts: one for each threshold.
    """

    verdict: Verdict
    stage: str
    absolute: bool = True
    speed: float | None = None
    load: float | None = None
    bands: tuple[Band, ...] = ()
    band_source: str = "configured"
    features: BlockFeatures | None = None
    leading: int = 0
    naming: Naming | None = None
    detection: detect.DetectOutput | None = None
    damage: damage.Damage | None = None
    forecasts: tuple[damage.Remaining, ...] = ()


def judge(samples: NDArray[np.floating], state: ChannelState, settings: ChannelSettings) -> Verdict:
    """Judge the samples of one channel (shape (sample,)) against its settings and its learned level."""
    return check_samples(
        samples,
        expected=settings.samples,
        signal_range=settings.signal_range,
        reference_rms=state.detect.reference_rms,
        absolute=settings.absolute,
    )


def step(
    state: ChannelState,
    samples: NDArray[np.floating],
    info: BlockInfo,
    verdict: Verdict,
    settings: ChannelSettings,
) -> tuple[ChannelState, ChannelOutput]:
    """Take one block of one channel into its state.

    Args:
        state: the channel so far.
        samples: shape (sample,), m/s2, or any unit where ``settings.absolute`` is False.
        info: what else is known of the block.
        verdict: what quality says of it, the flags of the block included.
        settings: of the channel.
    """
    if not verdict.accepted:
        return state, ChannelOutput(verdict=verdict, stage=state.detect.stage, absolute=settings.absolute)
    speed = info.speed if info.speed is not None else settings.speed
    load = info.load if info.load is not None else settings.load
    if speed is None:
        raise ValueError(f"channel {settings.name!r}: the shaft speed is neither configured nor stated by the block")
    lines = kinematics(settings.bearing, speed)
    bands, band_source = _bands(state, settings, info.rate, lines)
    features = block_features(
        samples,
        info.rate,
        FeatureSettings(rate=info.rate, bands=bands, fundamentals=fundamentals(lines), rms_band=settings.rms_band),
    )
    state = _run_clock(state, info, verdict)
    naming: Naming | None = None
    leading = 0
    if verdict.for_baseline:
        state, naming, leading = _name(state, features, lines, settings.average_blocks)
    state, detection = _detect(state, features, info, verdict, settings, settled=band_source != "provisional")
    if verdict.for_baseline and band_source == "provisional":
        state = _vote(state, samples, info.rate, lines)
    state, found, forecasts = _damage(state, features, verdict, settings, load, speed)
    state = _latch_name(state, naming, info.sequence)
    return state, ChannelOutput(
        verdict=verdict,
        stage=state.detect.stage,
        absolute=settings.absolute,
        speed=speed,
        load=load,
        bands=bands,
        band_source=band_source,
        features=features,
        leading=leading,
        naming=naming,
        detection=detection,
        damage=found,
        forecasts=forecasts,
    )


def _bands(
    state: ChannelState, settings: ChannelSettings, rate: float, lines: Kinematics
) -> tuple[tuple[Band, ...], str]:
    """Return the bands to demodulate and where they come from; provisionally the widest candidate."""
    if settings.bands is not None:
        return settings.bands, "configured"
    if state.bands:
        return state.bands, state.band_source
    return (candidate_bands(rate, max(lines.bpfo, lines.bpfi, 2.0 * lines.bsf))[0],), "provisional"


def _run_clock(state: ChannelState, info: BlockInfo, verdict: Verdict) -> ChannelState:
    """Advance the damage time: the time that the machine ran. What is between two running blocks counts as running."""
    if info.time is None or {"late", "out_of_order", "clock"} & set(verdict.flags):
        return state
    running = "stopped" not in verdict.flags
    gained = 0.0
    if running and state.was_running and state.last_time is not None and info.time > state.last_time:
        gained = info.time - state.last_time
    return replace(state, running_time=state.running_time + gained, last_time=info.time, was_running=running)


def _vote(state: ChannelState, samples: NDArray[np.floating], rate: float, lines: Kinematics) -> ChannelState:
    """Let one of the first blocks vote for a band; freeze the band when enough have voted."""
    votes = (state.votes or BandVotes()).add(samples, rate, fundamentals(lines))
    if votes.enough:
        return replace(state, votes=None, bands=(votes.best(),), band_source="learning", spectra=Spectra())
    return replace(state, votes=votes)


def _name(
    state: ChannelState, features: BlockFeatures, lines: Kinematics, average_blocks: int
) -> tuple[ChannelState, Naming, int]:
    """Name the damaged part from the mean of the neighbouring envelope spectra, each over its own mean envelope.

    The number is the place of the band that shows it, 0 where nothing is named. The division, and a weight of one over
    its noise, keep one loud or knocking block from deciding for all.
    """
    needed = bins_needed(lines, features.envelopes[0].resolution)
    relative = tuple(
        np.asarray(envelope.amplitude[:needed], dtype=np.float32) / max(envelope.mean, np.finfo(np.float32).tiny)
        for envelope in features.envelopes
    )
    spectra = state.spectra.add(relative, average_blocks)
    namings = [
        name_fault(amplitude, features.envelopes[0].resolution, lines, spectra.count)
        for amplitude in spectra.averages()
    ]
    place = max(range(len(namings)), key=lambda i: (namings[i].fault is not None, _standing(namings[i])))
    best = namings[place]
    kept = spectra if average_blocks > 1 else Spectra()
    return replace(state, spectra=kept), best, place if best.fault is not None else 0


def _standing(naming: Naming) -> float:
    """Return how high the best family stands, over the score that it had to reach."""
    return 0.0 if naming.evidence is None else naming.evidence.score / naming.threshold


def detect_input(features: BlockFeatures, info: BlockInfo, *, absolute: bool, usable: bool) -> detect.DetectInput:
    """Return what the detector takes from the features of a block.

    Args:
        features: of the block.
        info: its number and time.
        absolute: whether the unit is known; without it there is no peak in m/s2.
        usable: whether quality lets the block move the detector.
    """
    outer = features.lines[0]["outer"]
    floor = float(outer.floor.sum())
    return detect.DetectInput(
        sequence=info.sequence,
        time=info.time,
        rms=features.rms,
        prominence=outer.total / floor if floor > 0.0 else None,
        peak=features.indicators.peak if absolute else None,
        usable=usable,
    )


def _detect(
    state: ChannelState,
    features: BlockFeatures,
    info: BlockInfo,
    verdict: Verdict,
    settings: ChannelSettings,
    *,
    settled: bool,
) -> tuple[ChannelState, detect.DetectOutput]:
    """Feed the detector; until the band is settled it only counts the blocks of the run-in and the peaks."""
    running_in = state.detect.seen < settings.detect.run_in_blocks
    usable = verdict.for_baseline and (settled or running_in)
    block = detect_input(features, info, absolute=settings.absolute, usable=usable)
    detector, output = detect.step(state.detect, block, settings.detect)
    return replace(state, detect=detector), output


def _damage(
    state: ChannelState,
    features: BlockFeatures,
    verdict: Verdict,
    settings: ChannelSettings,
    load: float | None,
    speed: float,
) -> tuple[ChannelState, damage.Damage | None, tuple[damage.Remaining, ...]]:
    """Track and forecast, where the channel is tracked."""
    if settings.damage is None:
        return state, None, ()
    resolved = bool(np.all(features.bpfo_resolved))
    reading = damage.Reading(
        time=state.running_time,
        rms=features.rms,
        harmonics=tuple(float(value) for value in features.bpfo_amplitude) if resolved else None,
        load=load,
        speed=speed,
    )
    stage = damage.Stage(
        final=state.detect.t_fs is not None,
        raised=state.detect.elevated is not None,
        usable=verdict.for_tracker,
        absolute=settings.absolute,
    )
    after, found, forecasts = damage.step(state.damage, reading, stage, settings.damage)
    return replace(state, damage=after), found, forecasts


def _latch_name(state: ChannelState, naming: Naming | None, sequence: int) -> ChannelState:
    """Keep what the channel's fault is called: the present verdict before the final stage, the strongest in it."""
    if naming is None:
        return state
    named = None
    if naming.fault is not None and naming.evidence is not None:
        found = naming.evidence
        named = Named(naming.fault, found.snr, found.depth, _standing(naming), sequence)
    if state.detect.t_fs is None and state.detect.t_eol is None:
        return replace(state, named=named)
    if named is not None and (state.named is None or named.standing > state.named.standing):
        return replace(state, named=named)
    return state
