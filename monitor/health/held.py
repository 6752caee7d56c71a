"""The part that a verdict names, once it has held, and when it gives way to another.

A name counts after as many usable blocks in a row as an onset needs (``persist_blocks``). From then on it is held: a
name that shares a part with it ("inner|ball" for "inner") leaves it as it is; another has to hold for as long to take
its place. Hints do not count. With the final stage what is held ends.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from monitor.health.name.evidence import parts_of


@dataclass(frozen=True)
class HeldName:
    """The name of a bearing's verdict that has held.

    Attributes:
        fault: None until one has held.
        rival: the latest name that shares no part with it, while it is named.
        blocks: usable blocks in a row that named the rival.
    """

    fault: str | None = None
    rival: str | None = None
    blocks: int = 0

    def after(self, fault: str | None, persist_blocks: int) -> HeldName:
        """Return what is held after one more usable block of an open final stage.

        Args:
            fault: name of the verdict, None where there is none.
            persist_blocks: usable blocks in a row after which a name is held.
        """
        if fault is None or parts_of(fault) & parts_of(self.fault):
            return HeldName(self.fault)
        blocks = self.blocks + 1 if fault == self.rival else 1
        return HeldName(fault) if blocks >= persist_blocks else HeldName(self.fault, fault, blocks)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> HeldName:
        """Return what :meth:`to_dict` gave."""
        return cls(stored["fault"], stored["rival"], stored["blocks"])
