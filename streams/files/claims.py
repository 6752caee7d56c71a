"""What a data set says of its files by their names, against what the files state."""

from __future__ import annotations

from typing import TYPE_CHECKING

from streams.files.judge import JudgedRate, opened_rate
from streams.files.statements import is_of_vibration, multiple_of
from streams.types.samples import ReaderError, Samples
from streams.types.spec import UNITS

if TYPE_CHECKING:
    from streams.files.datasets import DataSet, FileFacts

ANOTHER_LOGGER = "; files of another logger need [[source]] format, such as csv or mat"
"""Behind a refusal of a file that contradicts its data set."""
_SPEED_TOLERANCE = 0.1
"""Relative; a shaft is up to 6 % off the speed that a name gives."""


def check_claims(data_set: DataSet, facts: FileFacts, samples: Samples, where: str) -> None:
    """Compare what a file, or what stands beside it, states with what its data set says of its name.

    Raises:
        ReaderError: ``wrong_rate``, ``wrong_unit`` or ``unreadable`` (the speed) where they differ; it quotes both.
    """
    name = data_set.name
    stated = JudgedRate(None, (samples.rate,)) if samples.rate is not None else opened_rate(samples)
    if facts.rate is not None and stated.readings and not stated.fits(facts.rate):
        own = f"{samples.rate_written} is {stated.meant}" if samples.rate_written else f"the file states {stated.meant}"
        raise ReaderError("wrong_rate", f"{where}: {own}, {name} has {facts.rate:g} Hz by its name{ANOTHER_LOGGER}")
    for unit in samples.units:
        if data_set.unit in UNITS and is_of_vibration(unit) and multiple_of(unit)[0] != data_set.unit:
            own = f"the file states {unit}, {name} is in {data_set.unit}"
            raise ReaderError("wrong_unit", f"{where}: {own}{ANOTHER_LOGGER}")
    speed = samples.stated_speed
    if facts.speed is not None and speed is not None and abs(speed - facts.speed) > _SPEED_TOLERANCE * facts.speed:
        own = f"the file states {60.0 * speed:.6g} rpm, {name} has {60.0 * facts.speed:.6g} rpm by its name"
        raise ReaderError("unreadable", f"{where}: {own}{ANOTHER_LOGGER}")
