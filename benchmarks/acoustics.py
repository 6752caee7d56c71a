"""Sound: boundary elements against a multipole series, their cost, given vectors, third octaves against filters.

Run as ``python -m benchmarks.acoustics [--quick] [--json FILE]``. A sphere of 1 m radius over a rigid plane, pulsating
and moving up and down and sideways, at twelve microphones; the reference is the series of multipoles of
``tests/oracles/sphere_over_plane.py``, in which no element is. "error dB" is the largest difference of levels among
microphones less than 10 dB below the mean square of all, "of mean dB" that of all microphones,
20 lg (1 + |p - exact| / rms of the exact ones). k a = pi, 4.4934, 5.7635 and 2 pi are resonances of the
air within the sphere.
"""

from __future__ import annotations

import time
import tracemalloc
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.gears.sound.boundary_elements import AIR_DENSITY, COUPLING, radiation_cost, transfer_vectors
from models.gears.sound.filter_bank import bands_by_filters
from models.gears.sound.influence import influence
from models.gears.sound.levels import level_db, line_mean_squares
from models.gears.sound.shapes import box, sphere
from models.gears.sound.third_octave import Bands, bands_of_record
from models.gears.sound.transfer_vectors import TransferVectors
from models.gears.sound.weighting import weighting_db
from tests.oracles.sphere_over_plane import MOTIONS, SphereOverPlane, exact_pressure
from tests.support.levels import A_TABLE

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from models.gears.sound.surface import Surface

SPEED = 343.0
RESONANCES = (np.pi, 4.493409458, 5.763459197, 2.0 * np.pi)
WAVE_NUMBERS = (0.5, 2.0, np.pi, 4.493409458, 5.0, 5.763459197, 2.0 * np.pi)
HEIGHTS = (None, 1.02, 1.1, 1.5, 3.0)
LEAST_SPLITS = 4
EDGE = 1.315
"""Longest edge of ``sphere(1, splits)`` times splits, from eight splits on; a little less below."""


def microphones() -> NDArray[np.float64]:
    """Return twelve places from 0.2 to 3 m off a sphere, all at least 0.1 m above the plane."""
    rng = np.random.default_rng(5)
    turn, up = rng.uniform(0.0, 2.0 * np.pi, 12), rng.uniform(0.1, 3.0, 12)
    away = rng.uniform(1.2, 4.0, 12)
    return np.column_stack((away * np.cos(turn), away * np.sin(turn), up))


def motion_of(surface: Surface, name: str) -> NDArray[np.float64]:
    """Return the normal velocity of each element for a motion of ``MOTIONS``."""
    return {"pulsating": np.ones(len(surface)), "up and down": surface.normal[:, 2]}.get(name, surface.normal[:, 0])


def hertz(k: float) -> float:
    """Return the frequency of a wave number."""
    return k * SPEED / (2.0 * np.pi)


def errors(h: NDArray[np.complex128], surface: Surface, oracle: SphereOverPlane) -> dict[str, float]:
    """Return the largest errors of vectors (microphones, elements) over the motions."""
    loud, mean, missed = 0.0, 0.0, 0.0
    for motion in MOTIONS:
        exact, gap = exact_pressure(oracle, motion, microphones())
        found = h @ motion_of(surface, motion)
        rms = np.sqrt(np.mean(np.abs(exact) ** 2))
        heard = np.abs(exact) > 10.0**-0.5 * rms
        loud = max(loud, float(np.max(np.abs(20.0 * np.log10(np.abs(found / exact)[heard])))))
        mean = max(mean, float(np.max(20.0 * np.log10(1.0 + np.abs(found - exact) / rms))))
        missed = max(missed, gap)
    return {"error dB": loud, "of mean dB": mean, "oracle misses": missed}


def over_heights(per_wavelength: float, *, quick: bool) -> list[Row]:
    """Return errors of spheres at heights, the mesh made for each wave number."""
    rows: list[Row] = []
    for height in HEIGHTS[2:4] if quick or per_wavelength > 6.0 else HEIGHTS:
        for k in WAVE_NUMBERS[:4] if quick or per_wavelength > 6.0 else WAVE_NUMBERS:
            splits = max(int(np.ceil(EDGE * per_wavelength * k / (2.0 * np.pi))), LEAST_SPLITS)
            surface = sphere(1.0, splits, (0.0, 0.0, height or 0.0), over_plane=height is not None)
            found = transfer_vectors(surface, hertz(k), microphones(), min_per_wavelength=1.0)
            oracle = SphereOverPlane(1.0, height, k, terms=80 if height and height < 1.1 else 40)
            rows.append(
                {
                    "made for": per_wavelength,
                    "height": height,
                    "ka": k,
                    "elements": len(surface),
                    "per wavelength": float(found.per_wavelength[0]),
                    **errors(found.vectors.h[0], surface, oracle),
                    "residual": float(found.residual[0]),
                    "gap": found.gap,
                    "status": found.status[0],
                }
            )
    return rows


def summary(rows: list[Row]) -> list[Row]:
    """Return the worst of all heights and wave numbers, by status, at resonances and elsewhere."""
    found: list[Row] = []
    groups = sorted({(float(r["made for"] or 0.0), str(r["status"]), r["ka"] in RESONANCES) for r in rows})
    for made, status, at in groups:
        chosen = [r for r in rows if (r["made for"], r["status"], r["ka"] in RESONANCES) == (made, status, at)]
        worst = {key: max(float(r[key] or 0.0) for r in chosen) for key in ("error dB", "of mean dB", "residual")}
        where = "resonances" if at else "others"
        found.append({"made for": made, "status": status, "wave numbers": where, "runs": len(chosen), **worst})
    return found


def around_a_resonance() -> list[Row]:
    """Return errors at wave numbers within 1 % of the first two resonances, one mesh."""
    surface = sphere(1.0, 6, (0.0, 0.0, 1.5), over_plane=True)
    rows: list[Row] = []
    for middle in RESONANCES[:2]:
        k = middle * np.array([0.99, 0.997, 0.999, 1.0, 1.001, 1.003, 1.01])
        found = transfer_vectors(surface, k * SPEED / (2.0 * np.pi), microphones())
        each = [
            errors(h, surface, SphereOverPlane(1.0, 1.5, float(x))) for x, h in zip(k, found.vectors.h, strict=True)
        ]
        worst = {key: max(e[key] for e in each) for key in ("error dB", "of mean dB")}
        rows.append({"about ka": middle, "elements": len(surface), "runs": len(k), **worst})
    return rows


def couplings() -> list[Row]:
    """Return errors of a pulsating sphere in free space at its first resonance, by Burton and Miller's equation alone.

    With the usual coupling and with the small one, and with points inside as ``transfer_vectors`` solves it.
    """
    rows: list[Row] = []
    k = float(RESONANCES[0])
    exact, _ = exact_pressure(SphereOverPlane(1.0, None, k), "pulsating", microphones())
    for splits in (4, 8):
        surface = sphere(1.0, splits)
        half = 0.5 * np.eye(len(surface))
        on = influence(surface.middle, surface.normal, surface.panels, over_plane=False)
        off = influence(microphones(), np.ones_like(microphones()), surface.panels, over_plane=False)
        heard, direct = off.matrices(k, 0j)
        load = 1j * k * SPEED * AIR_DENSITY
        small = COUPLING * float(np.sqrt(surface.area.mean()))
        for name, c in (("i / k", -1j / k), ("small", -1j * small), ("small, points inside", None)):
            if c is None:
                pressure = transfer_vectors(surface, hertz(k), microphones()).vectors.h[0].sum(axis=1)
            else:
                double, single = on.matrices(k, c)
                right = (single + c * half).sum(axis=1)
                pressure = load * (heard @ np.linalg.solve(half - double, right) + direct.sum(axis=1))
            error = float(np.max(np.abs(20.0 * np.log10(np.abs(pressure / exact)))))
            rows.append({"coupling": name, "elements": len(surface), "error dB": error})
    return rows


def convergence(*, quick: bool) -> list[Row]:
    """Return errors over the size of the elements, and the order, at a resonance and away from it."""
    rows: list[Row] = []
    for k in (2.0, np.pi):
        before: float | None = None
        for splits in (3, 4, 6) if quick else (3, 4, 6, 8, 11):
            surface = sphere(1.0, splits, (0.0, 0.0, 1.5), over_plane=True)
            found = transfer_vectors(surface, hertz(k), microphones(), min_per_wavelength=1.0)
            error = errors(found.vectors.h[0], surface, SphereOverPlane(1.0, 1.5, k))["of mean dB"]
            rows.append({"ka": k, "splits": splits, "elements": len(surface), "of mean dB": error})
            if before is not None:
                last = rows[-2]["splits"]
                rows[-1] = {**rows[-1], "order": float(np.log(before / error) / np.log(splits / float(last or 1)))}
            else:
                rows[-1] = {**rows[-1], "order": None}
            before = error
    return rows


def boxes(*, quick: bool) -> list[Row]:
    """Return errors of a box whose velocity is that of a source within it, at resonances of the air in the box."""
    size = (0.4, 0.3, 0.24)
    places = np.array([(0.5, 0.2, 0.3), (-0.4, 0.1, 0.1), (0.0, 0.0, 0.6), (0.3, -0.4, 0.05)])
    rows: list[Row] = []
    for times in (1, 2) if quick else (1, 2, 3):
        surface = box(size, (10 * times, 8 * times, 6 * times), on_plane=True)
        for name, modes in (("first", (1, 1, 0.5)), ("second", (2, 1, 0.5))):
            k = np.pi * float(np.linalg.norm(np.array(modes) / size))

            def field(x: NDArray[np.float64], k: float = k) -> NDArray[np.complex128]:
                r = [np.linalg.norm(x - (0.05, -0.04, z), axis=1) for z in (0.12, -0.12)]
                return np.asarray(sum(np.exp(-1j * k * d) / d for d in r))

            step = 1e-5 * surface.normal
            slope = (field(surface.middle + step) - field(surface.middle - step)) / 2e-5
            found = transfer_vectors(surface, hertz(k), places, min_per_wavelength=1.0)
            pressure = found.vectors.h[0] @ (slope / (-1j * k * SPEED * 1.2))
            error = float(np.max(np.abs(20.0 * np.log10(np.abs(pressure / field(places))))))
            rows.append(
                {
                    "resonance": name,
                    "elements": len(surface),
                    "per wavelength": float(found.per_wavelength[0]),
                    "error dB": error,
                    "residual": float(found.residual[0]),
                }
            )
    return rows


def cost(*, quick: bool) -> list[Row]:
    """Return processor time and memory of one frequency and two microphones, and what was said before."""
    rows: list[Row] = []
    for splits in (4, 6) if quick else (4, 6, 8, 11):
        surface = sphere(1.0, splits, (0.0, 0.0, 1.5), over_plane=True)
        said = radiation_cost(surface, 1, 2)
        start = time.thread_time()
        transfer_vectors(surface, [50.0], microphones()[:2])
        one = time.thread_time() - start
        start = time.thread_time()
        transfer_vectors(surface, [50.0, 51.0], microphones()[:2])
        two = time.thread_time() - start
        tracemalloc.start()
        transfer_vectors(surface, [50.0], microphones()[:2])
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        rows.append(
            {
                "elements": len(surface),
                "s a frequency": two - one,
                "said s": said.seconds,
                "s before": 2.0 * one - two,
                "peak MB": peak / 1e6,
                "said MB": said.memory / 1e6,
            }
        )
    return rows


def given_vectors(*, quick: bool) -> list[Row]:
    """Return errors of vectors applied half-way between their frequencies, a sphere of 0.1 m over the plane."""
    surface = sphere(0.1, 3 if quick else 4, (0.0, 0.0, 0.25), over_plane=True)
    places = np.array([(0.3, 0.0, 0.25), (-0.1, 0.35, 0.6)])
    fine = np.arange(562.5, 2838.0, 25.0)
    found = transfer_vectors(surface, fine, places, min_per_wavelength=3.0).vectors
    velocity = np.random.default_rng(6).standard_normal((1, 6)) @ np.vstack(
        (
            np.ones(len(surface)),
            surface.normal.T,
            surface.normal[:, 0] * surface.normal[:, 2],
            surface.normal[:, 1] ** 2,
        )
    )
    rows: list[Row] = []
    for step in (2, 4, 8, 16):
        for placed in (True, False):
            position = surface.middle if placed else None
            grid = fine[::step]
            between = fine[step // 2 :: step]
            between = between[between < grid[-1]]
            given = TransferVectors(
                grid, found.h[::step], found.microphones, found.points, places, position, None, SPEED, over_plane=True
            )
            exact = found.h[step // 2 :: step][: len(between)] @ velocity[0]
            pressure = given.pressure(between, np.repeat(velocity, len(between), axis=0))
            levels = level_db(line_mean_squares(pressure)) - level_db(line_mean_squares(exact))
            rows.append(
                {
                    "step Hz": 25.0 * step,
                    "places known": str(placed),
                    "error dB": float(np.max(np.abs(levels))),
                    "stated dB": float(given.interpolation_error_db().max()),
                }
            )
    return rows


def third_octaves(*, quick: bool) -> list[Row]:
    """Return differences of levels by FFT from those of the filters: records of 20 s at 51,200 Hz, 100 to 8000 Hz.

    All bands within 30 dB of the loudest count.
    """
    rate, bands = 51_200.0, Bands.between(100.0, 8000.0)
    moment = np.arange(int(20.0 * rate)) / rate
    rows: list[Row] = []
    for kind in ("noise", "mesh lines and noise"):
        worst = {"ideal": [0.0, 0.0], "filter": [0.0, 0.0]}
        for seed in range(2 if quick else 5):
            rng = np.random.default_rng(seed)
            spectrum = np.fft.rfft(rng.standard_normal(len(moment)))
            spectrum[1:] *= np.arange(1.0, len(spectrum)) ** rng.uniform(-0.75, 0.0)
            record = np.fft.irfft(spectrum)
            record /= np.std(record)
            if kind != "noise":
                mesh = rng.uniform(200.0, 900.0)
                lines = [(n * mesh + s * mesh / 37.0, 0.2 ** abs(s)) for n in range(1, 8) for s in (-1, 0, 1)]
                record += sum(a * rng.uniform(0.3, 3.0) * np.sin(2.0 * np.pi * f * moment) for f, a in lines)
            filters = level_db(bands_by_filters(record, rate, bands))
            for shape, found in worst.items():
                difference = np.abs(level_db(bands_of_record(record, rate, bands, shape=shape)) - filters)
                difference = difference[filters > filters.max() - 30.0]
                found[0] = max(found[0], float(difference.max()))
                found[1] = max(found[1], float(np.sqrt(np.mean(difference**2))))
        for shape, (largest, rms) in worst.items():
            rows.append({"records": kind, "shape": shape, "largest dB": largest, "worst rms dB": rms})
    return rows


def tones() -> list[Row]:
    """Return errors of A-weighted tones at the mid-band frequencies, 10 Hz to 20 kHz, against the printed table."""
    centres = Bands(-20, 13).centre
    rate = 51_200.0
    moment = np.arange(int(6.0 * rate)) / rate
    by_record = np.empty(len(centres))
    for place, f in enumerate(centres):
        band = Bands(place - 20, place - 20)
        by_record[place] = level_db(
            bands_of_record(np.sqrt(2.0) * np.sin(2.0 * np.pi * f * moment), rate, band, weighting="A"), 1.0
        )[0]
    table, exact = np.array(A_TABLE), weighting_db(centres)
    return [
        {"tones": "by poles, against the table of 0.1 dB", "largest dB": float(np.max(np.abs(exact - table)))},
        {"tones": "of records, against the poles", "largest dB": float(np.max(np.abs(by_record - exact)))},
    ]


def main() -> None:
    """Compute, print and write all tables."""
    options = arguments(__doc__ or "")
    made_for = (6.0,) if options.quick else (4.0, 6.0, 10.0)
    quick = bool(options.quick)
    steps: dict[str, Callable[[], list[Row]]] = {
        "spheres": lambda: [row for made in made_for for row in over_heights(made, quick=quick)],
        "sphere over a plane, worst": lambda: summary(tables["spheres"]),
        "about resonances": around_a_resonance,
        "couplings": couplings,
        "convergence": lambda: convergence(quick=quick),
        "boxes": lambda: boxes(quick=quick),
        "cost": lambda: cost(quick=quick),
        "given vectors": lambda: given_vectors(quick=quick),
        "third octaves": lambda: third_octaves(quick=quick),
        "A-weighted tones": tones,
    }
    tables: dict[str, list[Row]] = {}
    for name, step in steps.items():
        tables[name] = step()
        print_table(name, tables[name])
        write_json(options.json, tables)


if __name__ == "__main__":
    main()
