"""The posterior of an identification in the configuration, and in maps and libraries that are built with it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from models.lives.population import Population
from models.machine.rig import Rig, RigPosterior
from models.maps.file import load_map
from monitor.cli import spallwatch
from monitor.commands import library as library_commands
from monitor.config.load import ConfigError, load_config
from tests.support.commands_identify import MACHINE
from tests.support.rigs import six_dof

PARAMETERS = ("m_i", "m_o", "k_i", "k_c", "m_b", "m_r", "k_r", "beta_c", "alpha_c", "c_i", "c_r")
POSTERIOR = RigPosterior(
    best=(*((name, float(getattr(Rig(), name))) for name in PARAMETERS), ("clearance", 0.0)),
    names=("m_r", "k_r"),
    rows=tuple((3.01 + n / 32, 4.25e9 - n * 2e7) for n in range(-9, 11)),
    result="ab" * 32,
    effective=120.5,
    candidates=700,
)
AXES = ("--load-newton", "4000", "--speed-hz", "40", "--dphi-deg", "3:6:2", "--h-d-um", "5:10:2")
SMALL = (*AXES, "--interpolation-tolerance", "0", "--workers", "1")


def machine(folder: Path, *more: str, identification: str = POSTERIOR.identification, posterior: bool = True) -> Path:
    """Write a configuration with the identified rig, which is the default one, and its posterior."""
    path = folder / "machine.toml"
    named = ['posterior = "rig.posterior.csv"'] if posterior else []
    rig = ["[rig]", "calibrated = true", f'identification = "{identification}"', *named, *more]
    path.write_text(MACHINE + "\n".join(rig) + "\n")
    (folder / "rig.posterior.csv").write_text(POSTERIOR.text())
    return path


def build(folder: Path, config: Path, *options: str) -> tuple[dict[str, Any], Path]:
    out = folder / "map.nc"
    arguments = ["map", "build", "--config", str(config), *SMALL, *options, "--out", str(out), "--json"]
    return json.loads(CliRunner().invoke(spallwatch, arguments, catch_exceptions=False).stdout), out


def test_a_map_of_an_identified_rig_takes_the_spread_of_its_posterior(tmp_path: Path) -> None:
    values, out = build(tmp_path, machine(tmp_path))
    plan = load_map(out).plan
    assert plan.rig_posterior == POSTERIOR.draws.first(16)
    assert plan.rig_draws == 16
    assert six_dof(plan.rig).identification == POSTERIOR.identification
    assert values["rig_spread_over"] == f"spread over the posterior of identification {POSTERIOR.identification}"
    # 5 % of m_r move f_r by 2 %, and the RMS by more.
    assert values["spread_rig"] > 0.02


@pytest.mark.parametrize(
    ("options", "posterior", "draws", "words"),
    [
        (("--rig-draws", "3"), True, 3, "spread over the posterior of identification"),
        (("--rig-draws", "0"), True, 0, "none: no rig was drawn"),
        (
            ("--rig-draws", "2", "--rig-spread", "0.05"),
            True,
            2,
            r"assumed spread of +-5 % of parameters, +-1.4 % of k_r",
        ),
        (("--rig-draws", "2"), False, 2, "assumed spread of +-3.5 % of parameters, +-1.4 % of k_r"),
        ((), False, 0, "none: no rig was drawn"),
    ],
)
def test_another_spread_is_taken_where_it_is_asked_for_and_said(
    tmp_path: Path, options: tuple[str, ...], posterior: bool, draws: int, words: str
) -> None:
    values, out = build(tmp_path, machine(tmp_path, posterior=posterior), *options)
    plan = load_map(out).plan
    assert plan.rig_draws == draws
    assert (plan.rig_posterior is not None) == words.startswith("spread over")
    assert values["rig_spread_over"].startswith(words)


def test_other_numbers_another_file_and_another_hash_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"rig\.posterior: the numbers are not those of .*m_r is 3\.2, identified was 3"
    ):
        load_config(machine(tmp_path, "m_r_kg = 3.2"))
    with pytest.raises(ConfigError, match=r"rig\.posterior: the posterior is of identification"):
        load_config(machine(tmp_path, identification="cd" * 32))
    path = machine(tmp_path)
    (tmp_path / "rig.posterior.csv").write_text(POSTERIOR.text().replace("2.72875", "2.72876"))
    with pytest.raises(
        ConfigError, match=r"rig\.posterior\.csv: is not the posterior that was written, or was changed"
    ):
        load_config(path)
    (tmp_path / "rig.posterior.csv").unlink()
    with pytest.raises(ConfigError, match="cannot be read"):
        load_config(path)
    path.write_text(MACHINE + '[rig]\ncalibrated = "declared"\nposterior = "rig.posterior.csv"\n')
    with pytest.raises(ConfigError, match="posterior is the file of an identification"):
        load_config(path)


def test_the_posterior_is_that_of_the_rigs_own_bearing_and_not_in_the_hash(tmp_path: Path) -> None:
    config = load_config(machine(tmp_path, "m_r_kg = 3.01"))
    entry = config.own_bearing.to_entry()
    assert config.posterior_of(entry) == POSTERIOR.draws
    other = config.own_bearing.model_copy(update={"designation": "6205"}).to_entry()
    assert config.posterior_of(other) is None
    assert config.hash == load_config(machine(tmp_path, posterior=False)).hash


def test_lives_of_a_library_take_the_posterior(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Population] = []

    def build_nothing(population: Population, **options: object) -> None:
        asked.append(population)
        raise ValueError("enough")

    monkeypatch.setattr(library_commands, "build_library", build_nothing)
    arguments = ["library", "build", "--config", str(machine(tmp_path)), "--out", str(tmp_path / "lives.npz")]
    result = CliRunner().invoke(spallwatch, arguments)
    assert "enough" in str(result.exception) + result.output
    assert asked[0].rig_posterior == POSTERIOR.draws
