"""What a folder's file system is, and how to make a file there durable."""

from __future__ import annotations

import os
from pathlib import Path

from streams.folder.listing import NETWORK_FILE_SYSTEMS, file_system_type

__all__ = ["NETWORK_FILE_SYSTEMS", "file_system_type", "replace_durably", "sync_folder"]


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable: a rename survives a power cut only after this."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def replace_durably(temporary: Path, target: Path) -> None:
    """Put a finished file in the place of another at once: readers see the old one or the new one, never a part."""
    descriptor = os.open(temporary, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
    temporary.replace(target)
    sync_folder(target.parent)
