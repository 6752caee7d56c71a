"""``spallwatch gear``: a gear train, its orders, forces and levels."""

from __future__ import annotations

from models.words.extras import Command

GEAR = Command("monitor.gears.command:command", "A gear train: speeds, mesh orders, forces, levels.", after="bearing")
