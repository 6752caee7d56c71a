"""Every message of the table of wrong configurations names file, line, key, what was expected and what came."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.config.load import load_config
from tests.support.wrong_configurations import FILE, Case, answer, read_cases

CASES = read_cases()


def test_there_are_sixty_cases_and_the_base_is_right(tmp_path: Path) -> None:
    assert len({case.what for case in CASES}) == len(CASES) >= 60
    first = CASES[0]
    path = tmp_path / FILE
    path.write_text(first.text.replace(first.new, "speed_hz = 29.5"))
    assert load_config(path).operating.speed_hz == 29.5


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.what)
def test_a_message_names_file_line_key_expectation_and_finding(case: Case, tmp_path: Path) -> None:
    lines = answer(case, tmp_path)
    begin = f"{FILE}:{case.line}: "
    told = [line for line in lines if line.startswith(begin)]
    assert told, "\n".join(lines)
    assert [word for word in (case.key, case.expected, case.came) if not any(word in line for line in told)] == [], told


def test_all_problems_of_a_file_come_at_once(tmp_path: Path) -> None:
    text = CASES[0].text.replace('"6205-2RS"', '"6999"').replace('"logger"\nunit = "g"', '"loger"\nunit = "mV"')
    lines = answer(Case("", text, "", 0, "", "", ""), tmp_path)
    assert [line.split(":")[1] for line in lines] == ["6", "9", "19", "20"]


def test_what_is_wrong_with_a_section_as_a_whole_comes_with_its_wrong_keys(tmp_path: Path) -> None:
    text = (
        CASES[0]
        .text.replace("speed_rpm = 1770", "speed_hz = 1")
        .replace('unit = "g"', 'unit = "mm"\ntrack = 3\ncolumn = 1\nkey = "a"')
    )
    lines = answer(Case("", text, "", 0, "", "", ""), tmp_path)
    assert [line.split(":")[1] for line in lines] == ["20", "21", "22"]
    assert "give column or key, not both" in lines[2]


def test_bands_are_compared_with_the_rate_whatever_else_is_wrong(tmp_path: Path) -> None:
    text = CASES[0].text.replace('unit = "g"', 'unit = "g"\nband_hz = [5000, 20000]\nscale = 0')
    lines = answer(Case("", text, "", 0, "", "", ""), tmp_path)
    assert [line.split(":")[1] for line in lines] == ["9", "21", "22"]
    assert "Nyquist" in lines[1]


def test_every_line_that_is_no_toml_comes_at_once(tmp_path: Path) -> None:
    text = (
        CASES[0]
        .text.replace("speed_rpm = 1770", "speed_hz = 29,5")
        .replace('"fan"', "fan")
        .replace("[[source]]", "[[source]")
    )
    lines = answer(Case("", text, "", 0, "", "", ""), tmp_path)
    assert [line.split(":")[1] for line in lines] == ["2", "9", "12"]
    assert all("not valid TOML" in line for line in lines)
