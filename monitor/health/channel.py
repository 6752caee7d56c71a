"""The stages of one channel: features, onset, name of the damaged part, V_eq, TT.

State in, block in, state and output out: the live daemon, a restarted one and a replay give the same records.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from models.machine.bearing import Kinematics, kinematics
from monitor.health import onset as detect
from monitor.health.gears.lines import Wheels
from monitor.health.later_stages import ChannelBlock, later_stages
from monitor.health.name.naming import Naming, name_fault
from monitor.health.output import ChannelOutput
from monitor.health.signal.average import RecentSpectra
from monitor.health.signal.bands import BandVotes, candidate_bands
from monitor.health.signal.comb import comb_depth
from monitor.health.signal.condition import known_sd
from monitor.health.signal.features import BlockFeatures, FeatureSettings, block_features, fundamentals
from monitor.health.signal.interference import MESH_SD, all_combs, wheel_turns
from monitor.health.signal.quality import Verdict, check_samples
from monitor.health.signal.search import family_searches, slip_searches
from monitor.health.signal.transform import Band
from monitor.health.state import ChannelSettings, ChannelState, Named
from monitor.words.parts import PARTS

HELD_BLOCKS = 5
"""Blocks that must show the shaft before its speed is taken for blocks that do not."""


def check_channel(
    samples: NDArray[np.floating],
    state: ChannelState,
    settings: ChannelSettings,
    span: tuple[float, float] | None = None,
) -> Verdict:
    """Check the samples of one channel, shape (sample,), against its settings and its learned level.

    Those of a sensor of velocity are checked for its faults alone; its level is that of the acceleration.
    """
    if settings.measures_velocity:
        return check_samples(samples, expected=settings.samples, absolute=False, span=span)
    return check_level(samples, state, settings, span)


def check_level(
    samples: NDArray[np.floating],
    state: ChannelState,
    settings: ChannelSettings,
    span: tuple[float, float] | None = None,
) -> Verdict:
    """Check the acceleration of one channel, shape (sample,), against its settings and its learned level."""
    return check_samples(
        samples,
        expected=settings.samples,
        signal_range=settings.signal_range,
        reference_rms=state.detect.reference_rms,
        absolute=settings.absolute,
        span=span,
    )


@dataclass(frozen=True, eq=False)
class Analysed:
    """What the samples of an accepted block say.

    Attributes:
        state: of the channel before the block.
        channel: its settings.
        settings: by which the features were computed.
        band_source: where its bands come from, as in the record.
    """

    state: ChannelState
    block: ChannelBlock
    channel: ChannelSettings
    settings: FeatureSettings
    features: BlockFeatures
    band_source: str

    @property
    def detected(self) -> detect.DetectInput:
        """What the detector takes of the block."""
        usable = is_for_detector(self.state, self.block.verdict, self.channel, self.band_source)
        return detect_input(self.features, self.block, absolute=self.channel.absolute, usable=usable)


def step(state: ChannelState, block: ChannelBlock, settings: ChannelSettings) -> tuple[ChannelState, ChannelOutput]:
    """Take one block of one channel into its state; a rejected one leaves it as it is.

    Raises:
        ValueError: the block is accepted and its speed is not known.
    """
    return conclude(state, block, settings, analyse(state, block, settings))


def analyse(state: ChannelState, block: ChannelBlock, settings: ChannelSettings) -> Analysed | None:
    """Compute the features of one block; None of a rejected one. Raises as :func:`step`."""
    if not block.verdict.accepted:
        return None
    if block.speed.value is None:
        raise ValueError(f"channel {settings.name!r}: the shaft speed is neither configured nor stated by the block")
    lines = kinematics(settings.bearing, block.speed.value)
    bands, band_source = _bands(state, settings, block.rate, lines)
    asked = FeatureSettings(
        rate=block.rate,
        bands=bands,
        fundamentals=fundamentals(lines),
        rms_band=settings.rms_band,
        speed=lines.speed,
        speed_sd=known_sd(block.speed, settings.condition),
        held=held_factor(state.speed_factors),
        average_blocks=settings.average_blocks,
        search=settings.condition.speed_tolerance,
        searches=family_searches(settings.uncertainty, settings.condition.speed_tolerance),
        slip=slip_searches(settings.uncertainty),
        interference=all_combs(settings.interference, lines.speed),
        view=settings.waterfall.rows > 0,
        rotation=block.found.rotation if settings.condition.domain == "auto" else None,
    )
    recent = state.spectra if block.verdict.for_baseline else None
    features = block_features(block.samples, block.rate, asked, recent, block.span)
    return Analysed(state, block, settings, asked, features, band_source)


def conclude(
    state: ChannelState, block: ChannelBlock, settings: ChannelSettings, analysed: Analysed | None
) -> tuple[ChannelState, ChannelOutput]:
    """Take the features of one block of one channel into its state; without them, it stays as it is."""
    verdict = block.verdict
    if analysed is None:
        return state, ChannelOutput(block, settings, state.detect.stage)
    features, band_source = analysed.features, analysed.band_source
    naming: Naming | None = None
    leading = 0
    if verdict.for_baseline:
        state, naming, leading = _name(analysed)
    harmonics = tuple(float(value) for value in features.bpfo_amplitude) if features.bpfo_resolved.all() else None
    named = None if naming is None else _named(naming, block.sequence)
    state, found = later_stages(state, block, settings, analysed.detected, harmonics, named)
    if verdict.for_baseline and band_source == "provisional":
        state = _vote(state, block, analysed.settings, settings.band_limit)
    return state, ChannelOutput(
        block,
        settings,
        state.detect.stage,
        bands=analysed.settings.bands,
        band_source=band_source,
        features=features,
        leading=leading,
        naming=naming,
        detection=found.detection,
        damage=found.damage,
        forecasts=found.forecasts,
        to_alarm=found.to_alarm,
    )


def _bands(
    state: ChannelState, settings: ChannelSettings, rate: float, lines: Kinematics
) -> tuple[tuple[Band, ...], str]:
    """Return the bands to demodulate and where they come from; provisionally the widest candidate."""
    if settings.bands is not None:
        return settings.bands, "configured"
    if state.bands:
        return state.bands, state.band_source
    highest = max(lines.bpfo, lines.bpfi, 2.0 * lines.bsf)
    return (candidate_bands(rate, highest, settings.band_limit)[0],), "provisional"


def _vote(state: ChannelState, block: ChannelBlock, asked: FeatureSettings, limit: float) -> ChannelState:
    """Count the vote of one of the first blocks for a band; fix the band once there are enough votes."""
    votes = (state.votes or BandVotes()).add(
        block.samples, block.rate, asked.fundamentals, asked.interference, asked.rotation, limit
    )
    if votes.enough:
        return replace(state, votes=None, bands=(votes.best(),), band_source="learning", spectra=RecentSpectra())
    return replace(state, votes=votes)


def _name(analysed: Analysed) -> tuple[ChannelState, Naming, int]:
    """Name the damaged part; the number is the place of the band that shows it, 0 where no part is named.

    The ranges in which the families were sought count where the geometry is an estimate.
    """
    state, settings, features = analysed.state, analysed.channel, analysed.features
    assert features.speed is not None
    ask = partial(
        name_fault,
        kinematics=kinematics(settings.bearing, features.speed),
        searches={} if settings.uncertainty.known else analysed.settings.searches,
        verified=features.shaft is not None,
        tolerance=settings.condition.speed_tolerance,
        wheels=_wheels(features, settings, analysed.settings.speed),
    )
    namings = [
        ask(spectrum, families=families) for spectrum, families in zip(features.sought, features.families, strict=True)
    ]
    if features.shaft is not None and features.shaft.measured and features.speed_factor is not None:
        factors = (*state.speed_factors, features.speed_factor)[-HELD_BLOCKS:]
        state = replace(state, speed_factors=factors)
    place = max(range(len(namings)), key=lambda i: (namings[i].fault is not None, namings[i].relative_score))
    best = namings[place]
    kept = features.recent if settings.average_blocks > 1 else RecentSpectra()
    return replace(state, spectra=kept), best, place if best.fault is not None else 0


def _wheels(features: BlockFeatures, settings: ChannelSettings, stated: float | None) -> Wheels | None:
    """Return the gear wheels beside the bearing, at the speed that is known best; None where there are none."""
    turns = wheel_turns(settings.interference)
    if not turns or features.speed is None:
        return None
    tolerance = settings.condition.speed_tolerance
    if features.shaft is not None:
        return Wheels(turns, features.speed, features.shaft.sd, tolerance)
    factor = features.envelopes[0].mesh_factor
    if factor is not None and stated is not None:
        return Wheels(turns, factor * stated, MESH_SD * factor * stated, tolerance)
    return Wheels(turns, features.speed, None, tolerance)


def held_factor(factors: Sequence[float]) -> float:
    """Return the speed found over the stated one of the latest blocks that showed the shaft: 1 until there are enough.

    A single wrong one among them has no effect.
    """
    return statistics.median(factors) if len(factors) == HELD_BLOCKS else 1.0


def detect_input(features: BlockFeatures, block: ChannelBlock, *, absolute: bool, usable: bool) -> detect.DetectInput:
    """Return what the detector takes from a block; without a known unit (``absolute``) there is no peak in m/s2."""
    by_name = {name: features.lines[0][fault] for name, fault in ((part.feature, part.name) for part in PARTS)}
    floors = {name: float(lines.floor.sum()) for name, lines in by_name.items()}
    return detect.DetectInput(
        sequence=block.sequence,
        time=block.time,
        rms=features.rms,
        prominence={name: by_name[name].total / floor for name, floor in floors.items() if floor > 0.0},
        peak=features.indicators.peak if absolute else None,
        usable=usable,
        shallow=shallow_lines(
            {name: (lines.amplitude, lines.floor) for name, lines in by_name.items()}, features.envelopes[0].mean
        ),
        speed=block.speed.value,
        speed_range=block.speed_range,
        load=block.load.value,
    )


def shallow_lines(
    lines: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64]]], envelope_mean: float
) -> frozenset[str]:
    """Return the lines of parts that are no deeper than the detector counts; those of the outer race never are.

    Args:
        lines: amplitudes and the noise under them by the name of their sum, shape (harmonic,).
        envelope_mean: in the same unit.
    """
    depth = {name: comb_depth(np.square(amplitude) - np.square(floor)) for name, (amplitude, floor) in lines.items()}
    return frozenset(name for name in detect.LINES[1:] if depth[name] < detect.MIN_DEPTH * envelope_mean)


def is_for_detector(state: ChannelState, verdict: Verdict, settings: ChannelSettings, band_source: str) -> bool:
    """Return whether a block moves the detector: until the band is settled, only those of the run-in are counted."""
    running_in = state.detect.seen < settings.detect.run_in_blocks
    return verdict.for_baseline and (band_source != "provisional" or running_in)


def _named(naming: Naming, sequence: int) -> Named | None:
    if naming.fault is None or naming.evidence is None:
        return None
    found = naming.evidence
    return Named(
        naming.fault,
        found.family_snr,
        found.depth,
        naming.relative_score,
        sequence,
        naming.candidates,
        not naming.verified,
    )
