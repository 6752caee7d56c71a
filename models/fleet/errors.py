"""What goes wrong with a cluster."""

from __future__ import annotations

from models.words.errors import SpallwatchError, WrongInputError


class ClusterError(SpallwatchError):
    """The scheduler or its workers are not reached, or not for too long; the message says which and how long."""


class RefusedWorkerError(WrongInputError):
    """A scheduler or workers cannot be used; the message names each, what was expected and what came."""
