"""What the numbers of a row mean: their unit, the sensitivity of the sensor, what one count is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from streams.files.statements import is_of_counts, is_of_vibration, multiple_of, quantity_words
from streams.types.block import STANDARD_GRAVITY, VELOCITY
from streams.types.large import elementwise
from streams.types.samples import DIGITAL, FRACTIONS, SCALED, VALUES, ReaderError, Samples, Sensitivity
from streams.types.spec import UNITS, ChannelSpec

_LEVEL_TOLERANCE = 0.01


def rows_as_stored(
    samples: Samples,
    channels: Sequence[ChannelSpec],
    rows: Sequence[int],
    where: str,
    range_g: float | None = None,
) -> frozenset[int]:
    """Return the rows that channels take in V, or scale themselves; ``range_g`` is the configured full scale.

    Raises:
        ReaderError: ``wrong_unit`` where the recording states another sensitivity, or another value of one count.
    """
    for channel, row in zip(channels, rows, strict=True):
        if samples.sensitivities[row] is None and samples.count_scales[row] is None:
            continue
        told = f"{where}: channel {channel.name}"
        level, in_volts, of_volts = samples.sensitivities[row], None, None
        if level is not None:
            own, size = multiple_of(samples.units[row])
            _check_quantity(level, own, channel, told)
            in_volts = None if samples.open_gain else level.millivolts
            of_volts = 1e3 * size / level.millivolts if in_volts and own == "V" and channel.unit == VELOCITY else None
        of_one_g = STANDARD_GRAVITY if channel.unit == "m/s2" else 1.0
        is_fraction = samples.stored[row] == FRACTIONS
        scale = None if channel.scale is None or channel.unit not in ("g", "m/s2") else channel.scale / of_one_g
        for key, unit, stated, given in (
            ("sensitivity_mv_per_g", "mV/g", in_volts, channel.sensitivity_mv_per_g),
            ("scale", f"mm/s a {samples.units[row]}", of_volts, channel.scale),
            ("scale", "g a count", samples.count_scales[row], scale),
            ("range_g", "g at full scale", samples.count_scales[row] if is_fraction else None, range_g),
        ):
            if stated is not None and given is not None and abs(stated - given) > _LEVEL_TOLERANCE * abs(given):
                reason = f"{stated:g} {unit} by the recording, {given:g} by {key}"
                raise ReaderError("wrong_unit", f"{told}: {reason}")
    return frozenset(
        row
        for channel, row in zip(channels, rows, strict=True)
        if channel.unit == "V" or channel.any_unit or channel.scale is not None
    )


def _check_quantity(level: Sensitivity, own: str, channel: ChannelSpec, told: str) -> None:
    """Refuse a channel of a row in ``own`` unit whose sensitivity is one of another quantity."""
    quantity = {"V": "g", "g": "g", "m/s2": "g", VELOCITY: VELOCITY}.get(channel.unit or "")
    if own == "V" and quantity not in (None, level.unit):
        meant, stated = (
            f"{'a velocity' if unit == VELOCITY else 'an acceleration'}" for unit in (quantity, level.unit)
        )
        given = "sensitivity_mv_per_g" if channel.unit == "V" else f"unit = {channel.unit!r}"
        reason = f"{given} is of {meant}, but the recording states {level.words}, of {stated}"
        raise ReaderError("wrong_unit", f'{told}: {reason}; write unit = "{level.unit}"')


def refuse_open(samples: Samples, row: int, channel: ChannelSpec | None, where: str) -> None:
    """Raise ReaderError ``wrong_unit`` where a gain or a factor leaves the level of a row open; None: no channel."""
    unit = multiple_of(samples.units[row])[0]
    if channel is not None and channel.any_unit:
        return
    if samples.open_multiplier and (channel is None or channel.scale is None) and (unit == "" or is_of_vibration(unit)):
        told = f"{samples.open_multiplier} may have been applied or not; give [[channel]] scale"
        raise ReaderError("wrong_unit", f"{where}: {told}, or name it in disregard")
    gain, level = samples.open_gain, samples.sensitivities[row]
    is_scaled = channel is not None and (
        (channel.unit == "V" and level is not None) or (channel.unit == VELOCITY and channel.scale is not None)
    )
    if gain is None or unit != "V" or is_scaled:
        return
    told, way = gain.words, "if sensitivity_mv_per_g contains it,"
    if level is not None:
        both = level.words
        if gain.factor is not None:
            both = f"{level.millivolts:g} or {level._replace(millivolts=level.millivolts * gain.factor).words}"
        told = f"the sensitivity may hold for the sensor alone or with {gain.words}, {both}"
        way = f"give [[channel]] {'sensitivity_mv_per_g' if level.unit == 'g' else 'scale'} of both, or"
    raise ReaderError("wrong_unit", f"{where}: in V; {told}; {way} name the gain in disregard")


def in_own_units(samples: Samples, as_stored: frozenset[int] = frozenset()) -> tuple[Samples, tuple[float, ...]]:
    """Return the samples with our unit for each multiple of it, such as V for mV, and the factors still to apply.

    Rows in V are in g or mm/s where the file states the sensitivity and no gain, rows of counts where it states one
    count; but for those that are wanted ``as_stored``.
    """
    both, stored = [multiple_of(unit) for unit in samples.units], list(samples.stored)
    for row, (unit, level, count) in enumerate(
        zip(samples.units, samples.sensitivities, samples.count_scales, strict=True)
    ):
        if row in as_stored:
            continue
        if both[row][0] == "V" and level is not None and samples.open_gain is None:
            both[row] = level.unit, both[row][1] * 1e3 / level.millivolts
        elif count is not None and is_of_counts(unit) and not samples.scaled:
            both[row], stored[row] = ("g", count), SCALED
    units, factors = tuple([own or None for own, _ in both]), tuple([factor for _, factor in both])
    is_same = (units, tuple(stored)) == (samples.units, samples.stored)
    return samples if is_same else samples.changed(units=units, stored=tuple(stored)), factors


def scaled_by(samples: Samples, factors: Sequence[float]) -> Samples:
    """Return samples whose rows are multiplied by a factor each."""
    if factors.count(1.0) == len(factors):
        return samples
    column = np.array(factors, samples.values.dtype)[:, np.newaxis]
    return samples.changed(values=elementwise(lambda values: values * column, samples.values, 1))


def check_unit(stated: str | None, name: str, where: str) -> None:
    """Raise ReaderError ``wrong_unit`` for a row without a channel whose unit is none of ours."""
    if stated is None:
        raise ReaderError("wrong_unit", f"{where}: no unit is stated; give [[channel]] unit")
    if stated not in UNITS:
        raise ReaderError(
            "wrong_unit",
            f"{where}: {name} is in {stated!r}{quantity_words(stated)}; expected one of {', '.join(UNITS)}",
        )
    if stated == "V":
        raise ReaderError("wrong_unit", f"{where}: in V; give [[channel]] sensitivity_mv_per_g or a side-car")


def unit_of(samples: Samples, row: int, channel: ChannelSpec, where: str) -> str:
    """Return the unit of a row by the recording and the channel.

    Raises:
        ReaderError: ``wrong_unit`` where neither states one, they differ, or both scale it.
    """
    if channel.any_unit:
        return "unknown"
    stated, configured = samples.units[row], channel.unit
    if channel.scale is not None and (
        is_of_counts(stated) or (configured == VELOCITY and multiple_of(stated)[0] == "V")
    ):
        stated = None
    where = f"{where}: channel {channel.name}"
    if samples.scaled and channel.scale not in (None, 1.0):
        reason = f"the side-car scales it already, and so does scale = {channel.scale:g}"
        raise ReaderError("wrong_unit", f"{where}: {reason}")
    if stated is None and configured is None:
        raise ReaderError("wrong_unit", f"{where}: no unit is stated; give [[channel]] unit")
    if configured is not None and stated not in (None, "unknown", configured):
        hint = f'; write unit = "{stated}"' if stated in UNITS else quantity_words(stated)
        raise ReaderError("wrong_unit", f"{where}: the recording is in {stated}, unit = {configured!r}{hint}")
    if configured is None and (stated not in UNITS or stated == "V"):
        hint = quantity_words(stated) or "; give [[channel]] unit"
        raise ReaderError("wrong_unit", f"{where}: the recording is in {stated}{hint}")
    return configured or stated or "unknown"


def factor_of(
    samples: Samples, row: int, channel: ChannelSpec, unit: str | None, range_g: float | None, where: str
) -> float:
    """Return the factor that ``range_g`` gives a row in a unit that no scale is given for; 1 for all others.

    Raises:
        ReaderError: ``wrong_unit`` where the row holds integers and nothing states what they mean.
    """
    stored = samples.stored[row]
    if stored in (VALUES, SCALED, DIGITAL) or unit == "unknown" or channel.scale is not None:
        return 1.0
    if stored == FRACTIONS and range_g is not None and not samples.scaled and unit != VELOCITY:
        of_one_g = {"m/s2": STANDARD_GRAVITY, "V": 1e-3 * (channel.sensitivity_mv_per_g or 0.0)}
        return range_g * of_one_g.get(unit or "g", 1.0)
    meant, other = f"the {unit} of one count", ""
    if stored == FRACTIONS:
        meant = f"the {unit} at full scale"
        other = ", or [[source]] range_g, the g at full scale" if unit != VELOCITY else ""
    raise ReaderError(
        "wrong_unit",
        f"{where}: holds {stored}, and nothing states their level; give [[channel]] scale, {meant} "
        f"(a side-car may too){other}",
    )


def level_in_words(samples: Samples, row: int, channel: ChannelSpec, unit: str, range_g: float | None) -> str:
    """Return in words what states the level of a row: its unit and, of integers, what they mean."""
    stated, stored, scale = samples.units[row], samples.stored[row], channel.scale
    parts = [f"{unit} ({'configured' if stated is None else 'stated by the file or its side-car'})"]
    if unit == "V":
        parts.append(f"{channel.sensitivity_mv_per_g:g} mV per g")
    if stored == SCALED:
        parts.append("integers, scaled as the file or its side-car states")
    elif stored != VALUES and unit != "unknown":
        meant = "full scale is" if stored == FRACTIONS else "one count is"
        level = "not stated"
        if scale is not None:
            level = f"{scale:g} {unit} (scale)"
        elif stored == FRACTIONS and range_g is not None:
            level = f"{range_g:g} g (range_g)"
        parts.append(f"integers, {meant} {level}")
    elif samples.scaled:
        parts.append("scaled by the side-car")
    elif scale not in (None, 1.0):
        parts.append(f"times {scale:g} (scale)")
    return ", ".join(parts)
