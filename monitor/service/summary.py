"""Provenance of the records of a run, results of each channel, and what is said where its rig is not calibrated."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

from models.machine.rig import Calibration, Rig, RigParameters
from models.maps.data import RmsMap
from models.solve.registry import RIGS
from monitor import __version__
from monitor.config.interference import removed_lines, words_of
from monitor.config.load import Config
from monitor.config.source import ChannelSection
from monitor.health.gears.values import gears_summary, primary_fault
from monitor.health.name.machine import patience_of, weigh
from monitor.health.onset import Episode, Mark
from monitor.health.record_values import basis_of
from monitor.health.schema import VERDICT
from monitor.health.size.library.model import Library
from monitor.health.state import ChannelSettings, SourceSettings, SourceState, channels_by_bearing
from monitor.words.advice import ADVICE, state_of
from monitor.words.calibration import uncalibrated_sentence
from monitor.words.features import columns, first
from monitor.words.situation import Situation
from monitor.words.statuses import suspended_words
from streams.types.block import STANDARD_GRAVITY


def weakest_calibration(*found: Calibration) -> Calibration:
    """Return the weakest of several claims: false, then "declared", then true; true for none."""
    return False if False in found else "declared" if "declared" in found else True


def rig_of_library(library: Library) -> RigParameters | None:
    """Return the rig whose lives a library was made of, None for a library without simulated lives."""
    if "population" not in library.made_of:
        return None
    population = library.made_of["population"]
    return RIGS[population.get("model", Rig.model)](**population["rig"])


def is_calibrated(library: Library) -> bool:
    """Return whether the rig that a library is of is calibrated; one that does not name its rig is not."""
    rig = rig_of_library(library)
    return rig is not None and rig.calibrated is not False


def calibration_of(
    config: Config, channel: ChannelSection, maps: Iterable[RmsMap], library: Library | None
) -> Calibration:
    """Return the weakest claim of the configuration, maps and library: a map that was built uncalibrated stays so.

    The configuration claims in ``[rig]`` for the model of the casing, in ``[shaft]`` for the others.
    """
    rigs: list[RigParameters] = [rms_map.plan.rig for rms_map in maps]
    of_library = None if library is None else rig_of_library(library)
    if of_library is not None:
        rigs.append(of_library)
    claims: list[Calibration] = [rig.calibrated for rig in rigs]
    if not rigs or any(isinstance(rig, Rig) for rig in rigs):
        claims.append(config.calibration_of(channel))
    if not all(isinstance(rig, Rig) for rig in rigs):
        claims.append(config.shaft.calibrated)
    return weakest_calibration(*claims)


def uncalibrated_lines(config: Config, channels: Mapping[str, ChannelSettings]) -> Iterator[str]:
    """Yield a line for each channel of an uncalibrated rig that is tracked, and for each level that is suspended."""
    for section in config.channel:
        settings = channels.get(section.name)
        if settings is not None and settings.calibration is False:
            yield from channel_lines(config, section, settings.alarms.suspended, other_models(settings))


def other_models(settings: ChannelSettings) -> list[str]:
    """Return the models of the maps and the library of a channel, but that of the casing."""
    if settings.damage is None:
        return []
    models = {part_map.model for part_map in settings.damage.maps.values()}
    of_library = None if settings.damage.library is None else rig_of_library(settings.damage.library)
    if of_library is not None:
        models.add(of_library.model)
    return sorted(models - {Rig.model})


def channel_lines(
    config: Config, section: ChannelSection, suspended: Sequence[str] = (), models: Sequence[str] = ()
) -> Iterator[str]:
    """Yield the lines of one tracked channel of an uncalibrated rig, and of its ``suspended`` levels.

    ``models`` are those of its maps and its library, but that of the casing.
    """
    issued = config.forecast.uncalibrated_threshold
    yield f"channel {section.name!r}: {_reason(config, section, models, issued=issued)}"
    if suspended:
        yield f"channel {section.name!r}: {suspended_words(suspended)}; give a level on v_eq_relative"


def _reason(config: Config, section: ChannelSection, models: Sequence[str], *, issued: bool) -> str:
    if models and config.shaft.calibrated is False:
        return uncalibrated_sentence(f"[shaft] does not declare the parameters of {', '.join(models)}", issued=issued)
    if models:
        return uncalibrated_sentence("its map or library was built before [shaft] was declared", issued=issued)
    if config.calibration_of(section) is not False:
        return uncalibrated_sentence("its map or library was built before [rig] was calibrated", issued=issued)
    try:
        rig = config.rig_of(config.entry_of(section))
    except ValueError as error:
        return uncalibrated_sentence(str(error), issued=issued)
    if config.rig.claim is not False:
        return uncalibrated_sentence("[rig] is that of another bearing; see bearing in [rig]", issued=issued)
    return uncalibrated_sentence(rig, issued=issued)


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
        "rms_band_hz": listed({name: _band_words(channels[name], band) for name, band in bands.items()}),
        "track_method": listed({name: settings.track_method for name, settings in damage.items()}),
        "forecast_method": listed({name: settings.forecast_method for name, settings in damage.items()}),
    }
    if velocities := {name: _derivative_words(one) for name, one in channels.items() if one.measures_velocity}:
        attributes["velocity_sensors"] = listed(velocities)
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


def _band_words(settings: ChannelSettings, band: tuple[float, float] | None) -> str:
    if band is not None:
        return f"{band[0]:g} to {band[1]:g}"
    return f"0 to {settings.velocity_limit:g}" if settings.measures_velocity else "full bandwidth"


def _derivative_words(settings: ChannelSettings) -> str:
    return f"acceleration up to {settings.velocity_limit:g} Hz by differentiation"


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
    patience = patience_of(state.order.clock.interval for state, _ in pairs) if len(pairs) > 1 else None
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
