"""The engine's answers to scenes of the oracle: right, wrong, refused or none in time."""

from __future__ import annotations

import math
import time
from dataclasses import asdict, dataclass
from typing import Any

from models.machine.bearing import Bearing
from models.machine.rig import Rig
from models.machine.scene import Defect, Floor, Scene, Waviness
from models.solve.simulate import simulate
from reference.periodic.rig import OracleScene
from reference.periodic.settle import Caps, simulate_oracle

# Accuracy that counts as asked where none is named, and how many times it an answer called converged may be off.
DEFAULT_ACCURACY = 1e-3
SLACK = 3.0
# Spread of the RMS from period to period, relative, above which a motion certainly does not repeat.
_UNREST = 1e-3
_STANDARD_ERRORS = 3.0
# Relative errors that the oracle does not see in its own: the end of the transient (runs settle to 1e-6), crests
# between the places at which they are looked for. Those of lines are relative to the strongest.
_LEAST_DOUBT = {"rms": 1e-6, "peak": 1e-5, "line": 2e-6}


def engine_scene(scene: OracleScene) -> Scene:
    """Return the same scene in the product's words."""
    g, rough = scene.geometry, scene.rough
    bearing = Bearing(
        designation=g.name,
        n_elements=g.n_elements,
        element_diameter=2.0 * g.element_radius,
        pitch_diameter=2.0 * g.pitch_radius,
        contact_angle=g.contact_angle,
        rows=g.rows,
        element="ball" if g.element == "ball" else "roller",
        outer_race_radius=g.outer_race_radius,
    )
    floor = Floor() if rough is None else Floor("rough", rough.sd, rough.pitch, rough.cutoff, rough.seed)
    defects = [Defect(pit.extent, pit.depth, floor, pit.position, pit.rows) for pit in scene.pits]
    rig = Rig(**asdict(scene.parameters), element="ball" if g.element == "ball" else "roller")
    return Scene(
        *(scene.speed, scene.load, bearing, rig),
        defect=defects[0] if defects else None,
        clearance=scene.clearance,
        waviness=tuple(Waviness(wave.amplitude, wave.order, "outer", wave.phase) for wave in scene.waves),
        more_defects=tuple(defects[1:]),
    )


def answer(scene: OracleScene, accuracy: float | None) -> dict[str, Any]:
    """Return status, levels, the engine's own error estimates (those of lines in m/s2), and its cost, ms."""
    options: dict[str, Any] = {} if accuracy is None else {"accuracy": accuracy}
    begun = time.thread_time()
    try:
        found = simulate(engine_scene(scene), **options)
    except (ValueError, RuntimeError, MemoryError) as error:
        return {"status": "refused", "reason": f"{type(error).__name__}: {error}"[:200]}
    return {
        "status": found.status,
        "rms": found.rms,
        "peak": found.peak,
        "spread": found.spread,
        "lines": [float(a) for a in found.harmonics],
        "estimate": found.rms_error,
        "peak_estimate": found.peak_error,
        "line_estimates": [float(e) for e in found.harmonics_error],
        "ms": 1e3 * (time.thread_time() - begun),
    }


def verdict(scene: OracleScene, truth: dict[str, Any] | None, got: dict[str, Any], asked: float) -> dict[str, Any]:
    """Return one row of the comparison.

    ``error``: relative difference of the RMS; ``doubt``: what of it the oracle itself may be off by (its own error,
    and three standard errors of a mean that does not repeat); ``bounded``: whether the engine's estimate, if it gives
    one, covers the error; ``wrong``: called converged, and off by more than SLACK times what was asked; ``unstable``:
    called converged, where simulating on does not repeat; ``motion``: highest resonance in the motion, in ball rates.
    """
    row: dict[str, Any] = {"kind": scene.kind, "bearing": scene.geometry.name, "engine": got["status"]}
    row |= {"oracle": "beyond" if scene.beyond else "missing" if truth is None else truth["status"]}
    # A deep defect under a light load presses the contacts harder, and their resonance higher, than at rest.
    row["motion"] = math.inf if scene.beyond else (truth or {}).get("motion_resonance") or 0.0
    row |= {"ms": got.get("ms"), "estimate": got.get("estimate"), "reason": got.get("reason")}
    if scene.beyond or truth is None or truth["status"] == "unresolved" or got["status"] in _NO_LEVEL:
        return row
    rms = truth["rms"]
    row["error"] = abs(got["rms"] - rms) / rms if rms > 0.0 else abs(got["rms"])
    row["doubt"] = truth["error"] or 0.0
    row["doubt"] += _STANDARD_ERRORS * truth["standard_error"] / rms if rms > 0.0 else 0.0
    row["peak_error"] = abs(got["peak"] / truth["peak"] - 1.0) if truth["peak"] > 0.0 else 0.0
    strongest = max(truth["lines"], default=0.0)
    if strongest > 0.0:
        pairs = zip(got["lines"], truth["lines"], strict=True)
        row["line_error"] = max(abs(a - b) for a, b in pairs) / strongest
    converged = got["status"] == "converged"
    if row["estimate"] is not None:
        row["bounded"] = row["error"] <= row["estimate"] + row["doubt"]
    row["wrong"] = converged and not row["error"] <= SLACK * asked + row["doubt"]
    row["unstable"] = converged and not truth["repeats"] and truth["spread"] > _UNREST * rms
    return row


@dataclass(frozen=True)
class Compared:
    """One quantity of an answer, m/s2: stated error, true one, and what of the latter the oracle may be off by."""

    quantity: str
    stated: float
    true: float
    doubt: float

    @property
    def covered(self) -> bool:
        """Whether the stated error is at least the true one."""
        return self.true <= self.stated + self.doubt

    @property
    def wrong(self) -> bool:
        """Whether the answer is off by more than SLACK times what it states."""
        return not self.true <= SLACK * self.stated + self.doubt


def compared(truth: dict[str, Any], got: dict[str, Any]) -> list[Compared]:
    """Return the quantities of an answer that both know: RMS, and where the motion repeats peak and each line.

    The oracle may be off by SLACK times its own errors, by what is left of the transient and of the search for crests,
    and by three standard errors of a mean that does not repeat. An error that the answer does not state is not judged.
    """
    settled = truth["status"] == "settled"
    known = truth["error"] is not None if settled else truth["status"] == "not_periodic"
    if not known or got["status"] in _NO_LEVEL:
        return []
    rms, peak, lines = truth["rms"], truth["peak"], truth["lines"]
    doubt = (_LEAST_DOUBT["rms"] + SLACK * (truth["error"] or 0.0)) * rms + _STANDARD_ERRORS * truth["standard_error"]
    rows = [("rms", got["estimate"] * got["rms"], abs(got["rms"] - rms), doubt)]
    if settled and truth["repeats"]:
        doubt = (_LEAST_DOUBT["peak"] + SLACK * truth["peak_error"]) * peak
        rows.append(("peak", got["peak_estimate"] * got["peak"], abs(got["peak"] - peak), doubt))
        for k, line in enumerate(lines):
            doubt = _LEAST_DOUBT["line"] * max(lines) + SLACK * truth["line_errors"][k]
            rows.append((f"line {k + 1}", got["line_estimates"][k], abs(got["lines"][k] - line), doubt))
    return [Compared(*row) for row in rows if math.isfinite(row[1])]


_NO_LEVEL = ("refused", "timeout", "crashed", "not_converged")


def solve(scene: OracleScene, steps: int) -> dict[str, Any]:
    """Return the entry of one scene, as tests/data/engine_oracle.json has it."""
    result = simulate_oracle(scene, caps=Caps(steps=steps))
    values = {name: None if value != value else value for name, value in vars(result).items()}
    return {"key": scene.key(), "scene": scene.as_dict(), "result": values}
