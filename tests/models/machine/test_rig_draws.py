"""Files of posteriors, and maps and lives whose rigs are drawn from one."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.lives.life import draw_life
from models.lives.population import Population
from models.machine.rig import PosteriorError, Rig, RigDraws, RigPosterior, read_posterior
from models.maps.build import build_map
from models.maps.file import load_map, save_map
from models.maps.nodes import drawn_rig, rig_rows, simulate_node_row
from models.maps.plan import MapPlan
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
