"""Doubts of the signal: rate, block and band against the lines of the bearings; sensitivity, mains, tacho."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from models.machine.bearing import kinematics
from monitor.config.interference import removed_lines
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.machine import speed_doubt
from monitor.config.plausible.rules import JudgedConfig, SourceFacts, place_of
from monitor.config.positions import Place
from monitor.config.source import ChannelSection, SourceSection
from monitor.health.signal.bands import candidate_bands
from monitor.health.signal.differentiate import USUAL_LIMIT
from monitor.health.signal.settings import N_HARMONICS, fundamentals
from streams.types.limits import MAX_BYTES

MIN_RATE_HZ = 200.0
"""Sampling rate below which no shaft of usual speed shows its bearing: that of a trend."""
_MAX_RATE_HZ = 2e7
_MIN_RESONANCE_HZ, _USUAL_RESONANCE_HZ, _MAX_RESONANCE_HZ = 100.0, 500.0, 50e3
_MIN_PERIODS = 8.0
"""Bins of the spectrum below the first line of a family that is named (``monitor.health.name``)."""
_MIN_CAGE_TURNS, _MAX_BLOCK_S = 2.0, 600.0
_MAX_CAGE_TURNS, _MAX_USUAL_BLOCK_S = 1000.0, 60.0
"""Turns of the cage beyond which a longer block shows no more of it, and length from which that is doubted."""
_MIN_SAMPLES_A_PULSE = 2.5
_MAINS_HZ, _MAINS_ORDERS, _STRONG_ORDERS = (50.0, 60.0), 6, 2
_SLIP = 0.005
"""Error of a fault line at a known speed. The strong multiples of the mains are avoided as far as the speed is open."""
_SENSITIVITY = (1.0, 1e4)
_BYTES_A_SAMPLE = 8


def signal_doubts(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what is doubtful in sources and channels, without what follows from a doubtful speed or rate."""
    config = subject.config
    speed = config.operating.speed_hz
    sure = speed is None or not _is_problem(speed_doubt(subject, ("operating", "speed_hz"), speed))
    for at, section in enumerate(config.source):
        facts = subject.facts_of(section.name)
        wrong = list(_rate(subject, at, section, facts))
        wrong += _block(subject, at, section, facts)
        yield from wrong
        if not any(doubt.rule == "rate" and doubt.severity == "problem" for doubt in wrong):
            known = facts if sure else replace(facts, speed=None)
            known = replace(known, duration=None) if any(doubt.rule == "block" for doubt in wrong) else known
            yield from _of_lines(subject, at, section, known)
            for channel in config.channel:
                if channel.source == section.name:
                    yield from _bands(subject, channel, known)
    for channel in config.channel:
        yield from _sensitivity(subject, channel)


def _is_problem(doubt: Doubt | None) -> bool:
    return doubt is not None and doubt.severity == "problem"


def _rate(subject: JudgedConfig, at: int, section: SourceSection, facts: SourceFacts) -> Iterator[Doubt]:
    rate = facts.rate
    if rate is None:
        return
    place: Place = ("source", at, "rate_hz")
    whose = "" if section.rate_hz is not None else " by its files"
    if rate < MIN_RATE_HZ:
        came = f"{rate:g} Hz{whose}, that of a trend; {1e3 * rate:g} Hz if kHz was meant"
        yield subject.doubt(
            "rate", "problem", place, f"at least {MIN_RATE_HZ:g} Hz: fault lines need the waveform", came
        )
    elif rate > _MAX_RATE_HZ:
        yield subject.doubt("rate", "problem", place, f"up to {_MAX_RATE_HZ:g} Hz", f"{rate:g} Hz{whose}")


def _lines(subject: JudgedConfig, channel: ChannelSection, speed: float) -> dict[str, float]:
    """Return the first line of each part of the bearing of a channel, Hz."""
    return fundamentals(kinematics(subject.config.bearing_of(channel), speed))


def _passages(lines: dict[str, float]) -> list[float]:
    """Return the first lines of all parts but the cage, ascending, Hz."""
    return sorted(line for part, line in lines.items() if part != "cage")


def _block(subject: JudgedConfig, at: int, section: SourceSection, facts: SourceFacts) -> Iterator[Doubt]:
    """Yield that a block is too long; that it is too short shows against the lines."""
    if section.block_s == "file":
        return
    place: Place = ("source", at, "block_s")
    length, rate = section.block_s, facts.rate
    if rate is not None and length * rate * _BYTES_A_SAMPLE > MAX_BYTES:
        expected = f"up to {MAX_BYTES / _BYTES_A_SAMPLE / rate:.4g} s at {rate:g} Hz (1 GiB)"
        yield subject.doubt("block", "problem", place, expected, f"{length:g} s; {1e-3 * length:g} s if ms was meant")
    elif facts.speed is None and length > _MAX_BLOCK_S:
        came = f"{length:g} s; {1e-3 * length:g} s if ms was meant"
        yield subject.doubt("block", "warning", place, f"up to {_MAX_BLOCK_S:g} s", came)


def _of_lines(subject: JudgedConfig, at: int, section: SourceSection, facts: SourceFacts) -> Iterator[Doubt]:
    """Yield what is doubtful in rate and length of block against the lines, each once for the worst bearing."""
    speed = facts.speed
    channels = [channel for channel in subject.config.channel if channel.source == section.name]
    if speed is None or not channels:
        return
    found = [_lines(subject, channel, speed) for channel in channels]
    if facts.rate is not None:
        yield from _nyquist(subject, ("source", at, "rate_hz"), facts.rate, found, speed)
    if section.block_revolutions is not None:
        yield from _resolution(subject, ("source", at, "block_revolutions"), section.block_revolutions / speed, found)
    elif facts.duration is not None:
        yield from _resolution(subject, ("source", at, "block_s"), facts.duration, found)
    if facts.rate is not None and subject.config.operating.tacho_channel is not None:
        yield from _tacho(subject, facts.rate, speed)
    named: dict[str, dict[str, float]] = {
        channel.bearing: lines for channel, lines in zip(channels, found, strict=True)
    }
    for bearing, lines in named.items():
        yield from _mains(subject, bearing, lines, facts.duration)


def _nyquist(
    subject: JudgedConfig, place: Place, rate: float, found: list[dict[str, float]], speed: float
) -> Iterator[Doubt]:
    first = max(_passages(lines)[0] for lines in found)
    fastest = max(_passages(lines)[-1] for lines in found)
    came = f"{rate:g} Hz, {rate / speed:.4g} samples a revolution"
    if rate < 2.0 * first:
        expected = f"more than {2.0 * first:.4g} Hz: the first line of the slowest part is {first:.4g} Hz"
        yield subject.doubt("rate", "problem", place, expected, came)
    elif rate < 2.0 * N_HARMONICS * fastest:
        expected = f"at least {2 * N_HARMONICS * fastest:.4g} Hz for {N_HARMONICS} harmonics of {fastest:.4g} Hz"
        yield subject.doubt("rate", "warning", place, expected, came)


def _resolution(subject: JudgedConfig, place: Place, length: float, found: list[dict[str, float]]) -> Iterator[Doubt]:
    first = min(_passages(lines)[0] for lines in found)
    cage = min(lines["cage"] for lines in found)
    if length * first < _MIN_PERIODS:
        expected = (
            f"at least {_MIN_PERIODS / first:.3g} s: {_MIN_PERIODS:g} periods of the slowest fault line, {first:.4g} Hz"
        )
        yield subject.doubt("block", "problem", place, expected, f"{length:.4g} s")
    elif length > _MAX_USUAL_BLOCK_S and length * cage > _MAX_CAGE_TURNS:
        came = f"{length:g} s, {length * cage:.4g} turns of the cage; {1e-3 * length:g} s if ms was meant"
        expected = f"up to {_MAX_CAGE_TURNS / cage:.3g} s: {_MAX_CAGE_TURNS:g} turns"
        yield subject.doubt("block", "warning", place, expected, came)
    elif length * cage < _MIN_CAGE_TURNS:
        expected = f"at least {_MIN_CAGE_TURNS / cage:.3g} s: {_MIN_CAGE_TURNS:g} turns of the cage"
        came = f"{length:.4g} s, {length * cage:.2g} turns: a resolution of {1.0 / length:.3g} Hz"
        yield subject.doubt("block", "warning", place, expected, came)


def _tacho(subject: JudgedConfig, rate: float, speed: float) -> Iterator[Doubt]:
    operating = subject.config.operating
    pulses = speed / operating.tacho_ratio * operating.pulses_per_revolution
    if rate < _MIN_SAMPLES_A_PULSE * pulses:
        place: Place = ("operating", "pulses_per_revolution")
        came = (
            f"{operating.pulses_per_revolution} pulses a revolution: {rate / pulses:.2g} samples a pulse at {rate:g} Hz"
        )
        yield subject.doubt("tacho_rate", "problem", place, f"at least {_MIN_SAMPLES_A_PULSE:g} samples a pulse", came)


def _mains(subject: JudgedConfig, bearing: str, lines: dict[str, float], length: float | None) -> Iterator[Doubt]:
    """Yield the first lines of a bearing that a multiple of the mains may pass for."""
    operating = subject.config.operating
    combs = (comb for each in removed_lines(subject.config) for comb in each.combs(operating.speed_hz or 1.0))
    removed = [comb.fundamental for comb in combs]
    found: list[str] = []
    for part, line in lines.items():
        if part == "cage":
            continue
        near, order = min(
            ((order * mains, order) for mains in _MAINS_HZ for order in range(1, _MAINS_ORDERS + 1)),
            key=lambda pair: abs(pair[0] - line),
        )
        reach = min(_SLIP * line, math.inf if length is None else 1.0 / length)
        if order <= _STRONG_ORDERS and not operating.speed_exact:
            reach = max(reach, 0.5 * operating.speed_tolerance * line)
        if abs(near - line) <= reach and not any(_divides(comb, near) for comb in removed):
            found.append(f"{part} {line:.4g} Hz beside {near:g} Hz")
    if found:
        place = place_of(subject.config, "bearing", bearing)
        expected = "fault lines apart from multiples of 50 and 60 Hz, or [[interference]] lines_hz that removes them"
        yield subject.doubt("mains", "warning", place, expected, ", ".join(found))


def _divides(comb: float, line: float) -> bool:
    return comb > 0.0 and abs(line / comb - round(line / comb)) < 1e-3


def _bands(subject: JudgedConfig, channel: ChannelSection, facts: SourceFacts) -> Iterator[Doubt]:
    lines = [] if facts.speed is None else _passages(_lines(subject, channel, facts.speed))
    if channel.measures_velocity:
        yield from _of_velocity(subject, channel, lines, facts.rate)
    for band in () if channel.band_hz == "auto" else channel.band_hz:
        place = place_of(subject.config, "channel", channel.name, "band_hz")
        yield from _band(subject, place, band, lines, facts.rate)
    if channel.rms_band_hz is not None:
        place = place_of(subject.config, "channel", channel.name, "rms_band_hz")
        yield from _reach(subject, place, channel.rms_band_hz, facts.rate)


def _of_velocity(
    subject: JudgedConfig, channel: ChannelSection, lines: list[float], rate: float | None
) -> Iterator[Doubt]:
    """Yield that a sensor of velocity does not reach a band, or that it leaves none."""
    place = place_of(subject.config, "channel", channel.name, "band_hz")
    limit = channel.velocity_limit
    if channel.sensor_max_hz is None and limit > USUAL_LIMIT:
        expected = f"bands up to {USUAL_LIMIT:g} Hz, as usual sensors of velocity measure, or its sensor_max_hz"
        yield subject.doubt("band", "warning", place, expected, f"up to {limit:g} Hz")
    elif channel.band_hz == "auto" and lines:
        try:
            candidate_bands(rate or 2.0 * limit, lines[-1], limit)
        except ValueError as error:
            yield subject.doubt("band", "problem", place, "a band that is given, or a higher sensor_max_hz", str(error))


def _reach(subject: JudgedConfig, place: Place, band: tuple[float, float], rate: float | None) -> Iterator[Doubt]:
    """Yield that a band lies where no resonance is, or above the Nyquist frequency."""
    low, high = band
    if high < _MIN_RESONANCE_HZ:
        expected = f"an upper edge above {_USUAL_RESONANCE_HZ:g} Hz, where machines resonate"
        came = f"[{low:g}, {high:g}] Hz; [{1e3 * low:g}, {1e3 * high:g}] Hz if kHz was meant"
        yield subject.doubt("band", "problem", place, expected, came)
    elif rate is not None and high > 0.5 * rate:
        expected = f"up to {0.5 * rate:g} Hz, half the sampling rate"
        yield subject.doubt("band", "problem", place, expected, f"[{low:g}, {high:g}] Hz")


def _band(
    subject: JudgedConfig, place: Place, band: tuple[float, float], lines: list[float], rate: float | None
) -> Iterator[Doubt]:
    wrong = list(_reach(subject, place, band, rate))
    if wrong:
        yield from wrong
        return
    low, high = band
    came = f"[{low:g}, {high:g}] Hz, {high - low:g} Hz wide"
    if lines and high - low < lines[0]:
        expected = f"wider than {lines[0]:.4g} Hz, the first line of the slowest part"
        yield subject.doubt("band", "problem", place, expected, came)
    elif lines and high - low < N_HARMONICS * lines[-1]:
        expected = f"at least {N_HARMONICS * lines[-1]:.4g} Hz wide: {N_HARMONICS} harmonics of {lines[-1]:.4g} Hz"
        yield subject.doubt("band", "warning", place, expected, came)
    elif high < _USUAL_RESONANCE_HZ or low > _MAX_RESONANCE_HZ:
        expected = f"a resonance between {_USUAL_RESONANCE_HZ:g} Hz and {_MAX_RESONANCE_HZ / 1e3:g} kHz"
        yield subject.doubt("band", "warning", place, expected, came)


def _sensitivity(subject: JudgedConfig, channel: ChannelSection) -> Iterator[Doubt]:
    value = channel.sensitivity_mv_per_g
    least, most = _SENSITIVITY
    if value is None or least <= value <= most:
        return
    place = place_of(subject.config, "channel", channel.name, "sensitivity_mv_per_g")
    meant = (
        f"; {1e3 * value:g} mV/g if V/g was meant" if value < least else f"; {1e-3 * value:g} mV/g if uV/g was meant"
    )
    yield subject.doubt("sensitivity", "problem", place, f"{least:g} to {most:g} mV/g", f"{value:g} mV/g{meant}")
