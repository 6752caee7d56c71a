"""Crash states: what a disk may hold after a crash behind each call of a record, under a stated model of file systems.

Both models keep what a call for durability confirmed, and may lose, of all that came after it, any subset of the
writes of a file, each torn at sectors of 512 bytes. They differ in the names (create, link, rename, unlink, mkdir,
rmdir), each of which is atomic:

"ordered" (ext4, xfs, btrfs): names become durable in the order in which they were given, by their own log; a call for
the durability of any file or folder writes the log. fdatasync does so only of a file whose own name is in it.
"weakest" (POSIX): any subset of the names is lost, until one of their folders is made durable.
"""

from __future__ import annotations

import hashlib
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from benchmarks.crash.recorder import Entry

Model = Literal["ordered", "weakest"]
MODELS: tuple[Model, ...] = ("ordered", "weakest")
ROOT = 0
SECTOR_BYTES = 512
_MAPPED = "-shm"
"""Ending of the files that are written by memory maps; they are made anew, and are in no state."""


@dataclass(frozen=True)
class Change:
    """A change that is not durable yet.

    Attributes:
        edits: (folder, name, file or None) of a change of names.
        file: of a change of data.
        data: what is written at ``offset``; None where the file is cut or extended to it.
    """

    edits: tuple[tuple[int, str, int | None], ...] = ()
    file: int | None = None
    offset: int = 0
    data: bytes | None = None

    def torn(self, kept: Sequence[bool]) -> Iterator[Change]:
        """Yield the changes of those sectors of a write that are kept."""
        assert self.data is not None
        for number, is_kept in enumerate(kept):
            if is_kept:
                part = self.data[number * SECTOR_BYTES : (number + 1) * SECTOR_BYTES]
                yield Change(file=self.file, offset=self.offset + number * SECTOR_BYTES, data=part)


@dataclass(frozen=True)
class State:
    """One crash state.

    Attributes:
        after: number of the entry behind which the crash was.
        call: name and kind of file of that entry.
        loss: what was lost of what was not durable, in a word.
        files: content by path below the root.
        folders: paths below the root.
    """

    after: int
    call: tuple[str, str]
    model: Model
    loss: str
    files: Mapping[str, bytes]
    folders: tuple[str, ...]
    digest: bytes


def changed(content: bytes, changes: Sequence[Change]) -> bytes:
    """Return the content of a file after changes of it, in their order."""
    if not changes:
        return content
    result = bytearray(content)
    for change in changes:
        if change.data is None:
            size = change.offset
            del result[size:]
            result.extend(bytes(size - len(result)))
        else:
            result.extend(bytes(max(0, change.offset - len(result))))
            result[change.offset : change.offset + len(change.data)] = change.data
    return bytes(result)


@dataclass
class Disk:
    """What is durable, and the changes since, under one model."""

    model: Model
    contents: dict[int, bytes] = field(default_factory=dict[int, bytes])
    folders: dict[int, dict[str, int]] = field(default_factory=lambda: {ROOT: {}})
    pending: list[Change] = field(default_factory=list[Change])
    _digests: dict[int, bytes] = field(default_factory=dict[int, bytes])

    def sync(self, inode: int, *, data_only: bool) -> None:
        """Make a file or folder durable, and what its model has become durable with it."""
        named = any(found == inode for change in self.pending for *_, found in change.edits)
        kept: list[Change] = []
        written: list[Change] = []
        for change in self.pending:
            if change.edits:
                of_folder = any(folder == inode for folder, *_ in change.edits)
                if of_folder or (self.model == "ordered" and (named or not data_only)):
                    self._rename(self.folders, change)
                else:
                    kept.append(change)
            elif change.file == inode:
                written.append(change)
            else:
                kept.append(change)
        if written:
            self.contents[inode] = changed(self.contents.get(inode, b""), written)
            self._digests.pop(inode, None)
        self.pending = kept

    @staticmethod
    def _rename(folders: dict[int, dict[str, int]], change: Change) -> None:
        for folder, name, inode in change.edits:
            names = folders.setdefault(folder, {})
            if inode is None:
                names.pop(name, None)
            else:
                names[name] = inode

    def tree(self, kept: Sequence[Change], kinds: Mapping[int, bool]) -> tuple[dict[str, bytes], list[str], bytes]:
        """Return files, folders and a digest of what is durable with some of the changes; ``kinds`` tells folders."""
        folders = {inode: dict(names) for inode, names in self.folders.items()}
        by_file: dict[int, list[Change]] = {}
        for change in kept:
            if change.edits:
                self._rename(folders, change)
            elif change.file is not None:
                by_file.setdefault(change.file, []).append(change)
        files: dict[str, bytes] = {}
        found: list[str] = []
        digest = hashlib.blake2b(digest_size=16)
        waiting = [(ROOT, "")]
        while waiting:
            folder, place = waiting.pop()
            for name, inode in sorted(folders.get(folder, {}).items()):
                path = f"{place}{name}"
                if kinds[inode]:
                    found.append(path)
                    waiting.append((inode, f"{path}/"))
                    digest.update(f"{path}/\0".encode())
                elif not name.endswith(_MAPPED):
                    files[path], own = self._content(inode, by_file.get(inode, ()))
                    digest.update(path.encode() + b"\0" + own)
        return files, found, digest.digest()

    def _content(self, inode: int, changes: Sequence[Change]) -> tuple[bytes, bytes]:
        content = self.contents.get(inode, b"")
        if changes:
            content = changed(content, changes)
            return content, hashlib.blake2b(content, digest_size=16).digest()
        if inode not in self._digests:
            self._digests[inode] = hashlib.blake2b(content, digest_size=16).digest()
        return content, self._digests[inode]


class History:
    """The files of a record as they come to be, call by call."""

    def __init__(self, root: Path, model: Model, *, ignore_syncs: bool = False) -> None:
        """Begin with an empty root; ``ignore_syncs`` is the disk that lies, a control."""
        self._root, self._ignore_syncs = str(root.resolve()), ignore_syncs
        self.disk = Disk(model)
        self.kinds: dict[int, bool] = {ROOT: True}
        self._names: dict[int, dict[str, int]] = {ROOT: {}}
        self._known: dict[int, int] = {}
        self._paths: dict[int, str] = {ROOT: ""}

    def add(self, entry: Entry) -> tuple[str, str]:
        """Take an entry; return its call, and the kind of its file."""
        if entry.call in ("create", "mkdir"):
            inode = self._known[entry.inode] = len(self.kinds)
            self.kinds[inode] = entry.call == "mkdir"
            self._names[inode] = {}
            folder, name = self._locate(entry.paths[0])
            self._edit(((folder, name, inode),))
            self._paths[inode] = entry.paths[0]
        elif entry.call in ("rename", "link"):
            (folder, name), target = self._locate(entry.paths[0]), self._locate(entry.paths[1])
            inode = self._names[folder][name]
            gone = ((folder, name, None),) if entry.call == "rename" else ()
            self._edit((*gone, (*target, inode)))
            self._paths[inode] = entry.paths[1]
        elif entry.call in ("unlink", "rmdir"):
            self._edit(((*self._locate(entry.paths[0]), None),))
        elif entry.call in ("write", "truncate"):
            inode = self._known[entry.inode]
            data = entry.data if entry.call == "write" else None
            self.disk.pending.append(Change(file=inode, offset=entry.offset, data=data))
        else:
            inode = self._inode(entry)
            if not self._ignore_syncs:
                self.disk.sync(inode, data_only=entry.call == "fdatasync")
        path = entry.paths[-1] if entry.paths else self._paths[self._inode(entry)]
        return entry.call, kind_of(path.removeprefix(f"{self._root}/"), is_folder=entry.is_folder)

    def _inode(self, entry: Entry) -> int:
        # The root was there before; no other unknown inode is written to.
        return self._known.get(entry.inode, ROOT) if entry.is_folder else self._known[entry.inode]

    def _locate(self, path: str) -> tuple[int, str]:
        *folders, name = path.removeprefix(f"{self._root}/").split("/")
        inode = ROOT
        for folder in folders:
            inode = self._names[inode][folder]
        return inode, name

    def _edit(self, edits: tuple[tuple[int, str, int | None], ...]) -> None:
        change = Change(edits)
        Disk._rename(self._names, change)
        self.disk.pending.append(change)

    def tree(self) -> tuple[dict[str, bytes], list[str], bytes]:
        """Return files, folders and digest of what the calls have made so far."""
        return self.disk.tree(self.disk.pending, self.kinds)

    def states(self, after: int, call: tuple[str, str], number: int, rng: random.Random) -> Iterator[State]:
        """Yield states of a crash behind the last entry: all of it there, only what is durable, and further losses."""
        pending = self.disk.pending
        losses: list[tuple[str, Sequence[Change]]] = [("nothing", pending)]
        if pending:
            losses.append(("all", ()))
            ways = (self._last_alone, self._without_one_file, self._subset, self._torn)
            losses += [ways[(after + k) % len(ways)](rng) for k in range(max(0, number - 2))]
        for loss, kept in losses:
            files, folders, digest = self.disk.tree(kept, self.kinds)
            yield State(after, call, self.disk.model, loss, files, tuple(folders), digest)

    def _in_order(self, kept: Sequence[Change], rng: random.Random) -> list[Change]:
        """Return changes of which the names are a beginning of all, where the model has them in order."""
        if self.disk.model == "weakest":
            return list(kept)
        names = [change for change in self.disk.pending if change.edits]
        first = {id(change) for change in names[: rng.randint(0, len(names))]}
        chosen = {id(change) for change in kept if not change.edits} | first
        return [change for change in self.disk.pending if id(change) in chosen]

    def _last_alone(self, rng: random.Random) -> tuple[str, Sequence[Change]]:
        return "all but the last", self._in_order(self.disk.pending[-1:], rng)

    def _without_one_file(self, rng: random.Random) -> tuple[str, Sequence[Change]]:
        files = sorted({change.file for change in self.disk.pending if change.file is not None})
        lost = rng.choice(files) if files else None
        kept = [change for change in self.disk.pending if change.edits or change.file != lost]
        return "one file", kept if rng.random() < 0.5 else self._in_order(kept, rng)

    def _subset(self, rng: random.Random) -> tuple[str, Sequence[Change]]:
        share = rng.choice((0.2, 0.5, 0.8))
        return "a subset", self._in_order([change for change in self.disk.pending if rng.random() < share], rng)

    def _torn(self, rng: random.Random) -> tuple[str, Sequence[Change]]:
        writes = [change for change in self.disk.pending if change.data is not None]
        if not writes:
            return self._subset(rng)
        torn = writes[-1] if rng.random() < 0.5 else rng.choice(writes)
        sectors = -(-len(torn.data or b"") // SECTOR_BYTES)
        kept: list[Change] = []
        for change in self.disk.pending:
            kept += torn.torn([rng.random() < 0.5 for _ in range(sectors)]) if change is torn else [change]
        return "sectors of a write", kept


def kind_of(path: str, *, is_folder: bool = False) -> str:
    """Return the kind of a file or folder by its path below the root."""
    place, _, rest = path.partition("/")
    if is_folder:
        return f"folder {place}" if place else "the root"
    if place == "state":
        if rest.startswith("state.db"):
            ending = rest.removeprefix("state.db")
            return {"": "store", "-wal": "store log", "-journal": "store journal", ".lock": "lock"}.get(
                ending, "store beside"
            )
        return "lock" if rest.endswith(".lock") else "status" if "status" in rest else "other state"
    if place == "records" and rest.endswith((".nc", ".nc.tmp")):
        return "published"
    return {"records": "published notes", "backups": "backup", "old": "moved day"}.get(place, place)


def walk(entries: Sequence[Entry], history: History) -> Iterator[tuple[int, Entry, tuple[str, str]]]:
    """Yield number, entry and (call, kind) of each call but marks, which :func:`marks_before` has."""
    for number, entry in enumerate(entries):
        if entry.call != "mark":
            yield number, entry, history.add(entry)


def final_difference(root: Path, history: History) -> list[str]:
    """Return the paths in which the record and the folder itself differ: none, if every call was seen."""
    files, folders, _ = history.tree()
    real: dict[str, Any] = {}
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        if not name.endswith(_MAPPED):
            real[name] = None if path.is_dir() else path.read_bytes()
    built: dict[str, Any] = {**files, **dict.fromkeys(folders)}
    absent = object()
    return sorted(name for name in real.keys() | built.keys() if real.get(name, absent) != built.get(name, absent))
