"""What healthy recordings say of a rig to failure (PRONOSTIA), and what V_eq and TT become with it.

    python -m benchmarks.identify_pronostia [--quick | --ends] [--json FILE]

The recordings are those of ``benchmarks.score_real``. Healthy are the blocks that the program learns from (the 100
after the first 30 of each run). Their spectra, averaged over the runs of one load, give resonances of either axis;
which axis is along the load is left open. With them enter: the level of healthy blocks as an upper limit, and the
priors of the bearing's geometry. Nothing is known of masses, shaft and housing of the rig. One set of parameters is
sought for all loads. Then V_eq and the forecasts of ``score_real`` are computed by its own code, with the thesis' bench
(before) and with the best fit (after). Nothing was tuned on the outcome.

``--quick``: resonances and identification only; ``--ends``: V_eq at the ends, without forecasts.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import score_real
from benchmarks.common import print_table, write_json
from models.identify.evidence import Evidence, Peak
from models.identify.geometry import geometry_priors
from models.identify.leaning import leaning
from models.identify.limits import wide_limits
from models.identify.resonances import find_resonances, welch
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.space import FREE_WITHOUT_TESTS, Space
from models.identify.trials import Condition, Trial, gather
from models.identify.volume import OperatingPoint, objections, volume_spread
from monitor.identify.rig_table import key_of
from monitor.service.setup import open_configured
from streams.block import STANDARD_GRAVITY, Block
from tests.support.recordings import EXAMPLES, RUNS, Run

Signals = list[NDArray[np.float64]]

SEED = 2012
RATE = 25600.0
LIVES = 40
"""Of each library: fewer than in ``score_real``, the same number before and after."""
METHOD = score_real.METHODS["thesis"]


def healthy_blocks(run: Run, folder: Path) -> dict[str, Signals]:
    """Return the blocks that the program learns from, by channel, m/s2."""
    config = score_real.configuration(run, 0.05e-6, METHOD)
    first = config.detect.run_in_blocks
    count = config.detect.learn_blocks or 100
    found: dict[str, Signals] = {name: [] for name in score_real.CHANNELS}
    accepted = 0
    for item in open_configured(config, config.source[0], str(folder / run.file)):
        if not isinstance(item, Block):
            continue
        accepted += 1
        if accepted > first:
            for name, signals in found.items():
                samples = np.asarray(item.samples[item.channels.index(name)], dtype=np.float64)
                signals.append(samples * STANDARD_GRAVITY)
        if accepted == first + count:
            break
    return found


def evidence_of(runs: Sequence[Run], folder: Path) -> tuple[list[Peak], list[Trial]]:
    """Return the resonances of either axis under each load, and the level of the quieter axis."""
    by_point: dict[tuple[float, float], dict[str, Signals]] = {}
    for run in runs:
        operating = score_real.configuration(run, 0.05e-6, METHOD).operating
        assert operating.load_newton is not None
        assert operating.speed_hz is not None
        joined = by_point.setdefault((operating.load_newton, operating.speed_hz), {})
        for name, signals in healthy_blocks(run, folder).items():
            joined.setdefault(name, []).extend(signals)
    peaks: list[Peak] = []
    trials: list[Trial] = []
    for (load, speed), channels in sorted(by_point.items()):
        for signals in channels.values():
            peaks += [
                Peak(load, "", r.frequency, r.frequency_sd, r.damping, r.damping_sd, extracted=True)
                for r in find_resonances(welch(signals, RATE), (50.0, 0.45 * RATE))
            ]
        levels = [float(np.sqrt(np.mean(np.square(np.concatenate(signals))))) for signals in channels.values()]
        trials.append(Trial(Condition(load, speed, 0.0, 3.5e-3), min(levels), math.nan))
    return peaks, trials


def identified(runs: Sequence[Run], folder: Path) -> tuple[Identification, dict[str, Any]]:
    """Identify one rig from the healthy blocks of all runs; return it with its figures."""
    config = score_real.configuration(runs[0], 0.05e-6, METHOD)
    entry = config.entry_of(config.channel[0])
    peaks, trials = evidence_of(runs, folder)
    began = time.process_time()
    loads = tuple(sorted({peak.load for peak in peaks}))
    space = Space(config.rig_of(entry), entry.bearing, loads, free=FREE_WITHOUT_TESTS, limits=wide_limits())
    evidence = Evidence(tuple(peaks), tuple(geometry_priors(entry)))
    found = identify(gather(trials), space, IdentifyOptions(seed=SEED), evidence)
    spread = volume_spread(found, OperatingPoint(4000.0, 30.0))
    residuals = evidence.residuals(space, found.best.values)
    pairs = residuals[: 2 * len(peaks)].reshape(-1, 2)
    return found, {
        "peaks": [
            [p.load, p.frequency, p.frequency_sd, p.damping, p.damping_sd] for p in sorted(peaks, key=lambda p: p.load)
        ],
        "explained": int(np.count_nonzero(np.hypot(pairs[:, 0], pairs[:, 1]) < 2.0)),
        "healthy_rms_g": [trial.rms / STANDARD_GRAVITY for trial in trials],
        "model_healthy_rms_g": (found.features[:, 0] / STANDARD_GRAVITY).tolist(),
        "priors": [[p.name, p.value, p.sd, p.source, p.at_least] for p in evidence.priors],
        "best": {name: found.best.values[name] for name in space.free},
        "intervals": {name: [i.low, i.high] for name, i in found.intervals.items()},
        "undetermined": list(found.undetermined),
        "leans_on": leaning(found),
        "misfit": math.sqrt(found.limit.variance),
        "spread of V_eq": [[1e6 * s.volume, s.low, s.high] for s in spread],
        "not calibrated": objections(found, spread, ()),
        "effective draws": found.posterior.effective,
        "cpu_s": time.process_time() - began,
    }


def ends_of(recordings: Sequence[score_real.Recording]) -> dict[str, Any]:
    """Return V_eq at the ends of the runs and its spread over runs and channels."""
    ends = [v_eq for recording in recordings for v_eq in recording.ends.values()]
    return {
        "ends_mm2": {r.run.name: {name: 1e6 * v for name, v in r.ends.items()} for r in recordings},
        "spread": max(ends) / min(ends),
        "log_sd": float(np.std(np.log(ends), ddof=1)),
    }


def forecasts(recordings: Sequence[score_real.Recording]) -> list[dict[str, Any]]:
    """Return the scores of the forecasts on runs that were read, means over the runs."""
    thresholds = [score_real.threshold_for(recording, recordings) for recording in recordings]
    config = score_real.configuration(recordings[0].run, thresholds[0], METHOD)
    library = score_real.library_of(config, thresholds, LIVES)
    return score_real.mean_table([score_real.score(recording, recordings, library) for recording in recordings])


def main() -> None:
    """Identify, track, score, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="resonances and identification only")
    parser.add_argument("--ends", action="store_true", help="no forecasts: V_eq at the ends only")
    options = parser.parse_args()
    folder = Path(os.environ.get("SPALLWATCH_DATA") or EXAMPLES.parents[1] / "shared" / "data")
    found, figures = identified(RUNS, folder)
    print(figures, flush=True)
    result: dict[str, Any] = {"identification": figures}
    write_json(options.json, result)
    if options.quick:
        return
    rig = {key_of(name, "ball"): found.best.values[name] for name in found.space.free}
    for when, values in (("before", {}), ("after", rig)):
        score_real.assume_rig(values)
        recordings = [score_real.read(run, folder) for run in RUNS]
        result[when] = ends_of(recordings)
        print(f"{when}: V_eq at the ends spans x {result[when]['spread']:.3g}", flush=True)
        write_json(options.json, result)
        if options.ends:
            continue
        result[when]["means"] = forecasts(recordings)
        print_table(f"forecasts {when}", result[when]["means"])
        write_json(options.json, result)


if __name__ == "__main__":
    main()
