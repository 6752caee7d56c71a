"""Doubts about the clocks of several sources: loggers out of step."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations

from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig, place_of
from streams.dates.pairs import apart_words, disjoint_words


def clock_doubts(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield which sources state times that cannot all be those of one machine."""
    facts = {
        section.name: subject.facts[section.name] for section in subject.config.source if section.name in subject.facts
    }
    spans = {name: found.span for name, found in facts.items() if found.span is not None}
    words = list(disjoint_words(spans))
    lags = {name: found.lag for name, found in facts.items() if found.lag is not None}
    pairs = (apart_words(one, other, (lags[one], lags[other])) for one, other in combinations(lags, 2))
    words += [text for text in pairs if text is not None]
    for text in words:
        yield subject.doubt(
            "clocks", "warning", place_of(subject.config, "source", list(facts)[-1]), "sources in step", text
        )
