"""The message: what happened, where, since when, how the bearing stands; safe whatever the names hold."""

from __future__ import annotations

import json
import string
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.config.load import Config
from monitor.config.outputs import SmtpSection
from monitor.records.events import LoggedEvent
from monitor.service.notify.channels import SmtpChannel
from monitor.service.notify.message import MessageItem, MessageSender, clean, compose
from monitor.words.events import badness, event_text, local_moment
from monitor.words.statuses import fault_words
from streams.types.block import STANDARD_GRAVITY
from tests.support.receivers import Mail

UTC = 1795269845.0  # 2026-11-21 14:04:05 UTC
ROME = MessageSender("press", "Europe/Rome", "http://127.0.0.1:8710/", {"horizontal": "drive"})
ALARM = {
    "kind": "alarm_raised",
    "channel": "horizontal",
    "block": 1234,
    "rule": "rms",
    "feature": "rms",
    "severity": "danger",
    "value_si": 3.2149 * STANDARD_GRAVITY,
    "level_si": 3.0 * STANDARD_GRAVITY,
}
VALUES = {
    "absolute_level": "yes",
    "stage": "final",
    "t_fs": UTC - 86400.0,
    "t_fs_block": 900,
    "fault": "inner|ball",
    "rms": 3.2149 * STANDARD_GRAVITY,
    "v_eq": 1.234e-8,
    "v_eq_lower": 1.01e-8,
    "v_eq_upper": 1.51e-8,
    "v_th": (5e-8, 9e-8),
    "tt": (12.1 * 86400.0, 20.0 * 86400.0),
    "tt_lower": (8.0 * 86400.0, None),
    "tt_upper": (19.5 * 86400.0, None),
    "tt_status": ("ok", "ok"),
}


def alarm(change: str, **more: Any) -> dict[str, Any]:
    return {"kind": f"alarm_{change}", "severity": "alert", **more}


def item(body: dict[str, Any], values: dict[str, Any] | None = None, utc: float | None = UTC) -> MessageItem:
    return MessageItem(LoggedEvent("17", "acq", 1234, utc, body), values or {})


def test_an_alarm_says_all_that_somebody_on_the_way_wants_to_know() -> None:
    message = compose(ROME, [item(ALARM, VALUES)])
    assert message.title == "press: horizontal: danger: RMS is 3.21 g, above the level of 3 g"
    assert message.text.splitlines() == [
        "press: horizontal: danger: RMS is 3.21 g, above the level of 3 g",
        "",
        "State    danger, final stage of its life: inner race or rolling element of bearing drive",
        "How sure likely: named since the onset",
        "Level    the threshold of damage in 12 d 2 h (8 d to 19 d 12 h)",
        "To do    inspect bearing drive as soon as it can be reached, and exchange it within 8 d, the earliest that "
        "the threshold of damage may be reached",
        "What     danger: RMS is 3.21 g, above the level of 3 g",
        "Machine  press",
        "Channel  horizontal (source acq)",
        "Since    2026-11-21 15:04:05 CET (14:04:05 UTC), block 1234",
        "Stage    final stage since 2026-11-20 15:04:05 CET (14:04:05 UTC) (block 900)",
        "V_eq     0.0123 mm³/mm (0.0101 to 0.0151)",
        "TT       12 d 2 h (8 d to 19 d 12 h), until 0.05 mm³/mm",
        "Event    17",
        "Page     http://127.0.0.1:8710/",
    ]


@pytest.mark.parametrize(
    "status", [{"edv_status": "uncalibrated"}, {"edv_status": "widened", "tt_status": ("uncalibrated",)}]
)
def test_v_eq_of_an_uncalibrated_rig_is_sent_relative(status: dict[str, Any]) -> None:
    values = VALUES | {"v_eq_relative": 2.5} | status
    message = compose(ROME, [item(ALARM, values)])
    assert "V_eq     2.5 times the first tracked value (rig not calibrated)" in message.text
    (event,) = json.loads(message.to_json())["events"]
    assert event["state"]["v_eq_relative"] == pytest.approx(2.5)
    calibrated = compose(ROME, [item(ALARM, VALUES | {"v_eq_relative": 2.5, "edv_status": "ok", "tt_status": ("ok",)})])
    assert "V_eq     0.0123 mm³/mm" in calibrated.text


def test_a_name_without_an_onset_is_told_as_a_hint() -> None:
    told = [compose(ROME, [item(ALARM, VALUES | {"fault_basis": basis})]) for basis in ("hint", "verdict")]
    part = f"a pattern of the {fault_words(VALUES['fault'])} of bearing drive (hint)"
    assert [part in message.text for message in told] == [True, False]
    assert ["only a hint" in message.values["sureness"] for message in told] == [True, False]
    assert json.loads(told[0].to_json())["events"][0]["state"]["fault_basis"] == "hint"


def test_programs_get_the_same_with_units_in_the_keys() -> None:
    found = json.loads(compose(ROME, [item(ALARM, VALUES)]).to_json())
    assert (found["machine"], found["page"], found["left_out"]) == ("press", ROME.page, 0)
    event = found["events"][0]
    assert ALARM.items() <= event.items()
    assert (event["id"], event["source"], event["time_utc"]) == ("17", "acq", "2026-11-21T14:04:05.000Z")
    state = event["state"]
    assert (state["stage"], state["fault"], state["t_fs_block"], state["unit"]) == ("final", "inner|ball", 900, "g")
    assert state["rms_g"] == pytest.approx(3.2149)
    assert state["v_eq_mm2"] == pytest.approx(0.01234)
    assert (state["tt_s"], state["tt_lower_s"]) == (12.1 * 86400.0, 8.0 * 86400.0)


@pytest.mark.parametrize(
    ("body", "text"),
    [
        (
            alarm("raised", rule="soon", feature="tt_lower", value_si=3.6e5, level_si=6e5),
            "alert: lower end of the time to threshold is 4 d 4 h, below the level of 6 d 23 h (rule soon)",
        ),
        (
            alarm("cleared", rule="v_eq", feature="v_eq", value_si=1e-8, level_si=2e-8),
            "alert over: damaged volume V_eq is 0.01 mm³/mm again, the level is 0.02 mm³/mm",
        ),
        ({"kind": "condition", "from": "normal", "to": "bad_data"}, "status bad data (before: normal)"),
        ({"kind": "final_stage", "block": 9, "t_fs_block": 7}, "the final stage of its life has begun, with block 7"),
        ({"kind": "final_stage", "block": 9, "t_fs_block": 9}, "the final stage of its life has begun"),
        ({"kind": "end_of_life", "block": 9}, "the end of its life is reached"),
        ({"kind": "no_data", "source": "s", "text": "no block for 61 s"}, "no data: no block for 61 s"),
        ({"kind": "of_tomorrow", "channel": "x", "n": 3, "list": [1]}, "of tomorrow: n 3, list [1]"),
        ({"kind": "alarm_raised", "feature": "rms"}, "alarm: RMS is None, above the level of None"),
        ({}, "event"),
    ],
)
def test_every_kind_has_a_sentence(body: dict[str, Any], text: str) -> None:
    assert event_text(body) == text


def test_an_unknown_unit_is_not_called_g() -> None:
    message = compose(ROME, [item(ALARM, {"absolute_level": "no", "rms": 5.0})])
    assert "31.5 (unit of the sensor)" in message.title
    state = message.values["events"][0]["state"]
    assert (state["rms_g"], state["unit"]) == (5.0, "unknown")


def test_without_a_date_the_block_says_when() -> None:
    values = {"stage": "end_of_life", "t_fs": 7200.0, "t_fs_block": 4}
    message = compose(MessageSender("press"), [item({"kind": "end_of_life", "channel": "x"}, values, None)])
    assert "Since    block 1234\n" in message.text
    found = MessageItem(LoggedEvent("17", "acq", 1234, None, ALARM), found=UTC)
    text = compose(ROME, [found, found]).text
    assert "Since    found 2026-11-21 15:04:05 CET (14:04:05 UTC), block 1234\n" in text
    assert "- found 2026-11-21 15:04:05 CET (14:04:05 UTC), horizontal, danger" in text
    assert "Stage    end of life, final since 2 h after the first block (block 4)" in message.text
    assert "Page" not in message.text
    assert message.values["events"][0]["time_utc"] is None


def test_a_notice_has_no_block_and_no_channel() -> None:
    body = {"kind": "no_data", "source": "acq", "text": "no block from source acq for 61 s"}
    message = compose(ROME, [MessageItem(LoggedEvent("n3", None, None, UTC, body))])
    assert message.title == "press: acq: no data: no block from source acq for 61 s"
    assert "Source   acq" in message.text
    assert "Channel" not in message.text


def test_of_many_the_worst_is_in_the_title_and_all_are_listed() -> None:
    cleared = {**ALARM, "kind": "alarm_cleared"}
    events = [item(cleared), item({"kind": "end_of_life", "channel": "x"}), item(ALARM)]
    message = compose(ROME, events, left_out=4)
    assert message.title == "press: 7 events, worst: x: the end of its life is reached"
    lines = message.text.splitlines()
    assert [line for line in lines if line.startswith("- ")] == [
        "- 2026-11-21 15:04:05 CET (14:04:05 UTC), horizontal, danger over: RMS is 3.21 g again, the level is 3 g",
        "- 2026-11-21 15:04:05 CET (14:04:05 UTC), x, the end of its life is reached",
        "- 2026-11-21 15:04:05 CET (14:04:05 UTC), horizontal, danger: RMS is 3.21 g, above the level of 3 g",
        "- and 4 events not listed here; the event log has them all",
    ]


def test_the_worst_comes_first() -> None:
    bodies: list[dict[str, Any]] = [
        {"kind": "end_of_life"},
        {"kind": "alarm_raised", "severity": "danger"},
        {"kind": "final_stage"},
        {"kind": "store_salvaged"},
        {"kind": "alarm_raised", "severity": "alert"},
        {"kind": "no_data"},
        {"kind": "condition", "to": "bad_data"},
        {"kind": "alarm_cleared", "severity": "danger"},
    ]
    ranks = [badness(body) for body in bodies]
    assert ranks == sorted(ranks, reverse=True)
    assert len(set(ranks)) == len(ranks)
    assert badness({"kind": "condition", "to": "normal"}) == badness({"kind": "data_again"}) == 0
    assert badness({"kind": "of_tomorrow"}) > 0


def test_moments_are_in_the_time_of_the_machine_and_in_utc() -> None:
    assert local_moment(UTC) == "2026-11-21 14:04:05 UTC"
    assert local_moment(UTC, "Asia/Tokyo") == "2026-11-21 23:04:05 JST (14:04:05 UTC)"
    assert local_moment(UTC + 36000.0, "Europe/Rome") == "2026-11-22 01:04:05 CET (00:04:05 UTC)"
    assert local_moment(UTC + 34000.0, "Europe/Rome") == "2026-11-22 00:30:45 CET (2026-11-21 23:30:45 UTC)"
    # The hour that comes twice is told apart by the name of the zone.
    assert local_moment(1792886400.0, "Europe/Rome") == "2026-10-25 02:00:00 CEST (00:00:00 UTC)"
    assert local_moment(1792890000.0, "Europe/Rome") == "2026-10-25 02:00:00 CET (01:00:00 UTC)"
    assert local_moment(None) is None
    assert local_moment(1e300) is None


BODY = ("Content-Type", "MIME-Version")
NASTY = (
    "press\r\nBcc: all@plant.example",
    "<script>alert(1)</script>",
    "a\x00b\x1b[31mc\u2028d\u202ee",
    "\ud800",
    '"quoted", <a@b>',
    "é" * 400,
)


@pytest.mark.parametrize("name", NASTY)
def test_no_name_becomes_a_header_or_a_command(name: str) -> None:
    body = {**ALARM, "channel": name, "rule": name}
    other = {"kind": name, "channel": name, "text": name}
    message = compose(MessageSender(name, page="http://127.0.0.1:8710/"), [item(body), item(other)], left_out=1)
    assert len(message.title) <= 180
    assert clean(message.title) == message.title
    with Mail().serving() as server:
        section = SmtpSection(
            host="127.0.0.1", port=server.port, security="none", sender="a@plant.example", to=("b@plant.example",)
        )
        SmtpChannel(section).send(message)
    mail = server.received[0]
    assert sorted(mail.keys()) == sorted(["Subject", "From", "To", "Date", "Message-ID", "Auto-Submitted", *BODY])
    assert mail.get_content_type() == "multipart/alternative"
    assert len(server.recipients) == 1
    assert mail["Subject"] == message.title


@given(text=st.text(st.characters(codec=None), max_size=60))
def test_a_cleaned_text_is_one_printable_line(text: str) -> None:
    found = clean(text)
    assert found == " ".join(found.split())
    assert all(mark.isprintable() for mark in found)
    if set(text) <= set(string.ascii_letters):
        assert found == text


@given(
    body=st.dictionaries(
        st.sampled_from(["kind", "channel", "feature", "rule", "severity", "from", "to", "text", "value_si", "other"]),
        st.one_of(st.text(max_size=20), st.none(), st.integers(), st.lists(st.integers(), max_size=3)),
    ),
    utc=st.one_of(st.none(), st.floats(allow_nan=False, allow_infinity=False)),
)
def test_whatever_a_log_holds_becomes_a_message(body: dict[str, Any], utc: float | None) -> None:
    if body.get("value_si") is not None:
        body["value_si"] = body["level_si"] = 1.0 if not isinstance(body["value_si"], int) else float(body["value_si"])
    message = compose(ROME, [item(body, utc=utc)])
    assert clean(message.title) == message.title
    json.loads(message.to_json())


CONFIG: dict[str, Any] = {
    "machine": {"name": "press", "timezone": "Europe/Rome"},
    "bearing": [{"name": "b", "designation": "1205 ETN9"}],
    "source": [{"name": "s"}],
    "channel": [{"name": "x", "source": "s", "unit": "g", "bearing": "b"}],
}


def test_the_page_is_named_where_it_can_be_known() -> None:
    def page(web: dict[str, Any], **notify: Any) -> str | None:
        return MessageSender.of_config(Config.model_validate({**CONFIG, "web": web, "notify": notify})).page

    assert page({}) == "http://127.0.0.1:8710/"
    assert page({"host": "::1", "port": 81, "cert_file": "c", "key_file": "k"}) == "https://[::1]:81/"
    assert page({"port": 0}) is None
    assert page({"enabled": False}) is None
    assert page({"enabled": False}, page_url="https://press.plant.example/") == "https://press.plant.example/"


def test_who_is_told_is_no_part_of_what_records_are_made_under() -> None:
    plain = Config.model_validate(CONFIG)
    mqtt = {"mqtt": {"url": "mqtt://broker/t"}}
    told = Config.model_validate({**CONFIG, "notify": mqtt, "publish": mqtt, "web": {"port": 1}})
    other = Config.model_validate({**CONFIG, "detect": {"learn_blocks": 11}})
    assert plain.hash == told.hash != other.hash


def test_programs_get_what_people_read() -> None:
    verdict = {"fault": "inner|ball", "fault_basis": "verdict", "support": 0.9, "channels": ["horizontal", "vertical"]}
    values = VALUES | {"fault_basis": "verdict", "speed_unverified": "no", "rms_baseline": STANDARD_GRAVITY}
    told = json.loads(compose(ROME, [replace(item(ALARM, values), bearing=verdict)]).to_json())
    assert told["headline"] == "danger, final stage of its life: inner race or rolling element of bearing drive"
    assert told["sureness"].startswith("sure: ")
    assert told["level"].startswith("level 3.2 times the baseline")
    assert told["action"].startswith("inspect bearing drive as soon as it can be reached")
    assert all(told["events"][0][key] == told[key] for key in ("headline", "sureness", "level", "action"))
    # A verdict of the present on another part does not vouch for this one.
    other = compose(ROME, [replace(item(ALARM, values), bearing=verdict | {"fault": "outer"})])
    assert other.values["headline"] == told["headline"]
    assert other.values["sureness"].startswith("likely: ")


def test_a_silent_source_is_told_with_what_to_do() -> None:
    told = compose(ROME, [item({"kind": "no_data", "source": "acq", "text": "no block for 90 s"})])
    assert "State    no data: no block for 90 s" in told.text
    assert "To do    check the logger and its connection: no data come from channel acq" in told.text
    own = replace(ROME, advice=dict(ROME.advice) | {"no_data": "call the electrician"})
    assert "To do    call the electrician" in compose(own, [item({"kind": "no_data", "source": "acq"})]).text
    nothing = compose(ROME, [item({"kind": "disk_low", "text": "x"})])
    assert "To do" not in nothing.text
    assert "action" not in nothing.values
