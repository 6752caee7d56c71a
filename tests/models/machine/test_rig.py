"""Files of posteriors, and maps and lives whose rigs are drawn from one.

Whether a rig is calibrated: what vouches for it, and what maps and lives carry of it.
"""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.lives.life import draw_life
from models.lives.population import Population
from models.machine.rig import (
    PosteriorError,
    Rig,
    RigDraws,
    RigPosterior,
    contact_damping,
    natural_frequencies,
    read_posterior,
    resonator_stiffness,
    stiffness_damping,
)
from models.maps.build import build_map
from models.maps.file import load_map, save_map
from models.maps.nodes import drawn_rig, rig_rows, simulate_node_row
from models.maps.plan import MODEL_VERSION, MapPlan
from tests.support.rigs import six_dof

ROWS = ((2.9, 2e-6), (3.1, 5e-6), (3.3, 0.0))
POSTERIOR = RigPosterior(
    best=(*((name, float(getattr(Rig(), name))) for name in ("m_i", "m_r", "k_r")), ("clearance", 3e-6)),
    names=("m_r", "clearance"),
    rows=ROWS,
    result="ab" * 32,
    effective=120.5,
    candidates=700,
)
RIG = Rig(calibrated=True, identification=POSTERIOR.identification)
PLAN = MapPlan(
    load=(4000.0,), speed=(40.0,), h_d=(8e-6,), dphi_d=(0.06, 0.1), rig=RIG, rig_draws=3, rig_posterior=POSTERIOR.draws
)


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.posterior.csv"
    path.write_text(text)
    return path


def test_a_file_gives_back_the_posterior(tmp_path: Path) -> None:
    read = read_posterior(written(tmp_path, POSTERIOR.text()))
    assert read == POSTERIOR
    assert read.identification == POSTERIOR.identification
    assert read.draws == RigDraws(POSTERIOR.identification, ("m_r", "clearance"), ROWS)
    # As other tools save it.
    assert read_posterior(written(tmp_path, POSTERIOR.text().replace("\n", "\r\n"))) == POSTERIOR


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("2.9,2e-06", "2.8,2e-06"),
        ("2.9,2e-06\n", ""),
        ("2.9,2e-06\n3.1,5e-06\n", "3.1,5e-06\n2.9,2e-06\n"),
        ("m_r=3.01", "m_r=3.02"),
        ("effective 120.5", "effective 620.5"),
        ("m_r,clearance", "m_i,clearance"),
        ("m_r,clearance", "weight,clearance"),
        ("abab", "abac"),
        ("2.9,2e-06", "nan,2e-06"),
        ("2.9,2e-06", "2.9"),
        ("# posterior", "# posterior,"),
    ],
)
def test_a_changed_file_is_refused(tmp_path: Path, before: str, after: str) -> None:
    changed = POSTERIOR.text().replace(before, after, 1)
    assert changed != POSTERIOR.text()
    with pytest.raises(PosteriorError, match=r"rig\.posterior\.csv: is not the posterior that was written"):
        read_posterior(written(tmp_path, changed))


def test_what_is_no_posterior_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PosteriorError, match="cannot be read"):
        read_posterior(tmp_path / "absent.csv")
    for text in ("", "m_r\n3\n", POSTERIOR.text()[:150]):
        with pytest.raises(PosteriorError, match="is not the posterior"):
            read_posterior(written(tmp_path, text))


def test_other_numbers_than_the_identified_ones_are_named() -> None:
    best = replace(RIG, k_r=dict(POSTERIOR.best)["k_r"])
    assert POSTERIOR.differences(best, 3e-6) == []
    assert POSTERIOR.differences(replace(best, k_r=4.3e9), 3e-6) == ["k_r is 4300000000, identified was 4250000000"]
    assert POSTERIOR.differences(best, 0.0) == ["clearance is 0, identified was 3e-06"]
    # A clearance that was taken as known belongs to the bearing, which may be replaced.
    known = replace(POSTERIOR, names=("m_r",), rows=((3.0,),))
    assert known.differences(best, 0.0) == []


def test_draws_of_another_identification_are_refused() -> None:
    for identification in ("", "cd" * 32):
        calibrated = bool(identification)
        with pytest.raises(PosteriorError, match="the posterior is of identification"):
            replace(PLAN, rig=Rig(calibrated=calibrated, identification=identification))
        with pytest.raises(PosteriorError, match="the posterior is of identification"):
            Population(rig=Rig(calibrated=calibrated, identification=identification), rig_posterior=POSTERIOR.draws)
    short = replace(RIG, identification=f"sha256:{POSTERIOR.identification[:16]}")
    assert replace(PLAN, rig=short).rig_posterior == POSTERIOR.draws
    with pytest.raises(ValueError, match="has 3 draws, rig_draws is 2"):
        replace(PLAN, rig_draws=2)
    with pytest.raises(PosteriorError, match="the posterior has 3 draws, asked for 4"):
        POSTERIOR.draws.first(4)


def test_plans_without_a_posterior_keep_their_hash() -> None:
    bare = replace(PLAN, rig=Rig(), rig_draws=2, rig_posterior=None)
    assert "posterior" not in bare.as_json()
    assert "posterior" not in Population().as_json()
    assert MapPlan.from_json(PLAN.as_json()) == PLAN
    assert MapPlan.from_json(bare.as_json()) == bare
    population = Population(rig=RIG, rig_posterior=POSTERIOR.draws)
    assert Population.from_json(population.as_json()) == population
    assert json.loads(population.as_json())["rig_posterior"]["names"] == ["m_r", "clearance"]
    assert population.hash() != Population(rig=RIG).hash()


def test_a_map_has_the_spread_of_the_posterior_about_its_own_rig(tmp_path: Path) -> None:
    extents = np.array(PLAN.dphi_d)
    own = simulate_node_row(PLAN, 4000.0, 40.0, 8e-6, extents).rms
    changes = [
        simulate_node_row(
            replace(PLAN, rig=replace(RIG, m_r=m_r), clearance=clearance), 4000.0, 40.0, 8e-6, extents
        ).rms
        - own
        for m_r, clearance in ROWS
    ]
    expected = np.sqrt(np.mean(np.square(changes), axis=0))
    assert np.all(expected > 0.01 * own)
    found = rig_rows(PLAN, 4000.0, 40.0, 8e-6)
    assert found.rms == pytest.approx(expected, rel=1e-12)
    assert found.lines.shape == (2, 6)
    assert drawn_rig(PLAN, 2) == replace(RIG, m_r=3.3)
    built = build_map(PLAN)
    assert built.rms_rig_std[0, 0, 0] == pytest.approx(expected, rel=1e-12)
    words = f"spread over the posterior of identification {POSTERIOR.identification}"
    save_map(built, tmp_path / "map.nc")
    read = load_map(tmp_path / "map.nc")
    assert read.attributes["rig_spread_over"] == words
    assert read.plan.rig_posterior == POSTERIOR.draws
    # What all nodes share: the mean over them of each draw's logarithm.
    shared = [float(np.mean(np.log1p(change / own))) for change in changes]
    common = read.slice_at(4000.0, 40.0).rig_common
    assert common.shape == (7,)
    assert common[0] == pytest.approx(math.sqrt(np.mean(np.square(shared))), rel=1e-9)
    assert 0.0 < common[0] < np.max(read.rms_rig_std / read.rms)
    assert "rig_spread" not in read.attributes
    assumed = replace(PLAN, rig_posterior=None)
    assert np.all(build_map(assumed).slice_at(4000.0, 40.0).rig_common == 0.0)
    assert assumed.rig_spread_words == "assumed spread of +-3.5 % of parameters, +-1.4 % of k_r"
    assert replace(assumed, rig_draws=0).rig_spread_words == "none: no rig was drawn"


def test_lives_take_the_rigs_of_the_posterior_in_turn() -> None:
    population = Population(rig=RIG, rig_posterior=POSTERIOR.draws)
    plans = [draw_life(population, number) for number in range(4)]
    assert [(six_dof(plan.rig).m_r, plan.clearance) for plan in plans] == [*ROWS, ROWS[0]]
    # All else is that of the same lives without a posterior.
    bare = draw_life(Population(rig=RIG), 1)
    assert (plans[1].load, plans[1].gain, plans[1].floor) == (bare.load, bare.gain, bare.floor)
    assert six_dof(bare.rig).k_c != RIG.k_c == six_dof(plans[1].rig).k_c
    assert population.rig_spread_words.endswith(POSTERIOR.identification)
    assert Population().rig_spread_words.startswith("assumed spread of m_r +-3.5 %, k_c +-3.5 %")


RIG_CALIBRATION_PLAN = MapPlan(load=(4000.0,), speed=(40.0,), h_d=(0.0, 1e-5), dphi_d=(0.0, 0.1))
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
    plan, population = replace(RIG_CALIBRATION_PLAN, rig=rig), Population(rig=rig)
    assert MapPlan.from_json(plan.as_json()) == plan
    assert Population.from_json(population.as_json()) == population
    assert Rig(**rig.as_dict()) == rig


def test_every_claim_has_a_hash_of_its_own() -> None:
    assert len({replace(RIG_CALIBRATION_PLAN, rig=rig).hash() for rig in RIGS}) == len(RIGS)
    assert len({Population(rig=rig).hash() for rig in RIGS}) == len(RIGS)


def test_without_an_identification_the_hash_is_that_of_earlier_versions() -> None:
    fields = asdict(RIG_CALIBRATION_PLAN)
    del (
        fields["second_bearing"],
        fields["axial_load"],
        fields["part"],
        fields["rig_posterior"],
        fields["rig_spread_k_c"],
        fields["rig"]["identification"],
    )
    text = f"{RIG_CALIBRATION_PLAN.model} {MODEL_VERSION} {json.dumps(fields, sort_keys=True)}"
    assert RIG_CALIBRATION_PLAN.hash() == hashlib.sha256(text.encode()).hexdigest()


def test_the_default_bench_is_known_by_its_masses_and_springs() -> None:
    assert Rig().is_default_bench
    assert Rig(k_c=1e9, m_b=2e-3, c_i=1.0, calibrated=True).is_default_bench
    for name in ("m_i", "m_o", "m_r", "k_i", "k_r"):
        assert not replace(Rig(), **{name: 1.01 * getattr(Rig, name)}).is_default_bench


def test_the_claim_is_no_parameter_that_lives_may_draw() -> None:
    for name in ("calibrated", "identification"):
        with pytest.raises(ValueError, match=f"rig_spread names {name}"):
            Population(rig_spread=((name, 0.1),))


def test_natural_frequencies_ascend_and_solve_the_eigenproblem() -> None:
    rig = Rig()
    f = natural_frequencies(rig, 1.3e8, 1.9e8)
    assert len(f) == 6
    assert np.all(np.diff(f) > 0.0)
    lam = (2.0 * math.pi * f) ** 2
    for value in lam:
        determinants = []
        for k_b in (1.3e8, 1.9e8):
            k = np.array([[k_b + rig.k_i, -k_b, 0], [-k_b, k_b + rig.k_r, -rig.k_r], [0, -rig.k_r, rig.k_r]])
            m = np.diag([rig.m_i, rig.m_o, rig.m_r])
            scale = np.linalg.norm(k) ** 3
            determinants.append(abs(np.linalg.det(k - value * m)) / scale)
        assert min(determinants) < 1e-10


@given(st.floats(0.01, 0.3), st.floats(0.01, 0.3), st.floats(10.0, 1e3), st.floats(1.1, 20.0))
def test_damping_coefficients_return_their_ratios(z_1: float, z_2: float, f_1: float, ratio: float) -> None:
    alpha, beta = contact_damping(z_1, z_2, f_1, ratio * f_1)
    for zeta, f in ((z_1, f_1), (z_2, ratio * f_1)):
        omega = 2.0 * math.pi * f
        assert 0.5 * (alpha / omega + beta * omega) == pytest.approx(zeta, rel=1e-9)


def test_damping_frequencies_must_ascend() -> None:
    with pytest.raises(ValueError, match="ascending"):
        contact_damping(0.1, 0.1, 500.0, 400.0)


@given(st.floats(0.1, 5.0), st.floats(5e7, 3e8), st.floats(4500.0, 9500.0))
def test_resonator_stiffness_puts_the_frequency_where_it_is_asked(m_r: float, k_b: float, frequency: float) -> None:
    rig = Rig(m_r=m_r)
    k_r = resonator_stiffness(rig, k_b, frequency)
    assert natural_frequencies(replace(rig, k_r=k_r), k_b, k_b)[5] == pytest.approx(frequency, rel=1e-6)


def test_damping_of_a_spring_has_the_ratio_asked() -> None:
    # Of a mass on a spring, c = 2 zeta sqrt(k m).
    stiffness, mass = 3e8, 2.0
    frequency = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    assert stiffness_damping(0.05, frequency, stiffness) == pytest.approx(0.1 * math.sqrt(stiffness * mass), rel=1e-12)
