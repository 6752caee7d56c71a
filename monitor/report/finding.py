"""A question about a channel and its answer."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """A question and its answer from the records, one sentence at most.

    Attributes:
        support: evidence and its uncertainty, or the reason of a refusal.
        known: False for a refusal.
        brief: for a table, "" for none.
    """

    question: str
    answer: str
    support: str
    known: bool = True
    brief: str = ""
