"""The page of an identification: what it says and draws, also where there is little to draw."""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine

from models.identify import evaluate
from models.identify.evaluate import Evaluator
from models.identify.evidence import Evidence, Peak, Prior
from models.identify.limits import AdmissibleLimits
from models.identify.run import Identification, IdentifyOptions, identify
from models.identify.trials import Condition, Trial, gather
from models.machine.scene import Rig
from monitor.identify.report import tables
from monitor.identify.report.features import residuals
from monitor.identify.report.front import one_at_a_time
from monitor.identify.report.marks import MAX_DOTS, thinned
from monitor.identify.report.page import grade, headline, write_identification
from monitor.identify.report.profiles import lowest
from monitor.identify.report.subject import Extent, Subject
from monitor.report.page import lay_out
from reference.once import made_once
from streams.types.block import STANDARD_GRAVITY
from tests.models.identify.cases import BAND, space_of
from tests.monitor.conftest import ARRANGE
from tests.support.identify import stand_in

pytestmark = pytest.mark.usefixtures("plain_layout")

OPTIONS = IdentifyOptions(band=BAND)
EXTENTS = (0.04, 0.08, 0.12)
MANY = tuple(
    Condition(load, speed, extent, 5e-4) for load in (1000.0, 2000.0) for speed in (20.0, 40.0) for extent in EXTENTS
)
REASONS = {"wide": "its ends are far apart", "within its limits": "it takes more than half"}


@pytest.fixture(autouse=True, scope="module")
def simulated() -> Iterator[list[int]]:
    """Replace the simulation by a smooth stand-in; the simulated rows are counted."""
    count = [0]

    def simulate(bench: Any, task: Any) -> tuple[np.ndarray, np.ndarray]:
        values, row = task
        count[0] += 1
        features = stand_in(bench.space.rig_of(values), values["clearance"], np.array(row.extents))
        features *= (row.condition.load / 1000.0) ** 0.5 * (row.condition.speed / 40.0) ** 0.2
        return features, np.zeros_like(features)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluate, "CANDIDATES", replace(evaluate.CANDIDATES, function=simulate))
        yield count


def simulated_tests(conditions: Sequence[Condition], noise: float = 0.02, repetitions: int = 1) -> list[Trial]:
    """Return tests of Table 18 with noise."""
    space = space_of("m_r", rig=Rig())
    level = Evaluator(space, conditions, BAND).levels([space.known])[0]
    rng = np.random.default_rng(4)
    found: list[Trial] = []
    for _ in range(repetitions):
        noisy = level.features * np.exp(noise * rng.standard_normal(level.features.shape))
        found += [Trial(c, rms, a_star) for c, (rms, a_star) in zip(conditions, noisy.tolist(), strict=True)]
    return found


def subject_of(
    tests: list[Trial], *free: str, options: IdentifyOptions = OPTIONS, limits: AdmissibleLimits | None = None
) -> Subject:
    loads = tuple(sorted({test.condition.load for test in tests}))
    found = identify(gather(tests), space_of(*free, rig=Rig(), limits=limits, loads=loads), options)
    return Subject(found, options, tests, {name: f"key_{name}" for name in found.space.free}, REASONS, "press <4>")


@cache
def whole() -> Subject:
    """Return an identification of four parameters from repeated tests at all conditions."""
    return made_once(
        "identification_report",
        lambda: subject_of(simulated_tests(MANY, repetitions=3), "m_r", "c_i", "c_r", "alpha_c"),
    )


def written(subject: Subject, folder: Path) -> str:
    path = folder / "page.html"
    write_identification(subject, path)
    page = path.read_text(encoding="utf-8")
    assert not re.search(r">[^<]*\b(nan|None|inf)\b[^<]*<", page)
    return page


@pytest.fixture(scope="module")
def whole_page(tmp_path_factory: pytest.TempPathFactory, simulated: list[int]) -> str:
    """The page of ``whole``, arranged; nothing is simulated for it."""
    subject = whole()
    simulated[0] = 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ConstrainedLayoutEngine, "execute", ARRANGE)
        page = written(subject, tmp_path_factory.mktemp("whole"))
    assert simulated[0] == 0
    return page


def pictures(page: str) -> dict[str, Any]:
    """Return the values of each figure of a page by its name."""
    found = re.findall(r'<figure data-name="([^"]*)" data-values="([^"]*)"', page)
    return {name: json.loads(html.unescape(values)) for name, values in found}


def plain(page: str) -> str:
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL))).split())


def test_the_page_holds_every_figure(whole_page: str) -> None:
    subject, page = whole(), whole_page
    assert set(pictures(page)) == {
        *("profiles", "features_speed", "features_defect", "residuals", "alone", "front", "along_front"),
        *("frequencies", "resonator", "modes", "contact_damping", "damping"),
    }
    text = plain(page)
    assert "Identification of press <4>" in text
    assert "press &lt;4&gt;" in page
    assert "36 tests at 12 conditions" in text
    assert f"{subject.found.evaluations:,} simulated in" in text
    assert "none for this page" in text
    assert subject.found.hash in text
    for p in subject.parameters:
        assert p.number(subject.found.best.values[p.name]) in text
    # Self-contained: nothing is fetched.
    assert not re.search(r'(src|href)="(?!#)', page)


def test_what_is_not_determined_stands_first(whole_page: str) -> None:
    subject = whole()
    assert subject.found.undetermined
    assert grade(subject) == "watch"
    text = plain(whole_page)
    names = " and ".join(subject.parameter(name).symbol for name in subject.found.undetermined)
    known = 4 - len(subject.found.undetermined)
    assert f"{known} of 4 parameters are determined; not {names} What was found?" in text
    for name in subject.found.undetermined:
        reason = subject.found.intervals[name].reason
        assert f"{subject.parameter(name).symbol}: {REASONS[reason]}." in text


def test_grades_and_headlines() -> None:
    subject = whole()
    free = subject.found.space.free

    def said(reasons: dict[str, str]) -> tuple[str, str]:
        intervals = {
            name: replace(interval, reason=reasons.get(name, "")) for name, interval in subject.found.intervals.items()
        }  # pyright: ignore[reportArgumentType]
        changed = replace(subject, found=replace(subject.found, intervals=intervals))
        return grade(changed), headline(changed)

    assert said({}) == ("good", "All 4 free parameters are determined")
    assert said({"m_r": "wide", "c_i": "wide", "c_r": "wide"})[1] == (
        "1 of 4 parameters are determined; not m_r, c_i and c_r"
    )
    assert said(dict.fromkeys(free, "wide")) == ("bad", "The tests do not determine any of the 4 free parameters")


@pytest.mark.usefixtures("blank_pictures")
def test_a_fit_that_misses_the_tests_is_no_calibration(tmp_path: Path) -> None:
    subject = replace(whole(), calibrated=False, warnings=("the model misses <all> tests",))
    assert grade(subject) == "bad"
    page = written(subject, tmp_path)
    assert "This is no calibration; the tests scatter by" in page
    assert '<p class="note">Warning: the model misses &lt;all&gt; tests.</p>' in page


def test_statuses_say_where_an_end_is_a_limit() -> None:
    subject = whole()
    column = [row[1] for row in tables.parameter_table(subject).rows]
    for (name, interval), status in zip(subject.found.intervals.items(), column, strict=True):
        if interval.reason:
            assert status == "undetermined", name
        elif any(interval.at_limit):
            assert "end a limit" in str(status), name
        else:
            assert status == "determined", name


def test_one_defect_at_a_time_is_the_nearest_simulated_candidate() -> None:
    subject = whole()
    found = one_at_a_time(subject)
    assert [one.extent.dphi_d for one in found] == list(EXTENTS)
    for one in found:
        rows = [n for n, c in enumerate(subject.conditions) if c.dphi_d == one.extent.dphi_d]
        measured = subject.problem.trials.mean[rows]
        objectives = np.array(
            [
                np.mean(np.abs(level.features[rows] / measured - 1.0), axis=0) * 100.0
                for level in subject.problem.evaluator.kept.values()
            ]
        )
        assert one.objectives == pytest.approx(objectives)
        assert one.nearest == np.argmin(np.hypot(*objectives.T))
        best = objectives[one.nearest]
        assert np.hypot(*best) <= np.hypot(*one.objectives[0])
    rows = tables.alone_table(subject)
    assert rows is not None
    assert len(rows.rows) == 4
    assert rows.rows[0][1] == subject.parameter("m_r").number(subject.candidates.values_of(found[0].nearest)["m_r"])


def test_residuals_are_those_of_the_best_fit(whole_page: str) -> None:
    subject = whole()
    values, deviation = residuals(subject, "rms")
    expected = 100.0 * (subject.found.features[:, 0] / subject.problem.trials.mean[:, 0] - 1.0)
    assert values == pytest.approx(expected)
    # 2 % of noise, three repetitions.
    assert deviation == pytest.approx(np.full(12, 2.0 / math.sqrt(3.0)), rel=0.6)
    data = pictures(whole_page)
    assert data["residuals"]["rms_percent"] == pytest.approx(expected.tolist(), rel=1e-5)
    assert data["features_speed"]["rms_model_g"] == pytest.approx(
        (subject.found.features[:, 0] / STANDARD_GRAVITY).tolist(), rel=1e-5
    )


def test_intervals_hold_the_candidates_that_are_near() -> None:
    subject = whole()
    near = subject.candidates.near
    assert 0 < np.count_nonzero(near) < near.size
    assert np.all(subject.candidates.excess[near] <= 1.0 + 1e-9)
    low, high = subject.highest_modes
    assert low <= min(subject.found.resonances) <= max(subject.found.resonances) <= high


def test_too_many_dots_are_thinned_from_best_to_worst() -> None:
    cost = np.random.default_rng(1).random(1000)
    rows = thinned(cost, np.arange(1000))
    assert rows.size == MAX_DOTS
    assert cost[rows[0]] == cost.min()
    assert cost[rows[-1]] == cost.max()
    assert thinned(cost, np.array([3, 1])).tolist() == [3, 1]


def test_the_lowest_of_each_column_is_kept() -> None:
    values, excess = np.array([1.01, 1.02, 5.0, 9.0, 20.0, 2.0]), np.array([2.0, 1.0, 0.5, 3.0, 0.1, 99.0])
    # Columns of 1/7; the last two are outside what is shown.
    x, y = lowest(values, excess, 0.0, 10.0, wide=False)
    assert x.tolist() == [1.02, 5.0, 9.0]
    assert y.tolist() == [1.0, 0.5, 3.0]
    assert lowest(values, excess, 0.1, 0.2, wide=True)[0].size == 0


@pytest.mark.usefixtures("blank_pictures")
def test_without_a_star_there_is_no_trade_off(tmp_path: Path) -> None:
    tests = [replace(test, a_star=math.nan) for test in simulated_tests(MANY)]
    subject = subject_of(tests, "m_r", options=replace(OPTIONS, objectives=("rms",)))
    page = written(subject, tmp_path)
    data, text = pictures(page), plain(page)
    assert not {"front", "along_front", "frequencies", "alone"} & set(data)
    assert "RMS alone was compared, so there is no trade-off" in text
    assert "A* was not compared." in text
    # What no test has is not drawn.
    assert "a_star_model_g" not in data["features_speed"]
    assert data["features_speed"]["rms_measured_g"] == pytest.approx(
        [test.rms / STANDARD_GRAVITY for test in tests], rel=1e-5
    )
    # Table 19 by the only feature.
    assert "One defect at a time (Table 19)" in text


@pytest.mark.usefixtures("blank_pictures")
def test_a_condition_without_a_star_is_left_out_of_it(tmp_path: Path) -> None:
    tests = simulated_tests(MANY[:4])
    tests[:1] = [replace(tests[0], a_star=math.nan)]
    subject = subject_of(tests, "m_r")
    page = written(subject, tmp_path)
    assert "stands for 1 feature that no test has" in plain(page)
    assert pictures(page)["residuals"]["a_star_percent"].count(None) == 1


@pytest.mark.usefixtures("blank_pictures")
def test_one_load_and_one_speed(tmp_path: Path) -> None:
    subject = subject_of(simulated_tests(MANY[:3]), "k_r")
    page = written(subject, tmp_path)
    assert "features_speed" not in pictures(page)
    assert "features_defect" in pictures(page)
    assert "The tests have one speed and one load only." in plain(page)


@pytest.mark.usefixtures("arranged_layout")
def test_one_condition_and_one_parameter(tmp_path: Path) -> None:
    subject = subject_of(simulated_tests(MANY[:1], repetitions=2), "m_r")
    page = written(subject, tmp_path)
    data, text = pictures(page), plain(page)
    assert not {"features_speed", "features_defect", "features_load", "alone", "damping", "contact_damping"} & set(data)
    assert {"profiles", "residuals", "resonator"} <= set(data)
    assert "All tests with a defect are at one condition" in text
    assert "Table 19" not in text
    assert "Only the dotted line is searched: k_r is not free." in text


def test_loads_alone_are_an_axis(tmp_path: Path) -> None:
    conditions = [Condition(load, 40.0, 0.08, 5e-4) for load in (500.0, 1000.0, 2000.0)]
    page = written(subject_of(simulated_tests(conditions), "m_r"), tmp_path)
    assert pictures(page)["features_load"]["x"] == [500.0, 1000.0, 2000.0]


def test_a_front_of_one_candidate(tmp_path: Path) -> None:
    subject = whole()
    subject = replace(subject, found=replace(subject.found, front=subject.found.front[:1]))
    page = written(subject, tmp_path)
    assert "front" in pictures(page)
    assert not {"along_front", "frequencies"} & set(pictures(page))
    assert "One candidate is best in both features" in plain(page)


@pytest.mark.usefixtures("blank_pictures")
def test_parameters_without_coupled_limits(tmp_path: Path) -> None:
    page = written(subject_of(simulated_tests(MANY[:3]), "clearance"), tmp_path)
    assert not {"resonator", "contact_damping", "damping"} & set(pictures(page))
    assert "have no coupled limits that a plane could show" in plain(page)
    # The truth is no clearance; the best fit is as good as that.
    assert "clearance 0 µm (0 to" in plain(page)


def test_inner_defects_and_depths_are_named() -> None:
    conditions = [replace(MANY[0], h_d=h_d) for h_d in (1e-4, 5e-4)]
    subject = subject_of(simulated_tests(conditions), "m_r")
    assert [subject.extent_words(extent) for extent in subject.extents] == ["2.29° × 100 µm", "2.29° × 500 µm"]
    inner = Extent("inner", 0.04, 5e-4)
    assert subject.extent_words(inner) == "2.29° × 500 µm, inner race"


@pytest.mark.usefixtures("blank_pictures")
def test_motions_that_do_not_repeat_are_said(tmp_path: Path) -> None:
    subject = subject_of(simulated_tests(MANY[:4]), "m_r")
    found: Identification = replace(subject.found, not_periodic=1)
    level = found.problem.evaluator.levels([found.best.values])[0]
    level.doubt[0] = 0.2
    text = plain(written(replace(subject, found=found), tmp_path))
    assert "1 condition does not repeat with the ball passage and counts less" in text
    assert "Open: the motion does not repeat" in text


@pytest.mark.usefixtures("arranged_layout")
def test_a_healthy_machine_resonances_and_priors_beside_the_tests(tmp_path: Path) -> None:
    healthy = Condition(1000.0, 40.0, 0.0, 0.0)
    tests = [*simulated_tests(MANY[:4]), Trial(healthy, 900.0, math.nan)]
    space = space_of("m_r", rig=Rig(), loads=(1000.0,))
    evidence = Evidence(
        (Peak(1000.0, "along", 7400.0, 50.0, 0.01, 0.005), Peak(1000.0, "", 350.0, 5.0, extracted=True)),
        (Prior("m_r", 3.3, 0.2, "weighed"), Prior("m_o", 5.0, 0.1, "casing", at_least=True)),
    )
    found = identify(gather(tests), space, OPTIONS, evidence)
    subject = Subject(found, OPTIONS, tests, {"m_r": "m_r_kg"}, REASONS, "press")
    page = written(subject, tmp_path)
    data, text = pictures(page), plain(page)
    assert "5 tests at 5 conditions (1 of the healthy machine), 2 resonances, 2 priors" in text
    # Its level is far above the model's: nothing is compared, and nothing drawn.
    assert data["residuals"]["rms_percent"][4] is None
    assert [extent.dphi_d for extent in subject.extents] == sorted({c.dphi_d for c in MANY[:4]})
    assert "The level of a healthy machine is an upper limit of the model's." in text
    assert "40 1000 healthy 1" in text
    # The model's own modes: 7,389 Hz along 1000 N and 348 Hz at Table 18.
    peaks, priors = tables.evidence_tables(subject)
    assert [row[1] for row in peaks.rows] == ["not known, extracted", "along"]
    assert [row[4] for row in peaks.rows] == pytest.approx([348.0, 7389.0], rel=0.02)
    assert [row[1] for row in priors.rows] == ["3.30", "at least 5.00"]
    assert "found in a recording by the program" in text
    assert tables.evidence_tables(whole()) == []


@pytest.mark.pdf
@pytest.mark.usefixtures("blank_pictures")
def test_sections_on_paper_begin_beside_what_they_are_about(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[str] = []
    monkeypatch.setattr("monitor.report.page.to_pdf", lambda page: taken.append(page) or b"")
    write_identification(subject_of(simulated_tests(MANY[:3]), "k_r", "c_r"), tmp_path / "x.pdf")
    pages = [list(page._page_box.descendants()) for page in lay_out(taken[0]).pages]
    words_ = [[box.text.strip() for box in boxes if type(box).__name__ == "TextBox"] for boxes in pages]
    assert "Free parameters" in words_[0]
    assert "N\N{NO-BREAK SPACE}s/m" in words_[0]
    for boxes, shown in zip(pages, words_, strict=True):
        # No machine of a run is named in the header, which a separator would follow.
        assert not [text for text in shown if text.startswith("·") or text.endswith("·")]
        bottom = max(box.position_y for box in boxes if box.element_tag in {"table", "figure", "dl", "footer"})
        assert all(box.position_y <= bottom for box in boxes if box.element_tag == "h2")
