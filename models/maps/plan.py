"""Settings of an RMS map; imports no numba."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from typing import Any

from models.machine.bearing import Bearing, from_catalogue
from models.machine.rig import Rig, RigDraws, RigParameters, without_draws
from models.machine.scene import PARTS, Defect, Floor, Part, Scene, Slip
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.words.errors import WrongInputError

# Relative error of the RMS that is asked of each node.
MAP_ACCURACY = 2e-3
# Increment when the results of the six-degree-of-freedom model change: older maps are then rebuilt.
MODEL_VERSION = 5
# The same of the other models, 1 of those that are not named.
OTHER_VERSIONS: dict[str, int] = {}
SCHEMA_VERSION = 3
# By the damaged part: its name, the radius of V_eq (Eq. 90 of the thesis, and its like) and the frequency of the lines.
DAMAGED: dict[Part, str] = {"outer": "outer race", "inner": "inner race", "ball": "ball"}
VOLUMES: dict[Part, str] = {"outer": "r_o", "inner": "r_i", "ball": "r_b"}
LINES: dict[Part, str] = {"outer": "BPFO", "inner": "BPFI", "ball": "2 BSF"}
AXES = ("load", "speed", "h_d", "dphi_d")


class MapError(WrongInputError, ValueError):
    """A map or a plan of one is unusable; the message names the file or field and the problem."""


def version_of(model: str) -> int:
    """Return the version of the results of a model."""
    return MODEL_VERSION if model == Rig.model else OTHER_VERSIONS.get(model, 1)


def check_depth(model: str) -> None:
    """Raise a MapError unless the vibration of a model depends on the depth of a defect."""
    if model in IGNORES_DEPTH:
        others = ", ".join(name for name in RIGS if name not in IGNORES_DEPTH)
        raise MapError(
            f"V_eq cannot be told by the model {model}: {IGNORES_DEPTH[model]}; models that describe depth: {others}"
        )


@dataclass(frozen=True)
class MapPlan:
    """Settings of a map, SI units and radians; equal plans give equal maps.

    Attributes:
        load, speed, h_d, dphi_d: axes, N, Hz, m and rad, ascending.
        part: that is damaged; V_eq = radius * dphi_d * h_d with the radius of ``models.path.contour.part_radius``.
        clearance: radial, m.
        floor: the bottom of the defect; of several floors, the first.
        floors: number of floors averaged (seeds floor.seed, floor.seed + 1, ...); with slip that is redrawn, each has
            its own draws, so that a smooth floor can have several.
        rows, position: of the defect, as in ``models.machine.scene.Defect``.
        rms_band: band in which RMS is taken, Hz, or None for the full bandwidth.
        steps_per_period: steps of the integration per ball period, or None for the model's choice, which is the only
            one where the part is not the outer race.
        model: whose parameters ``rig`` are.
        rig_draws: number of rigs drawn around ``rig`` for the spread over its uncertain parameters, or 0.
        rig_spread: relative standard deviation of m_r, k_c, c_i, c_r, alpha_c and beta_c between draws.
        rig_spread_k_r: relative standard deviation of k_r, which a resonance peak determines best.
        rig_spread_k_c: that of k_c, as finite elements give it; None for ``rig_spread``.
        rig_posterior: the draws, from the posterior of the identification of ``rig``; without it they are factors of
            ``rig_spread`` around ``rig``.
        second_bearing, axial_load: as in ``models.machine.scene.Scene``.
    """

    load: tuple[float, ...]
    speed: tuple[float, ...]
    h_d: tuple[float, ...]
    dphi_d: tuple[float, ...]
    bearing: Bearing = field(default_factory=lambda: from_catalogue("1205 ETN9"))
    rig: RigParameters = field(default_factory=Rig)
    clearance: float = 0.0
    floor: Floor = field(default_factory=Floor)
    floors: int = 1
    rows: int = 1
    position: float = 0.0
    rms_band: tuple[float, float] | None = None
    steps_per_period: int | None = None
    model: str = Rig.model
    slip: Slip | None = None
    rig_draws: int = 0
    rig_spread: float = 0.035
    rig_spread_k_r: float = 0.014
    rig_seed: int = 0
    part: Part = "outer"
    rig_posterior: RigDraws | None = None
    second_bearing: Bearing | None = None
    axial_load: float = 0.0
    rig_spread_k_c: float | None = None

    def __post_init__(self) -> None:
        """Raise a MapError that names the field of an unusable value."""
        self._check_model()
        for name in AXES:
            values = getattr(self, name)
            if len(values) == 0 or not all(math.isfinite(v) and v >= 0.0 for v in values):
                raise MapError(f"map axis {name} needs finite values that are not negative, got {values!r}")
            if any(b <= a for a, b in pairwise(values)):
                raise MapError(f"map axis {name} must ascend, got {values!r}")
        if self.speed[0] <= 0.0:
            raise MapError(f"map axis speed must be positive, got {self.speed!r}")
        redraws = self.slip is not None and self.slip.redraws
        if self.floors < 1 or (self.floors > 1 and self.floor.kind == "smooth" and not redraws):
            raise MapError(f"floors must be 1 for a smooth floor and at least 1 for a rough one, got {self.floors!r}")
        if self.floors < 2 and redraws:
            raise MapError(f"slip that is redrawn needs floors of 2 or more for a standard error, got {self.floors!r}")
        self._check_rig_draws()
        self._check_part()

    def _check_rig_draws(self) -> None:
        if self.rig_draws < 0 or self.rig_draws == 1:
            raise MapError(f"rig_draws must be 0 or at least 2, got {self.rig_draws!r}")
        for name in ("rig_spread", "rig_spread_k_r", "rig_spread_k_c"):
            spread = getattr(self, name)
            if spread is not None and not 0.0 <= spread <= 0.5:
                raise MapError(f"{name} must lie between 0 and 0.5, got {spread!r}")
        if self.rig_spread_k_c is not None and "k_c" not in self.rig.uncertain:
            raise MapError(f"rig_spread_k_c is given, but the rig of {self.model} has no k_c that is drawn")
        if self.rig_posterior is not None:
            if not isinstance(self.rig, Rig):
                raise MapError(f"rig_posterior is one of {Rig.model}, the rig is that of {self.rig.model}")
            self.rig_posterior.check(self.rig)
            if self.rig_draws != len(self.rig_posterior.rows):
                raise MapError(f"rig_posterior has {len(self.rig_posterior.rows)} draws, rig_draws is {self.rig_draws}")

    def _check_model(self) -> None:
        if self.model != self.rig.model:
            raise MapError(f"model is {self.model!r}, but the rig is that of {self.rig.model}")
        check_depth(self.model)

    def _check_part(self) -> None:
        if self.part not in PARTS:
            raise MapError(f"part must be one of {', '.join(map(repr, PARTS))}, got {self.part!r}")
        widest = math.pi if self.part == "ball" else 2.0 * math.pi
        if self.dphi_d[-1] > widest:
            raise MapError(f"map axis dphi_d of the {self.part} ends at {widest:.4g} rad, got {self.dphi_d[-1]!r}")
        if self.part != "outer" and self.steps_per_period is not None:
            raise MapError(f"steps_per_period belongs to maps of the outer race, got {self.steps_per_period!r}")
        if self.part == "outer" or self.slip is None or self.slip.phi_slip == 0.0:
            return
        if self.part == "ball":
            raise MapError("slip moves a ball to or from a defect of a race; the map is of a ball")
        if self.slip.rule != "per_passage":
            raise MapError(f"slip.rule {self.slip.rule!r} is modelled on the outer race only")

    @property
    def rig_spread_words(self) -> str:
        """What the spread over rigs is of, as text."""
        if self.rig_posterior is not None:
            return f"spread over the posterior of identification {self.rig_posterior.identification}"
        assumed = f"+-{100.0 * self.rig_spread:g} % of parameters"
        if self.model == Rig.model:
            assumed += f", +-{100.0 * self.rig_spread_k_r:g} % of k_r"
        if self.rig_spread_k_c is not None:
            assumed += f", +-{100.0 * self.rig_spread_k_c:g} % of k_c"
        return f"assumed spread of {assumed}" if self.rig_draws else "none: no rig was drawn"

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Number of nodes along load, speed, h_d and dphi_d."""
        return len(self.load), len(self.speed), len(self.h_d), len(self.dphi_d)

    def as_json(self) -> str:
        """Return the plan as canonical JSON; ``from_json`` reads it back exactly."""
        fields = without_draws(asdict(self), self.rig_posterior) | {"rig": self.rig.as_dict()}
        if self.part == "outer":
            # As before there were other parts, so that maps of the outer race keep their hash.
            del fields["part"]
        # Likewise.
        if self.second_bearing is None:
            del fields["second_bearing"]
        if self.axial_load == 0.0:
            del fields["axial_load"]
        if self.rig_spread_k_c is None:
            del fields["rig_spread_k_c"]
        return json.dumps(fields, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> MapPlan:
        """Return the plan that ``as_json`` wrote.

        Raises:
            MapError: if the text is not a plan.
        """
        try:
            data: dict[str, Any] = json.loads(text)
            for name in AXES:
                data[name] = tuple(data[name])
            data["rms_band"] = None if data["rms_band"] is None else tuple(data["rms_band"])
            for name, kind in (("bearing", Bearing), ("rig", RIGS[data["model"]]), ("floor", Floor)):
                data[name] = kind(**data[name])
            if data.get("second_bearing") is not None:
                data["second_bearing"] = Bearing(**data["second_bearing"])
            data["slip"] = None if data["slip"] is None else Slip(**data["slip"])
            data["rig_posterior"] = RigDraws.from_dict(data.get("rig_posterior"))
            return cls(**data)
        except MapError:
            raise
        except (TypeError, KeyError, ValueError) as error:
            raise MapError(f"the parameters of the map are not those of this version: {error}") from error

    def hash(self) -> str:
        """Return a hash of the plan and the model's version: equal hashes, equal maps."""
        return hashlib.sha256(f"{self.model} {self.model_version} {self.as_json()}".encode()).hexdigest()

    @property
    def model_version(self) -> int:
        """Version of the results of the model."""
        return version_of(self.model)


def scene_at(plan: MapPlan, load: float, speed: float, h_d: float, dphi_d: float, seed: int = 0) -> Scene:
    """Return the scene of one point of a plan; ``seed`` counts its floors from zero."""
    floor = replace(plan.floor, seed=plan.floor.seed + seed)
    defect = Defect(dphi_d, h_d, floor, plan.position, plan.rows, plan.part)
    return Scene(
        speed,
        load,
        plan.bearing,
        plan.rig,
        defect,
        plan.clearance,
        plan.model,
        slip=plan.slip,
        second_bearing=plan.second_bearing,
        axial_load=plan.axial_load,
    )
