"""``/metrics`` for Prometheus: machines, daemons and the page itself."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping
from datetime import datetime
from typing import Any

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Histogram,
    ProcessCollector,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily
from prometheus_client.metrics_core import Metric

from models.platform.portable import process_memory, processor_time
from monitor import __version__
from monitor.health.alarms import SEVERITIES
from monitor.health.onset import STAGES
from monitor.records.database import StoreError
from monitor.records.reader import NAMES
from monitor.web.answers import VIEWS
from monitor.web.event_view import unacknowledged
from monitor.web.machines import Machines
from monitor.words.features import FEATURES, Feature
from monitor.words.statuses import STATES

METRICS_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_SUFFIXES = {
    "m s-1": "meters_per_second",
    "m2": "square_meters",
    "s": "seconds",
    "Hz": "hertz",
    "N": "newtons",
    "1": "ratio",
}
_ACCELERATION = {True: "meters_per_second_squared", False: "sensor_units"}
_CHANNEL = ("machine", "channel")
_ADDRESSES = (
    (re.compile(r"^/static/.*"), "/static"),
    (re.compile(r"^/records/.*"), "/records"),
    (re.compile(rf"^/api/(machines|channels)/[^/]+/[^/]+/({'|'.join(VIEWS)})$"), r"/api/channels/\2"),
    (re.compile(r"^/api/(channels/[^/]+|machines/[^/]+/channels)/[^/]+$"), "/api/channels"),
    (re.compile(r"^/api/machines/[^/]+/blocks$"), "/api/blocks"),
    (re.compile(r"^/api/machines/[^/]+/levels$"), "/api/levels"),
    (re.compile(r"^/api/events/.*"), "/api/events/acknowledge"),
)
_PLAIN = (
    *("/", "/login", "/logout", "/healthz", "/readyz", "/metrics", "/api/session", "/api/machines", "/api/events"),
    *("/api/records", "/api/stream"),
)


def address_of(path: str) -> str:
    """Return the kind of address of a path, one of a few."""
    for pattern, name in _ADDRESSES:
        if pattern.match(path):
            return pattern.sub(name, path)
    return path if path in _PLAIN else "other"


class Measures:
    """Number and duration of answered requests."""

    def __init__(self) -> None:
        """Begin at nothing."""
        disable_created_metrics()
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        self.listener: Callable[[], Mapping[str, Any]] | None = None
        """Gives the counts of the page's own connections, once it listens."""
        self._requests = Counter(
            "spallwatch_page_requests", "requests answered by the page", ("address", "status"), registry=self.registry
        )
        self._durations = Histogram(
            "spallwatch_page_request_duration_seconds",
            "time from a request to the end of its answer, without streams",
            ("address",),
            buckets=(0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0),
            registry=self.registry,
        )

    def answered(self, path: str, status: int, seconds: float) -> None:
        """Count an answer."""
        address = address_of(path)
        self._requests.labels(address, str(status)).inc()
        if address != "/api/stream":
            self._durations.labels(address).observe(seconds)


def metrics(site: Machines, measures: Measures, streams: int) -> bytes:
    """Return the text for Prometheus; ``streams`` is the number of open streams."""
    listening = GaugeMetricFamily("spallwatch_page_streams", "pages that are open on the stream of events")
    listening.add_metric((), streams)
    families = [listening, InfoMetricFamily("spallwatch_build", "version of the page", {"version": __version__})]
    for collect in (_daemons, _channels, _levels, _blocks):
        families += list(collect(site))
    families += _listeners(site, measures)
    return generate_latest(_Families(families)) + generate_latest(measures.registry)


class _Families(CollectorRegistry):
    """Metrics that were collected before."""

    def __init__(self, families: list[Metric]) -> None:
        super().__init__()
        self._made = families

    def collect(self) -> Iterator[Metric]:
        return iter(self._made)


def _gauges(names: Mapping[str, str], labels: tuple[str, ...]) -> dict[str, GaugeMetricFamily]:
    return {name: GaugeMetricFamily(f"spallwatch_{name}", text, labels=labels) for name, text in names.items()}


def _daemons(site: Machines) -> Iterator[Metric]:
    gauges = _gauges(
        {
            "up": "whether the daemon of the machine runs",
            "degraded": "whether the daemon runs, but something is wrong",
            "problems": "how many things are wrong",
            "status_age_seconds": "time since the daemon said how it stands",
            "unacknowledged_events": "events to be acknowledged",
            "last_backup_age_seconds": "time since the last verified backup",
            "daemon_start_time_seconds": "start of the daemon, UTC since 1970",
            "daemon_resident_memory_bytes": "resident memory of the daemon",
        },
        ("machine",),
    )
    state = GaugeMetricFamily("spallwatch_machine_state", "worst state of its channels", labels=("machine", "state"))
    problem = GaugeMetricFamily("spallwatch_problem", "what is wrong by now", labels=("machine", "what"))
    cpu = CounterMetricFamily("spallwatch_daemon_cpu_seconds", "processor time of the daemon", labels=("machine",))
    for machine in site:
        status = machine.status()
        values, running = status.values, status.values.get("running") is True
        label = (machine.name,)
        gauges["up"].add_metric(label, running)
        gauges["degraded"].add_metric(label, running and values.get("status") == "degraded")
        gauges["problems"].add_metric(label, len(values["problems"]))
        for what in values["problems"]:
            problem.add_metric((machine.name, what), 1)
        for name in STATES if values["channels"] else ():
            state.add_metric((machine.name, name), values.get("state") == name)
        for name, value in {
            "status_age_seconds": status.age,
            "unacknowledged_events": _or_none(lambda found=machine: unacknowledged(found)),
            "last_backup_age_seconds": _age(values["last_backup_utc"]),
            "daemon_start_time_seconds": _seconds(values.get("since_utc")) if running else None,
            "daemon_resident_memory_bytes": process_memory(values.get("pid")) if running else None,
        }.items():
            if value is not None:
                gauges[name].add_metric(label, value)
        used = processor_time(values.get("pid")) if running else None
        if used is not None:
            cpu.add_metric(label, used)
    return iter((*gauges.values(), state, problem, cpu))


def _channels(site: Machines) -> Iterator[Metric]:
    state = GaugeMetricFamily("spallwatch_channel_state", "how the channel stands", labels=(*_CHANNEL, "state"))
    stage = GaugeMetricFamily("spallwatch_channel_stage", "stage of its life", labels=(*_CHANNEL, "stage"))
    alarms = GaugeMetricFamily("spallwatch_channel_alarms", "alarms that stand", labels=(*_CHANNEL, "severity"))
    age = GaugeMetricFamily(
        "spallwatch_channel_last_block_age_seconds", "time since the latest block came", labels=_CHANNEL
    )
    stamp = GaugeMetricFamily(
        "spallwatch_channel_last_block_timestamp_seconds", "begin of the latest block, UTC since 1970", labels=_CHANNEL
    )
    for machine in site:
        status = machine.status()
        for name, channel in status.values["channels"].items():
            label = (machine.name, name)
            for word in STATES:
                state.add_metric((*label, word), channel["state"] == word)
            for word in STAGES:
                stage.add_metric((*label, word), channel["stage"] == word)
            raised = [alarm["severity"] for alarm in channel.get("alarms", ())]
            for severity in SEVERITIES:
                alarms.add_metric((*label, severity), raised.count(severity))
            if channel["last_block_age_s"] is not None:
                age.add_metric(label, channel["last_block_age_s"] + (status.age or 0.0))
            moment = _seconds(channel["last_block_utc"])
            if moment is not None:
                stamp.add_metric(label, moment)
    return iter((state, stage, alarms, age, stamp))


def _levels(site: Machines) -> Iterator[Metric]:
    families = {
        (feature.name, absolute): GaugeMetricFamily(
            f"spallwatch_channel_{feature.name}_{_suffix(feature, absolute)}", feature.long_name, labels=_CHANNEL
        )
        for feature in (FEATURES[name] for name in NAMES)
        for absolute in ((True, False) if feature.acceleration else (True,))
    }
    for machine in site:
        sources: dict[str, list[str]] = {}
        for channel in machine.channels.values():
            sources.setdefault(channel.source, []).append(channel.name)
        found = _or_none(lambda by=sources, of=machine: of.latest.of(by)) or {}
        for by_channel in found.values():
            for channel, numbers in by_channel.items():
                for name, value in numbers.items():
                    absolute = machine.absolute(channel) or not FEATURES[name].acceleration
                    families[name, absolute].add_metric((machine.name, channel), value)
    return iter(families.values())


def _suffix(feature: Feature, absolute: bool) -> str:
    """Return the unit in the name of a metric: SI, or the sensor's own where that is not known."""
    return _ACCELERATION[absolute] if feature.acceleration else _SUFFIXES[feature.units or "1"]


def _blocks(site: Machines) -> Iterator[Metric]:
    counted = CounterMetricFamily("spallwatch_blocks", "blocks in the ledger", labels=("machine", "source", "status"))
    gauges = _gauges(
        {
            "source_pending_blocks": "blocks, files or messages that wait",
            "source_oldest_pending_age_seconds": "how long the oldest of them has waited",
        },
        ("machine", "source"),
    )
    for machine in site:
        # A count that is not complete yet would be taken for a restart.
        for (source, status), number in sorted(machine.tally.by_source().items()) if machine.tally.complete else ():
            counted.add_metric((machine.name, source, status), number)
        for source, backlog in machine.status().values.get("sources", {}).items():
            label = (machine.name, source)
            gauges["source_pending_blocks"].add_metric(label, backlog["pending"])
            gauges["source_oldest_pending_age_seconds"].add_metric(label, backlog["oldest_age_s"] or 0.0)
    return iter((counted, *gauges.values()))


def _listeners(site: Machines, measures: Measures) -> Iterator[Metric]:
    """Yield the counts of the page's own connections, and those that the daemons state of theirs."""
    labels = ("machine", "listener")
    opened = GaugeMetricFamily("spallwatch_listener_connections", "open connections", labels=labels)
    taken = CounterMetricFamily("spallwatch_listener_accepted", "connections that were accepted", labels=labels)
    received = CounterMetricFamily("spallwatch_listener_received_bytes", "bytes received", labels=labels)
    refused = CounterMetricFamily(
        "spallwatch_listener_refused", "connections refused or ended", labels=(*labels, "cause")
    )
    found = {} if measures.listener is None else {("", "page"): measures.listener()}
    for machine in site:
        stated = machine.status().values.get("listeners", {})
        found |= {(machine.name, listener): counts for listener, counts in stated.items()}
    for label, counts in found.items():
        opened.add_metric(label, counts["connections"])
        taken.add_metric(label, counts["accepted"])
        received.add_metric(label, counts["received_bytes"])
        for cause, number in counts["refused"].items():
            refused.add_metric((*label, cause), number)
    return iter((opened, taken, received, refused))


def _or_none(make: Callable[[], Any]) -> Any:
    """Return a value of a store, None where it cannot be read, so that the other metrics remain."""
    try:
        return make()
    except StoreError:
        return None


def _seconds(utc: str | None) -> float | None:
    return None if utc is None else datetime.fromisoformat(utc).timestamp()


def _age(utc: str | None) -> float | None:
    moment = _seconds(utc)
    return None if moment is None else max(0.0, time.time() - moment)
