"""Mesh rules by name, for people who choose between speed and error."""

from __future__ import annotations

from typing import Literal

from models.fe.sizing import MeshRule

MeshName = Literal["coarse", "default", "fine"]

NAMED_RULES: dict[MeshName, MeshRule] = {
    "coarse": MeshRule(patch=1.6, size=0.8, growth=2.0, along=4),
    "default": MeshRule(),
    "fine": MeshRule(patch=1.6, size=0.27, growth=1.5, along=7),
}
"""Elements across the half width of the contact: about 1, 2 and 4."""
