"""What goes wrong with a store of chunks."""

from __future__ import annotations

from models.errors import SpallwatchError


class StoreError(SpallwatchError):
    """A folder or object store cannot be read or written; the message names its URL and the cause."""
