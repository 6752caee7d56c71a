"""Instantaneous angular speed of Thibault's shaft (seed 002): what encoder and clock its lines need.

Run as ``python -m benchmarks.ias [--quick] [--json FILE]``. Pulses are made from the angle of the disc in the model
``angular`` (radial load 600 N, axial load 200 N; healthy, and with the printed spall of the left bearing; 6000 and
20,000 rpm): the times at which it passes the marks of a wheel with a known error, at a speed that hunts by 0.3 %, with
jitter and the rounding of a clock; 200 turns each. A family stands out where its score exceeds the threshold for one
false alarm in 10,000 (``monitor.health.signal.lines``) within 0.3 % of its line. Tables:

1. lines of the angular speed without any error of the encoder, healthy and with the spall, and beside the torsion mode;
2. the slowest clock at which 3 of 3 records show n x 4.63, n x 4.26 and the three multiples of 4.63 next to the mode,
   for 1024 to 5000 marks, 0.02 degrees off, no jitter;
3. the highest jitter at which they do, with exact times;
4. shorter and longer records, missing pulses, larger errors of the marks, at 2500 marks, 1 GHz and 2 ns;
5. the error of the marks: learned over 1000 turns, against the truth; what remains of the shaft's line;
6. false alarms: the same shaft without bearings, ten families at random each;
7. milliseconds of 1,000,000 pulses (5 s at 40 Hz with 5000 marks).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.common import (
    REFERENCE_MS,
    Row,
    arguments,
    calibration_kernel,
    interleaved_ms,
    print_table,
    write_json,
)
from models.machine.scene import Scene
from models.published.thibault import FAST, SLOW
from models.published.thibault_shaft import BPFO_LEFT, REFERENCE, SPALL, bpfo
from models.solve.angular.solver import Trace, trace
from monitor.health.signal.lines import FALSE_ALARM, fault_lines, noise_threshold
from monitor.health.signal.rotation.encoder import EncoderState, encoder_step
from monitor.health.signal.rotation.ias import IasSpectrum, beside_marks, ias_lines, ias_spectrum, ias_view
from monitor.health.signal.rotation.intervals import intervals
from monitor.health.signal.rotation.train import PulseTrain

Floats = NDArray[np.float64]
TURNS, SETTLE_S, STEP_S = 200, 0.3, 5e-6
HUNTING = 0.003
TORSION_HZ = 25.44 * FAST
MARKS = (1024, 2048, 3600, 5000)
CLOCKS_MHZ = (1000.0, 500.0, 200.0, 100.0, 50.0, 20.0, 10.0)
JITTERS_NS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
OFF_DEGREES, JITTER, CLOCK = 0.02, 2e-9, 1e9
SHARE = 1.0
CLOSE = 0.003
SCENES = {
    "healthy, 6000 rpm": REFERENCE,
    "spall, 6000 rpm": replace(REFERENCE, defect=SPALL),
    "healthy, 20,000 rpm": replace(REFERENCE, speed=FAST),
    "spall, 20,000 rpm": replace(REFERENCE, speed=FAST, defect=SPALL),
}


@dataclass(frozen=True)
class Encoder:
    """A wheel and its counter.

    Attributes:
        marks: a turn.
        clock: Hz, or None for exact times.
        jitter: standard deviation of a time, s.
        degrees: error of the marks, RMS.
        missing: share of pulses that are missing, and counted.
    """

    marks: int
    clock: float | None = CLOCK
    jitter: float = JITTER
    degrees: float = OFF_DEGREES
    missing: float = 0.0


@cache
def turning(scene: Scene, turns: int) -> Trace:
    """Return the motion of the disc, settled, for a few turns more than are used."""
    return trace(scene, SETTLE_S * scene.speed + turns + 5, 2.0 * math.pi * scene.speed * STEP_S)


def off(marks: int, degrees: float) -> Floats:
    """Return errors of marks, revolutions: eccentricity, and 2 % of it from mark to mark."""
    angle = 2.0 * math.pi * np.arange(marks) / marks
    rough = np.random.default_rng(marks).normal(size=marks)
    error = math.sqrt(2.0) * np.cos(angle + 1.0) + 0.02 * rough
    return degrees / 360.0 * (error - error.mean())


@cache
def passages(scene: Scene | None, marks: int, degrees: float, turns: int = TURNS) -> Floats:
    """Return when the marks pass, s, by cubic interpolation of time over angle; None: a shaft at one speed."""
    numbers = np.arange(turns * marks + 1)
    turned = numbers / marks + off(marks, degrees)[numbers % marks]
    if scene is None:
        return turned / SLOW
    found = turning(scene, max(turns, TURNS))
    # The last turns: the beginning has not settled.
    angle = found.angle[-1] - 2.0 * math.pi * (turns + 2.0 - turned)
    left = np.searchsorted(found.angle, angle) - 1
    width = found.angle[left + 1] - found.angle[left]
    u = (angle - found.angle[left]) / width
    slowness = 1.0 / (2.0 * math.pi * scene.speed + found.ias)
    begin, end = width * slowness[left], width * slowness[left + 1]
    rise = found.time[left + 1] - found.time[left]
    time = found.time[left] + u * (begin + u * (3.0 * rise - 2.0 * begin - end + u * (begin + end - 2.0 * rise)))
    return time - time[0]


def record(scene: Scene | None, encoder: Encoder, seed: int, turns: int = TURNS) -> PulseTrain:
    """Return the pulses that a counter would give."""
    draw = np.random.default_rng(seed)
    numbers = np.arange(turns * encoder.marks + 1)
    time = passages(scene, encoder.marks, encoder.degrees, turns)
    # The speed is not a whole number of ticks, and hunts: the rounding is spread over all orders.
    angle = 2.0 * math.pi * turns * draw.uniform(1.0 / 60.0, 1.0 / 25.0) * time / time[-1]
    slow = time[-1] / angle[-1]
    time = time * (1.0 + draw.uniform(-0.01, 0.01)) + HUNTING * slow * np.sin(angle + draw.uniform(0.0, 6.28))
    time += encoder.jitter * draw.normal(size=time.size)
    if encoder.clock is not None:
        time = np.round((time - time[0]) * encoder.clock) / encoder.clock
    kept = draw.random(time.size) >= encoder.missing
    return PulseTrain(time[kept], numbers[kept], encoder.marks)


def spectrum(train: PulseTrain, error: Floats | None = None) -> IasSpectrum:
    """Return the spectrum of the angular speed of a record."""
    return ias_spectrum(intervals(train, error))


def near_torsion(scene: Scene) -> list[int]:
    """Return the three multiples of 4.63 next to the torsion mode."""
    middle = TORSION_HZ / scene.speed / BPFO_LEFT
    return sorted(sorted(range(1, 40), key=lambda n: abs(n - middle))[:3])


def stand_out(found: IasSpectrum, scene: Scene) -> dict[str, bool]:
    """Return which lines of a scene stand out."""
    lines = ias_lines(found, {"n x 4.63": 4.63, "n x 4.26": 4.26})
    truth = {"n x 4.63": BPFO_LEFT, "n x 4.26": bpfo(200.0, scene.speed)}
    stands = {
        name: family.detected and abs(family.fundamental / truth[name] - 1.0) < CLOSE for name, family in lines.items()
    }
    places = near_torsion(scene)
    prepared = beside_marks(found, (max(places) + 2) * BPFO_LEFT)
    singles = [fault_lines(prepared, n * BPFO_LEFT, n_harmonics=1, speed_factor=1.0) for n in places]
    score = math.sqrt(sum(float(one.snr[0]) ** 2 for one in singles) / len(singles))
    stands["torsion"] = score > noise_threshold(len(singles), 2, 1, 3 * prepared.floor_bins, 1.0, FALSE_ALARM)
    return stands


def amplitude(found: IasSpectrum, order: float) -> float:
    """Return the amplitude of a line, rad/s."""
    near = round(order / found.resolution) + np.arange(-2, 3)
    return math.sqrt(float(np.sum(np.square(found.amplitude[near]))) / 1.5)


def lines_table() -> list[Row]:
    """Return the lines of each scene, rad/s."""
    exact = Encoder(5000, None, 0.0, 0.0)
    rows: list[Row] = []
    for name, scene in SCENES.items():
        found = spectrum(PulseTrain(passages(scene, 5000, 0.0), np.arange(TURNS * 5000 + 1), exact.marks))
        right = bpfo(200.0, scene.speed)
        near = [amplitude(found, n * BPFO_LEFT) for n in near_torsion(scene)]
        rows.append(
            {
                "scene": name,
                **{f"{n} x 4.63": amplitude(found, n * BPFO_LEFT) for n in (1, 2, 3)},
                **{f"{n} x 4.26": amplitude(found, n * right) for n in (1, 2)},
                "right": right,
                "mode": TORSION_HZ / scene.speed,
                "beside": " ".join(f"{n * BPFO_LEFT:.1f}" for n in near_torsion(scene)),
                "beside the mode, rms": math.sqrt(float(np.mean(np.square(near)))),
            }
        )
    return rows


def _shares(scene: Scene, encoder: Encoder, seeds: int, turns: int = TURNS) -> dict[str, float]:
    stands = [stand_out(spectrum(record(scene, encoder, seed, turns)), scene) for seed in range(seeds)]
    return {name: sum(one[name] for one in stands) / seeds for name in stands[0]}


def _last(scene: Scene, encoders: Sequence[tuple[float, Encoder]], seeds: int) -> dict[str, float | None]:
    """Return for each kind of lines the last value, from the best encoder on, at which they still stand out."""
    least: dict[str, float | None] = {}
    lost: set[str] = set()
    for value, encoder in encoders:
        shares = _shares(scene, encoder, seeds)
        for name, share in shares.items():
            least.setdefault(name, None)
            if share < SHARE:
                lost.add(name)
            elif name not in lost:
                least[name] = value
        if len(lost) == len(shares):
            break
    return least


def limits(seeds: int, marks: Sequence[int], encoders: Mapping[float, Encoder]) -> list[Row]:
    """Return the worst of some encoders, from the best on, with which each kind of lines stands out."""
    rows: list[Row] = []
    for name, scene in SCENES.items():
        for count in marks:
            tried = [(value, replace(encoder, marks=count)) for value, encoder in encoders.items()]
            rows.append({"scene": name, "marks": count, **_last(scene, tried, seeds)})
    return rows


def harder(seeds: int) -> list[Row]:
    """Return the share of records in which each kind of lines stands out under what a wheel suffers."""
    plain = Encoder(2500)
    cases: dict[str, tuple[Encoder, int]] = {
        "as it is": (plain, TURNS),
        "50 turns": (plain, 50),
        "100 turns": (plain, 100),
        "0.1 % of pulses missing": (replace(plain, missing=1e-3), TURNS),
        "1 % of pulses missing": (replace(plain, missing=1e-2), TURNS),
        "marks exact": (replace(plain, degrees=0.0), TURNS),
        "marks 0.1 degrees off": (replace(plain, degrees=0.1), TURNS),
        "marks 1 degree off": (replace(plain, degrees=1.0), TURNS),
    }
    rows: list[Row] = []
    for name, scene in SCENES.items():
        chosen = cases if scene.speed == SLOW else {"as it is": (plain, TURNS), "1000 turns": (plain, 1000)}
        for case, (encoder, turns) in chosen.items():
            rows.append({"scene": name, "case": case, **_shares(scene, encoder, seeds, turns)})
    return rows


def _elsewhere(train: PulseTrain, first: int) -> PulseTrain:
    """Return a train whose count begins with the first pulse: where the wheel stood is not known."""
    cut = train.numbers >= first
    return PulseTrain(train.times[cut], train.numbers[cut] - first, train.per_revolution)


def encoder_errors() -> list[Row]:
    """Return how well the error of the marks is learned, without an index."""
    rows: list[Row] = []
    scene = SCENES["spall, 6000 rpm"]
    for encoder in (
        *(Encoder(1024, 1e8, 1e-8, degrees) for degrees in (0.0, 1e-4, 1e-3, 0.01, 0.1)),
        Encoder(1024, 1e7, 1e-8, 0.1),
        Encoder(60, 1e7, 1e-6, 0.1),
        Encoder(1024, 1e8, 1e-8, 0.1, missing=0.01),
    ):
        state = EncoderState()
        for block in range(7):
            state, _ = encoder_step(state, _elsewhere(record(scene, encoder, block), 37 * block % encoder.marks))
        begins = 37 * 7 % encoder.marks
        train = _elsewhere(record(scene, encoder, 7), begins)
        state, reading = encoder_step(state, train)
        plain, mended = (amplitude(spectrum(train, error), 1.0) for error in (None, reading.error))
        truth = np.roll(off(encoder.marks, encoder.degrees), -begins)
        left = None if reading.error is None else 360.0 * float(np.std(reading.error - truth))
        rows.append(
            {
                "marks": encoder.marks,
                "clock_mhz": 1e-6 * (encoder.clock or 0.0),
                "missing_percent": 100.0 * encoder.missing,
                "true_deg": 360.0 * float(np.std(truth)),
                "status": reading.status,
                "learned_deg": 360.0 * (reading.rms or 0.0),
                "stated_error_deg": 360.0 * (reading.rms_error or 0.0),
                "error_deg": left,
                "turns": reading.turns,
                "line_1_before_rad_s": plain,
                "line_1_after_rad_s": mended if reading.error is not None else None,
            }
        )
    return rows


def false_alarms(records: int) -> list[Row]:
    """Return how often families are found on a shaft without bearings."""
    rows: list[Row] = []
    cases = {
        "clock 10 MHz": Encoder(1024, 1e7, 0.0),
        "clock 1 GHz, jitter 2 ns": Encoder(1024),
        "marks 0.1 degrees off": Encoder(1024, degrees=0.1),
        "1 % of pulses missing": Encoder(1024, missing=0.01),
    }
    for place, (case, encoder) in enumerate(cases.items()):
        found = 0
        for seed in range(10_000 * (place + 1), 10_000 * (place + 1) + records):
            train = record(None, encoder, seed)
            draw = np.random.default_rng(100_000 + seed)
            families = {str(k): float(draw.uniform(2.2, 8.0)) for k in range(10)}
            found += sum(lines.detected for lines in ias_lines(spectrum(train), families).values())
        rows.append(
            {"case": case, "searches": 10 * records, "found": found, "rate": found / (10 * records), "set": FALSE_ALARM}
        )
    return rows


def cost(rounds: int) -> list[Row]:
    """Return milliseconds for the pulses of 5 s."""
    kernel: Callable[[], object] = calibration_kernel()
    rows: list[Row] = []
    for marks in (1024, 5000):
        count = marks * TURNS
        draw = np.random.default_rng(0)
        times = np.cumsum(1.0 + 1e-3 * draw.normal(size=count + 1)) / (marks * 40.0)
        train = PulseTrain(times, np.arange(count + 1), marks)
        state, _ = encoder_step(EncoderState(), train)
        found = intervals(train)
        made = ias_spectrum(found)

        def lines(made: IasSpectrum = made) -> Any:
            return ias_lines(made, {"outer": 4.63, "inner": 6.37, "ball": 5.2, "cage": 0.42}), ias_view(made)

        times_ms = interleaved_ms(
            {
                "kernel": kernel,
                "intervals": lambda train=train: intervals(train),
                "spectrum": lambda found=found: ias_spectrum(found),
                "lines": lines,
                "encoder": lambda state=state, train=train: encoder_step(state, train),
            },
            rounds,
        )
        scale = REFERENCE_MS / times_ms["kernel"]
        rows.append(
            {"pulses": count, **{f"{k}_ms": v for k, v in times_ms.items()}}
            | {f"{k}_ms_at_reference": v * scale for k, v in times_ms.items() if k != "kernel"}
        )
    return rows


def main() -> None:
    """Print the tables."""
    given = arguments(__doc__ or "")
    quick = given.quick
    seeds, marks = (2, (1024, 5000)) if quick else (3, MARKS)
    makers: dict[str, Callable[[], list[Row]]] = {
        "lines_rad_s": lines_table,
        "least_clock_mhz": lambda: limits(seeds, marks, {c: Encoder(0, 1e6 * c, 0.0) for c in CLOCKS_MHZ}),
        "most_jitter_ns": lambda: limits(seeds, marks, {j: Encoder(0, None, 1e-9 * j) for j in JITTERS_NS}),
        "harder": lambda: harder(seeds),
        "encoder_error": encoder_errors,
        "false_alarms": lambda: false_alarms(20 if quick else 1500),
        "cost": lambda: cost(5 if quick else 20),
    }
    tables: dict[str, list[Row]] = {}
    for name, make in makers.items():
        tables[name] = make()
        print_table(name, tables[name])
    write_json(given.json, tables)


if __name__ == "__main__":
    main()
