"""The time to the alarm level on its way out: state, records, JSON, MQTT, report."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.commands.replay import summary_lines
from monitor.health.alarms import AlarmSettings
from monitor.health.later_stages import ChannelBlock
from monitor.health.output import ChannelOutput
from monitor.health.record_values import record_values
from monitor.health.rest.trend import TimeToAlarm, TrendInput, TtaStatus, step
from monitor.health.signal.quality import Verdict
from monitor.health.state import ChannelState
from monitor.records.queries import StoredRecord
from monitor.service.neighbours.points import channel_message
from monitor.words.statuses import TTA_REFUSALS
from streams.types.block import STANDARD_GRAVITY
from tests.support.pipeline import base
from tests.support.report import one, page_of_records

FOUND = TimeToAlarm(TtaStatus.OK, 7200.0, 3600.0, 14400.0, 2.0 * STANDARD_GRAVITY, "alert", 0.01)


def values_of(found: TimeToAlarm, **more: Any) -> dict[str, Any]:
    block = ChannelBlock(np.empty(0), 1.0, 1, None, Verdict())
    return record_values(ChannelState().detect, ChannelOutput(block, base(), "final", to_alarm=found)) | more


def test_a_record_has_it_and_leaves_out_what_is_open() -> None:
    values = values_of(FOUND)
    assert (values["tta"], values["tta_lower"], values["tta_upper"]) == (7200.0, 3600.0, 14400.0)
    assert (values["tta_status"], values["tta_level_source"]) == ("ok", "alert")
    assert values_of(replace(FOUND, tta_upper=float("inf")))["tta_upper"] is None
    none = values_of(TimeToAlarm(TtaStatus.NO_TREND))
    assert none["tta"] is none["tta_upper"] is none["tta_level"] is none["tta_level_source"] is None


@pytest.mark.parametrize(("absolute", "level"), [("yes", 2.0), ("no", 2.0 * STANDARD_GRAVITY)])
def test_the_message_over_mqtt_has_the_level_in_the_unit_of_the_others(absolute: str, level: float) -> None:
    record = StoredRecord("m", "s", 1, "ok", "", "", None, 0.0, {"x": values_of(FOUND, absolute_level=absolute)})
    message = json.loads(channel_message(record, "x"))
    assert (message["tta_s"], message["tta_lower_s"], message["tta_upper_s"]) == (7200.0, 3600.0, 14400.0)
    assert (message["tta_status"], message["tta_level_source"]) == ("ok", "alert")
    assert message["tta_level_g"] == pytest.approx(level)


def test_a_stored_state_of_an_earlier_version_has_no_levels_yet() -> None:
    block = TrendInput(1, 0.0, 2.0, baseline=(0.0, 0.05), elevated=True)
    trend, _ = step(ChannelState().trend, block, AlarmSettings())
    stored = replace(ChannelState(), trend=trend).to_dict()
    assert ChannelState.from_dict(json.loads(json.dumps(stored))).trend == trend
    del stored["trend"]
    assert ChannelState.from_dict(stored).trend == ChannelState().trend


@pytest.mark.parametrize(
    ("found", "sentences"),
    [
        (FOUND, ("2 h. Interval: 60 min to 4 h. RMS reaches the alert, 2 g",)),
        (replace(FOUND, tta_upper=float("inf")), ("Interval: from 60 min.",)),
        (replace(FOUND, status=TtaStatus.REACHED, tta=0.0, source="danger"), ("It is reached. The danger, 2 g",)),
        (TimeToAlarm(TtaStatus.NO_TREND), (f"Cannot be said. T{TTA_REFUSALS['no_trend'][1:]}.",)),
    ],
)
def test_the_report_has_one_line(tmp_path: Path, found: TimeToAlarm, sentences: tuple[str, ...]) -> None:
    page = page_of_records(tmp_path, [one(values_of(found, rms=9.0, stage="final"))])
    assert "How long to the alarm level?" in page.text
    for sentence in sentences:
        assert sentence in page.text, page.text[page.text.index("alarm level?") :][:300]


def test_a_report_of_earlier_records_does_not_ask(tmp_path: Path) -> None:
    assert "alarm level?" not in page_of_records(tmp_path, [one({"rms": 9.0, "stage": "final"})]).text


def test_the_summary_of_a_replay_says_it() -> None:
    channel: dict[str, Any] = defaultdict(lambda: None)
    channel |= {"stage": "final", "closed_episodes": [], "tta_status": "ok", "tta_s": 7200.0, "tta_lower_s": 3600.0}
    channel |= {"tta_level_source": "default", "tta_level_factor": 4.0}
    counts: dict[str, Any] = {"blocks": 1, "seconds": 1.0, "accepted": 1, "pending": 0, "dating": [], "condition": None}
    counts |= {name: {} for name in ("flagged", "rejected", "ignored", "closed", "reasons", "bearings")}
    text = "\n".join(summary_lines(counts | {"channels": {"x": channel}, "uncalibrated": []}))
    assert "time to the alarm level (default, 4 times the baseline) 2 h, interval from 60 min, ok" in text
