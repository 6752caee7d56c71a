"""Times of pulses in files: found by name, told by their unit, refused where they cannot be of the samples."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter
from numpy.typing import NDArray

import spallwatch as sw
from streams.files.formats.pulse_text import pulse_column
from streams.files.formats.tdms import read_tdms
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.samples import ReaderError
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.streams.format_makers import RATE, START, csv_bytes, hdf5_bytes, mat73_bytes, sound_bytes
from tests.support.pulse_readers import ACC, FORMATS, LENGTH, TIMES, hdf5, tdms

each_format = pytest.mark.parametrize("name", FORMATS)


def first(folder: Path, name: str, data: bytes, pulses: str, **how: Any) -> Block | Rejected:
    (folder / name).write_bytes(data)
    channels = (ChannelSpec("acc_1", unit="g"),)
    spec = SourceSpec("s", str(folder / name), block_s="file", channels=channels, pulses=pulses, **how)
    return next(iter(open_source(spec)))


def pulses_of(item: Block | Rejected) -> tuple[NDArray[np.float64], int | None]:
    assert isinstance(item, Block), item
    assert item.channels == ("acc_1",)
    np.testing.assert_array_equal(item.samples, ACC)
    assert item.pulses is not None
    return item.pulses.times, item.pulses.per_revolution


@each_format
def test_times_of_every_format(name: str, tmp_path: Path) -> None:
    make, where = FORMATS[name]
    times, revolution = pulses_of(first(tmp_path, name, make(TIMES, None, pulses_per_revolution=4), where))
    np.testing.assert_array_equal(times, TIMES)
    assert revolution == 4


@each_format
@pytest.mark.parametrize("unit", ["ms", "seconds since 2024-05-01T11:59:50Z"])
def test_the_unit_tells_what_the_numbers_are(name: str, unit: str, tmp_path: Path) -> None:
    make, where = FORMATS[name]
    times, revolution = pulses_of(
        first(tmp_path, name, make(TIMES * 1e3 if unit == "ms" else TIMES + 10.0, unit), where)
    )
    np.testing.assert_allclose(times, TIMES, atol=1e-14)
    assert revolution is None


@each_format
@pytest.mark.parametrize(
    ("times", "unit", "status", "words"),
    [
        (TIMES[::-1], "s", "wrong_rate", "pulse 2 is at 0.030001 s behind 0.039 s"),
        (np.array([0.0, np.nan]), "s", "nan", "pulse 2"),
        (TIMES + 0.02, "s", "wrong_rate", "3 of 5 pulses are outside the samples"),
        (TIMES - 0.002, "s", "wrong_rate", "1 of 5 pulses are outside the samples"),
        (TIMES, "V", "wrong_unit", "'v'"),
        (TIMES, "counts", "wrong_rate", "need the rate"),
        (TIMES, "s since yesterday", "wrong_unit", "yesterday"),
    ],
)
def test_pulses_that_cannot_be_are_refused(
    name: str, times: NDArray[Any], unit: str, status: str, words: str, tmp_path: Path
) -> None:
    make, where = FORMATS[name]
    item = first(tmp_path, name, make(times, unit), where)
    assert isinstance(item, Rejected)
    assert item.status == status
    assert name in item.reason
    assert words in item.reason


@each_format
def test_a_standing_shaft_has_no_pulses_and_a_file_without_the_array_none_that_are_known(
    name: str, tmp_path: Path
) -> None:
    make, where = FORMATS[name]
    if name != "x.mat":  # MATLAB does not tell an empty array from a missing one.
        times, _ = pulses_of(first(tmp_path, name, make(np.empty(0), "s"), where))
        assert times.size == 0
    item = first(tmp_path, name, make(TIMES, "s"), "Encoder/none" if name == "x.tdms" else "none")
    assert not isinstance(item, Block) or item.pulses is None


def test_one_pulse_and_a_pulse_rounded_out_of_the_samples(tmp_path: Path) -> None:
    for name, (make, where) in FORMATS.items():
        assert pulses_of(first(tmp_path, name, make(TIMES[:1], "s"), where))[0].tolist() == [0.001]
    make, where = FORMATS["x.h5"]
    edges = np.array([-0.4 / RATE, 0.01, (LENGTH + 0.5) / RATE])
    assert pulses_of(first(tmp_path, "x.h5", make(edges, "s"), where))[0].tolist() == [0.01]


def test_counts_whose_rate_may_be_in_khz_are_refused(tmp_path: Path) -> None:
    make, where = FORMATS["x.h5"]
    item = first(tmp_path, "x.h5", make(np.array([5, 5, 6], np.int32), "counts", sampling_rate=12.8), where)
    assert isinstance(item, Rejected)
    assert "of the pulses may mean 12.8 or 12800 Hz" in item.reason


@pytest.mark.parametrize("name", ["x.tdms", "x.h5"])
def test_counts_are_pulses_in_the_middle_of_their_step(name: str, tmp_path: Path) -> None:
    make, where = FORMATS[name]
    counts = np.array([5, 5, 6, 8, 8], dtype=np.uint32) + np.uint32(2**32 - 7)
    wave = {"wf_increment": 0.001} if name == "x.tdms" else {"sampling_rate": 1000.0}
    times, _ = pulses_of(first(tmp_path, name, make(counts, "counts", **wave), where))
    np.testing.assert_allclose(times, [0.0015, 0.00225, 0.00275], atol=1e-12)
    item = first(tmp_path, name, make(np.array([5, 4, 6]), "counts", **wave), where)
    assert isinstance(item, Rejected)
    assert "fall at sample 2" in item.reason


def test_a_step_beside_times_that_state_their_unit_is_not_looked_at(tmp_path: Path) -> None:
    times, _ = pulses_of(first(tmp_path, "x.tdms", tdms(TIMES, "s", wf_increment=0.0), "edges"))
    np.testing.assert_array_equal(times, TIMES)


def test_times_of_tdms_may_be_dates(tmp_path: Path) -> None:
    dates = np.datetime64("2024-05-01T12:00:00") + (TIMES * 1e6).round().astype("timedelta64[us]")
    times, _ = pulses_of(first(tmp_path, "x.tdms", tdms(dates.astype("datetime64[us]"), None), "edges"))
    np.testing.assert_allclose(times, TIMES, atol=1e-9)


def test_a_structure_of_a_file_of_version_73_is_a_group(tmp_path: Path) -> None:
    data = mat73_bytes({"acc_1": ACC, "fs": np.array([RATE]), "Tacho.edges": TIMES[np.newaxis]})
    times, _ = pulses_of(first(tmp_path, "x.mat", data, "Tacho"))
    np.testing.assert_array_equal(times, TIMES)


def test_several_arrays_are_no_choice(tmp_path: Path) -> None:
    stream = io.BytesIO(hdf5(TIMES, "s"))
    with h5py.File(stream, "a") as file:
        file.create_dataset("Tacho/more", data=TIMES)
    item = first(tmp_path, "x.h5", stream.getvalue(), "Tacho")
    assert isinstance(item, Rejected)
    assert "matches 2 arrays" in item.reason


def test_a_channel_is_read_as_the_pulses_only_where_it_is_asked_for() -> None:
    data = tdms(TIMES[:1], "s")
    assert (read_tdms(data, "x").names, read_tdms(data, "x").beside) == (("run/acc_1",), ("Tacho/edges",))
    assert read_tdms(data, "x", pulses="edges").names == ("run/acc_1",)


@pytest.mark.parametrize(
    ("name", "pulses", "words"),
    [
        ("x.csv", "tacho", "hold no array of pulses"),
        ("x.csv", "", "is empty"),
        ("x.csv", "{stem}/p.csv", "a name in the folder"),
        ("x.csv", "{folder}.csv", "a file beside the recording"),
        ("x.csv", "{stem}", "a name in the folder"),
    ],
)
def test_keys_that_name_no_pulses(name: str, pulses: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError, match=words):
        first(tmp_path, name, csv_bytes(ACC), pulses)


COLUMNS = {
    "0.5\n1.5\n": ([0.5, 1.5], None, None),
    "time,level\n0.5,1\n1.5,1\n": ([0.5, 1.5], None, None),
    "pulses_per_revolution: 2\nTime [ms]\n500\n1500\n": ([0.5, 1.5], 2, None),
    "# unit: s since 2024-05-01T12:00:00Z\n0.5\n1.5\n": ([0.5, 1.5], None, START),
    "ppr;60\nt\n0,5\n1,5\n": ([0.5, 1.5], 60, None),
    "2024-05-01T12:00:00.500Z\n2024-05-01T12:00:01.500Z\n": ([0.5, 1.5], None, START),
    "dates\n2024-05-01 14:00:00.5\n2024-05-01 14:00:01.5\n": ([0.5, 1.5], None, START),
    "pulses [s]\n": ([], None, None),
}


@pytest.mark.parametrize("text", COLUMNS)
def test_texts_of_pulses(text: str) -> None:
    times, revolution, epoch = COLUMNS[text]
    found = pulse_column(text.encode(), "x", "Europe/Rome")
    assert found.pulses is not None
    np.testing.assert_allclose(found.pulses.times, times, atol=1e-9)
    assert (found.pulses.per_revolution, found.pulse_epoch) == (revolution, epoch)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no line of numbers"),
        ("words\nmore words\n", "no line of numbers"),
        ("1,2\n3,4\n", "2 columns; expected one"),
        ("ppr: 2.5\n1\n", "a whole number from 1"),
        ("1\n0.5\n", "fall"),
        ("2024-05-01T12:00:00Z\nlater\n", "line 2: expected a date"),
        ("2024-05-01T12:00:00Z\n2024-05-01T12:00:01\n", "several zones"),
        ("2024-13-01T12:00:00Z\n", "x"),
    ],
)
def test_texts_that_are_refused(text: str, words: str) -> None:
    with pytest.raises(ReaderError, match=words) as caught:
        pulse_column(text.encode(), "x")
    assert "x" in str(caught.value)


def tacho_files() -> dict[str, bytes]:
    """A vibration in g and a tacho that is on and off, or int16 counts, as every format may hold them."""
    on = np.arange(LENGTH) % 100 < 10
    made = io.BytesIO()
    wave = {"wf_increment": 1.0 / RATE}
    with TdmsWriter(made) as writer:
        writer.write_segment(
            [
                ChannelObject("run", "acc_1", ACC[0], properties={**wave, "unit_string": "g"}),
                ChannelObject("run", "tacho", on, properties=wave),
                ChannelObject("run", "volts", (on * 5000).astype(np.int16), properties={**wave, "unit_string": "mV"}),
            ]
        )
    stream = io.BytesIO(hdf5_bytes(ACC))
    with h5py.File(stream, "a") as file:
        file.create_dataset("run/tacho", data=on)
        file.create_dataset("run/volts", data=(on * 5000).astype(np.int16)).attrs["unit"] = "mV"
    matlab = io.BytesIO()
    rows = {"acc_1": ACC[0], "tacho": on, "volts": (on * 5000).astype(np.int16), "fs": RATE}
    scipy.io.savemat(matlab, rows)
    return {"x.tdms": made.getvalue(), "x.h5": stream.getvalue(), "x.mat": matlab.getvalue()}


TACHO_FILES = tacho_files()


@pytest.mark.parametrize("name", TACHO_FILES)
def test_rows_of_a_tacho_pass_as_they_are_stored(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(TACHO_FILES[name])
    others = (ChannelSpec(row, column=row, unit="unknown", any_unit=True) for row in ("tacho", "volts"))
    spec = SourceSpec(
        "s", str(tmp_path / name), block_s="file", channels=(ChannelSpec("acc_1", column="acc_1", unit="g"), *others)
    )
    block = next(iter(open_source(spec)))
    assert isinstance(block, Block), block
    assert block.units == ("g", "unknown", "unknown")
    on = np.arange(LENGTH) % 100 < 10
    np.testing.assert_array_equal(block.samples, [ACC[0], on, on * 5000.0])


def test_a_wav_of_two_channels_may_hold_a_tacho(tmp_path: Path) -> None:
    on = np.arange(LENGTH) % 100 < 10
    (tmp_path / "x.wav").write_bytes(sound_bytes(np.vstack([ACC, on * 0.5])))
    channels = (
        ChannelSpec("acc", column=1, unit="g", scale=1.0),
        ChannelSpec("2", column=2, unit="unknown", any_unit=True),
    )
    block = next(iter(open_source(SourceSpec("s", str(tmp_path / "x.wav"), block_s="file", channels=channels))))
    assert isinstance(block, Block), block
    np.testing.assert_array_equal(block.samples[1], on * 0.5)


def test_rows_that_are_on_and_off_are_no_vibration(tmp_path: Path) -> None:
    stream = io.BytesIO(hdf5_bytes(ACC))
    with h5py.File(stream, "a") as file:
        file.create_dataset("run/tacho", data=np.arange(LENGTH) % 100 < 10)
    (tmp_path / "x.h5").write_bytes(stream.getvalue())
    block = next(iter(open_source(SourceSpec("s", str(tmp_path / "x.h5"), block_s="file"))))
    assert isinstance(block, Block), block
    assert block.channels == ("acc_1",)


def test_a_unit_for_all_channels_does_not_ask_for_the_level_of_truth_values(tmp_path: Path) -> None:
    (tmp_path / "x.mat").write_bytes(TACHO_FILES["x.mat"])
    found = sw.read(tmp_path / "x.mat", unit="g", rate_hz=RATE, scale=1.0)
    assert list(found.channel.values) == ["acc_1", "volts", "tacho"]


@pytest.mark.parametrize("name", TACHO_FILES)
def test_truth_values_do_not_move_the_numbers_of_other_columns(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(TACHO_FILES[name])
    channels = (ChannelSpec("volts", column=2, unit="unknown", any_unit=True),)
    block = next(iter(open_source(SourceSpec("s", str(tmp_path / name), block_s="file", rate=RATE, channels=channels))))
    assert isinstance(block, Block), block
    assert block.samples.max() == 5000.0


def test_truth_values_of_another_length_are_passed_over(tmp_path: Path) -> None:
    stream = io.BytesIO(hdf5_bytes(ACC))
    with h5py.File(stream, "a") as file:
        file.create_dataset("run/flags", data=np.ones(7, dtype=bool))
        file.create_dataset("run/mask", data=np.ones((3, 3), dtype=bool))
    made = io.BytesIO()
    with TdmsWriter(made) as writer:
        wave = {"wf_increment": 1.0 / RATE, "unit_string": "g"}
        acc = ChannelObject("run", "acc_1", ACC[0], properties=wave)
        writer.write_segment([acc, ChannelObject("run", "flags", np.ones(7, dtype=bool))])
    matlab = io.BytesIO()
    scipy.io.savemat(matlab, {"acc_1": ACC[0], "flags": np.ones(7, bool), "mask": np.ones((3, 3), bool), "fs": RATE})
    for name, data in (("x.h5", stream.getvalue()), ("x.tdms", made.getvalue()), ("x.mat", matlab.getvalue())):
        (tmp_path / name).write_bytes(data)
        assert list(sw.read(tmp_path / name, unit="g").channel.values) == ["acc_1"]
