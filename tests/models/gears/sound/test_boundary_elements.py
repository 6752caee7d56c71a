"""Boundary elements against a multipole series and against sources within a box; what is refused or not claimed."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from models.gears.sound.boundary_elements import (
    MAX_RESIDUAL,
    MIN_GAP,
    Radiation,
    enclosed,
    interior_points,
    radiation_cost,
    transfer_vectors,
)
from models.gears.sound.shapes import box, sphere
from models.gears.sound.surface import Surface, SurfaceError
from tests.oracles.sphere_over_plane import MOTIONS, SphereOverPlane, exact_pressure

SPEED = 343.0
AROUND = np.array([(3.0, 0.5, 1.0), (0.3, 1.3, 2.0), (2.0, 2.0, 0.3)])


def hertz(k: float) -> float:
    return k * SPEED / (2.0 * np.pi)


def motion_of(surface: Surface, name: str) -> np.ndarray:
    return {"pulsating": np.ones(len(surface)), "up and down": surface.normal[:, 2]}.get(name, surface.normal[:, 0])


def decibels(found: np.ndarray, exact: np.ndarray) -> np.ndarray:
    return 20.0 * np.log10(np.abs(found / exact))


@pytest.mark.parametrize("height", [None, 1.3])
def test_a_sphere_radiates_as_its_multipoles_where_the_enclosed_air_resonates(height):
    surface = sphere(1.0, 4, (0.0, 0.0, height or 0.0), over_plane=height is not None)
    found = transfer_vectors(surface, hertz(np.pi), AROUND)
    assert found.status == ("ok",)
    oracle = SphereOverPlane(1.0, height, np.pi)
    for motion in MOTIONS:
        exact, missed = exact_pressure(oracle, motion, AROUND)
        assert missed < 1e-6
        assert decibels(found.vectors.h[0] @ motion_of(surface, motion), exact) == pytest.approx(0.0, abs=0.3)


def source(x: np.ndarray, k: float, *, over_plane: bool) -> np.ndarray:
    """Pressure at points of a source within the box, and of its image."""
    places = [(0.05, -0.04, 0.12), (0.05, -0.04, -0.12)][: 1 + over_plane]
    distance = [np.linalg.norm(x - place, axis=1) for place in places]
    return np.sum([np.exp(-1j * k * r) / r for r in distance], axis=0)


@pytest.mark.parametrize("on_plane", [True, False])
def test_a_box_that_moves_as_a_source_within_demands_radiates_as_that_source(on_plane):
    size, counts = (0.4, 0.3, 0.24), (10, 8, 6)
    surface = box(size, counts, on_plane=on_plane)
    # The first resonance of the air that the box, and over the plane its image, encloses.
    k = np.pi * np.sqrt(1 / size[0] ** 2 + 1 / size[1] ** 2 + (0.5 if on_plane else 1.0) ** 2 / size[2] ** 2)
    step = 1e-5 * surface.normal
    slope = source(surface.middle + step, k, over_plane=on_plane) - source(
        surface.middle - step, k, over_plane=on_plane
    )
    velocity = slope / 2e-5 / (-1j * k * SPEED * 1.2)
    microphones = np.array([(0.5, 0.2, 0.3), (-0.4, 0.1, 0.1), (0.0, 0.0, 0.6)])
    found = transfer_vectors(surface, hertz(k), microphones)
    assert found.per_wavelength[0] > 8.0
    pressure = found.vectors.pressure(hertz(k), velocity[None])[0]
    assert decibels(pressure, source(microphones, k, over_plane=on_plane)) == pytest.approx(0.0, abs=0.3)


def test_frequencies_and_microphones_do_not_disturb_each_other():
    surface = sphere(0.1, 2)
    several = transfer_vectors(surface, [300.0, 400.0], 0.2 * AROUND, names=("a", "b", "c")).vectors
    single = transfer_vectors(surface, 400.0, 0.2 * AROUND[1]).vectors
    assert several.h[1, 1] == pytest.approx(single.h[0, 0], rel=1e-9)
    assert several.microphones == ("a", "b", "c")
    assert np.array_equal(np.asarray(several.point_position), surface.middle)
    assert not several.over_plane


def test_the_cost_is_said_first_and_then_each_frequency():
    said: list[str] = []
    surface = sphere(0.1, 2)
    transfer_vectors(surface, [300.0, 400.0], 0.2 * AROUND, tell=said.append)
    assert said[0] == str(radiation_cost(surface, 2, 3))
    assert re.match(r"80 elements at 2 frequencies need about .* GB and .* s", said[0])
    assert [line.split(":")[0] for line in said[1:]] == ["300 Hz", "400 Hz"]


def with_status(surface: Surface, k: float) -> Radiation:
    return transfer_vectors(surface, hertz(k), AROUND, min_per_wavelength=0.1)


def test_ok_is_withheld_where_pressure_is_left_inside_or_nothing_could_be_checked():
    coarse = with_status(sphere(1.0, 2), 8.0)
    assert coarse.residual[0] > MAX_RESIDUAL
    assert coarse.status == ("inaccurate",)
    low = with_status(sphere(1.0, 4, (0.0, 0.0, 1.05), over_plane=True), 0.5)
    assert low.residual[0] < MAX_RESIDUAL
    assert low.gap < MIN_GAP
    assert low.status == ("inaccurate",)
    plate = with_status(box((1.0, 1.0, 0.01), (6, 6, 1)), 1.0)
    assert np.isnan(plate.residual[0])
    assert plate.status == ("unchecked",)


def test_points_inside_are_inside_and_away_from_the_surface():
    surface = box((0.4, 0.3, 0.24), (8, 6, 5), on_plane=True)
    points = interior_points(surface, 20)
    assert len(points) == 20
    assert np.all(np.abs(points) < (0.2, 0.15, 0.24))
    assert np.all(points[:, 2] > 0.0)
    assert np.all(enclosed(surface, points))
    assert not np.any(enclosed(surface, np.array([(0.21, 0.0, 0.1), (0.0, 0.0, 0.25), (1.0, 1.0, 1.0)])))


CUBE = box((1.0, 1.0, 1.0), (2, 2, 2))


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: replace(CUBE, elements=CUBE.elements[1:]), r"not closed: the edge of the vertices \d+ and \d+ has"),
        (lambda: replace(CUBE, elements=CUBE.elements[:, ::-1]), "counterclockwise"),
        (lambda: replace(CUBE, elements=np.roll(CUBE.elements, 1) * [1, 1, 1, 0]), "element|edge"),
        (lambda: replace(CUBE, elements=CUBE.elements[:, :3]), "shape"),
        (lambda: replace(CUBE, elements=CUBE.elements + 1), "must name vertices 0 to 25, got 26"),
        (lambda: replace(CUBE, vertices=CUBE.vertices * np.nan), "finite"),
        (lambda: replace(CUBE, vertices=CUBE.vertices * (1.0, 1.0, 0.0)), r"element \d+ has no area"),
        (lambda: replace(CUBE, vertices=CUBE.vertices**2), "element"),
        (lambda: replace(CUBE, over_plane=True), r"element \d+ lies on the plane"),
        (lambda: replace(CUBE, vertices=CUBE.vertices - (0, 0, 0.2), over_plane=True), "below the plane .* -0.2 m"),
        (lambda: replace(CUBE, elements=np.concatenate((CUBE.elements, CUBE.elements[:1]))), "the same way"),
        (lambda: transfer_vectors(CUBE, 500.0, AROUND), r"edge of 0\.5 m is too coarse for 500 Hz: 1\.4 elements"),
        (
            lambda: transfer_vectors(CUBE, 50.0, AROUND, max_memory=10.0),
            "24 elements at 1 frequencies need about .* GB",
        ),
        (lambda: transfer_vectors(CUBE, 50.0, [(0.1, 0.1, 0.5)], names=["left"]), "microphone left is inside the body"),
        (lambda: transfer_vectors(sphere(0.1, 1, (0, 0, 1), over_plane=True), 50.0, [0, 0, -1]), "mic1 is below"),
        (lambda: transfer_vectors(CUBE, 50.0, AROUND[:, :2]), "microphones must be finite, of shape"),
        (lambda: transfer_vectors(CUBE, 50.0, AROUND, names=["a"]), "names must be those of 3"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(make, said):
    with pytest.raises(SurfaceError, match=said):
        make()


def test_shapes_check_their_arguments():
    for call, said in ((lambda: sphere(0.0, 2), "radius"), (lambda: sphere(1.0, 0), "splits")):
        with pytest.raises(ValueError, match=said):
            call()
    with pytest.raises(ValueError, match="base"):
        box((1.0, 1.0, 1.0), (1, 1, 1), (0.0, 0.0, 1.0), on_plane=True)
    with pytest.raises(ValueError, match="density"):
        transfer_vectors(CUBE, 50.0, AROUND, density=-1.0)
