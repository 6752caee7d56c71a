from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from models.warmup import PARTS, compile_parts
from monitor.commands.installation import command
from tests.support.cli import CONFIG
from tests.support.effort import effort_count


@pytest.mark.parametrize(("block", "transforms"), [("1", 1), ('"file"', 0)])
def test_says_how_long_compiling_and_planning_took(
    tmp_path: Path, block: str, transforms: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # In this process, where they are loaded once.
    monkeypatch.setattr("models.warmup.compile_parts", lambda workers: compile_parts(1))
    path = tmp_path / "machine.toml"
    path.write_text(CONFIG.replace("block_s = 1", f"block_s = {block}"))
    result = CliRunner().invoke(command, ["--config", str(path), "--json"], catch_exceptions=False)
    values = json.loads(result.stdout)
    assert result.exit_code == 0
    assert values["transforms"] == transforms
    assert values["compile_seconds"] == pytest.approx(sum(values["kernels"].values()))
    assert values["elapsed_seconds"] > 0.0
    assert set(values["parts"]) == set(PARTS)
    assert values["plan_seconds"] >= 0.0


@pytest.mark.process
def test_without_a_configuration_the_model_is_compiled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    # The processes load what they are told by name.
    some = dict(list(PARTS.items())[-effort_count(quick=2, full=len(PARTS)) :])
    monkeypatch.setattr("models.warmup.PARTS", some)
    result = CliRunner().invoke(command, [], catch_exceptions=False)
    assert result.exit_code == 0
    assert "functions compiled in" in result.stdout
    assert "0 planned" in result.stdout
