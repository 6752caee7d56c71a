"""What commands that draw share."""

from __future__ import annotations

from pathlib import Path

from monitor.commands.common import InputError

ENDINGS = (".png", ".svg", ".html")
"""Kinds of files that a model report is written as."""


def check_ending(option: str, path: Path) -> None:
    """Refuse a file that would be none of the kinds, before anything is computed for it.

    Raises:
        InputError: the name ends in something else.
    """
    if path.suffix.lower() not in ENDINGS:
        raise InputError(f"{option} {path}: expected a name that ends in .png, .svg or .html")
