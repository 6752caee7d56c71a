"""What a run says of itself: how its records were made, and what is known of each channel by now."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from monitor import __version__
from monitor.config.load import Config
from monitor.health.detect import Mark
from monitor.service.setup import ChannelSetup
from monitor.service.watcher import Watcher


def run_attributes(config: Config, setups: Mapping[str, ChannelSetup]) -> dict[str, Any]:
    """Return what the records say of how they were made, by channel where channels differ.

    Args:
        config: the machine.
        setups: its channels by name.
    """
    bands = {name: setup.settings.rms_band for name, setup in setups.items()}
    damage = {name: s.settings.damage for name, s in setups.items() if s.settings.damage is not None}
    leaning = {name: settings for name, settings in damage.items() if settings.prior is not None}
    libraries = {
        name: settings.library.hash
        for name, settings in leaning.items()
        if settings.asks_library and settings.library is not None
    }

    def listed(values: Mapping[str, Any]) -> str:
        return "; ".join(f"{name}: {value}" for name, value in values.items())

    attributes = {
        "software_version": __version__,
        "config_hash": config.hash,
        "map_hash": listed({name: setup.map.hash for name, setup in setups.items() if setup.map is not None}),
        "calibrated": "yes" if config.rig.calibrated else "no",
        "rms_band_hz": listed(
            {name: "full bandwidth" if band is None else f"{band[0]:g} to {band[1]:g}" for name, band in bands.items()}
        ),
        "track_method": listed({name: settings.track_method for name, settings in damage.items()}),
        "forecast_method": listed({name: settings.forecast_method for name, settings in damage.items()}),
    }
    if leaning:
        attributes |= {
            "interval_level": config.forecast.interval,
            "library_hash": listed(libraries),
            "prior": listed({name: settings.prior for name, settings in leaning.items()}),
        }
    return attributes


def channel_summary(watcher: Watcher, name: str) -> dict[str, Any]:
    """Return what is known of a channel by now: the keys of the interface, units in their names."""
    state = watcher.channel(name)
    values = watcher.latest.get(name, {})
    detector, named = state.detect, state.named

    def first(value: Any) -> Any:
        return value[0] if isinstance(value, tuple) else value

    def in_mm2(key: str) -> float | None:
        value = values.get(key)
        return None if value is None else value * 1e6

    return {
        "stage": detector.stage,
        "t_fs_block": detector.t_fs and detector.t_fs.sequence,
        "t_fs_known_block": detector.t_fs_known and detector.t_fs_known.sequence,
        "t_fs_utc": _utc(detector.t_fs) if watcher.dated else None,
        "t_eol_block": detector.t_eol and detector.t_eol.sequence,
        "fault": named and named.fault,
        "fault_snr": named and named.snr,
        "v_eq_mm2": in_mm2("v_eq"),
        "v_eq_lower_mm2": in_mm2("v_eq_lower"),
        "v_eq_upper_mm2": in_mm2("v_eq_upper"),
        "edv_status": values.get("edv_status"),
        "tt_s": first(values.get("tt")),
        "tt_lower_s": first(values.get("tt_lower")),
        "tt_upper_s": first(values.get("tt_upper")),
        "tt_status": first(values.get("tt_status")),
        "p_threshold": first(values.get("p_threshold")),
    }


def _utc(mark: Mark | None) -> str | None:
    if mark is None or mark.time is None:
        return None
    try:
        return datetime.fromtimestamp(mark.time, UTC).isoformat()
    except (OverflowError, OSError, ValueError):
        # A clock that was wrong enough gives times that no calendar has.
        return None
