"""What the stages said of a block, as the record that is stored."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from monitor.health.record import Record, plain
from monitor.health.spectrum.features import FAULTS, BlockFeatures
from monitor.health.state import ChannelState
from monitor.health.step import ChannelOutput
from streams.block import Block, Rejected

_DAMAGE = ("rms_smoothed", "dphi_d", "h_d", "v_eq", "v_eq_lower", "v_eq_upper")
_REMAINING = ("tt", "tt_lower", "tt_upper", "p_threshold")


def rejected_record(item: Rejected) -> Record:
    """Return the record of a block that could not be made."""
    return Record(
        source=item.source,
        sequence=item.sequence,
        name=item.name,
        content_hash=item.content_hash,
        status=item.status,
        reason=item.reason,
    )


def block_record(
    block: Block,
    status: str,
    flags: tuple[str, ...],
    reason: str,
    channels: Mapping[str, tuple[ChannelState, ChannelOutput]],
    truth: Mapping[str, Any] | None = None,
    methods: Mapping[str, str] | None = None,
    *,
    conditions: Mapping[str, Mapping[str, Any]] | None = None,
) -> Record:
    """Return the record of a block.

    Args:
        block: where it came from.
        status: of the whole block.
        flags: of the whole block.
        reason: one sentence where the status is not "ok".
        channels: state after the block and output, by channel.
        truth: what a simulated rig knows (``v_eq_true``, ``tt_true``), for its tracked channels.
        methods: by which method each channel is forecast, for the archive; the thesis' where it does not say.
        conditions: by channel, where speed and load come from and how exact they are.
    """
    values = {name: channel_values(state, output) for name, (state, output) in channels.items()}
    for name, condition in (conditions or {}).items():
        values[name] |= {key: plain(value) for key, value in condition.items()}
    if truth:
        for name, (_, output) in channels.items():
            if output.damage is not None:
                values[name] |= plain(truth)
    return Record(
        source=block.source,
        sequence=block.sequence,
        name=block.name,
        content_hash=block.content_hash,
        status=status,
        flags=flags,
        reason=reason,
        time=block.start,
        elapsed=block.elapsed,
        channels=values,
        forecasts=tuple(
            row
            for name, (_, output) in channels.items()
            for row in _forecast_rows(name, output, (methods or {}).get(name, "thesis"))
        ),
        events=tuple(event for name, (state, output) in channels.items() for event in _events(name, state, output)),
    )


def channel_values(state: ChannelState, output: ChannelOutput) -> dict[str, Any]:
    """Return the values of one channel by variable (``monitor.health.schema``), None where there is none."""
    detector = state.detect
    values: dict[str, Any] = {
        "quality_status": output.verdict.status,
        "quality_flags": output.verdict.flags,
        "stage": output.stage,
        "absolute_level": "yes" if output.absolute else "no",
        "speed": output.speed,
        "load": output.load,
    }
    for name in ("t_fs", "t_fs_known", "t_eol"):
        mark = getattr(detector, name)
        if mark is not None:
            values[name] = mark.time
            values[f"{name}_block"] = mark.sequence
    if output.features is not None:
        values |= _feature_values(output.features, output)
    if output.detection is not None:
        values["detect_score"] = output.detection.score
        values["detect_threshold"] = output.detection.threshold
    if output.naming is not None and output.naming.evidence is not None:
        evidence = output.naming.evidence
        values |= {
            "fault": output.naming.fault,
            "fault_snr": evidence.snr,
            "fault_depth": evidence.depth,
            "fault_score": evidence.score,
        }
    if output.damage is not None:
        values |= {name: getattr(output.damage, name) for name in _DAMAGE}
        values["edv_status"] = output.damage.status
    if output.forecasts:
        values |= _forecast_values(output)
    return {name: plain(value) for name, value in values.items()}


def _feature_values(features: BlockFeatures, output: ChannelOutput) -> dict[str, Any]:
    values: dict[str, Any] = dict(features.values)
    values["bpfo_amplitude"] = np.where(features.bpfo_resolved, features.bpfo_amplitude, np.nan)
    single = len(features.lines) == 1

    def over_bands(rows: Sequence[Any]) -> Any:
        return rows[0] if single else tuple(rows)

    values["band_lo"] = over_bands([band[0] for band in output.bands])
    values["band_hi"] = over_bands([band[1] for band in output.bands])
    values["band_source"] = output.band_source
    for name, attribute in (("amplitude", "amplitude"), ("floor", "floor"), ("snr", "snr")):
        values[f"envelope_{name}"] = over_bands(
            [
                tuple(
                    tuple(
                        float(value) if resolved else None
                        for value, resolved in zip(getattr(band[fault], attribute), band[fault].resolved, strict=True)
                    )
                    for fault in FAULTS
                )
                for band in features.lines
            ]
        )
    return values


def _forecast_values(output: ChannelOutput) -> dict[str, Any]:
    results = output.forecasts
    return {
        "v_th": tuple(result.threshold for result in results),
        **{name: tuple(getattr(result, name) for result in results) for name in _REMAINING},
        "tt_status": tuple(result.status for result in results),
        "tt_coefficients": tuple(result.coefficients for result in results),
        "r_squared": tuple(result.r_squared for result in results),
    }


def _forecast_rows(channel: str, output: ChannelOutput, method: str) -> list[dict[str, Any]]:
    """Return the forecasts as issued, units at the edge; keys as ``monitor.records.archive`` knows them."""
    return [
        {
            "channel": channel,
            "method": method,
            "threshold_mm2": result.threshold * 1e6,
            "status": result.status,
            **{f"{name}_s": plain(getattr(result, name)) for name in ("tt", "tt_lower", "tt_upper")},
            "p_threshold": plain(result.p_threshold),
            "quantiles_s": {str(level): value for level, value in result.quantiles} or None,
        }
        for result in output.forecasts
        if result.status != "not_final_stage"
    ]


def _events(channel: str, state: ChannelState, output: ChannelOutput) -> list[dict[str, Any]]:
    """Return what became known with this block."""
    events: list[dict[str, Any]] = []
    detection, detector = output.detection, state.detect
    if detection is None:
        return events
    if detection.alarm and detector.t_fs is not None and detector.t_fs_known is not None:
        events.append(
            {
                "kind": "final_stage",
                "channel": channel,
                "block": detector.t_fs_known.sequence,
                "t_fs_block": detector.t_fs.sequence,
                "score": detection.score,
            }
        )
    if detection.end and detector.t_eol is not None:
        events.append({"kind": "end_of_life", "channel": channel, "block": detector.t_eol.sequence})
    return events
