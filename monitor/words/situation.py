"""The situation of a channel, as far as words for people need it: of its status, or of the record of a block."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

from monitor.words.features import first


@dataclass(frozen=True)
class Forecast:
    """A time with its interval, s, and the status that says whether there is one; NaN where there is none.

    Attributes:
        to: what it leads to, "" where that is not known.
    """

    status: str | None = None
    time: float = math.nan
    lower: float = math.nan
    upper: float = math.nan
    to: str = ""


@dataclass(frozen=True)
class Situation:
    """What is known of a channel after a block.

    Attributes:
        bearing: name of the bearing that it listens to, "" for none.
        state: status after NAMUR NE 107.
        stage: of life, "" where no block was judged.
        severity: of the worst alarm that stands, None for none.
        fault: the damaged part by the channel itself, None for none; parts that cannot be told apart joined by "|".
        basis: "hint" or "verdict".
        candidates: parts between which the stated speed does not decide.
        unverified: whether the speed of the shaft is only stated; None where that is not known.
        snr: lines of the part over the noise floor under them, NaN where not known.
        blocks: since the onset was known, None before it.
        level: RMS over its learned median, NaN where not known.
        to_alarm: time to the alarm level, by the trend of RMS; ``to`` is "alert", "danger" or "default".
        to_threshold: time to the first threshold of V_eq, or to the end as recorded runs ended.
        calibrated: whether V_eq may be compared with a threshold.
        bearing_fault, bearing_basis: what all channels of the bearing say together.
        support: share of their evidence that names it so, None where not known.
        channels: how many listen to the bearing.
        disagreement: by channel, the part that it names instead.
        level_of: the bearing with whose damage the level rises, where no part of its own is named.
        gear, gear_kind: the wheel that is named, as a value of ``fault``, and the kind of its damage; None for none.
    """

    channel: str = ""
    bearing: str = ""
    state: str = "normal"
    stage: str = ""
    severity: str | None = None
    fault: str | None = None
    basis: str | None = None
    candidates: tuple[str, ...] = ()
    unverified: bool | None = None
    snr: float = math.nan
    blocks: int | None = None
    level: float = math.nan
    to_alarm: Forecast = Forecast()
    to_threshold: Forecast = Forecast()
    calibrated: bool = True
    bearing_fault: str | None = None
    bearing_basis: str | None = None
    support: float | None = None
    channels: int = 0
    disagreement: Mapping[str, str] = field(default_factory=dict[str, str])
    level_of: str | None = None
    gear: str | None = None
    gear_kind: str | None = None

    @classmethod
    def of_status(cls, name: str, channel: Mapping[str, Any], bearing: str = "", state: str | None = None) -> Self:
        """Return that of a channel's part of a status, or of the summary of a replay, which has no ``state``."""
        latest, known = channel.get("last_block"), channel.get("t_fs_known_block")
        fault, basis = channel.get("fault"), channel.get("fault_basis")
        if fault is not None and fault == channel.get("gear_fault"):
            # A wheel comes first only where the bearing has no verdict.
            fault = channel.get("bearing_fault")
            basis = None if fault is None else "hint"
        return cls(
            channel=name,
            bearing=bearing,
            state=state or str(channel.get("state") or "normal"),
            stage=channel.get("stage") or "",
            severity=_worst(channel.get("alarms") or ()),
            fault=fault,
            basis=basis,
            candidates=tuple(channel.get("fault_candidates") or ()),
            unverified=channel.get("speed_unverified"),
            snr=_number(channel.get("fault_snr")),
            blocks=None if latest is None or known is None else max(0, latest - known),
            level=_number(channel.get("rms_over_baseline")),
            to_alarm=_forecast(channel, "tta", "_s", channel.get("tta_level_source") or ""),
            to_threshold=_forecast(channel, "tt", "_s"),
            calibrated=channel.get("calibrated") is not False,
            gear=channel.get("gear_fault"),
            gear_kind=channel.get("gear_kind"),
        )

    @classmethod
    def of_record(
        cls, name: str, values: Mapping[str, Any], block: int | None, bearing: str = "", severity: str | None = None
    ) -> Self:
        """Return that of the values of a channel in the record of a block, SI."""
        known, unverified = values.get("t_fs_known_block"), values.get("speed_unverified")
        rms, baseline = _number(values.get("rms")), _number(values.get("rms_baseline"))
        return cls(
            channel=name,
            bearing=bearing,
            stage=values.get("stage") or "",
            severity=severity,
            fault=values.get("fault"),
            basis=values.get("fault_basis"),
            candidates=tuple(values.get("fault_candidates") or ()),
            unverified=None if unverified is None else unverified == "yes",
            snr=_number(values.get("fault_snr")),
            blocks=None if block is None or known is None else max(0, block - known),
            level=rms / baseline if baseline > 0.0 else math.nan,
            to_alarm=_forecast(values, "tta", "", values.get("tta_level_source") or ""),
            to_threshold=_forecast(values, "tt", ""),
            calibrated="uncalibrated" not in (values.get("edv_status"), first(values.get("tt_status"))),
        )

    def with_bearing(self, found: Mapping[str, Any] | None) -> Self:
        """Return it with what all channels of its bearing say together, by the keys of the interface."""
        if not found:
            return self
        return replace(
            self,
            bearing_fault=found.get("fault"),
            bearing_basis=found.get("fault_basis"),
            support=found.get("support"),
            channels=len(found.get("channels") or ()),
            disagreement=dict(found.get("disagreement") or {}),
            level_of=found.get("level_of"),
        )


def _worst(alarms: Sequence[Mapping[str, Any]]) -> str | None:
    severities = {alarm.get("severity") for alarm in alarms}
    return next((severity for severity in ("danger", "alert") if severity in severities), None)


def _forecast(values: Mapping[str, Any], name: str, ending: str, to: str = "") -> Forecast:
    time, lower, upper = (_number(values.get(f"{name}{end}{ending}")) for end in ("", "_lower", "_upper"))
    return Forecast(first(values.get(f"{name}_status")), time, lower, upper, to)


def _number(value: Any) -> float:
    found = first(value)
    return float(found) if isinstance(found, int | float) else math.nan
