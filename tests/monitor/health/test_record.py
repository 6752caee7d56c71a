from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings

from monitor.health import onset as detect
from monitor.health import schema
from monitor.health.record import Record, RecordError, plain
from monitor.health.schema import VARIABLES
from monitor.health.signal import features, quality
from monitor.records.packing import pack, unpack
from monitor.words.features import GABRIELLI
from tests.oracles.records_oracle import records
from tests.support.effort import effort_count

EXAMPLES = effort_count(quick=30, full=2000)


def make(**values: Any) -> Record:
    return Record(source="s", sequence=1, name="a", content_hash="h", channels={"x": values})


@given(records())
@settings(max_examples=EXAMPLES)
def test_json_gives_the_record_back_bit_for_bit(record: Record) -> None:
    text = record.to_json()
    again = Record.from_json(text)
    assert again == record
    assert again.to_json() == text
    assert "NaN" not in json.dumps(json.loads(text)["channels"])


@given(records(bands=3))
@settings(max_examples=EXAMPLES)
def test_packed_values_come_back_bit_for_bit(record: Record) -> None:
    channels = {channel: dict(values) for channel, values in record.channels.items()}
    assert unpack(*pack(channels)) == channels
    assert list(unpack(*pack(channels))) == list(channels)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rms": math.nan}, "rms: nan is refused"),
        ({"rms": math.inf}, "rms: inf is refused"),
        ({"envelope_amplitude": [[1.0] * 5] * 3 + [[math.nan] * 5]}, "envelope_amplitude: nan is refused"),
        ({"rms": "loud"}, "rms: expected a number or null, got 'loud'"),
        ({"rms": True}, "rms: expected a number or null, got True"),
        ({"loudness": 1.0}, "unknown variable 'loudness'"),
        ({"stage": "dead"}, "stage: expected one of learning, healthy, final, end_of_life, got 'dead'"),
        ({"fault": "outer|seal"}, "fault: expected any of outer, inner, ball, cage, undecided, got 'seal'"),
        ({"quality_flags": 1 << 9}, "bits beyond"),
        ({"bpfo_amplitude": (1.0, 2.0)}, "expected 6 values over bpfo_harmonic, got 2"),
        ({"envelope_amplitude": (1.0,) * 5}, r"expected values over \(band, fault, harmonic\), got 1 dimensions"),
        ({"t_fs_block": 3.0}, "t_fs_block: expected a whole number, got 3.0"),
    ],
)
def test_what_breaks_the_schema_is_refused_by_name(values: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordError, match=message) as caught:
        make(**values)
    assert "block 1 of 's'" in str(caught.value)
    assert "'x'" in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"status": "fine"}, "status must be one of ok, flat"),
        ({"flags": ("loud",)}, "flags may be flat, stopped"),
        ({"sequence": 0}, "sequence must be a whole number from 1, got 0"),
        ({"time": math.nan}, "time: nan is refused"),
        ({"events": ({"kind": object()},)}, "events.kind: expected finite numbers"),
        ({"forecasts": ({"tt": math.nan},)}, "forecasts.tt: expected finite numbers"),
    ],
)
def test_what_breaks_the_ledger_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RecordError, match=message):
        Record(**{"source": "s", "sequence": 1, "name": "a", "content_hash": "h", **changes})


def test_garbage_is_no_record() -> None:
    for text in ("", "[1]", '{"source": "s"}', '{"source": "s", "sequence": 1, "what": 2}'):
        with pytest.raises(RecordError, match="not a record"):
            Record.from_json(text)


def test_arrays_and_absent_rows_become_nested_tuples() -> None:
    rows: list[Any] = [[1.0] * 5, [2.0] * 5, [3.0] * 5, None]
    record = make(envelope_floor=rows, bpfo_amplitude=np.arange(6, dtype=np.float32), tt=np.float64(3.0))
    assert record.channels["x"]["envelope_floor"][3] == (None,) * 5
    assert record.channels["x"]["bpfo_amplitude"] == (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)
    assert type(record.channels["x"]["tt"]) is float


def test_a_value_without_any_number_is_absent() -> None:
    for nothing in ((None, None), [None], ((None,) * 3,), ((None,) * 3, None)):
        assert make(tt_coefficients=nothing).channels["x"]["tt_coefficients"] is None
    assert make(tt_coefficients=((1.0, 2.0, 3.0), None)).channels["x"]["tt_coefficients"][1] == (None,) * 3


def test_sets_of_words_are_brought_into_one_order() -> None:
    for fault in ("ball|inner", ("ball", "inner"), 6, "inner|ball"):
        assert make(fault=fault).channels["x"]["fault"] == "inner|ball"
    assert make(quality_flags=0).channels["x"]["quality_flags"] is None


def test_plain_turns_nan_into_none_and_arrays_into_tuples() -> None:
    value = {"a": np.array([[1.0, math.nan]]), "b": [np.float32(0.5), -math.inf], "c": "word", 4: True}
    assert plain(value) == {"a": ((1.0, None),), "b": (0.5, None), "c": "word", "4": True}


def test_the_schema_knows_every_word_that_the_stages_say() -> None:
    assert schema.REJECTIONS == quality.REJECTIONS
    assert schema.FLAGS == quality.FLAGS
    assert schema.STAGES == detect.STAGES
    assert schema.FAULTS == features.FAULTS


def test_the_words_of_published_files_keep_their_integers() -> None:
    edv = "ok widened below_map above_map no_map no_library not_final_stage bad_block ambiguous outside_conditions"
    tt = "ok not_final_stage too_few_points no_crossing concave crossing_in_past already_crossed beyond_horizon"
    assert (
        *edv.split(),
        "outside_library",
        "no_absolute_level",
        *("uncalibrated", "episode_closed", "implausible", "not_this_part", "velocity_sensor"),
    ) == schema.EDV_STATUSES
    assert (
        *tt.split(),
        "no_library",
        "outside_library",
        "cannot_tell",
        "uncalibrated",
        "episode_closed",
        "no_growth",
    ) == schema.TT_STATUSES
    tta = "ok reached no_trend too_few_points not_final_stage learning beyond_horizon no_level bad_block episode_closed"
    assert tuple(tta.split()) == schema.TTA_STATUSES
    assert schema.VARIABLES["tta_level_source"].values == ("alert", "danger", "default")


def test_every_variable_is_described() -> None:
    for name, variable in VARIABLES.items():
        assert variable.name == name == name.lower()
        assert variable.long_name
        assert bool(variable.values) == (variable.kind in ("flag", "mask"))
        assert len(set(variable.values)) == len(variable.values) < 120
        assert variable.kind != "float" or variable.units or name == "tt_coefficients"


def _short(source: str) -> str:
    """Return a source as the document names it, which gives the works in full once."""
    for work in (
        GABRIELLI,
        "Ceruti, Master's thesis, Politecnico di Torino, 2021",
        "Sassi et al., J. Vibration and Control 13, 2007",
    ):
        source = source.replace(work, work.split(",")[0].removesuffix(" et al."))
    return source


def test_the_document_lists_the_variables_as_they_are() -> None:
    text = (Path(__file__).parents[3] / "docs" / "reference" / "records.md").read_text(encoding="utf-8")
    listed = text[text.index("## Variables of every channel") : text.index("## The store")].splitlines()
    rows = [line for line in listed if line.startswith("| `")]
    expected = []
    for variable in VARIABLES.values():
        dims = f" ({', '.join(variable.dims)})" if variable.dims else ""
        unit = {"time": "time axis"}.get(variable.units or "", variable.units or "")
        words = f": {', '.join(variable.values)}" if variable.values else ""
        departure = f"; {variable.comment}" if variable.comment else ""
        what = variable.long_name + departure + (words if len(variable.values) <= 6 else " ([words](statuses.md))")
        cells = (f"`{variable.name}`{dims}", unit, what, _short(variable.source))
        expected.append(f"| {' | '.join(cells)} |")
    assert rows == expected
