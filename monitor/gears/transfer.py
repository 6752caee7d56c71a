"""``spallwatch gear --frf`` and ``--atv``: what the forces on the bearings become on the casing and in the air."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.gears.sound.levels import (
    MIN_LINES,
    REFERENCE_PRESSURE,
    Bands,
    bands_of_density,
    density_of_record,
    level_db,
    power,
    sum_db,
)
from models.gears.sound.transfer_files import read_transfer_vectors
from models.gears.sound.transfer_vectors import TransferVectors
from models.gears.sound.wav import full_scale_for, write_wav
from models.gears.transfer.frf import MOTION_UNITS, FrequencyResponses
from monitor.commands.common import InputError, finite, output_errors
from monitor.gears.config.section import GearSection
from monitor.gears.forces import GearRun
from monitor.gears.frf_files import read_frf
from streams.types.block import STANDARD_GRAVITY

Array = NDArray[np.float64]

REFERENCE_ACCELERATION = 1e-6
"""Reference of levels of acceleration, m/s2 (ISO 1683)."""
MAX_LEAD_S = 2.0
"""Longest time that is left out at either end, where the forces begin and end."""
_PRESSURE = "Pa"
_AUDIBLE = (10.0, 20000.0)
_SEGMENTS = 1.01
_CYCLES = 1.05 * MIN_LINES
"""Widths of a band, times the length of the record, from which it is resolved."""
_ROUNDED = 2e-3
"""A band of responses that ends at the rounded edge of a third octave, such as 562 or 2818 Hz, still has it."""


@dataclass(frozen=True, eq=False)
class CasingResponses:
    """Responses to the forces on the bearings.

    Attributes:
        motion: m/s2 over N at points of the casing, None where there are none.
        pressure: Pa over N at microphones, None where there are none.
    """

    motion: FrequencyResponses | None
    pressure: FrequencyResponses | None

    @property
    def lead(self) -> float:
        """Time after which a casing that began at rest moves as if it always had, s; left out at both ends."""
        steps = [np.diff(part.frequency).min() for part in (self.motion, self.pressure) if part is not None]
        return min(MAX_LEAD_S, 1.0 / float(min(steps))) if steps else 0.0


def read_casing(gear: GearSection, frf: Path, atv: Path | None) -> CasingResponses:
    """Return the responses of a casing to the bearings of a train.

    Args:
        gear: section; inputs of the responses are ``NAME.x`` and ``NAME.y`` of its supports.
        frf: responses of the casing (CSV, UFF58).
        atv: acoustic transfer vectors, whose points are outputs of the responses, or None.

    Raises:
        InputError: a file cannot be read, or names and units do not meet.
        FrfError, TransferVectorError: its content cannot be used.
    """
    try:
        content = frf.read_bytes()
    except OSError as error:
        raise InputError(f"--frf {frf}: cannot be read: {error.strerror or error}") from None
    return casing_of(gear, read_frf(content, str(frf)), f"--frf {frf}", atv)


def casing_of(gear: GearSection, found: FrequencyResponses, where: str, atv: Path | None) -> CasingResponses:
    """Return the responses of a casing, of which those to other inputs are left out; ``where`` names them."""
    wanted = [f"{support.name}.{axis}" for support in gear.support for axis in "xy"]
    if missing := [name for name in wanted if name not in found.inputs]:
        raise InputError(
            f"{where}: no response to {missing[0]!r}; expected inputs NAME.x and NAME.y of each [[gear.support]], "
            f"found {', '.join(found.inputs[:8])}{', ...' if len(found.inputs) > 8 else ''}"
        )
    if found.input_unit != "N":
        raise InputError(f"{where}: expected responses to forces in N, found {found.input_unit}")
    responses = found.select(inputs=wanted)
    if responses.output_unit == _PRESSURE:
        if atv is not None:
            raise InputError(f"--atv {atv}: needs the motion of the surface, but {where} has pressures")
        return CasingResponses(None, responses)
    if responses.output_unit not in MOTION_UNITS:
        raise InputError(f"{where}: expected outputs in {', '.join(MOTION_UNITS)} or Pa, found {responses.output_unit}")
    if atv is None:
        return CasingResponses(responses.in_unit("m/s2"), None)
    try:
        vectors = read_transfer_vectors(atv)
    except OSError as error:
        raise InputError(f"--atv {atv}: cannot be read: {error.strerror or error}") from None
    pressure, used = heard(responses, vectors, where, f"--atv {atv}")
    others = [name for name in responses.outputs if name not in used]
    return CasingResponses(responses.select(outputs=others).in_unit("m/s2") if others else None, pressure)


def heard(
    responses: FrequencyResponses, vectors: TransferVectors, where: str, what: str
) -> tuple[FrequencyResponses, set[str]]:
    """Return the pressures at the microphones over the forces, and the outputs of the responses that they take.

    A point of the vectors is the output of its name, its normal velocity, or NAME.x, .y and .z along its normal.

    Raises:
        InputError: a point has no output, or fewer than two lines of the responses are within the vectors' frequencies.
    """
    low, high = float(vectors.frequency[0]), float(vectors.frequency[-1])
    inside = (responses.frequency >= low) & (responses.frequency <= high) & (responses.frequency > 0.0)
    if np.count_nonzero(inside) < 2:
        raise InputError(
            f"{what}: {low:g} to {high:g} Hz has fewer than two lines in common with {where}, "
            "{:g} to {:g} Hz".format(*responses.band)
        )
    frequency = responses.frequency[inside]
    velocity = responses.h[inside] * (2j * math.pi * frequency[:, None, None]) ** (
        MOTION_UNITS.index("m/s") - MOTION_UNITS.index(responses.output_unit)
    )
    place = {name: index for index, name in enumerate(responses.outputs)}
    normal = np.zeros((len(vectors.points), len(place)))
    for row, point in enumerate(vectors.points):
        axes = [f"{point}.{axis}" for axis in "xyz"]
        if point in place:
            normal[row, place[point]] = 1.0
        elif vectors.normal is not None and all(name in place for name in axes):
            normal[row, [place[name] for name in axes]] = vectors.normal[row]
        else:
            along = "" if vectors.normal is None else f", or {', '.join(axes)}"
            raise InputError(f"{where}: no output for the point {point!r} of {what}; expected {point}{along}")
    h = np.stack([vectors.at(f)[0] @ (normal @ v) for f, v in zip(frequency, velocity, strict=True)])
    used = {name for name, index in place.items() if normal[:, index].any()}
    return FrequencyResponses(frequency, h, vectors.microphones, responses.inputs, _PRESSURE), used


@dataclass(frozen=True, eq=False)
class Felt:
    """Records of outputs between the leads.

    Attributes:
        names: of the outputs.
        values: m/s2 or Pa, (outputs, samples).
        rate: Hz.
        bands: third-octave bands that lie within the responses and below half the rate, and that the record resolves.
        outside: largest share of the variance of a force that lies outside the band of the responses.
        band: of the responses, Hz.
    """

    names: tuple[str, ...]
    values: Array
    rate: float
    bands: Bands
    outside: float
    band: tuple[float, float]

    @cached_property
    def _density(self) -> tuple[Array, Array]:
        """Lines as near as the record allows, as mesh lines are tones and may be near an edge, and their density."""
        return density_of_record(self.values, self.rate, _SEGMENTS * self.rate / self.values.shape[1])

    @cached_property
    def squares(self) -> Array:
        """Mean squares by output and band."""
        return self.weighted("Z")

    def weighted(self, weighting: str) -> Array:
        """Return mean squares by output and band, with a weighting (A, C or Z)."""
        frequency, density = self._density
        return bands_of_density(frequency, density * power(frequency, weighting), self.bands)


def felt(run: GearRun, responses: FrequencyResponses, lead: float) -> Felt:
    """Return the outputs of responses to the forces on the bearings, without ``lead`` seconds at both ends.

    Raises:
        InputError: no third-octave band lies within the responses, or the record is too short for any.
    """
    rate = run.motion.rate
    forces = np.stack([run.forces[name.rpartition(".")[0]][:, "xy".index(name[-1])] for name in responses.inputs])
    forces -= forces.mean(axis=1, keepdims=True)
    ends = round(lead * rate)
    bands = bands_within(responses.band, rate, (forces.shape[1] - 2 * ends) / rate)
    # Nothing rings in what is kept: the forces rise and fall smoothly in what is left out.
    rise = 0.5 - 0.5 * np.cos(math.pi * (np.arange(ends) + 0.5) / max(ends, 1))
    forces[:, :ends] *= rise
    forces[:, forces.shape[1] - ends :] *= rise[::-1]
    try:
        found = responses.apply(forces, rate)
    except ValueError as error:
        raise InputError(f"responses: {error}") from None
    values = found.values[:, ends : forces.shape[1] - ends]
    return Felt(responses.outputs, values, rate, bands, float(found.outside.max()), responses.band)


def bands_within(band: tuple[float, float], rate: float, seconds: float) -> Bands:
    """Return the third-octave bands between two frequencies, Hz, that a record at a rate, Hz, resolves.

    Raises:
        InputError: there is none.
    """
    low, high = band[0] * (1.0 - _ROUNDED), min(band[1] * (1.0 + _ROUNDED), 0.5 * rate)
    every = Bands.between(*_AUDIBLE)
    resolved = seconds * (every.upper - every.lower) >= _CYCLES
    numbers = every.numbers[(every.lower >= low) & (every.upper <= high) & resolved]
    if not numbers.size:
        raise InputError(
            f"no third-octave band lies within {band[0]:g} to {min(band[1], 0.5 * rate):g} Hz, where responses are "
            f"given and the rate is high enough, and is resolved in {max(seconds, 0.0):.3g} s; give a longer "
            "--duration-s or a higher --rate-hz"
        )
    return Bands(int(numbers[0]), int(numbers[-1]))


def motion_values(found: Felt) -> dict[str, Any]:
    """Return RMS and levels of accelerations."""
    squares = found.squares
    return {
        **_coverage(found),
        "outputs": [
            {
                "name": name,
                "rms_g": float(np.std(record)) / STANDARD_GRAVITY,
                "peak_g": float(np.max(np.abs(record))) / STANDARD_GRAVITY,
                **_levels("", row, REFERENCE_ACCELERATION),
            }
            for name, record, row in zip(found.names, found.values, squares, strict=True)
        ],
    }


def pressure_values(found: Felt) -> dict[str, Any]:
    """Return levels of pressures, with A-weighting too."""
    weighted = found.weighted("A")
    return {
        **_coverage(found),
        "microphones": [
            {
                "name": name,
                **_levels("", row, REFERENCE_PRESSURE),
                **_levels("a", weighed, REFERENCE_PRESSURE),
            }
            for name, row, weighed in zip(found.names, found.squares, weighted, strict=True)
        ],
    }


def _levels(weighting: str, squares: Array, reference: float) -> dict[str, Any]:
    """Return the levels of mean squares by band and of their sum, None where there is nothing."""
    levels = level_db(squares, reference)
    return {
        f"level_db{weighting}": finite(sum_db(levels)),
        f"bands_db{weighting}": [finite(level) for level in levels],
    }


def _coverage(found: Felt) -> dict[str, Any]:
    return {
        "band_hz": list(found.band),
        "outside_share": found.outside,
        "bands_hz": list(found.bands.nominal),
    }


def motion_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield what :func:`motion_values` found, as text."""
    yield from _coverage_lines(values, "acceleration")
    for one in values["outputs"]:
        yield (
            f"acceleration {one['name']}: RMS {one['rms_g']:.4g} g, peak {one['peak_g']:.4g} g, "
            f"{_level(one['level_db'])} dB re 1 µm/s²"
        )
        yield "  third octaves: " + _bands(values["bands_hz"], one["bands_db"])


def pressure_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield what :func:`pressure_values` found, as text."""
    yield from _coverage_lines(values, "sound")
    for one in values["microphones"]:
        yield f"microphone {one['name']}: {_level(one['level_dba'])} dB(A), {_level(one['level_db'])} dB re 20 µPa"
        yield "  third octaves, A-weighted: " + _bands(values["bands_hz"], one["bands_dba"])


def _coverage_lines(values: dict[str, Any], what: str) -> Iterator[str]:
    low, high = values["band_hz"]
    yield (
        f"{what} from {low:g} to {high:g} Hz; up to {100.0 * values['outside_share']:.3g} % of the varying force "
        "on a bearing lies outside"
    )


def _level(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def _bands(nominal: Sequence[float], levels: Sequence[float | None]) -> str:
    return ", ".join(f"{hz:g} Hz {_level(level)}" for hz, level in zip(nominal, levels, strict=True)) + " dB"


def write_sound(found: Felt, path: Path) -> float:
    """Write the pressures as WAV, a channel a microphone; return the pressure at full scale, Pa."""
    full_scale = full_scale_for(found.values)
    with output_errors("--wav", path):
        write_wav(path, found.values, found.rate, full_scale=full_scale)
    return full_scale
