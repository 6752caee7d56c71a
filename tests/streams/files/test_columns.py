"""What a row is, by name, unit and shape, in every format; which rows are taken where lengths differ."""

from __future__ import annotations

import io
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import scipy.io
import soundfile
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st
from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

import spallwatch as sw
from monitor.commands.init.command import command
from monitor.config.load import load_config
from streams.files.abscissa import abscissa_called
from streams.files.columns import hertz_in, kind_of, kinds_of
from streams.files.survey import survey
from streams.open import open_source
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceSpec
from tests.streams.format_makers import uff_bytes

COUNT, RATE = 4096, 3200.0
RNG = np.random.default_rng(5)
NOISE = np.round(RNG.normal(size=COUNT), 6)
STEPS = np.arange(COUNT)
EPOCH = 1_730_708_100.0
RUNNING = {
    "seconds": STEPS / RATE,
    "a number": STEPS + 1.0,
    "a number that falls": 9000.0 - STEPS,
    "a counter of a byte": STEPS % 256.0,
    "a counter with lost samples": np.cumsum(RNG.choice([1.0, 1.0, 1.0, 7.0], COUNT)),
    "milliseconds since 1970": np.floor(EPOCH * 1e3 + STEPS * 1e3 / RATE),
    "microseconds, jittering": EPOCH * 1e6 + STEPS * 1e6 / RATE + np.round(RNG.uniform(0, 100, COUNT)),
    "an angle": (STEPS * 2.8125) % 360.0,
    "counts of a tacho": np.floor(STEPS / 37.0) % 65536,
}
TURNING = {
    "noise": NOISE,
    "coarse noise": np.round(NOISE),
    "noise of one bit": np.where(NOISE > 0.0, 1.0, 0.0),
    "a pure sine": np.sin(2.0 * np.pi * 25.0 * STEPS / 51200.0 * 16.0),
    "a sine on gravity": 1.0 + 0.2 * np.sin(2.0 * np.pi * 80.0 * STEPS / RATE) + 0.01 * NOISE,
    "noise with gaps of zeros": np.where((STEPS // 512) % 2, NOISE, 0.0),
    "an impact that dies away": np.exp(-STEPS / 300.0) * np.cos(STEPS / 4.0) + 1e-3 * NOISE,
    "a dead sensor": np.full(COUNT, 0.25),
    "pulses": np.where(STEPS % 100 < 20, 5.0, 0.0),
}


@pytest.mark.parametrize("case", RUNNING)
@pytest.mark.parametrize("title", ["ch2", "acc [g]", "Time (us)"])
def test_what_runs_on_is_never_vibration(case: str, title: str) -> None:
    found = kind_of(title, "g" if title == "ch2" else "", RUNNING[case])
    assert found.kind == ("time" if title.startswith("Time") else "index"), found
    assert found.evidence


@pytest.mark.parametrize("case", TURNING)
def test_what_turns_back_is_vibration_unless_it_is_called_something_else(case: str) -> None:
    assert kind_of("acc_x", "", TURNING[case]).kind == "vibration"
    assert kind_of("acc_x", "m/s2", TURNING[case]).kind == "vibration"
    assert kind_of("n [1/min]", "", TURNING[case]).kind == "speed"
    assert kind_of("Motor power", "", TURNING[case]).kind == "other"
    assert kind_of("ch3", "degC", TURNING[case]).kind == "other"
    assert kind_of("time", "", TURNING[case]).kind == "other"
    assert kind_of("X099_DE_time", "", TURNING[case]).kind == "vibration"
    assert kind_of("t", "g", TURNING[case]).kind == "vibration"


@given(st.lists(st.floats(0.0, 1e3), min_size=70, max_size=300), st.floats(-1e6, 1e6), st.booleans())
def test_any_steps_that_never_turn_back_run_on(steps: list[float], first: float, falls: bool) -> None:
    values = first + np.cumsum(steps) * (-1.0 if falls else 1.0)
    if np.unique(values).size >= 20:
        assert kind_of("acc", "g", values).kind == "index"


@given(st.integers(0, 2**32 - 1), st.integers(64, 500), st.floats(-5.0, 5.0))
def test_noise_of_any_length_is_vibration(seed: int, length: int, mean: float) -> None:
    assert kind_of("acc", "", np.random.default_rng(seed).normal(mean, 1.0, length)).kind == "vibration"


def test_a_slow_row_is_a_process_value_only_beside_another() -> None:
    slow = 61.0 + 0.1 * np.sin(STEPS / 2000.0)
    held = np.repeat(np.round(1488.0 + RNG.normal(size=COUNT // 64), 1), 64)
    switch = (STEPS > 2000).astype(float)
    kinds = kinds_of(["a", "b", "c", "d"], [""] * 4, [NOISE, slow, held, switch])
    assert [kind.kind for kind in kinds] == ["vibration", "other", "other", "other"]
    assert "61" in kinds[1].evidence
    assert [kind.kind for kind in kinds_of(["b"], [""], [slow])] == ["vibration"]
    assert [kind.kind for kind in kinds_of(["a", "b"], ["", "g"], [NOISE, slow])] == ["vibration", "vibration"]


@pytest.mark.parametrize(
    ("title", "unit", "seconds"),
    [
        ("Time (us)", "", 1e-6), ("epoch_ms", "", 1e-3), ("time", "ns", 1e-9), ("timestamp_us", "", 1e-6),
        ("log/Zeit [s]", "", 1.0), ("time", "milliseconds since 2024-01-01", 1e-3), ("timems", "", 1e-3),
        ("t", "", None), ("time", "V", None), ("Time_us", "g", 1e-6),
    ],
)  # fmt: skip
def test_the_unit_of_times_is_stated_by_unit_or_name(title: str, unit: str, seconds: float | None) -> None:
    assert abscissa_called(title.rpartition("/")[2], unit).size == seconds


def hdf5(rows: dict[str, np.ndarray]) -> bytes:
    stream = io.BytesIO()
    with h5py.File(stream, "w") as file:
        for name, row in rows.items():
            file.create_dataset(name, data=row).attrs["unit"] = "g" if name.startswith("acc") else ""
    return stream.getvalue()


def mat(rows: dict[str, np.ndarray]) -> bytes:
    stream = io.BytesIO()
    scipy.io.savemat(stream, {**rows, "unit": "g"})
    return stream.getvalue()


def tdms(rows: dict[str, np.ndarray]) -> bytes:
    stream = io.BytesIO()
    with TdmsWriter(stream) as writer:
        writer.write_segment(
            [
                ChannelObject("log", name, row, {"unit_string": "g"} if name == "acc" else {})
                for name, row in rows.items()
            ]
        )
    return stream.getvalue()


MAKERS = {"x.h5": hdf5, "x.mat": mat, "x.tdms": tdms}


@pytest.mark.parametrize("name", MAKERS)
@pytest.mark.parametrize(
    ("title", "times", "start"),
    [
        ("Time_us", STEPS * 1e6 / RATE, None),
        ("time", STEPS / RATE, None),
        ("epoch_ms", EPOCH * 1e3 + STEPS * 1e3 / RATE, EPOCH),
        ("timestamp", EPOCH * 1e6 + STEPS * 1e6 / RATE, EPOCH),
    ],
)
def test_a_row_of_times_states_rate_and_start(
    name: str, title: str, times: np.ndarray, start: float | None, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(MAKERS[name]({"acc": NOISE, title: times}))
    found = sw.read(tmp_path / name)
    assert [str(channel).rpartition("/")[2] for channel in found.channel.values] == ["acc"]
    assert found.attrs["rate_hz"] == pytest.approx(RATE, rel=1e-6)
    assert ("start_utc" in found.attrs) == (start is not None)
    if start is not None:
        assert found.attrs["start_utc"].startswith("2024-11-04T08:15:00")


@pytest.mark.parametrize("name", MAKERS)
def test_a_row_of_times_that_contradicts_the_rate_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(MAKERS[name]({"acc": NOISE, "time": STEPS / RATE}))
    with pytest.raises(sw.SpallwatchError, match=r"3200 Hz and 1000 Hz"):
        sw.read(tmp_path / name, rate_hz=1000.0)
    uneven = STEPS / RATE + np.where(STEPS > 2000, 0.1, 0.0)
    (tmp_path / name).write_bytes(MAKERS[name]({"acc": NOISE, "time": uneven}))
    with pytest.raises(sw.SpallwatchError, match="not evenly spaced"):
        sw.read(tmp_path / name)


@pytest.mark.parametrize(("stated", "rate"), [(3.2, RATE), (3200.0, RATE), (28.16, None), (4000.0, None)])
def test_a_row_of_times_is_compared_with_each_reading_of_a_stated_rate(
    stated: float, rate: float | None, tmp_path: Path
) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"acc": NOISE, "unit": "g", "sampling_rate": stated, "t": STEPS / RATE})
    if rate is not None:
        assert sw.read(tmp_path / "x.mat").attrs["rate_hz"] == pytest.approx(rate)
        return
    with pytest.raises(sw.SpallwatchError, match="several sampling rates"):
        sw.read(tmp_path / "x.mat")


@pytest.mark.parametrize("running", ["a number", "a counter of a byte", "milliseconds since 1970"])
@pytest.mark.parametrize("name", ["x.npy", "x.wav", "x.uff", *MAKERS])
def test_a_running_row_is_no_channel_of_any_format(running: str, name: str, tmp_path: Path) -> None:
    rows = np.vstack([NOISE, RUNNING[running]])
    place = tmp_path / name
    if name == "x.npy":
        np.save(place, rows)
    elif name == "x.wav":
        # Of a sound, numbers that need more bits than it has are taken at its full scale.
        counted = (STEPS % 65536 - 32768) / 32768 if running != "a counter of a byte" else (STEPS % 256) / 256
        soundfile.write(place, np.vstack([NOISE / 8, counted]).T, int(RATE), subtype="FLOAT")
    elif name == "x.uff":
        place.write_bytes(uff_bytes(rows, RATE))
    else:
        place.write_bytes(MAKERS[name]({"acc": NOISE, "ch2": RUNNING[running]}))
    seen = survey(str(place))
    assert [row.kind for row in seen.rows] == ["vibration", "index"]
    unit = {"unit": "g"} if name in ("x.npy", "x.wav") else {}
    found = sw.read(place, **unit, **({} if seen.rate else {"rate_hz": RATE}))
    assert list(found.channel.values) == [seen.rows[0].name]


def process_file(name: str, speed_rows: int = 16, rate: float = RATE / 256) -> bytes:
    """Return a file of two signals, and a speed and a temperature at a lower rate."""
    rows = {"Vibration/DE": NOISE, "Vibration/NDE": 0.5 * NOISE}
    slow = {"Process/Speed": 1488.0 + np.arange(speed_rows) % 2, "Process/Temp": np.full(speed_rows, 61.0)}
    units = {"Vibration/DE": "g", "Vibration/NDE": "g", "Process/Speed": "rpm", "Process/Temp": "degC"}
    stream = io.BytesIO()
    if name.endswith("tdms"):
        with TdmsWriter(stream) as writer:
            writer.write_segment(
                [
                    ChannelObject(
                        key.partition("/")[0],
                        key.partition("/")[2],
                        row,
                        {"unit_string": units[key], "wf_increment": 1.0 / (RATE if key in rows else rate)},
                    )
                    for key, row in (rows | slow).items()
                ]
            )
    else:
        with h5py.File(stream, "w") as file:
            for key, row in (slow | rows).items():
                item = file.create_dataset(key, data=row)
                item.attrs.update({"unit": units[key], "fs": RATE if key in rows else rate})
    return stream.getvalue()


@pytest.mark.parametrize("name", ["x.tdms", "x.h5"])
def test_only_wanted_rows_need_one_length(name: str, tmp_path: Path) -> None:
    place = tmp_path / name
    place.write_bytes(process_file(name))
    wanted = ["Vibration/NDE", "Vibration/DE"]
    assert list(sw.read(place, channels=wanted).channel.values) == wanted
    assert list(sw.read(place).channel.values) == ["DE", "NDE"]
    seen = survey(str(place))
    assert [(row.title, row.kind, row.samples) for row in seen.beside] == [
        ("Process/Speed", "speed", 16),
        ("Process/Temp", "other", 16),
    ]
    with pytest.raises(sw.SpallwatchError, match=r"different lengths.*4096.*16|different lengths.*16.*4096"):
        sw.read(place, channels=["Vibration/DE", "Process/Temp"], unit="unknown")


@pytest.mark.parametrize("name", ["x.tdms", "x.h5"])
def test_a_speed_of_another_length_is_taken_over_the_time_of_the_signals(name: str, tmp_path: Path) -> None:
    place = tmp_path / name
    place.write_bytes(process_file(name))
    channels = (
        ChannelSpec("de", key="Vibration/DE", unit="g"),
        ChannelSpec("speed", column="Process/Speed", unit="unknown", any_unit=True),
    )
    (block,) = open_source(SourceSpec("s", str(place), block_s="file", channels=channels))
    assert isinstance(block, Block)
    assert block.samples[1].mean() == pytest.approx(1488.5, abs=1e-3)
    place.write_bytes(process_file(name, rate=RATE / 100))
    (item,) = open_source(SourceSpec("s", str(place), block_s="file", channels=channels))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_shape"
    assert "lasts 0.5 s" in item.reason


def test_signals_of_two_lengths_are_no_choice(tmp_path: Path) -> None:
    place = tmp_path / "x.h5"
    place.write_bytes(hdf5({"acc_1": NOISE, "acc_2": NOISE[::2]}))
    with pytest.raises(sw.SpallwatchError, match=r"acc_1 4096, acc_2 2048; choose channels"):
        sw.read(place, rate_hz=RATE)
    assert sw.read(place, channels=["acc_2"], rate_hz=RATE).sizes["time"] == COUNT // 2
    place.write_bytes(hdf5({"acc_1": NOISE, "taps": NOISE[:8]}))
    assert list(sw.read(place, rate_hz=RATE).channel.values) == ["acc_1"]


def test_wanted_variables_of_netcdf_need_one_length(tmp_path: Path) -> None:
    place = tmp_path / "x.nc"
    with netCDF4.Dataset(place, "w") as file:
        for name, row in {"de": NOISE, "taps": NOISE[:1024], "n": np.full(16, 1488.0)}.items():
            file.createDimension(f"of_{name}", row.size)
            variable = file.createVariable(name, "f8", (f"of_{name}",))
            variable[:] = row
            variable.units = "rpm" if name == "n" else "g"
    assert sw.read(place, channels=["taps"], rate_hz=RATE).sizes["time"] == 1024
    assert sw.read(place, channels=["de"], rate_hz=RATE).sizes["time"] == COUNT
    with pytest.raises(sw.SpallwatchError, match="different lengths"):
        sw.read(place, rate_hz=RATE)


@pytest.mark.parametrize(
    ("title", "unit", "size"),
    [
        ("n", "1/min", 1 / 60), ("n [rpm]", "", 1 / 60), ("Drehzahl", "U/min", 1 / 60), ("giri/min", "", 1 / 60),
        ("speed_hz", "", 1.0), ("Speed", "Hz", 1.0), ("rpm", "Hz", 1.0), ("Speed", "", None), ("Drehzahl", "", None),
    ],
)  # fmt: skip
def test_the_unit_of_a_speed(title: str, unit: str, size: float | None) -> None:
    assert hertz_in(title, unit) == size


def stating_speed(name: str, place: Path) -> None:
    """Write a file whose properties state a speed of 1488 rpm."""
    if name.endswith("h5"):
        with h5py.File(place, "w") as file:
            file.attrs.update({"fs": RATE, "rpm": 1488.0})
            file.create_dataset("run/acc", data=NOISE).attrs["unit"] = "g"
    elif name.endswith("mat"):
        scipy.io.savemat(place, {"acc": NOISE, "fs": RATE, "unit": "g", "shaft_speed_hz": 24.8})
    elif name.endswith("tdms"):
        with TdmsWriter(str(place)) as writer:
            properties = {"unit_string": "g", "wf_increment": 1.0 / RATE}
            writer.write_segment(
                [RootObject({"Speed_rpm": 1488.0}), GroupObject("run"), ChannelObject("run", "acc", NOISE, properties)]
            )
    else:
        head = f"Sample rate: {RATE:g}\nSpeed: 1488 rpm\nUnit: g\nacc\n"
        place.write_text(head + "\n".join(f"{value:.6f}" for value in NOISE) + "\n", encoding="utf-8")


@pytest.mark.parametrize("name", ["x.h5", "x.mat", "x.tdms", "x.csv"])
def test_a_speed_among_the_properties_is_offered_and_not_used(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stating_speed(name, tmp_path / name)
    seen = survey(name)
    assert (seen.speed, seen.speed_from) == (pytest.approx(24.8), "by the properties of the files")
    assert "speed_hz" not in sw.read(name).attrs
    result = CliRunner().invoke(command, [name, "--yes", "--bearing", "6205"])
    assert result.exit_code == 0, result.output
    assert load_config(tmp_path / "config.toml").operating.speed_hz == pytest.approx(24.8)


@pytest.mark.parametrize(
    ("title", "speed", "options", "scale"),
    [
        ("Speed", 1488.0, [], 1 / 60),
        ("Speed", 24.8, ["--speed-unit", "Hz"], 1.0),
        ("Speed", 300.0, ["--speed-unit", "rpm"], 1 / 60),
        ("Speed [Hz]", 24.8, [], 1.0),
        ("n [1/min]", 240.0, [], 1 / 60),
        ("Speed", 24.8, None, 0.0),
    ],
)
def test_the_unit_of_a_row_of_speed_is_asked_where_it_is_open(
    title: str, speed: float, options: list[str] | None, scale: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{k / RATE:.7f};{value:.6f};{speed}\n" for k, value in enumerate(NOISE))
    (tmp_path / "x.csv").write_text(f"Time [s];acc [g];{title}\n{rows}", encoding="utf-8")
    result = CliRunner().invoke(command, ["x.csv", "--yes", "--bearing", "6205", *(options or [])])
    if options is None:
        assert "--speed-unit" in str(result.exception)
        return
    assert result.exit_code == 0, result.output
    assert load_config(tmp_path / "config.toml").operating.speed_channel_scale == pytest.approx(scale)


def test_a_rate_of_coarse_times_is_proposed_and_not_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.h5").write_bytes(hdf5({"acc": NOISE, "epoch_ms": np.floor(EPOCH * 1e3 + STEPS * 1e3 / RATE)}))
    seen = survey("x.h5")
    assert (seen.rate, seen.rate_hint) == (None, (RATE, "epoch_ms"))
    assert seen.start == pytest.approx(EPOCH)
    with pytest.raises(sw.SpallwatchError, match="rate_hz is missing"):
        sw.read("x.h5")
    result = CliRunner().invoke(command, ["x.h5", "--yes", "--bearing", "6205", "--speed-hz", "25"])
    assert result.exit_code == 0, result.output
    assert load_config(tmp_path / "config.toml").source[0].rate_hz == RATE


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    (tmp_path / "x.tdms").write_bytes(process_file("x.tdms"))
    assert sw.read(tmp_path / "x.tdms").attrs["left_out"] == ["Process/Speed", "Process/Temp"]
    assert "left_out" not in sw.read(tmp_path / "x.tdms", channels=["Vibration/DE"]).attrs
    (tmp_path / "x.h5").write_bytes(hdf5({"acc": NOISE, "n": STEPS + 1.0}))
    assert sw.read(tmp_path / "x.h5", rate_hz=RATE).attrs["left_out"] == ["n"]


@pytest.mark.parametrize("name", ["x.npy", "x.csv", "x.h5"])
def test_a_configured_channel_that_runs_on_is_refused(name: str, tmp_path: Path) -> None:
    place = tmp_path / name
    if name == "x.npy":
        np.save(place, np.vstack([STEPS / RATE, NOISE]))
    elif name == "x.csv":
        place.write_text("".join(f"{k % 256},{value:.6f}\n" for k, value in enumerate(NOISE)), encoding="utf-8")
    else:
        place.write_bytes(hdf5({"acc": NOISE, "n": STEPS + 1.0}))
    first = ChannelSpec("c", unit="g", column="n" if name == "x.h5" else 1)
    second = ChannelSpec("c", unit="g", column="acc" if name == "x.h5" else 2)
    (item,) = open_source(SourceSpec("s", str(place), block_s="file", rate=RATE, channels=(first,)))
    assert isinstance(item, Rejected)
    assert item.status == "wrong_shape"
    assert "as times or running numbers do" in item.reason
    (item,) = open_source(SourceSpec("s", str(place), block_s="file", rate=RATE, channels=(second,)))
    assert isinstance(item, Block)
    # What the machine is run by may be anything.
    process = ChannelSpec("c", column="n" if name == "x.h5" else 1, unit="unknown", any_unit=True)
    (item,) = open_source(SourceSpec("s", str(place), block_s="file", rate=RATE, channels=(process,)))
    assert isinstance(item, Block)


@pytest.mark.parametrize("title", ["temperature", "Temp", "temp_1", "Temp. Lager", "Oil pressure", "Luftfeuchte"])
def test_a_process_value_stays_one_where_a_file_states_one_unit_for_all(title: str) -> None:
    assert kind_of(title, "m/s2", NOISE).kind == "other"
    assert kind_of("template", "m/s2", NOISE).kind == "vibration"


def test_init_says_what_the_rows_are_where_none_is_vibration(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{value:.4f},{61.0:.1f}\n" for value in NOISE)
    (tmp_path / "x.csv").write_text(f"# fs=3200\nWay [mm],Temperature\n{rows}", encoding="utf-8")
    result = CliRunner().invoke(command, ["x.csv", "--yes", "--bearing", "6205", "--speed-hz", "25"])
    assert "no row of x.csv is vibration: Way [mm] is in mm," in str(result.exception)
