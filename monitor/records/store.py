"""Store: the SQLite database ``state.db``, from which all published files can be made again.

A committed block survives the end of the process and a power cut: write-ahead log, synchronous=FULL, and one
transaction for ledger, record, states of the stages, forecasts and events. After a restart, the states are exactly
those after the last block of the ledger.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

from models.platform.portable import FileLock
from monitor.health.record import Record
from monitor.health.signal.waterfall import SpectrumChange
from monitor.records.archive import ARCHIVE_QUERY, FULL_ARCHIVE_QUERY, Archived, archived_of
from monitor.records.condense import condensed_counts, has_condensed
from monitor.records.database import Presence, Renewed, connect, reconnect, refuse_unsuitable
from monitor.records.durable import take_lock
from monitor.records.failures import DATABASE_ERRORS, StoreError
from monitor.records.filing import (
    LAST_QUERY,
    MAX_BLOCK,
    STORED_QUERY,
    BlockWriter,
    Commit,
    Filing,
    Stored,
    count_refusal,
    insert_run,
    write_states,
)
from monitor.records.rollup import OPEN_BUDGET_S, check_features, roll_up
from monitor.records.spectra import write_changes
from streams.types.block import Rejected

_CHUNK_RECORDS = 500
"""Records read at a time: no transaction stays open while blocks are committed."""


class Published(NamedTuple):
    """A published file: name, UTC day since 1970 or None, ledger number of its last block, size in bytes."""

    file: str
    day: int | None
    last_block: int
    size: int


class Store(Renewed):
    """The database of one machine, with one writer; made by :meth:`open`.

    All methods raise :class:`StoreError`, naming the file and the cause, where the database cannot be read or written;
    a transaction that fails is rolled back.
    """

    def __init__(self, path: Path, connection: sqlite3.Connection, lock: FileLock | None) -> None:
        """Own an open connection and the writer's lock, None for a reader."""
        super().__init__(path, connection)
        self._lock = lock
        self._presence = Presence(path)
        self._writer = BlockWriter()

    @classmethod
    def open(
        cls,
        path: Path,
        *,
        machine: str | None = None,
        create: bool = True,
        read_only: bool = False,
    ) -> Self:
        """Open a store on a local disk, or make one where it is missing and ``create``.

        Args:
            machine: must be that of the store; needed to make one.
            read_only: open for reading beside the writer.

        Raises:
            StoreError: no database, another program's, a newer schema version, another machine's, a network file
                system, or a second writer.
        """
        new = refuse_unsuitable(path, create=create and not read_only, look_inside=not read_only)
        if new and not machine:
            raise StoreError(f"{path}: a new store needs the name of its machine")
        lock = None if read_only else take_lock(path)
        if lock is None and not read_only:
            raise StoreError(f"{path}: another process is writing to it")
        with ExitStack() as undo:
            if lock is not None:
                undo.callback(lock.close)
            connection = undo.enter_context(closing(connect(path, new=new, read_only=read_only)))
            store = cls(path, connection, lock)
            store._settle_machine(machine)
            if not read_only:
                with store.transaction():
                    check_features(connection)
                    roll_up(connection, OPEN_BUDGET_S)
            undo.pop_all()
        return store

    def _settle_machine(self, machine: str | None) -> None:
        found = self.meta().get("machine")
        if found is None and machine and self._lock is not None:
            with self.transaction() as connection:
                connection.execute("INSERT INTO meta VALUES ('machine', ?)", (machine,))
        elif machine is not None and found != machine:
            raise StoreError(f"{self.path}: belongs to machine {found!r}, not to {machine!r}")

    def describe(self, attributes: Mapping[str, Any]) -> None:
        """Set the attributes of the run that commits from now on, by default none; published files carry them.

        They are plain values by name: ``config_hash``, ``map_hash``, ``library_hash``, ``rms_band_hz``,
        ``interval_level``, ``calibrated`` ("yes", "no"), ... Where channels differ, "NAME: VALUE; NAME: VALUE".
        The software version is added.
        """
        with self.transaction() as connection:
            run = insert_run(connection, attributes)
        # Not before it is committed: a run that was rolled back has no number.
        self._writer.run = run

    @property
    def machine(self) -> str:
        """Name of the machine whose records these are."""
        return self.meta()["machine"]

    @property
    def writable(self) -> bool:
        """Whether this is the writer."""
        return self._lock is not None

    def meta(self) -> dict[str, str]:
        """Return schema version, machine, and the software version and configuration hash of the latest run."""
        return dict(self.rows("SELECT key, value FROM meta"))

    def commit(
        self,
        record: Record,
        states: Mapping[str, Mapping[str, Any]],
        beside: Callable[[sqlite3.Connection], None] | None = None,
        spectra: Iterable[SpectrumChange] = (),
    ) -> Commit:
        """Commit one block, see :meth:`commit_many`."""
        return self.commit_many([(record, states)], beside, spectra)[0]

    def commit_many(
        self,
        items: Iterable[tuple[Record, Mapping[str, Mapping[str, Any]]]],
        beside: Callable[[sqlite3.Connection], None] | None = None,
        spectra: Iterable[SpectrumChange] = (),
    ) -> list[Commit]:
        """Commit blocks in one transaction: ledger, records, forecasts, events, states and rollup, all or nothing.

        Args:
            items: records in order, each with the states after it as plain values for JSON, by name of the stage;
                stages that are not named keep their state.
            beside: writes in the same transaction.
            spectra: changes of the kept spectra, in order; written for the blocks that are committed.

        Returns:
            The outcome of each: "duplicate" where the block is in the ledger already, "changed" where a block of
            another content has its number; then nothing is overwritten and the offer is counted.

        Raises:
            UnstorableError: a record or a state does not fit the tables; nothing is committed.
        """
        if self._writer.run is None:
            self.describe({})
        outcomes: list[Commit] = []
        latest: dict[str, tuple[int, Mapping[str, Any]]] = {}
        committed: set[tuple[str, int]] = set()
        with self.transaction() as connection:
            for record, states in items:
                outcome, block = self._writer.insert(connection, record)
                outcomes.append(outcome)
                if outcome == "committed":
                    committed.add((record.source, record.sequence))
                    latest.update({name: (block, state) for name, state in states.items()})
            if committed:
                write_states(connection, latest)
                roll_up(connection)
            kept = [change for change in spectra if (change.row.source, change.row.sequence) in committed]
            write_changes(connection, kept)
            if beside is not None:
                beside(connection)
        return outcomes

    def load_states(self) -> dict[str, dict[str, Any]]:
        """Return the state of each stage after the last committed block; tuples come back as lists."""
        return {name: json.loads(state) for name, state in self.rows("SELECT name, state FROM stage_states")}

    def replace_states(self, source: str, states: Mapping[str, Mapping[str, Any]]) -> None:
        """Set the states of the stages after the last block of a source."""
        with self.transaction() as connection:
            (block,) = connection.execute("SELECT max(id) FROM blocks WHERE source = ?", (source,)).fetchone()
            write_states(connection, {name: (block, state) for name, state in states.items()})

    def last(self, source: str) -> int:
        """Return the highest committed sequence number of a source up to ``MAX_BLOCK``, 0 where there is none."""
        return self.rows(LAST_QUERY, source, MAX_BLOCK)[0][0]

    def recount_refusals(self, source: str, items: Iterable[Rejected]) -> None:
        """Replace the refused repetitions of a source: a replay that is resumed meets all of them again."""
        with self.transaction() as connection:
            connection.execute("DELETE FROM refusals WHERE source = ?", (source,))
            for item in items:
                count_refusal(connection, item, item.status)

    def counts(self) -> dict[str, int]:
        """Return how many blocks were offered by status; refused repetitions count as "duplicate" and "changed"."""
        counts: dict[str, int] = {}
        present = self.rows("SELECT status, count(*) FROM blocks GROUP BY status ORDER BY status")
        with self.connection() as connection:
            condensed = list(condensed_counts(connection))
        refused = self.rows("SELECT status, sum(times) FROM refusals GROUP BY status ORDER BY status")
        for status, number in (*present, *condensed, *refused):
            counts[status] = counts.get(status, 0) + number
        return counts

    def records(self) -> Iterator[Record]:
        """Yield the records in the order of commitment."""
        return (row.to_record() for row in self.stored())

    def records_after(self, source: str, block: int) -> Iterator[Record]:
        """Yield the records of a source after a number of the ledger."""
        return (row.to_record() for row in self._stored("source = ? AND blocks.id > ?", source, block))

    def record(self, source: str, sequence: int) -> Record | None:
        """Return one record, or None where that block is not committed."""
        row = next(self._stored("source = ? AND sequence = ?", source, sequence), None)
        return None if row is None else row.to_record()

    def stored(self) -> Iterator[Stored]:
        """Yield all records as they are stored, in the order of commitment."""
        return self._stored("1")

    def stored_on(self, day: int | None, last_block: int) -> Iterator[Stored]:
        """Yield the records of a UTC day (days since 1970) or of the undated axis as stored, up to a ledger number."""
        return self._stored("day IS ? AND blocks.id <= ?", day, last_block)

    def _stored(self, condition: str, *values: Any) -> Iterator[Stored]:
        """Yield records as they are stored, in the order of commitment, for an SQL condition on ``blocks``."""
        layouts: dict[int, str] = {}
        last = 0
        while True:
            rows = self.rows(STORED_QUERY.format(condition=condition), last, *values, _CHUNK_RECORDS)
            if not rows:
                return
            for row in rows:
                if row[1] not in layouts:
                    layouts.update(self.rows("SELECT id, layout FROM layouts"))
                filing = Filing(*row[2:5])
                yield Stored(filing, layouts[row[1]], *row[5:])
            last = rows[-1][0]

    def events(self) -> list[dict[str, Any]]:
        """Return all events in the order of commitment, each with the ``source`` and ``block`` it came with."""
        query = "SELECT source, sequence, body FROM events JOIN blocks ON blocks.id = block ORDER BY events.id"
        return [{"source": source, "block": block, **json.loads(body)} for source, block, body in self.rows(query)]

    def forecasts(self) -> Iterator[Archived]:
        """Yield all forecasts as they were issued, in the order of commitment.

        Raises:
            StoreError: the store is of version 1, without the inputs of forecasts, until it is opened for writing.
        """
        if self.meta()["schema_version"] == "1":
            raise StoreError(
                f"{self.path}: its forecasts do not say what they leaned on (schema version 1); "
                "open the store once for writing to complete them, such as with: spallwatch replay --resume"
            )
        with self.connection() as connection:
            query = FULL_ARCHIVE_QUERY if has_condensed(connection) else ARCHIVE_QUERY
        last = 0
        while rows := self.rows(query, last):
            yield from archived_of(rows)
            last = rows[-1][0]

    def note_published(self, done: Published) -> None:
        """Record a published file, so that it is written again only when its day changes."""
        with self.transaction() as connection:
            connection.execute("INSERT OR REPLACE INTO published VALUES (?, ?, ?, ?)", done)

    def check(self) -> list[str]:
        """Read the whole database and return the problems found."""
        problems = [row[0] for row in self.rows("PRAGMA quick_check") if row[0] != "ok"]
        orphans = self.rows("SELECT count(*) FROM blocks LEFT JOIN records ON block = id WHERE block IS NULL")[0][0]
        return problems + ([f"{orphans} blocks of the ledger have no record"] if orphans else [])

    def close(self) -> None:
        """Close the database and release the lock; closing twice does nothing."""
        super().close()
        lock, self._lock = self._lock, None
        if lock is not None:
            lock.close()

    def _reopened(self) -> sqlite3.Connection:
        found = reconnect(self.path, read_only=self._lock is None)
        # The last connection of a process that is closed removes the log.
        self._presence.renew_log()
        return found

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Run statements as one transaction, rolled back where anything fails."""
        if self._lock is None:
            raise StoreError(f"{self.path}: is open for reading only")
        with self.connection() as connection:
            if connection.in_transaction:
                # The roll-back of the one before failed too.
                connection.execute("ROLLBACK")
            connection.execute("BEGIN IMMEDIATE")
            try:
                yield connection
                self._presence.check()
                connection.execute("COMMIT")
            except BaseException:
                self._writer.forget_layouts()
                # After some errors SQLite has rolled back already.
                if connection.in_transaction:
                    with suppress(*DATABASE_ERRORS):
                        connection.execute("ROLLBACK")
                raise
