"""Reports on a rig that is not calibrated: relative V_eq from the headline on, and what is not issued."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.words.statuses import TT_REFUSALS
from tests.support.report import one, page_of_records

pytestmark = pytest.mark.usefixtures("plain_layout")

TRACKED = [
    one(
        {"rms": 1.0, "stage": "final", "edv_status": "uncalibrated", "tt_status": "uncalibrated", "v_th": 5e-8}
        | {name: times * 1e-8 for name, times in (("v_eq", v), ("v_eq_lower", 0.5 * v), ("v_eq_upper", 2.0 * v))}
        | ({"v_eq_relative": v / 2.0} if relative else {}),
        sequence=number,
        elapsed=60.0 * number,
    )
    for relative in (True, False)
    for number, v in enumerate((2.0, 3.0, 5.0), 1)
]


@pytest.mark.parametrize("recorded", [True, False], ids=["recorded", "of an earlier version"])
def test_v_eq_of_an_uncalibrated_rig_is_relative_from_the_headline_on(tmp_path: Path, *, recorded: bool) -> None:
    page = page_of_records(tmp_path, TRACKED[:3] if recorded else TRACKED[3:], calibrated="no")
    for sentence in (
        "; V_eq is relative, as the rig is not calibrated",
        "2.5 times the first tracked value. Interval: × 1.25 to × 5. Equivalent damaged volume V_eq, "
        "relative because the rig is not calibrated.",
        "V_eq is shown as a multiple of its first value",
        f"No forecast. For the threshold of 0.05 mm³/mm: {TT_REFUSALS['uncalibrated']}.",
        "V_eq from 1 times the first tracked value to 2.5 times the first tracked value",
        "rig calibrated on this machine",
    ):
        assert sentence in page.text, sentence
    assert "0.05 mm³/mm. Interval" not in page.text


@pytest.mark.parametrize("claim", ["yes", "declared", "a: no; x: yes"])
def test_v_eq_of_a_calibrated_rig_is_absolute(tmp_path: Path, claim: str) -> None:
    page = page_of_records(tmp_path, TRACKED[:3], calibrated=claim)
    assert "0.05 mm³/mm. Interval: 0.025 mm³/mm to 0.1 mm³/mm." in page.text
    assert "V_eq is relative" not in page.text
    assert "times the first" not in page.text


@pytest.mark.parametrize("claim", ["no; yes", "x: no; a: yes", "a: yes", ""])
def test_a_claim_that_does_not_hold_for_all_blocks_of_the_channel_is_none(tmp_path: Path, claim: str) -> None:
    assert "V_eq is relative" in page_of_records(tmp_path, TRACKED[:3], calibrated=claim).text


def test_a_forecast_that_is_asked_for_on_an_uncalibrated_rig_is_given_with_its_doubt(tmp_path: Path) -> None:
    values = {"stage": "final", "edv_status": "uncalibrated", "v_eq": 2e-8, "v_eq_relative": 1.0, "v_th": 5e-8}
    page = page_of_records(tmp_path, [one(values | {"tt": 600.0, "tt_status": "uncalibrated"})], calibrated="no")
    assert "10 min to the threshold of 0.05 mm³/mm." in page.text
    assert "On the scale of a model that is not calibrated." in page.text
