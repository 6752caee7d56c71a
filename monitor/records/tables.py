"""The tables of ``state.db``: their versions, how they are made and migrated."""

from __future__ import annotations

import sqlite3

from monitor.records.archive import COLUMNS, complete_archive

APPLICATION_ID = 0x53504C57
"""The bytes "SPLW" in the header of the database: it is ours."""

STORE_VERSION = 4
"""Version of the tables, the ``schema_version`` of the table ``meta``.

2: inputs of forecasts; 3: rollup of trends; 4: condensed blocks (:mod:`monitor.records.condense`).
"""
CONDENSED_VERSION = 4

# A record is its row of blocks, the values in records (see packing), and its forecasts and events. blocks.id grows with
# every commit. day and axis_time: see filing.Filing; blocks_by_day gives the last block of each day to the publisher.
_SCHEMA = f"""
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE runs (id INTEGER PRIMARY KEY, attributes TEXT NOT NULL);
CREATE TABLE blocks (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    source TEXT NOT NULL, sequence INTEGER NOT NULL, content_hash TEXT NOT NULL, name TEXT NOT NULL,
    status TEXT NOT NULL, flags TEXT NOT NULL, reason TEXT NOT NULL, time REAL, elapsed REAL,
    day INTEGER, axis_time REAL NOT NULL, time_status TEXT NOT NULL,
    run INTEGER NOT NULL REFERENCES runs (id),
    UNIQUE (source, sequence)
);
CREATE INDEX blocks_by_day ON blocks (day, id);
CREATE TABLE refusals (
    source TEXT NOT NULL, sequence INTEGER NOT NULL, content_hash TEXT NOT NULL, name TEXT NOT NULL,
    status TEXT NOT NULL, times INTEGER NOT NULL,
    UNIQUE (source, sequence, content_hash)
);
CREATE TABLE layouts (id INTEGER PRIMARY KEY, layout TEXT NOT NULL UNIQUE);
CREATE TABLE records (
    block INTEGER PRIMARY KEY REFERENCES blocks (id), layout INTEGER NOT NULL REFERENCES layouts (id),
    row BLOB NOT NULL
);
CREATE TABLE stage_states (name TEXT PRIMARY KEY, block INTEGER NOT NULL, state TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE forecasts (
    id INTEGER PRIMARY KEY, block INTEGER NOT NULL REFERENCES blocks (id), body TEXT NOT NULL,
    {", ".join(f"{name} {kind}" for name, kind in COLUMNS.items())}
);
CREATE INDEX forecasts_by_block ON forecasts (block);
CREATE TABLE events (id INTEGER PRIMARY KEY, block INTEGER NOT NULL REFERENCES blocks (id), body TEXT NOT NULL);
CREATE INDEX events_by_block ON events (block);
CREATE TABLE published (
    file TEXT PRIMARY KEY, day INTEGER, last_block INTEGER NOT NULL, size INTEGER NOT NULL
) WITHOUT ROWID;
"""

_UNVERSIONED = """
CREATE TABLE IF NOT EXISTS spectra (
    source TEXT NOT NULL, channel TEXT NOT NULL, sequence INTEGER NOT NULL, time REAL, kind INTEGER NOT NULL,
    header TEXT NOT NULL, amplitude BLOB NOT NULL, PRIMARY KEY (source, channel, sequence)
);
CREATE TABLE IF NOT EXISTS digests (block INTEGER PRIMARY KEY, ledger BLOB NOT NULL, content BLOB NOT NULL, states BLOB)
"""
"""Outside the versions of the schema: made where they are missing when a store is opened for writing."""

_ROLLUP = """
CREATE TABLE IF NOT EXISTS rollup (
    source TEXT NOT NULL, channel TEXT NOT NULL, dated INTEGER NOT NULL, level INTEGER NOT NULL,
    bucket INTEGER NOT NULL, records INTEGER NOT NULL, others TEXT, extremes BLOB NOT NULL,
    PRIMARY KEY (source, channel, dated, level, bucket)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS blocks_by_time ON blocks (source, day IS NULL, instr(flags, 'clock') > 0, axis_time);
"""
"""The extremes of trends (:mod:`monitor.records.rollup`), and where the blocks of a range of time are."""

_CONDENSED = """
CREATE TABLE IF NOT EXISTS condensed_sources (
    id INTEGER PRIMARY KEY, source TEXT NOT NULL UNIQUE, began REAL, counts TEXT NOT NULL,
    first_dated REAL, last_dated REAL, first_undated REAL, last_undated REAL
);
CREATE TABLE IF NOT EXISTS condensed_days (day INTEGER UNIQUE, blocks INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS identities (
    source INTEGER NOT NULL, sequence INTEGER NOT NULL, content BLOB NOT NULL, PRIMARY KEY (source, sequence)
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS identities_by_content ON identities (substr(content, 1, 6));
CREATE TABLE IF NOT EXISTS forecast_inputs (
    id INTEGER PRIMARY KEY, channel TEXT, method TEXT, threshold_mm2 REAL, interval_level REAL,
    library_hash TEXT, map_hash TEXT, config_hash TEXT
);
CREATE TABLE IF NOT EXISTS condensed_forecasts (
    id INTEGER PRIMARY KEY, source INTEGER NOT NULL, sequence INTEGER NOT NULL, dated INTEGER NOT NULL,
    inputs INTEGER NOT NULL, status TEXT, issued_utc REAL, data_until REAL, tt_s REAL, quantiles TEXT
);
"""
"""What stays of blocks whose full records have left the store."""


def create_tables(connection: sqlite3.Connection) -> None:
    """Make all tables in one transaction: a half-made store is an empty database."""
    connection.execute("BEGIN IMMEDIATE")
    for statement in (_SCHEMA + _ROLLUP + _CONDENSED).split(";"):
        if statement.strip():
            connection.execute(statement)
    connection.execute("INSERT INTO meta VALUES ('schema_version', ?)", (str(STORE_VERSION),))
    connection.execute(f"PRAGMA application_id = {APPLICATION_ID}")
    connection.execute("COMMIT")


def migrate_tables(connection: sqlite3.Connection, found: int) -> None:
    """Bring the tables of an older version to the present version, all or nothing."""
    connection.execute("BEGIN IMMEDIATE")
    try:
        if found < 2:
            complete_archive(connection)
        for statement in filter(str.strip, (_ROLLUP + _CONDENSED).split(";")):
            connection.execute(statement)
        connection.execute("UPDATE meta SET value = ? WHERE key = 'schema_version'", (str(STORE_VERSION),))
        connection.execute("COMMIT")
    finally:
        if connection.in_transaction:
            connection.execute("ROLLBACK")


def add_unversioned(connection: sqlite3.Connection) -> None:
    """Make the tables outside the versions, and their later columns, where they are missing."""
    for statement in _UNVERSIONED.split(";"):
        connection.execute(statement)
    columns = {name for _, name, *_ in connection.execute("PRAGMA table_info(spectra)")}
    if "view" not in columns:
        connection.execute("ALTER TABLE spectra ADD COLUMN view BLOB")
