"""Transfer vectors: application, interpolation, files, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from models.gears.sound.levels import level_db, line_mean_squares
from models.gears.sound.transfer_files import read_transfer_vectors, write_transfer_vectors
from models.gears.sound.transfer_vectors import TransferVectorError, TransferVectors

SPEED = 343.0
GRID = np.linspace(500.0, 2900.0, 25)


def monopoles(frequency: np.ndarray, *, placed: bool = True) -> TransferVectors:
    """Six sources over a rigid plane, each heard by two microphones directly and from its image: a closed form."""
    rng = np.random.default_rng(3)
    points = rng.uniform((-0.2, -0.2, 0.05), (0.2, 0.2, 0.4), (6, 3))
    microphones = np.array([(0.6, 0.1, 0.3), (-0.2, 0.5, 1.2)])
    h = np.zeros((len(frequency), 2, 6), np.complex128)
    for sign in (1.0, -1.0):
        r = np.linalg.norm(microphones[:, None] - points * (1.0, 1.0, sign), axis=2)
        waves = 2.0 * np.pi * frequency[:, None, None] / SPEED
        h += 1j * 1.2 * waves * SPEED * 0.01 * np.exp(-1j * waves * r) / (4.0 * np.pi * r)
    places = {"microphone_position": microphones, "point_position": points, "normal": np.tile((0.0, 0.0, 1.0), (6, 1))}
    names = ("front", "top"), tuple(f"p{i}" for i in range(6))
    vectors = TransferVectors(frequency, h, *names, sound_speed=SPEED, over_plane=True)
    return replace(vectors, **places) if placed else vectors


def velocities(count: int) -> np.ndarray:
    rng = np.random.default_rng(4)
    return 1e-3 * (rng.standard_normal((count, 6)) + 1j * rng.standard_normal((count, 6)))


def test_given_vectors_applied_between_their_frequencies_are_within_a_tenth_of_a_decibel():
    between = np.linspace(501.0, 2899.0, 40)
    v = velocities(40)
    exact = np.einsum("fmn,fn->fm", monopoles(between).h, v)
    levels = level_db(line_mean_squares(monopoles(GRID).pressure(between, v)))
    assert levels == pytest.approx(level_db(line_mean_squares(exact)), abs=0.1)


def test_at_their_own_frequencies_they_are_exact():
    vectors, v = monopoles(GRID, placed=False), velocities(len(GRID))
    assert vectors.pressure(GRID, v) == pytest.approx(np.einsum("fmn,fn->fm", vectors.h, v), rel=1e-12)


@pytest.mark.parametrize("delay", [0.0, 2e-3])
def test_a_cubic_with_a_delay_is_interpolated_exactly_where_there_are_no_positions(delay):
    f = np.array([100.0, 130.0, 190.0, 250.0, 400.0])
    x = np.array([100.0, 111.0, 222.0, 399.0, 400.0])

    def cubic(f: np.ndarray) -> np.ndarray:
        return (1.0 + 1e-6 * f**3 + 1e-3 * f**2) * np.exp(-2j * np.pi * delay * f)

    vectors = TransferVectors(f, cubic(f)[:, None, None], ("m",), ("p",))
    assert vectors.at(x)[:, 0, 0] == pytest.approx(cubic(x), rel=1e-12)


def test_the_error_stated_of_a_grid_exceeds_the_true_one_and_falls_with_the_fourth_power():
    between = 0.5 * (GRID[1:] + GRID[:-1])
    vectors = monopoles(GRID)
    wrong = np.linalg.norm(vectors.at(between) - monopoles(between).h, axis=2)
    true = 20.0 * np.log10(1.0 + np.max(wrong / np.linalg.norm(monopoles(between).h, axis=2), axis=1))
    stated = vectors.interpolation_error_db()
    assert stated.max() > true.max()
    assert stated.max() > 8.0 * monopoles(np.linspace(500.0, 2900.0, 49)).interpolation_error_db().max()
    assert len(replace(vectors, frequency=GRID[:2], h=vectors.h[:2]).interpolation_error_db()) == 0


def test_without_positions_the_phase_is_followed_and_a_finer_grid_needed():
    with_places, without = monopoles(GRID), monopoles(GRID, placed=False)
    assert with_places.interpolation_error_db().max() < 0.5 * without.interpolation_error_db().max()
    fine, between = np.linspace(500.0, 2900.0, 49), np.linspace(501.0, 2899.0, 40)
    found = monopoles(fine, placed=False).pressure(between, velocities(40))
    exact = np.einsum("fmn,fn->fm", monopoles(between).h, velocities(40))
    assert level_db(line_mean_squares(found)) == pytest.approx(level_db(line_mean_squares(exact)), abs=0.1)


@pytest.mark.parametrize("placed", [True, False])
@pytest.mark.parametrize("name", ["a.npz", "a.csv"])
def test_files_hold_all_of_it(tmp_path, name, placed):
    vectors = monopoles(GRID[:3], placed=placed)
    write_transfer_vectors(tmp_path / name, vectors)
    found = read_transfer_vectors(tmp_path / name)
    assert (found.microphones, found.points) == (vectors.microphones, vectors.points)
    assert (found.sound_speed, found.over_plane) == (SPEED, True)
    for field in ("frequency", "h", "microphone_position", "point_position", "normal"):
        assert np.array_equal(np.asarray(getattr(found, field)), np.asarray(getattr(vectors, field)))


def test_rows_in_any_order_with_other_columns_and_comments_are_read(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"m,{p},{f},{p}.5,-1,x" for f in (200, 100) for p in (2, 1)]
    head = "microphone,point,frequency_hz,real_pascal_per_m_per_s,imag_pascal_per_m_per_s,note"
    path.write_text("\n".join(["# by another program", head, *rows, ""]))
    found = read_transfer_vectors(path)
    assert found.points == ("2", "1")
    assert found.frequency.tolist() == [100.0, 200.0]
    assert found.h[0, 0].tolist() == [2.5 - 1j, 1.5 - 1j]
    assert found.point_position is None


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: t.replace("real_pascal", "re"), "missing real_pascal_per_m_per_s"),
        (lambda t: t + "front,p0,500.0,1,1\n", r"line 41: expected 14 cells, got 5"),
        (lambda t: t + t.splitlines()[-1], "line 41: microphone top, point p5 at 700 Hz stands twice"),
        (lambda t: "\n".join(t.splitlines()[:-1]), "no row of microphone top, point p5 at 700 Hz"),
        (
            lambda t: t.replace("front,p0,500.0,", "front,p0,500.0,x"),
            "line 5, real_pascal_per_m_per_s: expected a finite number",
        ),
        (lambda t: t.replace("343.0", "fast"), "sound_speed_m_per_s: expected a finite number"),
        (lambda t: t.replace(",0.6,", ",0.7,", 1), "line 6: microphone_x_m ... of front differ"),
        (lambda t: t.replace("p0,500.0,", "p0,0,", 1), "frequency_hz: expected a positive number, got '0'"),
        (lambda t: "\n".join(t.splitlines()[:4]), "expected rows below the header"),
        (lambda _: "", "missing microphone"),
    ],
)
def test_a_damaged_csv_is_refused_with_its_line(tmp_path, change, said):
    path = tmp_path / "a.csv"
    write_transfer_vectors(path, monopoles(GRID[:3]))
    path.write_text(change(path.read_text()))
    with pytest.raises(TransferVectorError, match=rf"a\.csv: .*{re.escape(said) if '.*' not in said else said}"):
        read_transfer_vectors(path)


def test_a_damaged_npz_is_refused_by_name(tmp_path):
    path = tmp_path / "a.npz"
    for content in (b"", b"PK\x03\x04 no archive", b"text"):
        path.write_bytes(content)
        with pytest.raises(TransferVectorError, match=r"a\.npz"):
            read_transfer_vectors(path)
    np.savez(path, h=np.zeros((1, 1, 1)))
    with pytest.raises(TransferVectorError, match="missing"):
        read_transfer_vectors(path)
    np.savez(path, frequency=[1.0], h=np.zeros((1, 2, 1)), microphones=["m"], points=["p"])
    with pytest.raises(TransferVectorError, match="shape"):
        read_transfer_vectors(path)
    np.savez(path, version=2, frequency=[1.0], h=np.zeros((1, 1, 1)), microphones=["m"], points=["p"])
    with pytest.raises(TransferVectorError, match="version 2"):
        read_transfer_vectors(path)
    with pytest.raises(TransferVectorError, match=r"none\.csv: cannot be read"):
        read_transfer_vectors(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"frequency": np.array([2.0, 1.0])}, "ascending"),
        ({"microphones": ("m", "n")}, "shape"),
        ({"points": ("p", "p")}, "different names"),
        ({"h": np.full((2, 1, 2), np.nan + 0j)}, "finite"),
        ({"normal": np.zeros((1, 3))}, "normal"),
        ({"sound_speed": 0.0}, "sound_speed"),
    ],
)
def test_fields_that_do_not_fit_are_refused_by_name(changes, said):
    good = TransferVectors(np.array([1.0, 2.0]), np.zeros((2, 1, 2), np.complex128), ("m",), ("p", "q"))
    with pytest.raises(TransferVectorError, match=said):
        replace(good, **changes)


def test_nothing_is_extrapolated_and_velocities_must_fit():
    vectors = monopoles(GRID)
    with pytest.raises(TransferVectorError, match="499 Hz is outside the transfer vectors' 500 to 2900 Hz"):
        vectors.pressure([600.0, 499.0], velocities(2))
    with pytest.raises(TransferVectorError, match="velocity must have the shape"):
        vectors.pressure([600.0], velocities(2))
