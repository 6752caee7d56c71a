"""``spallwatch send`` and ``stream``: a recording to a receiver over TCP or MQTT, and its streams."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from monitor.commands import option
from monitor.commands.common import InputError, find_source, progress_bar, publish_change, read_config
from monitor.config.load import Config

if TYPE_CHECKING:
    from streams.types.source import Source

_FILE = option.Place(path_type=Path, dir_okay=False, exists=True)


class _Seconds(click.ParamType):
    """A positive number of seconds, or "file"."""

    name = "SECONDS|file"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        try:
            return value if value == "file" else float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of seconds nor file", param, ctx)


@click.command("send")
@click.argument("path", type=option.PLACE)
@click.option("--to", "url", required=True, help="tcp://HOST:PORT or mqtt://HOST[:PORT]/TOPIC.")
@click.option(
    "--stream", help="Stream id: the name of the [[source]] of a TCP receiver. Default: the name of the recording."
)
@option.config
@click.option("--format", "kind", default="auto", help="Without --config: format or data set.")
@click.option("--rate-hz", type=option.POSITIVE, help="Without --config: sampling rate.")
@click.option("--block-s", type=_Seconds(), default=5.0, help="Without --config: block length.")
@click.option("--pulses", help="Without --config: times of pulses, an array or {stem}.pulses.csv.")
@click.option("--pace", type=option.POSITIVE, help="Multiple of real time. Default: as fast as possible.")
@click.option("--limit", type=click.IntRange(min=1), help="Number of the last block to send.")
@click.option("--patience-s", type=option.NOT_NEGATIVE, default=300.0, help="Give up after this time without progress.")
@click.option("--username-file", type=_FILE, help="User name for the broker: the first line of this file.")
@click.option("--password-file", type=_FILE, help="Password for the broker: the first line of this file.")
@click.option("--ca-file", type=_FILE, help="Certificates (PEM) that sign the broker's; enables TLS.")
@click.option("--cert-file", type=_FILE, help="Certificate of this machine (PEM).")
@click.option("--key-file", type=_FILE, help="Its private key (PEM).")
@click.option("--stream-key-file", type=_FILE, help="TCP: key of the stream, the first line of this file.")
@click.option("--tls-ca-file", type=_FILE, help="TCP: certificates (PEM) that sign the receiver's; enables TLS.")
@option.output
def command(
    path: str,
    url: str,
    stream: str | None,
    config_path: Path | None,
    kind: str,
    rate_hz: float | None,
    block_s: float,
    pulses: str | None,
    pace: float | None,
    limit: int | None,
    patience_s: float,
    stream_key_file: Path | None,
    tls_ca_file: Path | None,
    quiet: bool,
    **files: Any,
) -> option.Result:
    """Send a recording: PATH is a file, a folder, an archive or a source URL, as for replay.

    The command ends when the receiver has committed all blocks. If the receiver is unreachable or restarts, sending is
    retried from the block after its last committed one.
    """
    from streams.link.peer import read_key, sender_context
    from streams.link.sender import Link, Sender, TcpLink
    from streams.link.wire import WireError
    from streams.types.spec import NetworkSpec, parse_address

    address = parse_address(url, "--to")
    source = _recording(path, config_path, kind, rate_hz, block_s, pulses)
    name = stream or source.name
    _check_files(address.scheme, {**files, "stream_key_file": stream_key_file, "tls_ca_file": tls_ca_file})
    link: Link
    if address.scheme == "mqtt":
        from streams.link.mqtt import MqttLink

        link = MqttLink(address, NetworkSpec(**files))
    else:
        key = None if stream_key_file is None else read_key(stream_key_file, "--stream-key-file")
        tls = None if tls_ca_file is None else sender_context(tls_ca_file, "--tls-ca-file")
        try:
            link = TcpLink(address, name, key=key, tls=tls)
        except WireError as error:
            raise InputError(f"--stream {name!r}: {error}") from None
    total = len(source) if limit is None else min(len(source), limit)
    advance = _bar(total, quiet)
    result = Sender(source, link, pace=pace, limit=limit, patience=patience_s, progress=advance).run()
    values = {**asdict(result), "stream": address.topic or name}
    return values, _lines(values)


def _check_files(scheme: str, files: dict[str, Path | None]) -> None:
    """Refuse options of the other protocol: what they should protect would be sent without it."""
    of_tcp = ("stream_key_file", "tls_ca_file")
    for name, path in files.items():
        if path is not None and (name in of_tcp) != (scheme == "tcp"):
            other = "tcp" if name in of_tcp else "mqtt"
            raise InputError(f"--{name.replace('_', '-')} belongs to {other}://, --to is {scheme}://")


def _recording(
    path: str, config_path: Path | None, kind: str, rate: float | None, block_s: Any, pulses: str | None
) -> Source:
    from streams.open import open_source
    from streams.types.spec import SourceSpec

    if config_path is None:
        stem = re.sub(r"[^A-Za-z0-9_.-]", "-", Path(path).name)[:64] or "recording"
        return open_source(SourceSpec(stem, path, format=kind, rate=rate, block_s=block_s, pulses=pulses))
    from monitor.service.setup import only_source, open_configured

    config = read_config(config_path)
    return open_configured(config, only_source(config, "send"), path)


def _bar(total: int, quiet: bool) -> Any:
    """Return a callback that moves a progress bar to the last committed block."""
    steps = iter(progress_bar("send", quiet=quiet)(range(total), total))
    done = 0

    def advance(committed: int) -> None:
        nonlocal done
        while done < committed:
            done += 1
            next(steps, None)

    return advance


def _lines(values: dict[str, Any]) -> Iterator[str]:
    yield (
        f"{values['sent']} blocks sent to {values['stream']}, committed up to block {values['acknowledged']}"
        + (f"; {values['skipped']} had been committed before" if values["skipped"] else "")
        + (f"; {values['rejected']} could not be read" if values["rejected"] else "")
        + (f"; {values['reconnects']} reconnections" if values["reconnects"] else "")
    )


@click.group("stream")
def group() -> None:
    """Streams over TCP or MQTT."""


@group.command("reset")
@click.argument("source")
@click.option("--first", type=click.IntRange(1, 2**63 - 1), default=1, help="Number of the next frame of the sender.")
@option.config
@option.output
def reset(source: str, first: int, config_path: Path | None, quiet: bool) -> option.Result:
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
    return values, [] if quiet else lines


def _check(config: Config, source: str) -> None:
    """Raise InputError where there is no such stream, or its daemon runs."""
    from monitor.service.system import read_status

    section = find_source(config, source)
    if not (section.url or "").startswith(("tcp://", "mqtt://")):
        raise InputError(f"[[source]] {source}: url {section.url!r} is not a stream; expected tcp:// or mqtt://")
    if read_status(config.machine.state_dir)["running"]:
        raise InputError(f"the daemon of machine {config.machine.name} runs; stop it, reset the stream, start it again")
