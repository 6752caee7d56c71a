"""The base exceptions of the three floors."""

from __future__ import annotations

from typing import ClassVar


class SpallwatchError(Exception):
    """A failure that spallwatch foresees; the message is complete without a traceback.

    Attributes:
        exit_code: exit code of a command that it ends: 1 failed while running, 2 wrong usage or configuration.
    """

    exit_code: ClassVar[int] = 1


class WrongInputError(SpallwatchError):
    """Something that the user gave cannot be used; the message names it, what was expected and what was found."""

    exit_code = 2
