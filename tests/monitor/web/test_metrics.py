"""What Prometheus, Grafana and health checks are told."""

from __future__ import annotations

import json
import math
import os
import re
import time
from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from monitor.records.store import Store
from monitor.service.system import StatusFile
from monitor.web.metrics import address_of
from monitor.words.statuses import STATES
from tests.support.daemon import running
from tests.support.daemons import ROOT, status
from tests.support.pages import Page, alarmed_machine, page_of, put_blocks
from tests.support.waiting import wait_until

pytestmark = pytest.mark.process

_SAMPLES = {"histogram": ("_bucket", "_count", "_sum")}


def families(page: Page) -> dict[str, str]:
    """Return type by name of everything that is served, the names as expressions have them."""
    text = page.ask("/metrics").body.decode()
    found = re.findall(r"^# TYPE (\S+) (\S+)$", text, re.MULTILINE)
    return {f"{name}{ending}": kind for name, kind in found for ending in _SAMPLES.get(kind, ("",))}


def samples(page: Page) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    reply = page.ask("/metrics")
    assert reply.headers["content-type"].startswith("text/plain; version=0.0.4")
    return {
        (sample.name, tuple(sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(reply.body.decode())
        for sample in family.samples
    }


def test_metrics_say_what_the_daemon_and_the_store_say(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path, sources=2)
    text = config.read_text()
    config.write_text(
        text.replace('source = "s1"\ncolumn = 1\nunit = "g"', 'source = "s1"\ncolumn = 1\nunit = "unknown"')
    )
    put_blocks(config, 1)
    put_blocks(config, 1, source=1)
    (tmp_path / "in0" / "f0009.csv").write_bytes(b"words\n" * 30)
    with running(config), page_of(config) as page:
        wait_until(lambda: status(config)["blocks"] == 5)
        blocks = [
            ("spallwatch_blocks_total", (("machine", "m"), ("source", source), ("status", word)))
            for source, word in (("s0", "ok"), ("s0", "unreadable"), ("s1", "ok"))
        ]
        # The page counts once a second.
        wait_until(lambda: [samples(page).get(name) for name in blocks] == [2, 1, 2])
        wait_until(lambda: status(config)["unacknowledged"] == 2)
        said, found = status(config), samples(page)
        with Store.open(tmp_path / "state" / "state.db", read_only=True) as store:
            absolute, raw = (
                next(record for record in reversed(list(store.records())) if name in record.channels).channels[name]
                for name in ("x0", "x1")
            )
    machine, channel = (("machine", "m"),), (("channel", "x0"), ("machine", "m"))
    assert found["spallwatch_up", machine] == 1
    assert found["spallwatch_degraded", machine] == (said["status"] == "degraded")
    assert found["spallwatch_unacknowledged_events", machine] == said["unacknowledged"]
    assert found["spallwatch_daemon_resident_memory_bytes", machine] > 1e7
    assert found["spallwatch_daemon_cpu_seconds_total", machine] > 0
    states = {state: found["spallwatch_channel_state", (*channel, ("state", state))] for state in STATES}
    assert [state for state, value in states.items() if value] == [said["channels"]["x0"]["state"]]
    assert found["spallwatch_channel_stage", (*channel, ("stage", "learning"))] == 1
    assert found["spallwatch_channel_alarms", (*channel, ("severity", "alert"))] == 1
    assert found["spallwatch_channel_alarms", (*channel, ("severity", "danger"))] == 0
    assert found["spallwatch_channel_rms_meters_per_second_squared", channel] == absolute["rms"]
    other = (("channel", "x1"), ("machine", "m"))
    assert found["spallwatch_channel_rms_sensor_units", other] == raw["rms"]
    assert ("spallwatch_channel_rms_meters_per_second_squared", other) not in found
    assert found["spallwatch_channel_speed_hertz", channel] == 40.0
    assert not any(math.isnan(value) for value in found.values())


def test_the_dashboard_asks_for_what_is_served_and_for_all_of_it(tmp_path: Path) -> None:
    dashboard = json.loads((ROOT / "deploy" / "grafana" / "spallwatch.json").read_text())
    expressions = [target["expr"] for panel in dashboard["panels"] for target in panel.get("targets", ())]
    expressions += [item["query"]["query"] for item in dashboard["templating"]["list"] if item["type"] == "query"]
    asked = {name for text in expressions for name in re.findall(r"\b(?:spallwatch|process)_\w+", text)}
    with page_of(alarmed_machine(tmp_path)) as page:
        served = families(page)
    assert asked <= set(served)
    unseen = {name for name in served if name.startswith("spallwatch_")} - asked
    assert unseen == {
        "spallwatch_channel_last_block_timestamp_seconds",
        "spallwatch_channel_stage",
        "spallwatch_daemon_start_time_seconds",
        "spallwatch_machine_state",
        "spallwatch_page_request_duration_seconds_count",
        "spallwatch_page_request_duration_seconds_sum",
        "spallwatch_problems",
    }
    assert len({panel["id"] for panel in dashboard["panels"]}) == len(dashboard["panels"])


def test_the_documentation_names_every_metric(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "reference" / "api.md").read_text()
    rows = [row for row in text.splitlines() if row.startswith("`spallwatch_")]
    documented = {name for row in rows for name in re.findall(r"`(spallwatch_\w+)`", row)}
    with page_of(alarmed_machine(tmp_path)) as page:
        served = {re.sub("_(bucket|count|sum)$", "", name) for name in families(page) if name.startswith("spallwatch")}
    assert documented == served


def test_metrics_follow_the_conventions_of_prometheus(tmp_path: Path) -> None:
    with page_of(alarmed_machine(tmp_path)) as page:
        for name, kind in families(page).items():
            assert re.fullmatch("[a-z_]+", name), name
            assert (kind == "counter") == name.endswith("_total"), name


@pytest.mark.parametrize(
    ("path", "address"),
    [
        ("/", "/"),
        ("/api/channels/a/b/records", "/api/channels/records"),
        ("/api/channels/a/b", "/api/channels"),
        ("/api/machines/a/channels/b", "/api/channels"),
        ("/api/machines/a/blocks", "/api/blocks"),
        ("/api/machines/a/levels", "/api/levels"),
        ("/api/channels/a/b/waveform", "/api/channels/waveform"),
        ("/api/events/m:1/acknowledge", "/api/events/acknowledge"),
        ("/static/vendor/x.js", "/static"),
        ("/records/m.nc", "/records"),
        ("/api/channels/a/b/whatever", "other"),
        ("/etc/passwd", "other"),
    ],
)
def test_addresses_are_counted_by_kind(path: str, address: str) -> None:
    assert address_of(path) == address


def test_health_follows_the_daemon(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path)
    with page_of(config) as page:

        def reasons() -> list[str]:
            reply = page.ask("/healthz")
            assert (reply.status, reply.json["status"]) == ((503, "failing") if reply.json["reasons"] else (200, "ok"))
            return reply.json["reasons"]

        assert reasons() == ["machine m: the daemon has never run"]
        with running(config):
            put_blocks(config, 1)
            wait_until(lambda: reasons() == [])
            assert page.ask("/readyz").status == 200
        wait_until(lambda: reasons() == ["machine m: the daemon was stopped"])
        assert page.ask("/readyz").status == 200


def test_health_fails_on_what_is_stale_silent_or_broken(tmp_path: Path) -> None:
    config = alarmed_machine(tmp_path)
    put_blocks(config, 1)
    with running(config):
        wait_until(lambda: status(config)["blocks"] == 2)
        said = status(config)
    # Whoever holds the lock is the daemon, and says what the test wants to hear.
    with StatusFile.open(tmp_path / "state") as daemon, page_of(config) as page:

        def reasons(stale: float = 0.0, **changes: object) -> list[str]:
            daemon.write(said | changes)
            os.utime(daemon.path, (time.time() - stale, time.time() - stale))
            time.sleep(0.25)
            return page.ask("/healthz").json["reasons"]

        assert reasons() == []
        assert reasons(stale=100.0) == ["machine m: the daemon is stalled: it has not renewed its status for 100 s"]
        silent = {"x0": said["channels"]["x0"] | {"state": "no_data", "reason": "no block for 700 s"}}
        assert reasons(channels=silent) == ["machine m: source s0: no block for 700 s"]
        problems = {"store": f"{tmp_path}/state/state.db: disk I/O error", "s0": "the folder is away"}
        assert reasons(problems=problems) == ["machine m: state.db: disk I/O error"]
        (tmp_path / "state" / "state.db").rename(tmp_path / "aside")
        (found,) = reasons()
        assert found.startswith("machine m: the store cannot be read: state.db: ")
