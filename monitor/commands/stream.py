"""``spallwatch stream reset``: let a stream count its frames anew."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import click

from monitor.commands import option
from monitor.commands.common import InputError, emit, find_source, publish_change, read_config
from monitor.config.load import Config


@click.group("stream")
def group() -> None:
    """Streams over TCP or MQTT."""


@group.command("reset")
@click.argument("source")
@click.option("--first", type=click.IntRange(1, 2**63 - 1), default=1, help="Number of the next frame of the sender.")
@option.config
@option.output
def reset(source: str, first: int, config_path: Path | None, as_json: bool, quiet: bool) -> None:
    """Let the stream of SOURCE begin anew, such as after its logger was replaced; the daemon must be stopped.

    The records and the ledger of before are kept, and the numbers of blocks go on. A running daemon holds frames and
    connections that count as before, so it is refused; with the next start each sender asks where to continue.
    """
    config = read_config(config_path)
    _check(config, source)
    from monitor.records.events import EventLog
    from monitor.records.ledger import StoreLedger
    from monitor.records.store import Store
    from streams.types.source import StreamCount

    values: dict[str, Any] = {}
    with (
        Store.open(config.machine.state_dir / "state.db", machine=config.machine.name, create=False) as store,
        StoreLedger(store) as ledger,
        EventLog(store.path),
    ):
        before = ledger.stream(source)

        def notice_of(count: StreamCount) -> dict[str, Any]:
            last = before.frame_of(before.last)
            text = (
                f"the stream of source {source} begins anew after frame {last}: frame {first} is block {count.number}"
            )
            values.update(source=source, last=last, first=first, block=count.number, resets=count.resets)
            return {"kind": "stream_reset", **values, "text": text}

        ledger.reset_stream(source, first, time.time(), notice_of)
        publish_change(store, config.machine.records_dir)
    lines = [
        f"the stream of {source} begins anew: its next frame has number {first} and becomes block {values['block']}; "
        f"the last was frame {values['last']}"
    ]
    emit(values, [] if quiet else lines, as_json=as_json)


def _check(config: Config, source: str) -> None:
    """Raise InputError where there is no such stream, or its daemon runs."""
    from monitor.service.system import read_status

    section = find_source(config, source)
    if not (section.url or "").startswith(("tcp://", "mqtt://")):
        raise InputError(f"[[source]] {source}: url {section.url!r} is not a stream; expected tcp:// or mqtt://")
    if read_status(config.machine.state_dir)["running"]:
        raise InputError(f"the daemon of machine {config.machine.name} runs; stop it, reset the stream, start it again")
