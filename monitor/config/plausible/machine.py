"""Doubts of the machine: speed against the bearing, its geometry, its load."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from models.machine.bearing import Bearing
from models.machine.catalogue.ratings import Internal, dynamic_rating
from monitor.config.bearing import BearingSection
from monitor.config.load import Config
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig
from monitor.config.positions import Place

MAX_USUAL_SPEED_HZ = 500.0
"""Speed above which a number without a unit is asked for: few shafts turn at 30,000 rpm."""
MAX_SPEED_HZ = 5000.0
"""300,000 rpm: dental turbines turn faster, and have no bearings that this program knows."""
_MIN_SPEED_HZ = 0.02
_ANGULAR_RAD, _TAPERED_RAD = math.radians(12.0), math.radians(5.0)
_MAX_DN = {
    "ball bearing": (0.5e6, 0.75e6, 2.0e6),
    "angular contact ball bearing": (1.2e6, 1.5e6, 3.0e6),
    "cylindrical roller bearing": (0.5e6, 0.7e6, 1.5e6),
    "tapered or spherical roller bearing": (0.35e6, 0.5e6, 1.0e6),
}
"""Pitch diameter times speed, mm/min, by kind: as makers allow it with grease, with oil, and as the best of spindles
and motors reach it. Above ``MAX_USUAL_SPEED_HZ`` the second is the limit."""
_MAX_LOAD, _USUAL_LOAD = 5.0, 1.0
_MIN_LOAD, _USUAL_MIN_LOAD = 1 / 2000, 1 / 500
"""Loads over the dynamic rating. Makers ask for 1/100 at least, or the elements skid."""
_MIN_FILL = 0.35
_MIN_PITCH_MM, _MAX_PITCH_MM = 2.0, 8000.0
_MAX_CLEARANCE = 0.05


def machine_doubts(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what is doubtful in geometry, speed and load."""
    for at, section in enumerate(subject.config.bearing):
        yield from _geometry(subject, ("bearing", at), section)
    yield from _speeds(subject)
    yield from _limits(subject)
    yield from _loads(subject)


def rpm_words(speed: float) -> str:
    """Return a speed in Hz with both of its readings."""
    return f"{speed:g} Hz is {60.0 * speed:.6g} rpm; {speed / 60.0:.4g} Hz if rpm was meant"


def kind_of(bearing: Bearing) -> str:
    """Return the kind of a bearing, as far as it limits the speed."""
    if bearing.element == "ball":
        # Two rows, self-aligning or not, are no sign of a spindle.
        angular = bearing.contact_angle >= _ANGULAR_RAD and bearing.rows == 1
        return "angular contact ball bearing" if angular else "ball bearing"
    return (
        "cylindrical roller bearing" if bearing.contact_angle < _TAPERED_RAD else "tapered or spherical roller bearing"
    )


def speed_doubt(subject: JudgedConfig, place: Place, speed: float) -> Doubt | None:
    """Return what is doubtful in a speed of the shaft, Hz, for the bearings of the channels."""
    if speed < _MIN_SPEED_HZ:
        return subject.doubt("speed", "warning", place, f"turns a second, {_MIN_SPEED_HZ:g} or more", f"{speed:g} Hz")
    worst, found = 0.0, None
    for bearing in _monitored(subject.config):
        kind = kind_of(bearing)
        usual, oiled, most = _MAX_DN[kind]
        pitch = 1e3 * bearing.pitch_diameter
        dn = 60.0 * speed * pitch
        if dn <= usual * max(1.0, worst):
            continue
        worst = dn / usual
        impossible = dn > (oiled if speed > MAX_USUAL_SPEED_HZ else most)
        expected = f"up to {usual / pitch / 60.0:.3g} Hz ({usual / pitch:.5g} rpm), as usual for a {kind} of "
        found = subject.doubt(
            "speed",
            "problem" if impossible else "warning",
            place,
            f"{expected}{pitch:.3g} mm pitch diameter",
            f"{rpm_words(speed)} ({dn:.3g} mm/min of pitch diameter times speed)",
        )
    if (found is None or found.severity == "warning") and speed > MAX_SPEED_HZ:
        return subject.doubt("speed", "problem", place, f"up to {MAX_SPEED_HZ:g} Hz", rpm_words(speed))
    return found


def _monitored(config: Config) -> list[Bearing]:
    named = {channel.bearing for channel in config.channel}
    return [section.to_bearing() for section in config.bearing if section.name in named]


def _speeds(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what is doubtful in each speed that is configured, by its fastest reading."""
    operating = subject.config.operating
    speeds: list[tuple[str, float | None]] = [("speed_hz", operating.speed_hz)]
    if operating.speed_range_hz is not None:
        speeds.append(("speed_range_hz", operating.speed_range_hz[1]))
    # A lower limit beyond all speeds leaves no block; an upper one may be set far away.
    speeds += [("min_speed_hz", operating.min_speed_hz), ("max_speed_hz", operating.max_speed_hz)]
    for key, speed in speeds:
        doubt = None if speed is None else speed_doubt(subject, ("operating", key), speed)
        if doubt is None or (key.startswith("m") and doubt.severity == "warning"):
            continue
        yield replace(doubt, severity="warning") if key == "max_speed_hz" else doubt


def _limits(subject: JudgedConfig) -> Iterator[Doubt]:
    operating = subject.config.operating
    speed = operating.speed_hz
    if speed is None:
        return
    spans = {
        "min_speed_hz": (operating.min_speed_hz, None),
        "max_speed_hz": (None, operating.max_speed_hz),
        "speed_range_hz": operating.speed_range_hz or (None, None),
    }
    for key, (least, most) in spans.items():
        if (least is not None and speed < least) or (most is not None and speed > most):
            words = " to ".join("..." if end is None else f"{end:g}" for end in (least, most))
            yield subject.doubt(
                "speed_limits", "problem", ("operating", key), f"limits that hold speed_hz = {speed:g}", f"{words} Hz"
            )


def _geometry(subject: JudgedConfig, place: Place, section: BearingSection) -> Iterator[Doubt]:
    """Yield what is doubtful in a geometry; that of the catalogue is judged as far as it is replaced."""
    bearing = section.to_bearing()
    diameter = 1e3 * bearing.element_diameter
    given = section.model_fields_set & {"n_elements", "element_diameter_mm", "pitch_diameter_mm"}
    if given:
        key = "pitch_diameter_mm" if "pitch_diameter_mm" in given else min(given)
        yield from _sizes(subject, (*place, key), bearing)
    angle = section.contact_angle_deg
    if angle is not None and 0.0 < angle < 1.0:
        came = f"{angle:g} degrees; {math.degrees(angle):.3g} if radians were meant"
        yield subject.doubt("geometry", "warning", (*place, "contact_angle_deg"), "0, or more than 1 degree", came)
    limit = 1e3 * _MAX_CLEARANCE * diameter
    if section.clearance_um > limit:
        expected = f"up to {limit:.3g} um, {_MAX_CLEARANCE:.0%} of an element of {diameter:.3g} mm"
        came = f"{section.clearance_um:g} um"
        yield subject.doubt("geometry", "warning", (*place, "clearance_um"), expected, came)


def _sizes(subject: JudgedConfig, place: Place, bearing: Bearing) -> Iterator[Doubt]:
    diameter, pitch, count = 1e3 * bearing.element_diameter, 1e3 * bearing.pitch_diameter, bearing.n_elements
    if not _MIN_PITCH_MM <= pitch <= _MAX_PITCH_MM:
        came = f"{pitch:.4g} mm; {25.4 * pitch:.4g} mm if inches were meant"
        yield subject.doubt("geometry", "problem", place, f"{_MIN_PITCH_MM:g} to {_MAX_PITCH_MM:g} mm", came)
        return
    room = pitch * math.sin(math.pi / count)
    came = f"{count} elements of {diameter:.4g} mm on a pitch circle of {pitch:.4g} mm"
    if diameter > room:
        expected = f"elements that fit on the pitch circle: up to {room:.4g} mm each (n_elements is that of one row)"
        yield subject.doubt("geometry", "problem", place, expected, came)
    elif diameter < _MIN_FILL * room:
        expected = f"elements that fill more than {_MIN_FILL:.0%} of the pitch circle (diameters, no radii)"
        yield subject.doubt("geometry", "warning", place, expected, came)


def _rating(bearing: Bearing) -> float:
    """Return the dynamic load rating of a bearing, N: from the catalogue, else by ISO 281 with usual proportions."""
    if bearing.dynamic_load_rating is not None:
        return bearing.dynamic_load_rating
    diameter = 1e3 * bearing.element_diameter
    return dynamic_rating(
        Internal(
            family="deep_groove" if bearing.element == "ball" else "cylindrical",
            n_elements=bearing.n_elements,
            element_diameter=diameter,
            pitch_diameter=1e3 * bearing.pitch_diameter,
            rows=bearing.rows,
            contact_angle=bearing.contact_angle,
            effective_length=diameter if bearing.effective_length is None else 1e3 * bearing.effective_length,
        )
    )


def _loads(subject: JudgedConfig) -> Iterator[Doubt]:
    operating = subject.config.operating
    if operating.load_newton:
        yield from load_doubts(subject, ("operating", "load_newton"), operating.load_newton)
    axial = abs(operating.axial_load_newton)
    if axial:
        found = load_doubts(subject, ("operating", "axial_load_newton"), axial)
        # An axial load may be small.
        yield from (doubt for doubt in found if "C/" not in doubt.came)


def load_doubts(subject: JudgedConfig, place: Place, load: float) -> Iterator[Doubt]:
    """Yield what is doubtful in a load, N, by the ratings of the weakest and the strongest monitored bearing."""
    ratings = [_rating(bearing) for bearing in _monitored(subject.config)]
    high, low = load / min(ratings), load / max(ratings)
    if high > _USUAL_LOAD:
        came = f"{load:g} N is {high:.3g} C" + (f"; {load / 1e3:g} N if mN was meant" if high > _MAX_LOAD else "")
        severity = "problem" if high > _MAX_LOAD else "warning"
        yield subject.doubt("load", severity, place, f"up to C = {min(ratings):.3g} N, the dynamic rating", came)
    elif low < _USUAL_MIN_LOAD:
        came = f"{load:g} N is C/{1.0 / low:.4g}; {1e3 * load:g} N if kN was meant"
        severity = "problem" if low < _MIN_LOAD else "warning"
        expected = f"at least {max(ratings) * _USUAL_MIN_LOAD:.3g} N, C/500"
        yield subject.doubt("load", severity, place, expected, came)
