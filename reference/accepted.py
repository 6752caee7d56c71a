"""The acceptance rows of each model, which its own tests and those of the document look at."""

from __future__ import annotations

from importlib import import_module

from models.published.acceptance import AcceptanceRow
from reference.once import shared_by_workers

ACCEPTANCE = (
    "models.published.beat",
    "models.published.ceruti",
    "models.published.marin",
    "models.published.thibault",
    "models.published.thibault_shaft",
    "models.gears.published",
)
"""Modules of printed figures other than those of the thesis' bearings."""


@shared_by_workers
def rows_of(module: str) -> list[AcceptanceRow]:
    """Return ``acceptance_rows`` of a module with printed figures, such as ``models.published.beat``."""
    return import_module(module).acceptance_rows()
