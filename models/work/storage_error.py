"""What goes wrong with a store."""

from __future__ import annotations

from models.words.errors import SpallwatchError


class ObjectStorageError(SpallwatchError):
    """A request to an object storage failed; the message names its URL and the cause, without credentials."""


class LostFolderError(SpallwatchError):
    """The folder of a store can no longer be written; the message names it and the cause."""
