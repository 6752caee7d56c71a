"""Open sources by their URLs; each kind is imported only when a URL names it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack

from streams.dating import Dating
from streams.source import Ledger, LiveSource, Source
from streams.spec import SourceError, SourceSpec, parse_address


def open_source(spec: SourceSpec, kept: Dating | None = None) -> Source:
    """Open the recording or rig of a URL; it can be iterated over repeatedly.

    ``kept`` is what dates its files, where that was chosen before.

    Raises:
        SourceError: the path does not exist, nothing there is recognised, or rate or unit is stated by neither the
            recording, its data set nor the configuration.
    """
    # Imported here, because the parsers load pandas and the rig the bearing model: open_live needs neither.
    from streams.recording import open_recording

    scheme, colon, rest = spec.url.partition(":")
    if scheme == "rig" and colon:
        from streams.rig import open_rig

        return open_rig(spec.url, spec.name)
    if "://" in spec.url:
        raise SourceError(
            f"[[source]] {spec.name}: url {spec.url!r}: {scheme}:// is not a kind of source this version reads; "
            "expected dataset:NAME:PATH, folder:PATH, rig:NAME?seed=N or a path"
        )
    if scheme == "dataset" and colon:
        data_set, second, path = rest.partition(":")
        if not (data_set and second and path):
            raise SourceError(f"[[source]] {spec.name}: url {spec.url!r}: expected dataset:NAME:PATH")
        return open_recording(spec, path, data_set, kept=kept)
    if scheme == "folder" and colon:
        return open_recording(spec, rest, spec.format, must_be_folder=True, kept=kept)
    return open_recording(spec, spec.url, spec.format, kept=kept)


def open_live(specs: Sequence[SourceSpec], ledger: Ledger) -> list[LiveSource]:
    """Open live sources after the last committed block of a ledger.

    URLs are ``folder:PATH``, ``tcp://HOST:PORT`` or ``mqtt://HOST:PORT/TOPIC``. Sources at one address are opened as
    one; their blocks bear their names. The caller closes the sources.

    Raises:
        SourceError: another URL, an address that cannot be listened to, a path that is not a folder.
    """
    with ExitStack() as opened:
        sources = [opened.enter_context(source) for source in _live(specs)]
        for source in sources:
            source.open(ledger)
        opened.pop_all()
    return sources


def _live(specs: Sequence[SourceSpec]) -> Iterator[LiveSource]:
    at_address: dict[tuple[str, str, int], list[SourceSpec]] = {}
    for spec in specs:
        scheme, _, rest = spec.url.partition(":")
        if scheme == "folder" and rest:
            from streams.folder.source import FolderSource

            yield FolderSource(spec, rest)
        elif scheme in ("tcp", "mqtt"):
            place = parse_address(spec.url, f"[[source]] {spec.name}: url")
            at_address.setdefault((place.scheme, place.host, place.port), []).append(spec)
        else:
            raise SourceError(
                f"[[source]] {spec.name}: url {spec.url!r}: is not a source that goes on for ever; expected "
                "folder:PATH, tcp://HOST:PORT or mqtt://HOST:PORT/TOPIC"
            )
    for (scheme, _, _), group in at_address.items():
        if scheme == "tcp":
            from streams.link.tcp import TcpReceiver

            yield TcpReceiver(group)
        else:
            from streams.link.mqtt import MqttReceiver

            yield MqttReceiver(group)
