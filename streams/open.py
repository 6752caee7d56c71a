"""Open sources by their URLs; each kind is imported only when a URL names it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from models.work.redact import redact
from streams.dates.dating import Dating
from streams.types.source import Ledger, LiveSource, Source
from streams.types.spec import SourceError, SourceSpec, parse_address, refuse_credentials

if TYPE_CHECKING:
    from streams.files.container import Files
    from streams.folder.source import FolderSource
    from streams.link.receiver import Receiver
    from streams.recording.state import ReadingState


def open_source(
    spec: SourceSpec, kept: Dating | None = None, begin: ReadingState | None = None, files: Files | None = None
) -> Source:
    """Open the recording or rig of a URL; it can be iterated over repeatedly.

    Args:
        kept: what dates its files, where that was chosen before.
        begin: state from which a recording goes on, where it can; else it begins at its first block.
        files: of a recording, in place of those at the path of its URL.

    Raises:
        SourceError: the path does not exist, nothing there is recognised, or rate or unit is stated by neither the
            recording, its data set nor the configuration.
    """
    # Imported here, because the parsers load pandas and the rig the bearing model: open_live needs neither.
    from streams.recording.source import open_recording

    scheme, colon, rest = spec.url.partition(":")
    if scheme == "rig" and colon:
        from streams.rig.bench import open_rig

        return open_rig(spec.url, spec.name)
    if "://" in spec.url:
        raise SourceError(
            f"[[source]] {spec.name}: url {redact(spec.url)!r}: {scheme}:// is not a kind of source that is read in "
            "place; expected dataset:NAME:PATH, folder:PATH, rig:NAME?seed=N or a path (replay fetches s3:// and https://)"
        )
    if scheme == "dataset" and colon:
        data_set, second, path = rest.partition(":")
        if not (data_set and second and path):
            raise SourceError(f"[[source]] {spec.name}: url {redact(spec.url)!r}: expected dataset:NAME:PATH")
        return open_recording(spec, path, data_set, kept=kept, begin=begin, files=files)
    if scheme == "folder" and colon:
        return open_recording(spec, rest, spec.format, must_be_folder=True, kept=kept, begin=begin, files=files)
    return open_recording(spec, spec.url, spec.format, kept=kept, begin=begin, files=files)


def open_live(specs: Sequence[SourceSpec], ledger: Ledger) -> list[LiveSource]:
    """Open live sources after the last committed block of a ledger.

    URLs are ``folder:PATH``, ``tcp://HOST:PORT`` or ``mqtt://HOST:PORT/TOPIC``. Sources at one address are opened as
    one; their blocks bear their names. The caller closes the sources.

    Raises:
        SourceError: another URL, an address that cannot be listened to, a path that is not a folder.
    """
    with ExitStack() as opened:
        sources = [opened.enter_context(_made(group)) for group in _groups(specs)]
        for source in sources:
            source.open(ledger)
        opened.pop_all()
    return [*sources]


def check_live(specs: Sequence[SourceSpec], *, taken: bool = False) -> list[str]:
    """Return for which reasons :func:`open_live` would refuse these sources; nothing is received or changed.

    ``taken``: another process has opened them, so that their addresses are in use by right.
    """
    problems = []
    known = []
    for spec in specs:
        try:
            _groups([spec])
            known.append(spec)
        except SourceError as error:
            problems.append(str(error))
    for group in _groups(known):
        try:
            with _made(group) as source:
                source.check(taken=taken)
        except SourceError as error:
            problems.append(str(error))
    return problems


def _groups(specs: Sequence[SourceSpec]) -> list[list[SourceSpec]]:
    """Return the sources that are opened as one; SourceError for a URL that is not of a live source."""
    groups: dict[object, list[SourceSpec]] = {}
    for spec in specs:
        where = f"[[source]] {spec.name}: url"
        scheme, _, rest = spec.url.partition(":")
        if scheme == "folder" and rest:
            groups[spec.name] = [spec]
        elif scheme in ("tcp", "mqtt"):
            place = parse_address(spec.url, where)
            groups.setdefault((place.scheme, place.host, place.port), []).append(spec)
        else:
            refuse_credentials(spec.url, where)
            raise SourceError(
                f"{where} {redact(spec.url)!r}: is not a source that goes on for ever; expected "
                "folder:PATH, tcp://HOST:PORT or mqtt://HOST:PORT/TOPIC"
            )
    # Folders first, as their turns come.
    return sorted(groups.values(), key=lambda group: not group[0].url.startswith("folder:"))


def _made(group: Sequence[SourceSpec]) -> FolderSource | Receiver:
    """Return the source of a group, not open yet."""
    scheme, _, rest = group[0].url.partition(":")
    if scheme == "folder":
        from streams.folder.source import FolderSource

        return FolderSource(group[0], rest)
    if scheme == "tcp":
        from streams.link.tcp import TcpReceiver

        return TcpReceiver(group)
    from streams.link.mqtt import MqttReceiver

    return MqttReceiver(group)
