"""A doubt: what was expected of a key of the configuration or of a recording, and what came."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["problem", "warning"]


@dataclass(frozen=True)
class Doubt:
    """What is doubtful in a configuration or a recording.

    Attributes:
        rule: name of the rule in ``monitor.config.plausible.rules``.
        severity: "problem" where results are wrong, or absent although asked for; else "warning".
        expected, came: in words.
        place: of the key in the configuration, or its end below a channel.
        key: the same for people, "channel[x].unit".
    """

    rule: str
    severity: Severity
    expected: str
    came: str
    place: tuple[str | int, ...] = ()
    key: str = ""

    @property
    def text(self) -> str:
        """Key, what came and what was expected, in one line."""
        return f"{self.key}: {self.came}; expected {self.expected}"
