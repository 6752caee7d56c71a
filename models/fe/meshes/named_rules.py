"""Mesh rules by name, for people who choose between speed and error."""

from __future__ import annotations

from typing import Literal

from models.fe.meshes.sizing import MeshRule

MeshName = Literal["coarse", "default", "fine"]

# Cells on the rounded edge of a roller: without them the pressure at its end grows with each refinement.
_OVER = 2

NAMED_RULES: dict[MeshName, MeshRule] = {
    "coarse": MeshRule(patch=1.6, size=0.8, growth=2.0, along=4, over=_OVER),
    "default": MeshRule(over=_OVER),
    "fine": MeshRule(patch=1.6, size=0.27, growth=1.5, along=7, over=_OVER),
}
"""Elements across the half width of the contact: about 1, 2 and 4."""
