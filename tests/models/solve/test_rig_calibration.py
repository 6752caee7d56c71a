"""Whether a rig is calibrated: what vouches for it, and what maps and lives carry of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, replace
from typing import Any

import pytest

from models.lives.population import Population
from models.machine.rig import Rig
from models.maps.plan import MODEL_VERSION, MapPlan

PLAN = MapPlan(load=(4000.0,), speed=(40.0,), h_d=(0.0, 1e-5), dphi_d=(0.0, 0.1))
HASH = "0123456789abcdef" * 4
RIGS = [Rig(), Rig(calibrated=True), Rig(calibrated="declared"), Rig(calibrated=True, identification=HASH)]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"calibrated": "yes"}, r"rig\.calibrated must be False, True or 'declared', got 'yes'"),
        ({"identification": HASH}, r"rig\.identification belongs to rig\.calibrated = True, got False"),
        ({"identification": HASH, "calibrated": "declared"}, r"rig\.identification belongs to"),
    ],
)
def test_a_claim_that_nothing_vouches_for_is_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Rig(**values)


@pytest.mark.parametrize("rig", RIGS)
def test_maps_and_lives_carry_the_claim(rig: Rig) -> None:
    plan, population = replace(PLAN, rig=rig), Population(rig=rig)
    assert MapPlan.from_json(plan.as_json()) == plan
    assert Population.from_json(population.as_json()) == population
    assert Rig(**rig.as_dict()) == rig


def test_every_claim_has_a_hash_of_its_own() -> None:
    assert len({replace(PLAN, rig=rig).hash() for rig in RIGS}) == len(RIGS)
    assert len({Population(rig=rig).hash() for rig in RIGS}) == len(RIGS)


def test_without_an_identification_the_hash_is_that_of_earlier_versions() -> None:
    fields = asdict(PLAN)
    del (
        fields["second_bearing"],
        fields["axial_load"],
        fields["part"],
        fields["rig_posterior"],
        fields["rig_spread_k_c"],
        fields["rig"]["identification"],
    )
    text = f"{PLAN.model} {MODEL_VERSION} {json.dumps(fields, sort_keys=True)}"
    assert PLAN.hash() == hashlib.sha256(text.encode()).hexdigest()


def test_the_default_bench_is_known_by_its_masses_and_springs() -> None:
    assert Rig().is_default_bench
    assert Rig(k_c=1e9, m_b=2e-3, c_i=1.0, calibrated=True).is_default_bench
    for name in ("m_i", "m_o", "m_r", "k_i", "k_r"):
        assert not replace(Rig(), **{name: 1.01 * getattr(Rig, name)}).is_default_bench


def test_the_claim_is_no_parameter_that_lives_may_draw() -> None:
    for name in ("calibrated", "identification"):
        with pytest.raises(ValueError, match=f"rig_spread names {name}"):
            Population(rig_spread=((name, 0.1),))
