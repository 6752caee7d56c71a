"""``[advice]``: what to do next, by state, in the words of the plant."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from monitor.config.fields import Section
from monitor.words.advice import ADVICE, check_advice


def _checked(text: str) -> str:
    check_advice(text)
    if not text.isprintable():
        raise ValueError("expected one line of text")
    return text


Advice = Annotated[str, Field(max_length=500), AfterValidator(_checked)]


class AdviceSection(Section):
    """One line of text for each state, with the places of ``monitor.words.advice.PLACES`` in braces."""

    normal: Advice = ADVICE["normal"]
    learning: Advice = ADVICE["learning"]
    watch: Advice = ADVICE["watch"]
    gear: Advice = ADVICE["gear"]
    warning: Advice = ADVICE["warning"]
    danger: Advice = ADVICE["danger"]
    end_of_life: Advice = ADVICE["end_of_life"]
    sensor_fault: Advice = ADVICE["sensor_fault"]
    no_data: Advice = ADVICE["no_data"]

    @property
    def texts(self) -> dict[str, str]:
        """The text of each state."""
        return {name: getattr(self, name) for name in ADVICE}
