"""The model of impacts on rings: when and how hard a defect is hit, and what the sensor shows of it.

The short journal bearing's film against differences of the force that its theory gives.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from models.machine.bearing import from_catalogue, kinematics
from models.machine.scene import Defect, Part, Scene, Slip
from models.solve.ring_impact.hits import hits_on, short_bearing_film
from models.solve.ring_impact.rig import RingImpactRig
from models.solve.ring_impact.solver import noise_level, sensor_deflection
from models.solve.simulate import simulate

BEARING = from_catalogue("6205")
RIG = RingImpactRig()
DEFECT = Defect(0.02, 1e-4)
SCENE = Scene(30.0, 1000.0, bearing=BEARING, rig=RIG, defect=DEFECT)
LINES = kinematics(BEARING, SCENE.speed)
PARTS: tuple[Part, ...] = ("outer", "ball", "inner")


def on(part: Part, **changes: Any) -> Scene:
    return replace(SCENE, defect=replace(DEFECT, part=part), **changes)


def kurtosis(x: NDArray[np.float64]) -> float:
    return float(np.mean(x**4) / np.mean(x**2) ** 2)


# Hits.


def test_outer_race_is_hit_evenly_at_bpfo_and_at_one_strength() -> None:
    hits = hits_on(SCENE, 0, 0.0, 1.0)
    assert np.diff(hits.start) == pytest.approx(1.0 / LINES.bpfo, rel=1e-9)
    assert hits.force == pytest.approx(hits.force[0], rel=1e-12)
    assert hits.rate == 0.0


def test_inner_race_is_hit_at_bpfi_within_the_load_zone_only() -> None:
    hits = hits_on(on("inner"), 0, 0.0, 2.0)
    psi = 2.0 * np.pi * SCENE.speed * hits.start
    assert hits.force == pytest.approx(hits.force.max() * np.maximum(np.cos(psi), 0.0) ** 1.5, rel=1e-6, abs=1e-3)
    assert np.all(np.cos(psi) > 0.0)
    # Those that are left of the even comb are about half of all.
    gaps = np.diff(hits.start) * LINES.bpfi
    assert gaps == pytest.approx(np.round(gaps), abs=1e-6)
    assert len(hits.start) / (2.0 * LINES.bpfi) == pytest.approx(0.5, abs=0.02)


def test_ball_is_hit_at_twice_bsf_and_modulated_by_the_cage() -> None:
    hits = hits_on(on("ball"), 0, 0.0, 3.0)
    gaps = np.diff(hits.start) * 2.0 * LINES.bsf
    assert gaps == pytest.approx(np.round(gaps), abs=1e-6)
    psi = 2.0 * np.pi * LINES.ftf * hits.start
    assert hits.force == pytest.approx(hits.force.max() * np.maximum(np.cos(psi), 0.0) ** 1.5, rel=3e-3, abs=0.5)
    assert hits.rate == pytest.approx(2.0 * np.pi * LINES.ftf)


def test_a_turning_load_swaps_the_roles_of_the_rings() -> None:
    inner = hits_on(on("inner", load_turns=True), 0, 0.0, 1.0)
    assert inner.force == pytest.approx(inner.force[0], rel=1e-12)
    assert len(inner.start) == pytest.approx(LINES.bpfi, abs=1)
    outer = hits_on(replace(SCENE, load_turns=True), 0, 0.0, 1.0)
    psi = 2.0 * np.pi * SCENE.speed * outer.start
    assert outer.force == pytest.approx(outer.force.max() * np.maximum(np.cos(psi), 0.0) ** 1.5, rel=5e-2, abs=2.0)
    assert np.ptp(outer.force) > 0.9 * outer.force.max()


def test_a_turning_outer_ring_carries_its_defect_round() -> None:
    bearing = replace(BEARING, rotating_ring="outer")
    outer, inner = (hits_on(on(part, bearing=bearing), 0, 0.0, 1.0) for part in ("outer", "inner"))
    assert outer.rate == pytest.approx(2.0 * np.pi * SCENE.speed)
    assert np.ptp(outer.force) > 0.9 * outer.force.max()
    assert inner.rate == 0.0
    assert np.ptp(inner.force) < 1e-9 * inner.force.max()
    assert np.diff(inner.start) == pytest.approx(1.0 / LINES.bpfi, rel=1e-9)


def test_rows_are_staggered_and_each_is_hit() -> None:
    bearing = from_catalogue("1210")
    lines = kinematics(bearing, SCENE.speed)
    scene = replace(SCENE, bearing=bearing, defect=replace(DEFECT, rows=2))
    first, second = (hits_on(scene, 0, 0.0, 1.0, row) for row in (0, 1))
    assert np.diff(first.start) == pytest.approx(1.0 / lines.bpfo, rel=1e-9)
    assert np.diff(np.sort([*first.start, *second.start])) == pytest.approx(0.5 / lines.bpfo, rel=1e-9)
    assert second.start == pytest.approx(
        hits_on(replace(scene, defect=replace(DEFECT, first_row=1)), 0, 0.0, 1.0).start, rel=1e-12
    )


@pytest.mark.parametrize("part", PARTS)
def test_rows_add_up(part: Part) -> None:
    """Each row's damaged ball stands at a place of its own, which the sensor sees from another angle."""
    bearing = replace(BEARING, rows=2)
    one, other, both = (
        record_of(replace(SCENE, bearing=bearing, defect=replace(DEFECT, part=part, **rows)))
        for rows in ({"rows": 1}, {"first_row": 1}, {"rows": 2})
    )
    assert np.max(np.abs(both - one - other)) < 1e-3 * np.max(np.abs(both))


def test_slip_moves_each_hit_by_its_own_angle() -> None:
    slip = Slip(0.02, seed=3)
    even, drawn = hits_on(SCENE, 0, 0.0, 2.0), hits_on(replace(SCENE, slip=slip), 0, 0.0, 2.0)
    late = (drawn.start - even.start) * 2.0 * np.pi * LINES.ftf
    assert np.max(np.abs(late)) <= slip.phi_slip
    assert np.std(late) == pytest.approx(slip.phi_slip / math.sqrt(3.0), rel=0.1)


@pytest.mark.parametrize("part", PARTS)
def test_force_grows_with_the_square_of_the_defect(part: Part) -> None:
    """Eq. 16: what is above the static force is four times as much at twice the width."""
    scene = on(part, rig=replace(RIG, k_impact=40.0))
    static = hits_on(replace(scene, rig=replace(RIG, k_impact=0.0)), 0, 0.0, 0.5).force
    small, large = (
        hits_on(replace(scene, defect=replace(scene.defects[0], dphi_d=d)), 0, 0.0, 0.5).force for d in (0.02, 0.04)
    )
    assert large - static == pytest.approx(4.0 * (small - static), rel=1e-9)
    with pytest.raises(ValueError, match=r"dphi_d.* wide, more than an element"):
        hits_on(replace(scene, defect=replace(scene.defects[0], dphi_d=3.0)), 0, 0.0, 0.5)


def test_rollers_share_their_load_by_their_own_law() -> None:
    rollers = from_catalogue("NU 202 ECP")
    scene = replace(on("inner"), bearing=rollers)
    hits = hits_on(scene, 0, 0.0, 2.0)
    psi = 2.0 * np.pi * SCENE.speed * hits.start
    expected = hits.force.max() * np.maximum(np.cos(psi), 0.0) ** (10.0 / 9.0)
    assert hits.force == pytest.approx(expected, rel=5e-2, abs=1.0)
    assert rollers.effective_length is not None
    volume = 0.25 * math.pi * rollers.element_diameter**2 * rollers.effective_length
    assert RIG.element_mass(rollers) == pytest.approx(7800.0 * volume)


# What the sensor shows.


def record_of(scene: Scene, **request: Any) -> NDArray[np.float64]:
    found = simulate(scene, **{"duration": 0.2, "rate": 25600.0, "accuracy": 5e-3, **request})
    assert found.record is not None
    return found.record.of()


def test_responses_add_up() -> None:
    second = replace(DEFECT, part="inner", position=1.0)
    parts = record_of(SCENE) + record_of(replace(SCENE, defect=second))
    both = record_of(replace(SCENE, more_defects=(second,)))
    assert np.max(np.abs(both - parts)) < 1e-3 * np.max(np.abs(both))


def test_sensor_sees_the_ellipse_from_its_direction() -> None:
    along = record_of(SCENE)
    across, node = record_of(SCENE, direction=0.5 * math.pi), record_of(SCENE, direction=0.25 * math.pi)
    assert across == pytest.approx(-along, rel=1e-6, abs=1e-6 * np.max(np.abs(along)))
    assert np.max(np.abs(node)) < 1e-9 * np.max(np.abs(along))
    moved = replace(SCENE, defect=replace(DEFECT, position=0.3))
    assert np.std(record_of(moved)) == pytest.approx(np.std(along) * math.cos(0.6) * np.cos(0.3) ** 1.5, rel=1e-2)
    unturned = replace(moved, rig=replace(RIG, fixed_sensor=False))
    assert np.std(record_of(unturned)) == pytest.approx(np.std(along) * np.cos(0.3) ** 1.5, rel=1e-2)


def test_direction_is_exact_to_first_order() -> None:
    """Eq. 30 differs from z cos 2 angle by less than 2 z^2 / R."""
    angle, radius = np.linspace(0.0, 2.0 * np.pi, 73), 0.02
    for z in (1e-8, 1e-6, 1e-4):
        exact = sensor_deflection(np.full_like(angle, z), angle, radius)
        assert np.max(np.abs(exact - z * np.cos(2.0 * angle))) < 2.0 * z * z / radius + 1e-17
    assert sensor_deflection(np.array([1e-5, 1e-5]), np.array([0.0, 0.5 * np.pi]), radius) == pytest.approx(
        [1e-5, -1e-5]
    )


def test_a_band_and_given_steps_are_kept() -> None:
    whole = simulate(SCENE, duration=0.2, rate=25600.0, accuracy=5e-3)
    low, high = (
        simulate(SCENE, duration=0.2, rate=25600.0, accuracy=5e-3, band=band)
        for band in ((0.0, 8000.0), (8000.0, 11000.0))
    )
    assert math.hypot(low.rms, high.rms) <= whole.rms
    # The outer ring's own mode, at 5.3 kHz, makes nearly all of it.
    assert low.rms > 0.95 * whole.rms
    given = simulate(SCENE, duration=0.2, rate=25600.0, steps_per_period=2000)
    assert given.rms == pytest.approx(whole.rms, rel=1e-3)


def test_axial_load_widens_the_zone_of_the_inner_race() -> None:
    radial, both = (hits_on(on("inner", axial_load=axial), 0, 0.0, 2.0).force for axial in (0.0, 4000.0))
    assert len(both) > 1.5 * len(radial)
    assert np.min(both) / np.max(both) > 0.1


def test_noise_has_its_level_and_leaves_kurtosis_three() -> None:
    unit = noise_level(SCENE, 1.0)
    noisy = replace(SCENE.healthy, rig=replace(RIG, slip_noise=2.0 / noise_level(SCENE.healthy, 1.0)))
    assert noise_level(noisy) == pytest.approx(2.0)
    found = simulate(noisy, duration=1.0, rate=25600.0)
    assert found.status == "uncalibrated"
    assert not found.repeats
    assert found.rms == pytest.approx(2.0, rel=0.02)
    assert found.record is not None
    assert kurtosis(found.record.of()) == pytest.approx(3.0, abs=0.1)
    other = simulate(replace(noisy, rig=replace(noisy.rig_as(RingImpactRig), noise_seed=1)), duration=1.0, rate=25600.0)
    assert other.rms != found.rms
    # Eq. 32: the root of the slip speed, the square of the pressure, which grows with the third root of the load.
    assert noise_level(replace(SCENE, speed=120.0), 1.0) == pytest.approx(2.0 * unit)
    assert noise_level(replace(SCENE, load=8000.0), 1.0) == pytest.approx(4.0 * unit)
    weighted = replace(SCENE, rig=replace(RIG, noise_weights=(1.0, 0.0, 5.0)))
    assert noise_level(weighted, 1.0) == pytest.approx(unit * (1.0 + 5.0 * (0.02 * 23.48992e-3 / 7.94004e-3) ** 2))


def test_kurtosis_falls_to_three_and_the_crest_with_it_as_noise_takes_over() -> None:
    scene = on("inner")
    level = float(np.std(record_of(scene, duration=1.0)))
    shares, found = (0.0, 0.5, 0.8, 0.95, 0.999), []
    for share in shares:
        noise = level * share / math.sqrt(1.0 - share**2)
        x = record_of(replace(scene, rig=replace(RIG, slip_noise=noise / noise_level(scene, 1.0))), duration=1.0)
        found.append((kurtosis(x), float(np.max(np.abs(x)) / np.std(x))))
    kurtoses, crests = zip(*found, strict=True)
    assert list(kurtoses) == sorted(kurtoses, reverse=True)
    assert list(crests) == sorted(crests, reverse=True)
    assert kurtoses[-1] == pytest.approx(3.0, abs=0.1)
    # Independent signals: the excess falls with the square of the impacts' share of the power.
    expected = [3.0 + (1.0 - share**2) ** 2 * (kurtoses[0] - 3.0) for share in shares]
    assert kurtoses == pytest.approx(expected, rel=0.05)


def force(place: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """The film's force on a journal that turns at one, with clearance and viscosity factor one.

    Reynolds' equation of a short bearing whose film cavitates over half the turn, in the frame that turns with the
    line of centres: the wedge 1/2 - phi' and the squeeze e' drive it.
    """
    e = float(np.hypot(*place))
    radial = place / e
    across = np.array([-radial[1], radial[0]])
    squeeze, whirl = float(velocity @ radial), float(velocity @ across) / e
    gap = 1.0 - e * e
    wedge = 1.0 - 2.0 * whirl
    inwards = e * e / gap**2 * wedge + math.pi * (1.0 + 2.0 * e * e) / (2.0 * gap**2.5) * squeeze
    along = math.pi * e / (4.0 * gap**1.5) * wedge + 2.0 * e / gap**2 * squeeze
    return -inwards * radial + along * across


@pytest.mark.parametrize("e", [0.1, 0.4, 0.7, 0.93, 0.999])
def test_stiffness_and_damping_are_slopes_of_the_force(e: float) -> None:
    place, still = np.array([e, 0.0]), np.zeros(2)
    load = -force(place, still)
    carried = float(np.hypot(*load))
    line, step = load / carried, 1e-6 * (1.0 - e)
    stiffness = -(force(place + step * line, still) - force(place - step * line, still)) @ line / (2.0 * step)
    damping = -(force(place, step * line) - force(place, -step * line)) @ line / (2.0 * step)
    film = short_bearing_film(300.0, 200.0, thickness=(1.0 - e) * 5e-5, clearance=5e-5)
    assert film.stiffness == pytest.approx(300.0 / 5e-5 * stiffness / carried, rel=1e-5)
    assert film.damping == pytest.approx(300.0 / (5e-5 * 200.0) * damping / carried, rel=1e-5)


def test_a_thinner_film_is_stiffer_and_damps_more() -> None:
    films = [short_bearing_film(300.0, 200.0, thickness=h, clearance=2e-5) for h in (5e-6, 1e-6, 2e-7)]
    assert [f.stiffness for f in films] == sorted(f.stiffness for f in films)
    assert [f.damping for f in films] == sorted(f.damping for f in films)


@pytest.mark.parametrize(
    ("load", "speed", "thickness", "word"),
    [(0.0, 1.0, 1e-6, "load"), (1.0, 0.0, 1e-6, "speed"), (1.0, 1.0, 2e-5, "film_thickness"), (1.0, 1.0, 0.0, "film_")],
)
def test_what_it_does_not_describe(load: float, speed: float, thickness: float, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        short_bearing_film(load, speed, thickness=thickness, clearance=2e-5)
