"""Identification of the parameters of a rig: ``spallwatch identify``, its files and its page."""

from __future__ import annotations

from models.words.extras import Command

IDENTIFY = Command(
    "monitor.identify.command:command", "Parameters of a rig from tests with known defects.", after="library"
)
