"""What an answer over time costs by the accuracy that is asked for, and how well its stated error covers the true one.

Run as ``python -m benchmarks.engine.length [--quick] [--json FILE]``. Random scenes over time (as ``benchmarks.engine.
estimates`` draws them) at three accuracies, with the length that follows the error, and beside it with one second. The
reference is a run of a fine accuracy over LONGEST seconds; what it states counts for an answer.
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.common import Row, Tables, benchmark
from benchmarks.engine.estimates import turning_scene
from models.machine.scene import Scene
from models.solve.response import Response
from models.solve.six_dof import time_domain
from models.words.request import USUAL_SECONDS, Request

ACCURACIES = (3e-2, 1e-2, 1e-3)
LONGEST, FINE = 40.0, 1e-4
SEED = 40


def timed(scene: Scene, request: Request) -> tuple[Response, float]:
    """Return a response and the thread time of a second call, s."""
    time_domain.solve(scene, request)
    began = time.thread_time()
    return time_domain.solve(scene, request), time.thread_time() - began


def rows_of(scenes: list[Scene], truths: list[Response], accuracy: float, duration: float | None) -> Row:
    """Return the cost and the errors of all scenes, medians if nothing else is said."""
    found = [timed(scene, Request(accuracy=accuracy, duration=duration)) for scene in scenes]
    answers = [one for one, _ in found]
    true = np.array([abs(one.rms / truth.rms - 1.0) for one, truth in zip(answers, truths, strict=True)])
    doubt = np.array([truth.rms_error for truth in truths])
    stated = np.array([one.rms_error for one in answers])
    seconds = [one.record.signal.shape[1] / one.record.rate for one in answers if one.record is not None]
    return {
        "asked for": accuracy,
        "length": "as needed" if duration is None else f"{duration:g} s",
        "scenes": len(scenes),
        "simulated s": float(np.median(seconds)),
        "ms": 1e3 * float(np.median([spent for _, spent in found])),
        "ms, most": 1e3 * max(spent for _, spent in found),
        "stated": float(np.median(stated)),
        "true": float(np.median(true)),
        "covered": float(np.mean(true <= stated + doubt)),
        "inaccurate": sum(one.status == "inaccurate" for one in answers),
    }


@benchmark(__doc__ or "")
def main(quick: bool) -> Tables:
    """Print the table."""
    rng = np.random.default_rng(SEED)
    scenes = [turning_scene(rng, number) for number in range(8 if quick else 40)]
    fine = Request(accuracy=FINE, duration=LONGEST / (4.0 if quick else 1.0))
    truths = [time_domain.solve(scene, fine) for scene in scenes]
    lengths = (None, USUAL_SECONDS)
    return {"lengths": [rows_of(scenes, truths, accuracy, one) for accuracy in ACCURACIES for one in lengths]}
