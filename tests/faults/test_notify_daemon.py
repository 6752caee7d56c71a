"""The daemon as a process tells people and programs: killed before it could, and while the servers are away, too."""

from __future__ import annotations

import random
import time
from pathlib import Path
from typing import Any

import pytest

from monitor.records.events import EventLog
from monitor.records.store import Store
from tests.streams.folders import csv_bytes, noise
from tests.support.broker import Broker
from tests.support.daemons import free_port, make_machine, start, status
from tests.support.effort import effort_count
from tests.support.receivers import Certificate, Hook, Mail, make_certificate, subscribed
from tests.support.waiting import Running, stop, wait_until

pytestmark = pytest.mark.process

LEVEL = """
[[alarms.level]]
feature = "rms"
danger_g = 5.0
on_delay_blocks = 1
off_delay_blocks = 1
"""


PLAIN = "picture = false\n"


def put(config: Path, number: int, *, loud: bool) -> None:
    """Give the source a file of two blocks, of about 1 g or 10 g."""
    path = config.parent / "in0" / f"f{number:04d}.csv"
    path.with_suffix(".tmp").write_bytes(csv_bytes((10.0 if loud else 1.0) * noise(512, number)))
    path.with_suffix(".tmp").rename(path)


def mail_section(port: int, security: str = "none", more: str = "") -> str:
    return (
        f'[notify.smtp]\nhost = "127.0.0.1"\nport = {port}\nsecurity = "{security}"\n'
        f'sender = "watch@plant.example"\nto = ["maintenance@plant.example"]\n{more}'
    )


def machine(folder: Path, *sections: str) -> Path:
    """Make a machine with a level, who is told, and what else there is."""
    config = make_machine(folder)
    config.write_text(config.read_text() + "\n".join((LEVEL, *sections)))
    return config


def end(daemon: Running) -> str:
    said = stop(daemon)
    assert daemon.returncode == 0, said
    return said


def states(heard: list[tuple[str, Any, bool]]) -> list[tuple[str, str]]:
    """How the machine was said to stand over MQTT."""
    found = [body for topic, body, _ in heard if topic == "plant/records/m/state"]
    return [(body["status"], body["state"]) for body in found]


def committed_events(config: Path) -> list[tuple[str, str]]:
    """Number and kind of the events in the store, in order."""
    path = config.parent / "state" / "state.db"
    if not path.exists():
        return []
    with EventLog(path) as log:
        return [(event.id, event.body["kind"]) for _, event in log.events(limit=10**6)]


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Certificate:
    return make_certificate(tmp_path_factory.mktemp("certificates"))


@pytest.mark.broker
def test_an_alarm_is_told_by_mail_webhook_and_mqtt_and_records_are_published(
    tmp_path: Path, certificate: Certificate
) -> None:
    secrets = tmp_path / "secrets"
    secrets.mkdir()
    for name in ("user", "password", "token"):
        (secrets / name).write_text(f"the {name}\n")
    (secrets / "ca.pem").write_bytes(certificate.cert.read_bytes())
    with (
        Mail(certificate=certificate, login=("the user", "the password")).serving() as mail,
        Hook(certificate=certificate).serving() as hook,
        Broker(tmp_path / "broker") as broker,
        subscribed(broker.port, "plant/#") as heard,
    ):
        config = machine(
            tmp_path,
            '[notify]\npage_url = "https://bearings.plant.example/"\n',
            mail_section(
                mail.port,
                "starttls",
                'username_file = "secrets/user"\npassword_file = "secrets/password"\nca_file = "secrets/ca.pem"\n',
            ),
            f'[notify.webhook]\nurl = "https://127.0.0.1:{hook.port}/hook"\ntoken_file = "secrets/token"\n'
            'ca_file = "secrets/ca.pem"\n',
            f'[notify.mqtt]\nurl = "mqtt://127.0.0.1:{broker.port}/plant/alarms"\n',
            f'[publish.mqtt]\nurl = "mqtt://127.0.0.1:{broker.port}/plant/records"\n',
        )
        daemon = start(config)
        try:
            wait_until(lambda: status(config).get("status") == "running")
            put(config, 1, loud=False)
            put(config, 2, loud=True)
            wait_until(lambda: mail.received and hook.received)
            wait_until(lambda: [topic for topic, _, _ in heard].count("plant/records/m/s0/x0") == 4)
            wait_until(lambda: any(topic == "plant/alarms" for topic, _, _ in heard))
            wait_until(lambda: states(heard)[-1:] == [("running", "failure")])
            assert status(config)["problems"] == {}
        finally:
            said = end(daemon)
        wait_until(lambda: states(heard)[-1][0] == "stopped")
    body = mail.received[0].get_body(("plain",))
    assert body is not None
    text = body.get_content()
    (image,) = [part for part in mail.received[0].walk() if part.get_content_type() == "image/png"]
    assert image.get_content().startswith(b"\x89PNG\r\n")
    assert mail.received[0]["Subject"].startswith("m: x0: danger: RMS is ")
    assert "above the level of 5 g" in text
    assert "Channel  x0 (source s0)" in text
    assert "Stage    learning" in text
    assert "Page     https://bearings.plant.example/" in text
    _, authorization, body = hook.received[0]
    assert authorization == "Bearer the token"
    event = body["events"][0]
    assert (event["kind"], event["channel"], event["block"], event["id"]) == ("alarm_raised", "x0", 3, "1")
    assert 9.0 < event["state"]["rms_g"] < 11.0
    alarms = [body for topic, body, _ in heard if topic == "plant/alarms"]
    assert alarms[0]["events"][0]["id"] == "1"
    records = [body for topic, body, _ in heard if topic == "plant/records/m/s0/x0"]
    assert [record["block"] for record in records] == [1, 2, 3, 4]
    assert records[2]["rms_g"] == pytest.approx(event["state"]["rms_g"])
    assert states(heard)[-1] == ("stopped", "failure")
    for secret in ("the password", "the token"):
        assert secret not in said


def test_killed_between_commit_and_delivery_it_is_delivered_after_the_restart(tmp_path: Path) -> None:
    first, second = Mail(hang=True), Mail()
    with first.serving(), second.serving():
        config = machine(tmp_path, mail_section(first.port, more=PLAIN))
        daemon = start(config)
        wait_until(lambda: status(config).get("status") == "running")
        put(config, 1, loud=True)
        # The server has the whole message and has not said that it takes it.
        wait_until(first.hanging.is_set)
        daemon.kill()
        daemon.communicate()
        assert [kind for _, kind in committed_events(config)] == ["alarm_raised"]
        config.write_text(config.read_text().replace(f"port = {first.port}", f"port = {second.port}"))
        daemon = start(config)
        try:
            wait_until(lambda: second.received)
        finally:
            end(daemon)
        # Told once: another start has nothing to tell.
        daemon = start(config)
        wait_until(lambda: status(config).get("pid") == daemon.pid)
        put(config, 2, loud=False)
        wait_until(lambda: len(second.received) == 2)
        end(daemon)
    assert "danger: RMS" in second.received[0]["Subject"]
    assert "danger over" in second.received[1]["Subject"]


def test_a_server_that_is_away_for_a_while_is_a_problem_and_delays_nothing(tmp_path: Path) -> None:
    port = free_port()
    config = machine(tmp_path, mail_section(port, more=PLAIN))
    daemon = start(config)
    try:
        wait_until(lambda: status(config).get("status") == "running")
        put(config, 1, loud=True)
        wait_until(lambda: "notify.smtp" in status(config)["problems"])
        assert status(config)["status"] == "degraded"
        assert "refused" in status(config)["problems"]["notify.smtp"]
        put(config, 2, loud=False)
        wait_until(lambda: status(config)["blocks"] == 4)
        with Mail(port=port).serving() as mail:
            wait_until(lambda: mail.received)
            wait_until(lambda: status(config)["problems"] == {})
    finally:
        said = end(daemon)
    # What came meanwhile is in the same message, in order.
    body = mail.received[0].get_body(("plain",))
    assert body is not None
    lines = [line for line in body.get_content().splitlines() if line.startswith("- ")]
    assert len(lines) == 2
    assert "danger: RMS" in lines[0]
    assert "danger over: RMS" in lines[1]
    assert said.count("it is tried again") == 1


@pytest.mark.timeout(effort_count(quick=900, full=3600))
def test_killed_at_random_each_event_is_told_in_order(tmp_path: Path) -> None:
    generator = random.Random(20261121)
    number = 0
    with Hook().serving() as hook:
        config = machine(
            tmp_path, f'[notify]\nmost_per_hour = 3600\n[notify.webhook]\nurl = "http://127.0.0.1:{hook.port}/"\n'
        )
        for _ in range(effort_count(quick=2, full=40)):
            daemon = start(config, "--quiet")
            for _ in range(6):
                number += 1
                put(config, number, loud=bool(number % 2))
            time.sleep(generator.uniform(0.5, 3.0))
            daemon.kill()
            _, said = daemon.communicate()
            assert "Traceback" not in said
        daemon = start(config)
        wait_until(lambda: status(config).get("pid") == daemon.pid)
        wait_until(lambda: status(config)["sources"]["s0"]["accepted"] == number)
        wait_until(lambda: len(told(hook)) == len(committed_events(config)) == number)
        end(daemon)
    with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
        assert store.check() == []
    assert [kind for _, kind in committed_events(config)] == ["alarm_raised", "alarm_cleared"] * (number // 2)
    # In order, but for what is told once more because the kill came before it was noted.
    assert told(hook) == [name for name, _ in committed_events(config)]


def told(hook: Hook) -> list[str]:
    """The events that a webhook was told of, in the order in which it first heard of them."""
    names = [event["id"] for _, _, body in hook.received for event in body["events"]]
    return list(dict.fromkeys(names))
