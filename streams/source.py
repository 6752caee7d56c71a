"""The Source protocol, open_source for recordings and open_live for what goes on for ever."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Protocol, runtime_checkable

from streams.block import Block, Rejected
from streams.ledger import Ledger
from streams.live import LiveSource
from streams.spec import ChannelSpec, SourceError, SourceSpec

__all__ = [
    "ChannelSpec",
    "LiveSource",
    "Source",
    "SourceError",
    "SourceSpec",
    "open_live",
    "open_source",
]


@runtime_checkable
class Source(Protocol):
    """Gives blocks in the order of acquisition; a block that cannot be made comes as Rejected, in its place."""

    name: str

    def __iter__(self) -> Iterator[Block | Rejected]:
        """Iterate over the blocks from the first one on."""
        ...

    def __len__(self) -> int:
        """Return how many blocks the source holds in all (a recording)."""
        ...


def open_source(spec: SourceSpec) -> Source:
    """Open what a source's URL names.

    Args:
        spec: the configuration of the source.

    Returns:
        A source whose blocks can be iterated over any number of times.

    Raises:
        SourceError: the path does not exist, nothing there is recognised, or rate or unit is stated by neither the
            recording, its data set nor the configuration.
    """
    # Parsers load pandas; whoever needs the protocol only does not wait for them.
    from streams.recording import open_recording

    scheme, colon, rest = spec.url.partition(":")
    if scheme == "rig" and colon:
        # The rig stands on the bearing model; whoever reads recordings only does not wait for it.
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
        return open_recording(spec, path, data_set)
    if scheme == "folder" and colon:
        return open_recording(spec, rest, spec.format, must_be_folder=True)
    return open_recording(spec, spec.url, spec.format)


def open_live(specs: Sequence[SourceSpec], ledger: Ledger) -> list[LiveSource]:
    """Open sources that go on for ever, from what the ledger has on.

    Args:
        specs: the configuration of the sources; a URL is ``folder:PATH``, ``tcp://HOST:PORT`` or
            ``mqtt://HOST:PORT/TOPIC``. Sources at one address are opened as one; their blocks bear their names.
        ledger: what was committed.

    Returns:
        The sources, listening; whoever has them closes them.

    Raises:
        SourceError: another URL, an address that cannot be listened to, a folder that is none.
    """
    with ExitStack() as opened:
        sources = [opened.enter_context(source) for source in _live(specs)]
        for source in sources:
            source.open(ledger)
        opened.pop_all()
    return sources


def _live(specs: Sequence[SourceSpec]) -> Iterator[LiveSource]:
    # Each transport brings its own library; only the one that is named is loaded.
    at_address: dict[tuple[str, str, int], list[SourceSpec]] = {}
    for spec in specs:
        scheme, _, rest = spec.url.partition(":")
        if scheme == "folder" and rest:
            from streams.folder.source import FolderSource

            yield FolderSource(spec, rest)
        elif scheme in ("tcp", "mqtt"):
            from streams.link.network import parse_address

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
