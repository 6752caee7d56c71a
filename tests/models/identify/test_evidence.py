"""Rigs identified from resonances and priors, without any defect."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.identify.evaluate import Evaluator
from models.identify.evidence import Evidence, Prior, geometry_priors
from models.identify.limits import wide_limits
from models.identify.problem import Problem
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.space import Space
from models.identify.trials import Condition, Trial, gather, no_trials
from models.identify.volume import VolumePoint, VolumeSpread, objections, small_map, volume_spread
from models.machine.bearing import catalogue_entry
from models.machine.rig import Rig
from models.words.errors import WrongInputError
from monitor.identify.rig_table import leaning
from tests.models.identify.cases import BAND, BEARING, CONDITIONS, simulated_trials, space_of
from tests.support.evidence import LIGHT, LOADS, peaks_of


def _space(*free: str, rig: Rig = LIGHT) -> Space:
    return Space(rig, BEARING, LOADS, free=free, limits=wide_limits())


def _identified(evidence: Evidence, *free: str, rig: Rig = LIGHT) -> Identification:
    return identify(no_trials(), _space(*free, rig=rig), None, evidence)


def _from_peaks() -> Identification:
    return _identified(Evidence(tuple(peaks_of(LIGHT))), "m_r", "k_r", rig=replace(LIGHT, m_r=1.0, k_r=1e9))


@pytest.fixture(scope="module")
def from_peaks() -> Identification:
    """A rig of two free parameters from the peaks of another, which begins far from it."""
    return _from_peaks()


def test_the_truth_leaves_no_residual_in_any_order() -> None:
    peaks = peaks_of(LIGHT, absolute=True)
    evidence = Evidence((*peaks[::-1],), (Prior("m_o", LIGHT.m_o, 0.1, "weighed"),))
    residuals = evidence.residuals(_space("m_o"), _space("m_o").known)
    assert len(residuals) == evidence.size == 3 * len(peaks) + 1
    assert residuals == pytest.approx(np.zeros(len(residuals)), abs=1e-6)
    # One peak of an unknown direction is that of some mode.
    unknown = Evidence((replace(peaks[1], direction=""),))
    assert unknown.residuals(_space("m_o"), _space("m_o").known) == pytest.approx(np.zeros(3), abs=1e-6)


def test_residuals_by_hand() -> None:
    space, (peak, *_) = _space("m_o"), peaks_of(LIGHT)
    moved = replace(peak, frequency=peak.frequency - 2.0 * peak.frequency_sd, damping=None, damping_sd=None)
    assert Evidence((moved,)).residuals(space, space.known) == pytest.approx([2.0])
    foreign = replace(moved, frequency=1e5, frequency_sd=1.0, extracted=True)
    (residual,) = np.abs(Evidence((foreign,)).residuals(space, space.known))
    assert residual == pytest.approx(3.0)
    priors = (
        Prior("m_o", 0.3, 0.5, "x"),
        Prior("m_i", 0.2, 0.1, "ring", at_least=True),
        Prior("m_r", 0.6, 0.1, "x", True),
    )
    expected = [math.log(2.0) / 0.5, 0.0, math.log(0.5) / 0.1]
    assert Evidence((), priors).residuals(space, space.known) == pytest.approx(expected)
    assert Evidence((), priors).observations == 1


def test_wrong_evidence_is_refused_by_name() -> None:
    peaks = [replace(peak, load=1000.0, direction="along") for peak in peaks_of(LIGHT)][:4]
    with pytest.raises(WrongInputError, match="4 peaks at 1000 N along it; the model has 3"):
        Evidence(tuple(peaks))
    with pytest.raises(WrongInputError, match="'clearance' cannot have a prior"):
        Prior("clearance", 1e-6, 0.1, "x")
    with pytest.raises(WrongInputError, match="prior of m_o: sd must be positive, got 0"):
        Prior("m_o", 1.0, 0.0, "x")


def test_two_parameters_from_peaks(from_peaks: Identification) -> None:
    found = from_peaks
    for name in ("m_r", "k_r"):
        interval, truth = found.intervals[name], getattr(LIGHT, name)
        assert found.best.values[name] == pytest.approx(truth, rel=0.01)
        assert interval.low < truth < interval.high < 1.2 * interval.low
    assert found.front == []
    assert found.undetermined == ()
    assert math.isnan(found.noise)
    assert _from_peaks().hash == found.hash


def test_the_scale_comes_from_a_prior_or_an_accelerance() -> None:
    # m_o and m_i alone: with k_i, k_r known, peaks tell both; so k_c and all else are held at three times the truth.
    wrong = replace(LIGHT, k_c=1.2 * LIGHT.k_c)
    held = _identified(Evidence(tuple(peaks_of(LIGHT, directions=("along",)))), "k_c", "m_o", rig=wrong)
    assert held.best.values["k_c"] == pytest.approx(LIGHT.k_c, rel=0.02)
    known = {"m_i", "m_r", "k_i", "k_r", "c_i", "c_r", "beta_c"}
    point = VolumePoint(2000.0, 30.0, BAND)
    spread = volume_spread(held, point)
    assert spread
    assert all(0.5 < each.low <= each.high < 2.0 for each in spread)
    assert objections(held, spread, known) == []
    (words,) = objections(held, spread, known - {"m_i"})
    assert "m_i neither free nor given in [rig]" in words
    assert "without limit" in objections(held, (replace(spread[0], high=math.inf),), known)[0]


def test_nothing_tells_the_scale_of_frequencies(from_peaks: Identification) -> None:
    free = ("m_i", "m_o", "m_r", "k_i", "k_r", "k_c", "c_i", "c_r")
    everything = replace(from_peaks, space=replace(from_peaks.space, free=free))
    (words,) = [words for words in objections(everything, (), ()) if "scale" in words]
    assert "masses, stiffnesses and dampings times a factor" in words


def test_intervals_say_on_which_prior_they_lean() -> None:
    peaks = tuple(peak for peak in peaks_of(LIGHT) if peak.load == 1000.0 and peak.direction == "along")[2:]
    prior = Prior("m_r", LIGHT.m_r, 0.02, "weighed")
    found = _identified(Evidence(peaks, (prior,)), "m_r", "k_r")
    assert leaning(found) == {"m_r": ("m_r",), "k_r": ("m_r",)}
    assert leaning(_identified(Evidence(tuple(peaks_of(LIGHT)), (replace(prior, sd=5.0),)), "m_r", "k_r")) == {}


def test_tests_and_peaks_work_together() -> None:
    trials, space = simulated_trials(0.01), space_of("m_r", limits=wide_limits())
    prior = Prior("m_r", 2.8, 0.001, "weighed")
    alone = identify(trials, space, IdentifyOptions(band=BAND))
    both = identify(trials, space, IdentifyOptions(band=BAND), Evidence((), (prior,)))
    assert both.intervals["m_r"].high < 2.8 * 1.004
    assert both.hash != alone.hash
    assert objections(both, (VolumeSpread(0.005e-6, 0.9, 1.2),), ()) == []
    (objection,) = objections(both, (VolumeSpread(0.005e-6, 0.4, 2.0),), ())
    assert "differ by a factor of 5 in V_eq" in objection


def test_a_healthy_level_is_an_upper_limit() -> None:
    space = space_of("m_r")
    condition = Condition(2000.0, 40.0, 0.0, BEARING.element_diameter)
    evaluator = Evaluator(space, (condition,), BAND)
    level = evaluator.levels([space.known])[0]
    rms = float(level.features[0, 0])
    for factor, expected in ((10.0, 0.0), (0.5, math.log(2.0) / 0.03)):
        problem = Problem(gather([Trial(condition, factor * rms, math.nan)]), evaluator)
        assert problem.observations == 0
        assert problem.residuals(level, space.known) == pytest.approx([expected, 0.0])
        assert problem.deviations(level) == {}


def test_geometry_tells_contacts_and_limits_of_masses() -> None:
    entry = catalogue_entry("1205 ETN9")
    stiffness, outer, inner = geometry_priors(entry)
    assert stiffness.value == pytest.approx(5.767e9, rel=1e-3)
    assert (outer.name, outer.at_least, inner.name, inner.at_least) == ("m_o", True, "m_i", True)
    # A ring weighs less than the whole bearing, 0.14 kg.
    assert 0.01 < inner.value < outer.value < 0.1
    *_, shaft = geometry_priors(entry, (0.03, 0.3))
    assert shaft.value == pytest.approx(7810.0 * math.pi / 4.0 * 0.03**2 * 0.3 + inner.value)
    assert not shaft.at_least
    assert "30 mm x 300 mm" in shaft.source


def test_a_small_map_reads_back_its_own_volumes() -> None:
    point = VolumePoint(CONDITIONS[0].load, CONDITIONS[0].speed, BAND)
    made = small_map(Rig(), BEARING, point)
    assert made.rms.shape == made.volume.shape
    assert made.least_volume(0.0) == 0.0
    assert made.least_volume(2.0 * float(np.max(made.rms))) == math.inf
    levels = [made.level_of(volume) for volume in (2e-7, 1e-6, 2e-6)]
    assert levels == sorted(levels)
    assert made.least_volume(levels[1]) <= 1.2e-6
