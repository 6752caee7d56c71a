"""What goes wrong with an object storage."""

from __future__ import annotations

from models.errors import SpallwatchError


class ObjectStorageError(SpallwatchError):
    """A request to an object storage failed; the message names its URL and the cause, without credentials."""
