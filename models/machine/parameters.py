"""What the parameter types of all models share."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class RigParameters:
    """Base of the parameters of a model's machine, without fields of its own."""

    def as_dict(self) -> dict[str, Any]:
        """Return the parameters as plain values, from which the type makes the same rig as keyword arguments."""
        return asdict(self)
