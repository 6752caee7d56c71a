"""k_c of the lumped models from the answer of a bearing: from laws whose k_c is known, and how its spread is drawn."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from models.fe.bearings.assembly import AssembledBearing
from models.fe.bearings.law import ElementLaw
from models.fe.bearings.rig import BearingAnswer, bearing_answers, effective_stiffness, rig_stiffness
from models.fe.solid.elastic import NotConvergedError
from models.machine.bearing import Bearing, from_catalogue
from models.machine.hertz import contact_stiffness
from models.machine.load_distribution import stiffness_against_load
from models.machine.rig import Rig
from models.maps.nodes import drawn_rig
from models.maps.plan import MapError, MapPlan
from models.words.errors import WrongInputError
from monitor.config.bearing import RigSection
from monitor.fe.command import rig_text

BALLS, ROLLERS = from_catalogue("6210"), from_catalogue("NU 202 ECP")
PLAN = MapPlan((2000.0,), (30.0,), (0.0, 1e-5), (0.0, 0.1), rig_draws=4)
SHAFT = {
    "load_newton": 1000.0,
    "k_i_newton_per_m": 74.78e6,
    "mesh_error_percent": 0.8,
    "against_load": [
        {"load_newton": 250.0, "k_i_newton_per_m": 73.0e6},
        {"load_newton": 4000.0, "k_i_newton_per_m": 76.4e6},
    ],
    "status": "converged",
}


@pytest.mark.parametrize("bearing", [BALLS, ROLLERS])
@pytest.mark.parametrize("clearance", [0.0, 1e-5])
def test_k_c_of_lumped_bearing_is_found_again(bearing: Bearing, clearance: float) -> None:
    k_c = 1.07 * contact_stiffness(bearing)
    loads = [500.0, 1000.0]
    answers = bearing_answers(loads, *stiffness_against_load(bearing, loads, k_c, clearance=clearance, points=16))
    fitted = effective_stiffness(bearing, answers, 1000.0, clearance=clearance, mesh_error=0.01)
    assert fitted.value == pytest.approx(k_c, rel=1e-6)
    assert [k for _, _, k in fitted.matched] == pytest.approx([k_c] * (4 if clearance else 6), rel=1e-5)
    assert fitted.spread == pytest.approx(fitted.exponent * 0.01, rel=1e-3)
    assert math.log(fitted.high / fitted.low) == pytest.approx(2.0 * fitted.exponent * 0.01, rel=1e-3)


def test_k_c_of_softer_law_falls_with_load() -> None:
    """A law with a smaller exponent than the model's has no one k_c: it falls with the load, and that is the spread."""
    law = ElementLaw.from_power(1e9, 1.4, 1.0, 5000.0)
    fitted = rig_stiffness(AssembledBearing(law, BALLS.n_elements), BALLS, 1000.0)
    along = [k for name, _, k in fitted.matched if name == "displacement"]
    assert along == sorted(along, reverse=True)
    assert fitted.low < fitted.value < fitted.high
    assert 0.01 < fitted.spread < 0.3
    assert math.isnan(fitted.mesh_error)


def test_k_c_is_refused() -> None:
    answer = BearingAnswer(1000.0, 1e-5, 1e8, 1e8)
    with pytest.raises(WrongInputError, match=r"needs an answer there, got 1000 N"):
        effective_stiffness(BALLS, [answer], 2000.0)
    with pytest.raises(WrongInputError, match=r"not beyond the clearance"):
        effective_stiffness(BALLS, [answer], 1000.0, clearance=2e-5)
    with pytest.raises(NotConvergedError, match=r"no state of the bearing converged under 2000 N"):
        bearing_answers([1000.0, 2000.0], np.array([1e-5, math.nan]), np.ones((2, 2, 2)))
    law = ElementLaw.from_power(1e9, 1.5, 1.0, 100.0)
    with pytest.raises(NotConvergedError, match=r"converged under 1000 N"):
        rig_stiffness(AssembledBearing(law, BALLS.n_elements), BALLS, 1000.0)


def test_loads_beyond_the_law_are_left_out() -> None:
    law = ElementLaw.from_power(1e9, 1.5, 1.0, 700.0)
    fitted = rig_stiffness(AssembledBearing(law, BALLS.n_elements), BALLS, 1000.0)
    assert {load for _, load, _ in fitted.matched} == {500.0, 1000.0}
    assert fitted.value == pytest.approx(1e9, rel=1e-6)


def test_rig_text_is_a_section() -> None:
    loads = [500.0, 1000.0]
    answers = bearing_answers(loads, *stiffness_against_load(ROLLERS, loads, 5e8, points=16))
    k_c = effective_stiffness(ROLLERS, answers, 1000.0, mesh_error=0.002)
    text = rig_text("drive", "roller", k_c, SHAFT)
    section = RigSection.model_validate(tomllib.loads(text)["rig"])
    assert section.k_c_newton_per_m109 == pytest.approx(5e8, rel=1e-5)
    assert section.k_i_newton_per_m == 74.78e6
    assert "--rig-spread-k-c 0.002" in text
    assert "mesh error 0.8 %" in text
    assert "k_c" not in rig_text("drive", "roller", None, SHAFT)
    with pytest.raises(ValueError, match=r"neither a bearing nor a shaft"):
        rig_text("drive", "roller", None, None)
    with pytest.raises(ValueError, match=r"not_in_equilibrium; k_i is not written"):
        rig_text("drive", "roller", k_c, SHAFT | {"status": "not_in_equilibrium"})


def test_spread_of_k_c_is_drawn() -> None:
    def k_c(plan: MapPlan) -> list[float]:
        rigs = [drawn_rig(plan, n) for n in range(4)]
        return [math.log(rig.k_c / Rig.k_c) for rig in rigs if isinstance(rig, Rig)]

    usual, wide = k_c(PLAN), k_c(replace(PLAN, rig_spread_k_c=0.07))
    assert wide == pytest.approx([2.0 * factor for factor in usual])
    assert "+-7 % of k_c" in replace(PLAN, rig_spread_k_c=0.07).rig_spread_words
    wider = replace(PLAN, rig_spread_k_c=0.07)
    assert MapPlan.from_json(wider.as_json()) == wider
    assert "rig_spread_k_c" not in PLAN.as_json()
    with pytest.raises(MapError, match=r"rig_spread_k_c must lie between 0 and 0.5"):
        replace(PLAN, rig_spread_k_c=0.6)
