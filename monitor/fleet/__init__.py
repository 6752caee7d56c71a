"""Archives: many recordings of many machines, replayed into one place."""

from __future__ import annotations

from models.words.extras import Command

ARCHIVE = Command("monitor.fleet.command:group", "Many recordings of many machines, also on a cluster.", after="score")
