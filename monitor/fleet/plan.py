"""From a manifest to the rows of an index: globs are expanded once, histories are put together.

Recordings that came after an archive was planned are planned aside from the manifest as it is now, compared, and added.
All recordings of the archive must still be named, by the same machines with the same configurations and kinds of
history. Recordings of ``history = "each"`` may be added anywhere; a continued history goes on at its end alone, or with
a new beginning (``anew``), as its state is kept there and nowhere else. What is added stands behind what is there.

A history that goes on is replayed from the state at its end. It is replayed from its first recording where there is
none: it had blocks without dates, too few to learn its bands from, or its state is of another version.
"""

from __future__ import annotations

import glob
import hashlib
import json
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path

from models.words.errors import WrongInputError
from models.work.redact import redactor
from models.work.task import FileStore
from monitor.config.load import ConfigError
from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestEntry, ManifestError, count_files, read_manifest, without_file_scheme
from monitor.fleet.place import Overlap
from monitor.fleet.result import Later
from monitor.fleet.setup import send_setup
from streams.files.remote import bare, expand, is_remote
from streams.types.listing import natural_key

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.+-]+")
_MAX_NAME = 80
HISTORY_NAME = "history"
_MAGIC = re.compile(r"[*?\[]")


@dataclass
class _Planned:
    """A machine of which entries were met: what must not change, and the history that is going on."""

    id: int
    config: Path
    history: str
    recording: int | None = None
    place: int = 0


@dataclass
class Planner:
    """Fills an index from a manifest.

    Attributes:
        store: takes the configurations with their maps and libraries.
        overlap: finds recordings in the place of the archive, where that is known.
        signed: URLs with queries that must not be written, by the URL without them.
    """

    index: Index
    store: FileStore
    overlap: Overlap | None = None
    signed: dict[str, str] = field(default_factory=dict[str, str])
    _machines: dict[str, _Planned] = field(default_factory=dict[str, _Planned])
    _setups: dict[Path, str] = field(default_factory=dict[Path, str])
    _shown: Callable[[str], str] = field(default_factory=lambda: _bare_of_many())

    def plan(self, manifest: Path, check: Callable[[], None] = lambda: None) -> None:
        """Write all recordings of a manifest into the index, in one transaction; ``check`` is called at its end.

        Raises:
            ManifestError: the manifest cannot be used; the index stays empty.
            ConfigError: a configuration cannot be used.
        """
        with self.index.all_or_nothing():
            digest = _Digest(self._shown)
            for entry in read_manifest(manifest):
                digest.add(entry)
                self._add(entry)
            if not self._machines:
                raise ManifestError(f"{manifest}: holds no recordings")
            if (twice := self.index.given_twice()) is not None:
                raise ManifestError(f"{manifest}: recordings: {twice[1]} is given twice for machine {twice[0]}")
            if self.overlap is not None:
                self.overlap.check(self._machines)
            check()
            signed = "yes" if self.signed else "no"
            configs = json.dumps({str(path): setup for path, setup in self._setups.items()})
            self.index.set_meta(manifest=digest.text(), configs=configs, signed=signed)

    def _add(self, entry: ManifestEntry) -> None:
        machine = self._machine(entry)
        anew = {self._shown(without_file_scheme(url)) for url in entry.anew}
        if anew and entry.history == "each":
            raise ManifestError(f'{entry.where}: anew: every recording is anew with history = "each"')
        seen: set[str] = set()
        for url in expanded(entry):
            shown = self._shown(url)
            if shown in seen:
                raise ManifestError(f"{entry.where}: recordings: {shown} is given twice")
            seen.add(shown)
            if self.overlap is not None:
                self.overlap.add(entry.where, shown)
            if shown != url:
                self.signed[shown] = url
            if entry.history == "each" or machine.recording is None or shown in anew:
                machine.recording = self.index.add_recording(
                    machine.id, name_of(shown) if entry.history == "each" else HISTORY_NAME, shown
                )
                machine.place = 0
            else:
                machine.place += 1
                self.index.add_link(machine.recording, machine.place, shown)
        if lost := anew - seen:
            raise ManifestError(f"{entry.where}: anew: {min(lost)} is none of the recordings")

    def _machine(self, entry: ManifestEntry) -> _Planned:
        found = self._machines.get(entry.machine)
        if found is None:
            if entry.config not in self._setups:
                try:
                    self._setups[entry.config] = send_setup(entry.config, self.store)
                except ConfigError as error:
                    raise ConfigError(f"{entry.where}: machine {entry.machine}: {error}") from None
            number = self.index.add_machine(entry.machine, self._setups[entry.config], entry.history)
            found = self._machines[entry.machine] = _Planned(number, entry.config, entry.history)
        for key, before, now in (("config", found.config, entry.config), ("history", found.history, entry.history)):
            if before != now:
                raise ManifestError(f"{entry.where}: {key}: machine {entry.machine} has {before} above, got {now}")
        return found


def _bare_of_many() -> Callable[[str], str]:
    """Return what gives URLs without what must not be written."""
    hide = redactor()
    return lru_cache(maxsize=1024)(lambda url: bare(url, hide))


class _Digest:
    """Digest of the entries of a manifest; a URL that was signed anew is the same."""

    def __init__(self, shown: Callable[[str], str]) -> None:
        self._hash = hashlib.blake2b(digest_size=16)
        self._shown = shown

    def add(self, entry: ManifestEntry) -> None:
        urls, anew = ([self._shown(url) for url in listed] for listed in (entry.recordings, entry.anew))
        self._hash.update(json.dumps([entry.machine, str(entry.config), urls, entry.history, anew]).encode())

    def text(self) -> str:
        return self._hash.hexdigest()


def manifest_digest(manifest: Path) -> str:
    """Return the digest of the entries of a manifest.

    Raises:
        ManifestError: it cannot be used.
    """
    digest = _Digest(_bare_of_many())
    for entry in read_manifest(manifest):
        digest.add(entry)
    return digest.text()


def check_unchanged(index: Index, manifest: Path, store: FileStore) -> None:
    """Refuse a manifest or a configuration that has changed since an archive was planned.

    Raises:
        ManifestError: naming what has changed.
        ConfigError: a configuration cannot be used any more.
    """
    meta = index.meta()
    if meta["manifest"] != manifest_digest(manifest):
        raise ManifestError(
            f"{manifest}: has changed since the archive was begun; --extend adds recordings, or take another --out"
        )
    for path, digest in json.loads(meta["configs"]).items():
        if send_setup(Path(path), store) != digest:
            raise ManifestError(f"{path}: it or its maps have changed since the archive was begun; take another --out")


def signed_urls(manifest: Path) -> dict[str, str]:
    """Return the URLs of a manifest with what must not be written, by the URL without it."""
    shown = _bare_of_many()
    urls = (url for entry in read_manifest(manifest) for url in entry.recordings if is_remote(url))
    return {shown(url): url for url in urls if shown(url) != url}


def later_recordings(index: Index, manifest: Path) -> Later:
    """Count the recordings that patterns of a manifest name now, and did not when its archive was planned.

    Raises:
        ManifestError: it cannot be used.
        RemoteError: an object storage cannot be listed.
    """
    shown = _bare_of_many()

    def named() -> Iterator[tuple[str, str]]:
        for entry in read_manifest(manifest):
            patterns = tuple(url for url in entry.recordings if _MAGIC.search(url) and not url.startswith("rig:"))
            for pattern in patterns:
                # What it named then may all be gone.
                with suppress(ManifestError):
                    yield from ((entry.machine, shown(url)) for url in expanded(replace(entry, recordings=(pattern,))))

    return index.not_in_it(named())


def expanded(entry: ManifestEntry) -> Iterator[str]:
    """Yield the recordings of an entry, those of a glob in natural order.

    Raises:
        ManifestError: there is nothing of that name, or it cannot be looked up.
        RemoteError: an object storage cannot be listed.
    """
    for url in entry.recordings:
        try:
            found = _named(url)
        except WrongInputError as error:
            raise ManifestError(f"{entry.where}: recordings: {error}") from None
        except OSError as error:
            raise ManifestError(f"{entry.where}: recordings: {url!r}: {error.strerror or error}") from None
        yield from found


def _named(url: str) -> list[str]:
    if is_remote(url):
        return [without_file_scheme(one) for one in expand(url)]
    if url.startswith(("rig:", "dataset:", "folder:")) or Path(url).exists():
        return [url]
    if not _MAGIC.search(url):
        raise WrongInputError(f"there is no {url!r}")
    found = sorted(glob.glob(url, recursive=True), key=natural_key)  # noqa: PTH207 - absolute patterns
    if not found:
        raise WrongInputError(f"nothing is named {url!r}")
    return found


def name_of(url: str) -> str:
    """Return a name for a recording, a part of a path: the last part of its URL."""
    text = url if url.startswith("rig:") else url.rstrip("/").rpartition("/")[2]
    name = _NOT_IN_NAMES.sub("-", text).strip(".-")[:_MAX_NAME]
    return name or "recording"


def extend(index: Index, manifest: Path, store: FileStore, overlap: Overlap | None = None) -> Later:
    """Add the recordings that a manifest names now to the index of an archive; they and longer histories wait then.

    Args:
        index: that holds a plan; it is left as it is where an error is raised.
        manifest: of the archive, as it is now.
        store: takes the configurations with their maps and libraries.
        overlap: finds recordings in the place of the archive.

    Returns:
        How many recordings were added, and the first of them.

    Raises:
        ManifestError: the manifest cannot be used, or what was planned cannot be extended to it.
        ConfigError: a configuration cannot be used.
        RemoteError: an object storage cannot be listed.
    """
    with tempfile.TemporaryDirectory(prefix="spallwatch-index-") as folder:
        path = Path(folder) / "planned.db"
        with Index(path) as planned:
            Planner(planned, store, overlap).plan(manifest)
            meta = planned.meta()
        with index.compared(path):
            _Check(index, manifest).all()
            with index.all_or_nothing():
                count, first = 0, ""
                for url in index.add_compared(_name_of):
                    count, first = count + 1, first or url
                index.set_meta(**meta)
    return Later(count, first)


def grown_folders(index: Index) -> Later:
    """Count the recordings that are folders with more files than were read: files of a folder are not added later."""
    found = [url for url, files in index.folders_read() if (count_files(url) or 0) > files]
    return Later(len(found), found[0] if found else "")


class _Check:
    """Refuses what an archive cannot be extended to; ManifestError names machine and recording."""

    def __init__(self, index: Index, manifest: Path) -> None:
        self._index, self._manifest = index, manifest

    def all(self) -> None:
        self._machines()
        self._each()
        self._continued()

    def _refuse(self, machine: str, text: str) -> ManifestError:
        return ManifestError(f"{self._manifest}: machine {machine}: {text}; take another --out for it")

    def _machines(self) -> None:
        for machine, before, now, same in self._index.machine_changes():
            if now is None:
                raise self._refuse(machine, "is in the archive, and is not named any more")
            if before != now:
                raise self._refuse(machine, f'history: expected "{before}", as the archive was begun, got "{now}"')
            if not same:
                raise self._refuse(machine, "its configuration or its maps have changed since the archive was begun")

    def _each(self) -> None:
        if (found := self._index.dropped()) is not None:
            raise self._refuse(found[0], f"{found[1]} is in the archive, and is not named any more")

    def _continued(self) -> None:
        if (found := self._index.history_change()) is not None:
            raise self._refuse(
                found.machine,
                f"recording {found.place + 1} of {found.history}: expected {found.before}, as the archive was begun, "
                f"got {found.now or 'nothing'}; a history goes on at its end alone",
            )


def _name_of(url: str, each: bool) -> str:
    return name_of(url) if each else HISTORY_NAME
