"""The provenance of the records of a run, and the results of each channel up to its latest block."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from models.machine.rig import Calibration
from monitor import __version__
from monitor.config.interference import words_of
from monitor.config.load import Config
from monitor.config.removed import removed_lines
from monitor.health.gears.values import gears_summary, primary_fault
from monitor.health.name.machine import patience_of, weigh
from monitor.health.onset import Episode, Mark
from monitor.health.record_values import basis_of
from monitor.health.schema import VERDICT
from monitor.health.state import ChannelSettings, SourceSettings, SourceState, channels_by_bearing
from monitor.service.calibration import other_models
from monitor.words.advice import ADVICE, state_of
from monitor.words.features import columns, first
from monitor.words.situation import Situation
from streams.types.block import STANDARD_GRAVITY

_ROTATION = ("speed_min", "speed_max", "acceleration", "revolutions", "encoder_error", "level_rms")
_ROTATION_WORDS = ("domain", "rotation_status", "pulses_missing", "pulses_extra", "level_status")
_END_WORDS = {
    "learned": "as recorded runs ended, v_th is not used",
    "combined": "as recorded runs ended, or v_th by the library",
}


def run_attributes(config: Config, channels: Mapping[str, ChannelSettings]) -> dict[str, Any]:
    """Return the provenance of the records of a machine, with values by channel where channels differ."""
    bands = {name: channel.rms_band for name, channel in channels.items()}
    damage = {name: channel.damage for name, channel in channels.items() if channel.damage is not None}
    with_prior = {name: settings for name, settings in damage.items() if settings.prior is not None}
    libraries = {
        name: settings.library.hash
        for name, settings in with_prior.items()
        if settings.uses_library and settings.library is not None
    }

    def listed(values: Mapping[str, Any]) -> str:
        return "; ".join(f"{name}: {value}" for name, value in values.items())

    maps = {name: channel.map_hash for name, channel in channels.items() if channel.map_hash is not None}
    attributes = {
        "software_version": __version__,
        "config_hash": config.hash,
        "map_hash": listed(maps),
        "bearing": listed({name: channel.listens_to for name, channel in channels.items()}),
        "calibrated": _calibration_words(config, channels),
        "rms_band_hz": listed(
            {name: "full bandwidth" if band is None else f"{band[0]:g} to {band[1]:g}" for name, band in bands.items()}
        ),
        "track_method": listed({name: settings.track_method for name, settings in damage.items()}),
        "forecast_method": listed({name: settings.forecast_method for name, settings in damage.items()}),
    }
    models = {name: ", ".join(found) for name, channel in channels.items() if (found := other_models(channel))}
    if models:
        # Another model than that of the casing, which older records do not name.
        attributes["model"] = listed(models)
    own = {key: text for key, text in config.advice.texts.items() if text != ADVICE[key]}
    if own:
        attributes["advice"] = json.dumps(own, ensure_ascii=False)
    if config.machine.iso_class is not None:
        attributes["iso_class"] = config.machine.iso_class
    if removed := removed_lines(config):
        attributes["interference"] = "; ".join(map(words_of, removed))
    if config.gear is not None:
        # In the order of the dimension; wheels that turn alike are one.
        attributes["gears"] = ", ".join("|".join(group) for group in config.gear.to_settings().groups())
    if with_prior:
        attributes |= {
            "interval_level": config.forecast.interval,
            "library_hash": listed(libraries),
            "prior": listed({name: settings.prior for name, settings in with_prior.items()}),
        }
    learned = {name: settings for name, settings in damage.items() if settings.uses_learned}
    if learned:
        attributes |= {
            "forecast_end": listed({name: _END_WORDS[settings.forecast_method] for name, settings in learned.items()}),
            "learned_hash": listed({name: settings.learned.hash for name, settings in learned.items()}),
        }
    return attributes


def _calibration_words(config: Config, channels: Mapping[str, ChannelSettings]) -> str:
    """Return "yes", "no" or "declared", by channel where tracked channels differ."""
    words: dict[Calibration, str] = {True: "yes", False: "no", "declared": "declared"}
    found = {name: words[channel.calibration] for name, channel in channels.items() if channel.calibration is not None}
    if not found:
        return words[config.rig.claim]
    if len(set(found.values())) == 1:
        return next(iter(found.values()))
    return "; ".join(f"{name}: {word}" for name, word in found.items())


def channel_summary(state: SourceState, settings: ChannelSettings) -> dict[str, Any]:
    """Return the results of a channel up to the latest block: the keys of the interface, units in their names."""
    name = settings.name
    latest = state.latest
    values = {} if latest is None else latest.channels.get(name, {})
    dated = latest is not None and latest.time is not None
    detector, named = state.channels[name].detect, state.channels[name].named

    return {
        "stage": detector.stage,
        "t_fs_block": detector.t_fs and detector.t_fs.sequence,
        "t_fs_known_block": detector.t_fs_known and detector.t_fs_known.sequence,
        "t_fs_utc": _utc(detector.t_fs) if dated else None,
        "closed_episodes": [_episode(episode) for episode in detector.episodes],
        "t_eol_block": detector.t_eol and detector.t_eol.sequence,
        "rms_over_baseline": _over_baseline(values, detector.reference_rms),
        "fault": named and named.fault,
        "fault_basis": basis_of(named and named.fault, detector),
        "fault_candidates": list(named.candidates) if named and named.candidates else None,
        "speed_unverified": named and named.speed_unverified,
        "fault_snr": named and named.snr,
        **columns(("v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative"), values),
        "calibrated": settings.calibration,
        "edv_status": values.get("edv_status"),
        **columns(("tt", "tt_lower", "tt_upper"), values),
        "tt_status": first(values.get("tt_status")),
        **columns(("p_threshold", "p_no_growth", "p_crossed", "velocity_rms", "velocity_floor"), values),
        **{name: values.get(name) for name in ("velocity_status", "velocity_zone")},
        **columns(("speed", *_ROTATION), values),
        **{name: values.get(name) for name in _ROTATION_WORDS},
        **_alarm_time(values, detector.reference_rms),
        **_gears(state, name, values, (named and named.fault, basis_of(named and named.fault, detector))),
    }


def _gears(
    state: SourceState, name: str, values: Mapping[str, Any], bearing: tuple[str | None, str | None]
) -> dict[str, Any]:
    """Return what is said of the wheels, and what is said first; {} without gears.

    Args:
        bearing: the named part and what its name is.
    """
    if name not in state.gears:
        return {}
    found: dict[str, Any] = {"bearing_fault": bearing[0], **gears_summary(state.gears[name], values)}
    first = primary_fault(*bearing, found["gear_fault"])
    if first != bearing[0]:
        found |= {"fault": first, "fault_basis": VERDICT, "fault_snr": None}
        found |= {"fault_candidates": None, "speed_unverified": None}
    return found


def with_words(
    config: Config, channels: Mapping[str, Mapping[str, Any]], bearings: Mapping[str, Mapping[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return the channels of a status or of a replay, each with what is said of it.

    Keys are ``headline``, ``sureness``, ``level`` and ``action``.
    """
    heard = {section.name: section.bearing for section in config.channel}
    advice = config.advice.texts

    def said(name: str, channel: Mapping[str, Any]) -> dict[str, str]:
        bearing = heard.get(name, "")
        situation = Situation.of_status(name, channel, bearing).with_bearing(bearings.get(bearing))
        return state_of(situation, advice).to_dict()

    return {name: {**channel, **said(name, channel)} for name, channel in channels.items()}


def _over_baseline(values: Mapping[str, Any], baseline: float | None) -> float | None:
    rms = values.get("rms")
    return rms / baseline if rms is not None and baseline else None


def _alarm_time(values: Mapping[str, Any], baseline: float | None) -> dict[str, Any]:
    """Return the time to the alarm level; the level in g where the unit is known, and over the baseline."""
    level = values.get("tta_level")
    absolute = values.get("absolute_level") != "no"
    return {
        **{f"{name}_s": values.get(name) for name in ("tta", "tta_lower", "tta_upper")},
        "tta_status": values.get("tta_status"),
        "tta_level_source": values.get("tta_level_source"),
        "tta_level_g": level / STANDARD_GRAVITY if level is not None and absolute else None,
        "tta_level_factor": level / baseline if level is not None and baseline else None,
    }


def bearing_summaries(sources: Iterable[tuple[SourceState, SourceSettings]]) -> dict[str, dict[str, Any]]:
    """Return by bearing what the channels of all sources of a machine say of it: the keys of the interface."""
    pairs = list(sources)
    patience = patience_of(state.order.interval for state, _ in pairs) if len(pairs) > 1 else None
    bearings = channels_by_bearing(channel for _, settings in pairs for channel in settings.channels.values())
    found = weigh([state.machine for state, _ in pairs], bearings, patience)
    return {name: verdict.to_dict() for name, verdict in found.items()}


def _episode(episode: Episode) -> dict[str, int]:
    return {
        "t_fs_block": episode.began.sequence,
        "t_fs_known_block": episode.known.sequence,
        "closed_block": episode.closed.sequence,
    }


def _utc(mark: Mark | None) -> str | None:
    if mark is None or mark.time is None:
        return None
    try:
        return datetime.fromtimestamp(mark.time, UTC).isoformat()
    except (OverflowError, OSError, ValueError):
        # A wrong clock can give times outside of the calendar.
        return None
