"""Values of a record, and the kept spectrum, of the output of a block."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from models.machine.bearing import kinematics
from monitor.health.gears.values import gear_values
from monitor.health.onset import LINES, DetectState
from monitor.health.output import ChannelOutput
from monitor.health.record import plain
from monitor.health.rest.trend import TimeToAlarm
from monitor.health.schema import HINT, VERDICT
from monitor.health.signal.comb import FaultLines
from monitor.health.signal.condition import Quantity
from monitor.health.signal.features import SPECTRUM_LINES, BlockFeatures, fundamentals
from monitor.health.signal.orders import MAX_SPEED_RATIO
from monitor.health.signal.rotation.rotation import Rotation
from monitor.health.signal.rotation.shaft_angle import FoundRotation
from monitor.health.signal.velocity import NO_ABSOLUTE_LEVEL, SENSOR_LIMIT, VELOCITY_BAND
from monitor.health.signal.waterfall import SpectrumRow
from monitor.health.size import Remaining
from monitor.health.state import ChannelSettings
from monitor.words.parts import FAULTS
from monitor.words.zones import MAX_SPEED, MIN_SPEED
from streams.types.block import Block

_DAMAGE = (
    *("rms_smoothed", "dphi_d", "h_d", "v_eq", "v_eq_lower", "v_eq_upper", "v_eq_relative"),
    *("v_eq_filter", "v_eq_filter_lower", "v_eq_filter_upper"),
)
_REMAINING = ("tt", "tt_lower", "tt_upper", "p_threshold")


def record_values(
    detector: DetectState, output: ChannelOutput, truth: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the values of one channel by variable (``monitor.health.schema``), None where there is no value.

    Args:
        detector: its state after the block.
        truth: ``v_eq_true`` and ``tt_true`` of a simulated rig, for a channel that is tracked.
    """
    block = output.block
    values: dict[str, Any] = {
        "quality_status": block.verdict.status,
        "quality_flags": block.verdict.flags,
        "stage": output.stage,
        "absolute_level": "yes" if output.settings.absolute else "no",
        "speed": None if output.features is None else block.speed.value,
        "load": None if output.features is None else block.load.value,
        **_sensor_values(output.settings),
    }
    for name in ("t_fs", "t_fs_known", "t_eol"):
        mark = getattr(detector, name)
        if mark is not None:
            values[name] = mark.time
            values[f"{name}_block"] = mark.sequence
    warped = output.features is not None and output.features.domain == "order"
    values |= rotation_values(block.found, warped=warped)
    if output.features is not None:
        values |= _feature_values(output.features, output)
    if output.detection is not None:
        values["detect_score"] = output.detection.score
        values["detect_threshold"] = output.detection.threshold
        if detector.t_fs is not None:
            values["rms_baseline"] = output.detection.expected_rms
            values["raised"] = tuple(FAULTS[LINES.index(name)] for name in output.detection.raised) or None
    if output.naming is not None and output.naming.evidence is not None:
        evidence = output.naming.evidence
        values |= {
            "fault": output.naming.fault,
            "fault_basis": basis_of(output.naming.fault, detector),
            "fault_candidates": output.naming.candidates or None,
            "speed_unverified": "no" if output.naming.verified else "yes",
            "fault_snr": evidence.family_snr,
            "fault_depth": evidence.depth,
            "fault_score": evidence.comb_score,
        }
    if output.damage is not None:
        values |= {name: getattr(output.damage, name) for name in _DAMAGE}
        values["edv_status"] = output.damage.status
        values["p_no_growth"] = p_no_growth(output)
    if output.forecasts:
        values |= {**_forecast_values(output.forecasts), "p_crossed": output.forecasts[0].p_crossed}
    values |= _alarm_time_values(output.to_alarm)
    if output.features is not None:
        for name, quantity in (("speed", block.speed), ("load", block.load)):
            values |= {f"{name}_source": quantity.source, f"{name}_sd": quantity.sd}
    if output.damage is not None:
        values |= truth or {}
    values |= gear_values(output.gears)
    return {name: plain(value) for name, value in values.items()}


def _sensor_values(settings: ChannelSettings) -> dict[str, Any]:
    if not settings.measures_velocity:
        return {}
    return {"quantity": "velocity", "acceleration_limit": settings.velocity_limit}


def _alarm_time_values(found: TimeToAlarm | None) -> dict[str, Any]:
    if found is None:
        return {}
    values: dict[str, Any] = {name: getattr(found, name) for name in ("tta", "tta_lower", "tta_upper")}
    return {**values, "tta_status": found.status, "tta_level": found.level, "tta_level_source": found.source}


def p_no_growth(output: ChannelOutput) -> float:
    """Return the probability that V_eq stands still: the forecast's, on which its status rests, else the tracker's."""
    known = [found.p_no_growth for found in output.forecasts if math.isfinite(found.p_no_growth)]
    tracked = math.nan if output.damage is None else output.damage.p_no_growth
    return known[0] if known else tracked


def basis_of(fault: str | None, detector: DetectState) -> str | None:
    """Return what a name is: "verdict" in a final stage, "hint" without one, None without a name."""
    if fault is None:
        return None
    return HINT if detector.t_fs is None else VERDICT


def _feature_values(features: BlockFeatures, output: ChannelOutput) -> dict[str, Any]:
    def over_bands(value: Callable[[int], Any]) -> Any:
        found = tuple(value(place) for place in range(len(features.lines)))
        return found[0] if len(found) == 1 else found

    values: dict[str, Any] = {**features.values, **_velocity_values(features, output)}
    values["bpfo_amplitude"] = np.where(features.bpfo_resolved, features.bpfo_amplitude, np.nan)
    values["band_lo"] = over_bands(lambda band: output.bands[band][0])
    values["band_hi"] = over_bands(lambda band: output.bands[band][1])
    values["band_source"] = output.band_source
    values["envelope_mean"] = over_bands(lambda band: float(features.envelopes[band].mean))
    values["domain"] = features.domain
    if output.detection is not None and (output.detection.outside or output.detection.level is not None):
        status = "outside_conditions" if output.detection.outside else "ok"
        values |= {"level_rms": output.detection.level, "level_status": status}
    values["speed_factor_sd"] = _speed_factor_sd(features, output.block.speed)
    for name in ("amplitude", "floor", "snr"):
        values[f"envelope_{name}"] = over_bands(
            lambda band, name=name: [_resolved(features.lines[band][fault], name) for fault in FAULTS]
        )
    return values


def _velocity_values(features: BlockFeatures, output: ChannelOutput) -> dict[str, Any]:
    """Return status and zone of the velocity, which is none without the unit of the sensor, or beyond its range.

    Zones are for steady operation within the speeds that they judge, and for an undisturbed sensor.
    """
    if not output.settings.absolute:
        return {"velocity_rms": None, "velocity_floor": None, "velocity_status": NO_ABSOLUTE_LEVEL}
    if output.settings.band_limit < VELOCITY_BAND[1]:
        return {"velocity_rms": None, "velocity_floor": None, "velocity_status": SENSOR_LIMIT}
    found: dict[str, Any] = {"velocity_status": features.velocity.status}
    velocity, speed, judged = features.velocity.rms, output.block.speed.value, output.settings.machine_class
    if judged is not None and velocity is not None and speed is not None and output.block.verdict.for_tracker:
        found["velocity_zone"] = judged.zone(velocity) if MIN_SPEED <= speed <= MAX_SPEED else None
    return found


def _speed_factor_sd(features: BlockFeatures, stated: Quantity) -> float | None:
    """Return the standard deviation of a speed factor that was measured on the shaft, else None."""
    shaft = features.shaft
    return shaft.sd / stated.value if shaft is not None and shaft.measured and stated.value else None


def _resolved(lines: FaultLines, name: str) -> list[float | None]:
    """Return an attribute of each line, None where the spectrum does not resolve it."""
    values: list[float | None] = getattr(lines, name).tolist()
    if lines.resolved.all():
        return values
    return [value if resolved else None for value, resolved in zip(values, lines.resolved, strict=True)]


def _forecast_values(forecasts: tuple[Remaining, ...]) -> dict[str, Any]:
    return {
        "v_th": tuple(result.threshold for result in forecasts),
        **{name: tuple(getattr(result, name) for result in forecasts) for name in _REMAINING},
        "tt_status": tuple(result.status for result in forecasts),
        "tt_coefficients": tuple(result.coefficients for result in forecasts),
        "r_squared": tuple(result.r_squared for result in forecasts),
    }


def spectrum_row(block: Block, output: ChannelOutput) -> SpectrumRow | None:
    """Return the envelope spectrum to keep of a channel, or None where there is none that is finite.

    A block has one unless its channel is rejected, flat, stopped, late or out of order.
    """
    features = output.features
    speed = None if features is None else features.speed
    if not output.block.verdict.for_baseline or features is None or speed is None:
        return None
    envelope, lines = features.envelopes[output.leading], features.lines[output.leading]
    nominal = fundamentals(kinematics(output.settings.bearing, speed))
    keep = min(envelope.amplitude.size, int(SPECTRUM_LINES * max(nominal.values()) / envelope.resolution))
    rotation = output.block.found.rotation
    row = SpectrumRow(
        source=block.source,
        channel=output.settings.name,
        sequence=block.sequence,
        time=block.start if block.start is not None else block.elapsed,
        resolution=float(envelope.resolution),
        band=(float(envelope.band[0]), float(envelope.band[1])),
        speed=float(speed),
        mean=float(envelope.mean),
        absolute=output.settings.absolute,
        amplitude=envelope.amplitude[:keep],
        lines={
            fault: float(line * (lines[fault].speed_factor if lines[fault].detected else 1.0))
            for fault, line in nominal.items()
        },
        domain=features.domain,
        speed_range=None if rotation is None else rotation.speed_range,
        speed_course=speed_course(rotation),
    )
    return row if bool(np.isfinite(row.amplitude).all()) and math.isfinite(row.mean) else None


COURSE_POINTS = 65
"""Points of the course of the speed that are kept with a spectrum."""


def rotation_values(found: FoundRotation, *, warped: bool = True) -> dict[str, Any]:
    """Return the values of a record by variable; {} of a machine without any source of an angle.

    Args:
        found: angle of the shaft over the block.
        warped: whether the spectra of the block are over it.
    """
    rotation, status, pulses = found.rotation, found.status, found.pulses
    wide = rotation is not None and rotation.speed_range[1] > MAX_SPEED_RATIO * rotation.speed_range[0]
    if status == "ok" and wide and not warped:
        status = "too_wide"
    values: dict[str, Any] = {} if status is None else {"rotation_status": status}
    if rotation is not None:
        least, highest = rotation.speed_range
        values |= {
            "speed_min": least,
            "speed_max": highest,
            "acceleration": rotation.acceleration,
            "revolutions": rotation.turned,
        }
    if pulses is not None:
        values |= {
            "pulses_missing": pulses.missing,
            "pulses_extra": pulses.extra,
            "encoder_error": pulses.encoder_error,
        }
    return values


def speed_course(rotation: Rotation | None) -> tuple[float, ...] | None:
    """Return the speed at equal steps from the beginning to the end of a block, Hz, or None without an angle."""
    if rotation is None:
        return None
    times = np.linspace(0.0, rotation.duration, COURSE_POINTS)
    return tuple(np.round(rotation.speed_at(times), 6).tolist())
