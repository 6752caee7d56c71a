"""Makers and checks that tests of docs share."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


DOCS = ROOT / "docs"


FOR_USERS = ("tutorials", "how-to", "reference", "explanation")


def read(page: Path) -> str:
    return page.read_text(encoding="utf-8")
