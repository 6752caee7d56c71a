"""``spallwatch gear --casing``: responses of a box by finite elements, and its sound by boundary elements."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.fe.casing.model import Casing, RadiatingSurface, radiating_surface
from models.fe.casing.modes import CasingModes, NoModesError, first_modes, modal_responses, modes_below
from models.gears.sound.boundary_elements import Radiation, transfer_vectors
from models.gears.sound.surface import Surface
from models.gears.transfer.frf import FrequencyResponses
from monitor.commands.common import InputError
from monitor.fe.config_casing import CasingFile, read_casing
from monitor.gears.config.section import GearSection
from monitor.gears.transfer import CasingResponses, heard

if TYPE_CHECKING:
    from models.gears.sound.transfer_vectors import TransferVectors

Array = NDArray[np.float64]

_MODES_TO = 1.5
"""Modes are computed to this share of the upper end of the band; what is left out acts as at rest."""
_HALF_WIDTH = 0.2
_MIN_LINES, _MAX_LINES = 200, 2000
"""Distance of the lines, by the half width of the narrowest resonance, within limits of their number."""


def casing_by_elements(
    gear: GearSection, path: Path, tell: Callable[[str], None]
) -> tuple[CasingResponses, dict[str, Any]]:
    """Return the responses of the casing in a file to the bearings of a train, and what is known of them.

    Args:
        gear: section; each of its supports has a seat.
        path: of the casing.
        tell: called with what is being computed.

    Raises:
        ConfigError: the file cannot be used.
        InputError: a support has no seat, or a point is not on the casing.
        MissingExtraError: scikit-fem is missing.
        SurfaceError: the cells are too coarse for the sound of the band, or a microphone is inside.
    """
    file = read_casing(path)
    where = f"--casing {path}"
    seats = {seat.name for seat in file.seat}
    if missing := [support.name for support in gear.support if support.name not in seats]:
        raise InputError(
            f"{where}: no [[seat]] with name = {missing[0]!r}; expected one for each [[gear.support]], "
            f"found {', '.join(sorted(seats))}"
        )
    body = Casing(file.shape, file.made_of, file.rule)
    try:
        columns = body.columns(file.points)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    tell(f"casing: {body.unknowns:,} unknowns, modes to {_MODES_TO * file.band_hz[1]:g} Hz")
    try:
        modes = modes_below(body, _MODES_TO * file.band_hz[1])
    except NoModesError:
        # A stiff casing has no mode there: one suffices, as what modes leave out acts as at rest.
        modes = first_modes(body, 1)
    frequency = lines_of(file, modes)
    inputs = {f"{support.name}.{axis}": columns[f"{support.name}.{axis}"] for support in gear.support for axis in "xy"}
    outputs = {name: column for name, column in columns.items() if name.rpartition(".")[0] not in seats}
    damping = file.to_damping()
    known: dict[str, Any] = {
        "modes_hz": modes.frequency[modes.frequency <= file.band_hz[1]].tolist(),
        "unknowns": body.unknowns,
        "mass_kg": body.total_mass,
    }
    motion = modal_responses(body, modes, damping, frequency, outputs, inputs) if outputs else None
    pressure = None
    if file.microphone:
        surface = radiating_surface(body)
        found = _radiation(file, surface, tell)
        velocity = modal_responses(body, modes, damping, frequency, surface.columns, inputs, "m/s")
        pressure = pressure_responses(velocity, found.vectors, where)
        known["radiation"] = _radiation_values(found)
    return CasingResponses(motion, pressure), known


def pressure_responses(velocity: FrequencyResponses, vectors: TransferVectors, where: str) -> FrequencyResponses:
    """Return the pressures at the microphones over the forces."""
    return heard(velocity, vectors, where, "the sound of the casing")[0]


def lines_of(file: CasingFile, modes: CasingModes) -> Array:
    """Return the lines of the responses, Hz: close enough that no resonance lies between them."""
    low, high = file.band_hz
    inside = modes.frequency[(modes.frequency >= low) & (modes.frequency <= high)]
    widths = file.to_damping().at(inside) * inside
    apart = _HALF_WIDTH * float(widths.min(initial=math.inf)) if inside.size else math.inf
    count = int(np.clip(math.ceil((high - low) / apart) if apart > 0.0 else _MAX_LINES, _MIN_LINES, _MAX_LINES))
    return np.linspace(low, high, count + 1)


def _radiation(file: CasingFile, surface: RadiatingSurface, tell: Callable[[str], None]) -> Radiation:
    """Return the transfer vectors of the outside of a casing, over the plane on which it stands."""
    places = np.array([microphone.place for microphone in file.microphone])
    turned = np.stack((places[:, 0], -places[:, 2], places[:, 1]), axis=1)
    told = itertools.count()

    def first(text: str) -> None:
        # The cost, which comes first; not each frequency.
        if next(told) == 0:
            tell(text)

    return transfer_vectors(
        Surface(surface.corners, surface.elements, over_plane=True),
        np.linspace(*file.band_hz, file.sound_lines),
        turned,
        names=[microphone.name for microphone in file.microphone],
        tell=first,
    )


def _radiation_values(found: Radiation) -> dict[str, Any]:
    frequency = found.vectors.frequency
    return {
        "elements": len(found.vectors.points),
        "per_wavelength": float(found.per_wavelength.min()),
        "interpolation_error_db": float(found.vectors.interpolation_error_db().max(initial=0.0)),
        "inaccurate_hz": [float(hz) for hz, one in zip(frequency, found.status, strict=True) if one == "inaccurate"],
        "status": "inaccurate"
        if "inaccurate" in found.status
        else "ok"
        if set(found.status) == {"ok"}
        else "unchecked",
    }


def casing_lines(known: dict[str, Any]) -> list[str]:
    """Return what is known of a casing, as text."""
    modes = ", ".join(f"{value:.5g}" for value in known["modes_hz"][:12])
    more = f" and {len(known['modes_hz']) - 12} more" if len(known["modes_hz"]) > 12 else ""
    lines = [f"casing of {known['mass_kg']:.4g} kg, {known['unknowns']:,} unknowns; modes {modes}{more} Hz"]
    if "radiation" in known:
        sound = known["radiation"]
        lines.append(
            f"sound of {sound['elements']} elements, at least {sound['per_wavelength']:.3g} a wavelength, interpolated "
            f"to within {sound['interpolation_error_db']:.2g} dB: {sound['status']}"
            + (f" at {', '.join(f'{hz:.5g}' for hz in sound['inaccurate_hz'])} Hz" if sound["inaccurate_hz"] else "")
        )
    return lines
