"""Recovery of a lost or damaged store: the rows that SQLite can read, and the published records."""
