"""A program that adds one feature, a row and a function, and prints where it then appears, as JSON."""

from __future__ import annotations

import importlib.util
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

ROW = "margin | level | margin | Mg | margin of the block | largest sample above the mean | a test"


def add_row() -> None:
    """Import the table of features with one row more, before anything else reads it."""
    spec = importlib.util.find_spec("monitor.words.features")
    assert spec is not None
    assert spec.origin is not None
    source = Path(spec.origin).read_text(encoding="utf-8")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    exec(compile(source.replace('_TABLE = f"""\n', f'_TABLE = f"""\n{ROW}\n'), spec.origin, "exec"), module.__dict__)


def appearances(folder: Path) -> dict[str, Any]:
    """Run blocks through the stages and return what is found of the feature."""
    from monitor.config.alarms import AlarmLevel
    from monitor.health.alarms import AlarmInput, AlarmSettings, AlarmState
    from monitor.health.alarms import step as alarm_step
    from monitor.health.signal.features import FUNCTIONS
    from monitor.records.dataset import to_dataset
    from monitor.records.store import Store
    from monitor.records.trends import SeriesKey, read_trends
    from monitor.web.api import columns
    from monitor.words.events import event_text
    from monitor.words.statuses import page_words
    from tests.support.pipeline import base, life, record_of, run

    FUNCTIONS["margin"] = lambda x, found: float(np.max(x)) - found.indicators.mean
    blocks = life(3)
    expected = [float(np.max(x) - np.mean(x, dtype=np.float64)) for x in blocks]
    settings = base()
    state, outputs = run(blocks, settings)
    records = [record_of(i, state, output) for i, output in enumerate(outputs)]
    with Store.open(folder / "state.db", machine="m") as store:
        store.commit_many([(record, {}) for record in records])
        dataset = to_dataset(store.stored(), dated=False, attributes={})
        trends = read_trends(store, SeriesKey(records[0].source, "one", False), None, None, 100)
    level = AlarmLevel(feature="margin", alert_g=1e-3, on_delay_blocks=1)  # pyright: ignore[reportArgumentType]
    given = AlarmInput(1, usable=True, bad=False, values=records[-1].channels["one"])
    _, alarm = alarm_step(AlarmState(), given, AlarmSettings((level.to_rule(),)))
    (change,) = alarm.changes
    return {
        "expected": expected,
        "record": [record.channels["one"]["margin"] for record in records],
        "file": dataset["margin"].values[:, 0].tolist(),
        "attributes": dict(dataset["margin"].attrs),
        "column": columns(trends, absolute=True)["margin_g_max"],
        "page": [page_words()["features"]["margin"]["column"], page_words()["charts"]["margin"]["title"]],
        "event": event_text(
            {
                "kind": f"alarm_{change.kind}",
                "rule": change.rule,
                "feature": change.feature,
                "severity": change.severity,
                "value_si": change.value,
                "level_si": change.level,
            }
        ),
    }


if __name__ == "__main__":
    add_row()
    with tempfile.TemporaryDirectory() as name:
        print(json.dumps(appearances(Path(name))))
