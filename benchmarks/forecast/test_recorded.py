"""A recorded run to failure, replayed, archived and scored: what the whole line says of it, not how good it is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from benchmarks.forecast.recorded import METHODS, configuration, map_of
from monitor.commands.score import command
from monitor.records.store import Store
from monitor.service.replay import replay
from reference.recordings import RUNS

pytestmark = pytest.mark.real

END = 2290.0
"""The 230th file begins then."""


def test_a_recorded_run_is_scored_from_its_archive_and_from_its_records(data_dir: Path, tmp_path: Path) -> None:
    run = next(run for run in RUNS if run.name == "Bearing2_7")
    config = configuration(run, 0.02e-6, METHODS["thesis"])
    rms_map = map_of(config)
    maps = {channel.name: rms_map for channel in config.channel}
    replay(config, str(data_dir / run.file), tmp_path, maps=maps)
    found = {}
    for place in (tmp_path, tmp_path / "records"):
        arguments = [str(place), "--end-s", str(END), "--onset-s", "2230", "--lifetime-s", "200", "--json"]
        result = CliRunner().invoke(command, arguments, catch_exceptions=False)
        found[place.name] = json.loads(result.stdout)["runs"]
    archive, records = found.values()
    assert [run["issued_in"] for run in archive + records] == ["archive"] * len(archive) + ["records"] * len(records)
    for one, other in zip(archive, records, strict=True):
        assert {**one, "records": "", "issued_in": ""} == {**other, "records": "", "issued_in": ""}
    with Store.open(tmp_path / "state.db", read_only=True) as store:
        issued = list(store.forecasts())
    assert {f.map_hash for f in issued} == {rms_map.hash}
    for scored in archive:
        of_channel = [f for f in issued if f.channel == scored["channel"]]
        assert scored["forecasts"] == sum(f.data_until < END for f in of_channel)
        assert scored["method"] == "thesis"
        assert (scored["end_s"], scored["end_source"], scored["false_alarms"]) == (END, "given", 0)
        assert set(scored["baselines"]) >= {"constant", "climatology", "elapsed_alone", "linear", "exponential"}
