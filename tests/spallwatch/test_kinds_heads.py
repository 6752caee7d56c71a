"""Heads, rows and names as loggers of many makers write them: what they state is read, what is open is asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
import soundfile

import spallwatch as sw
from tests.support.stated_files import GRAVITY, noise

RATE, COUNT = 12800.0, 2560
A, B = noise(2, COUNT)
T = np.arange(COUNT) / RATE
START = datetime(2025, 3, 21, 8, 15)
DATED = "2025-03-21T08:15:00"


def cells(row: Sequence[float] | np.ndarray, form: str = "{:.7f}", decimal: str = ".") -> list[str]:
    return [form.format(value).replace(".", decimal) for value in row]


def lines(separator: str, *columns: Sequence[str]) -> list[str]:
    return [separator.join(row) for row in zip(*columns, strict=True)]


def read(folder: Path, text: Sequence[str], encoding: str = "utf-8", name: str = "x.csv", **given: Any) -> Any:
    (folder / name).write_bytes("\r\n".join([*text, ""]).encode(encoding))
    return sw.read(folder / name, **given)


def levels(signal: Any) -> list[float]:
    values = signal.values - signal.values.mean(axis=1, keepdims=True)
    return np.sqrt(np.mean(values**2, axis=1)).tolist()


def expect(signal: Any, *level: float, start: str | None = None) -> None:
    assert levels(signal) == pytest.approx(level, rel=2e-3)
    assert signal.attrs["rate_hz"] == pytest.approx(RATE, rel=1e-6)
    assert start is None or signal.attrs["start_utc"].startswith(start)


COMMA = {"decimal": ","}
NUMBERS = [str(i) for i in range(COUNT)]
SPECTRUM = [*cells(np.arange(COUNT // 2) * 5.0, decimal=","), *[""] * (COUNT // 2)]
AMPLITUDES = [*cells(np.abs(A[: COUNT // 2]), decimal=","), *[""] * (COUNT // 2)]


def stamps(pattern: str, digits: int = 3) -> list[str]:
    moments = [START + timedelta(microseconds=round(1e6 * t)) for t in T]
    return [moment.strftime(pattern).replace("FFF", f"{moment.microsecond:06d}"[:digits]) for moment in moments]


ROWS = lines("\t", cells(T, "{:.8f}", **COMMA), cells(A, **COMMA))
LAYOUTS: dict[str, Callable[[], tuple[str, list[str], tuple[float, ...], str | None]]] = {
    "an oscilloscope": lambda: (
        "utf-8",
        ["X,CH1,Start,Increment", f"Sequence,g,-1.0e-01,{1 / RATE:.6e}", *lines(",", NUMBERS, cells(A))],
        (GRAVITY,),
        None,
    ),
    "an oscilloscope with empty columns": lambda: (
        "utf-8",
        ["X,CH1,CH2,Start,Increment,", f"Sequence,g,g,-1.0e-01,{1 / RATE:.6e}",
         *(f"{row},," for row in lines(",", NUMBERS, cells(A), cells(B)))],
        (GRAVITY, 0.6 * GRAVITY),
        None,
    ),
    "a spectrum beside the signal": lambda: (
        "utf-8",
        ["Timestamp;21.03.2025 08:15:00", "Time [s];Signal [g];Frequency [Hz];FFT",
         *lines(";", cells(T, "{:.8f}", **COMMA), cells(A, **COMMA), SPECTRUM, AMPLITUDES)],
        (GRAVITY,),
        DATED,
    ),
    "a footer of statistics": lambda: (
        "utf-16",
        ["Data:\t21.03.2025", "Godzina:\t08:15:00", "Częstotliwość próbkowania:\t12800 Hz", "",
         "Czas [s]\tPrzyspieszenie [m/s2]", *ROWS, "", "Statystyka", "RMS\t7,0000", "Data:\t22.03.2025", ""],
        (1.0,),
        DATED,
    ),
    "a footer of comments": lambda: (
        "utf-8",
        ["Time [s],Acc [g]", *lines(",", cells(T, "{:.8f}"), cells(A)), "# end of data", "# samples: 2560"],
        (GRAVITY,),
        None,
    ),
    "numbers of channels above their names": lambda: (
        "cp1252",
        ["time\t[3:0]\t[3:1]\t[4.0]", "\tGerüst 3 Beschl.\tWellenweg\tDrehzahl [rpm]", "\tm/s²\tµm\t",
         *lines("\t", stamps("%d.%m.%Y %H:%M:%S.FFF", 6), cells(A, **COMMA), cells(B, **COMMA), ["1490"] * COUNT)],
        (1.0,),
        DATED,
    ),
    "columns of blanks with decimal commas": lambda: (
        "cp1252",
        ["; Datenexport", "; Startzeit: 21.03.2025 08:15:00,000", f"; Abtastzeit: {1e3 / RATE} ms".replace(".", ",", 1),
         "        Zeit     Beschl_1     Beschl_2", "           s           mg         m/s²",
         *(f"   {row}" for row in lines("     ", *(cells(row, "{:.6E}", **COMMA) for row in (T, A, B))))],
        (GRAVITY / 1e3, 0.6),
        None,
    ),
    "numbered rows with am and pm": lambda: (
        "utf-8",
        ["Sample Rate (Hz),12800", "", "Sample,Date/Time,DE (g)",
         *lines(",", NUMBERS, stamps("%m/%d/%Y %I:%M:%S.FFF %p"), cells(A))],
        (GRAVITY,),
        DATED,
    ),
    "Shift-JIS": lambda: (
        "cp932",
        ['"タイトル","ポンプ"', "\"トリガ時刻\",\"'25-03-21 08:15:00.000\"", '"モード","加速度"',
         '"時間","駆動側[m/s2]"', *lines(",", cells(T, "{:.9E}"), cells(A))],
        (1.0,),
        DATED,
    ),
    "GBK": lambda: (
        "gb18030",
        ["试验名称：风机", "采样时间：2025年03月21日 08:15:00", "采样频率：12800Hz", "转速：1490 r/min",
         "时间(s)\t1通道 加速度(m/s2)", *lines("\t", cells(T), cells(A))],
        (1.0,),
        DATED,
    ),
    "Windows-1250": lambda: (
        "cp1250",
        ["Częstotliwość próbkowania: 12800 Hz", "Przyspieszenie [m/s2]\tPrędkość [mm/s]",
         *lines("\t", cells(A, **COMMA), cells(B, **COMMA))],
        (1.0,),
        None,
    ),
    "a rate in kHz with a comma beside coarse stamps": lambda: (
        "cp1252",
        ["Machine : Ventilateur n°2", "Fréquence d'échantillonnage : 12,8 kHz", "Horodatage;Palier 1 (m/s²)",
         *lines(";", stamps("%d/%m/%Y %H:%M:%S,FFF"), cells(A, **COMMA))],
        (1.0,),
        DATED,
    ),
    "keys behind a key": lambda: (
        "utf-8",
        ["# Time: 2025-03-21 08:15:00.333682, Device: D4E9", "# Config: data_rate = 12800.0 Hz, filter = 488 Hz",
         "count,a_x [g]", *lines(",", NUMBERS, cells(A))],
        (GRAVITY,),
        DATED,
    ),
    "the size of a count behind words": lambda: (
        "utf-8",
        ["# sensor: ADXL345 full resolution, 3.9 mg/LSB", "# ODR: 12800 Hz", "x", *cells(np.round(1e4 * A), "{:.0f}")],
        (39.0 * GRAVITY,),
        None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", LAYOUTS)
def test_what_a_text_states_is_read(kind: str, tmp_path: Path) -> None:
    encoding, text, level, start = LAYOUTS[kind]()
    expect(read(tmp_path, text, encoding), *level, start=start)


REFUSED: dict[str, tuple[list[str], str]] = {
    "a signal that ends before another": (
        ["Time [s];A [g];B [g]", *lines(";", cells(T), cells(A), [*cells(B[: COUNT // 2]), *[""] * (COUNT // 2)])],
        "expected a number, found ''",
    ),
    "a spectrum with a gap": (
        ["Time [s];A [g];Frequency [Hz];FFT",
         *lines(";", cells(T), cells(A), [*SPECTRUM[:9], *[""] * (COUNT - 18), *SPECTRUM[:9]],
                [*AMPLITUDES[:9], *[""] * (COUNT - 18), *AMPLITUDES[:9]])],
        "expected a number",
    ),
    "words among the rows": (
        ["Time [s],A [g]", "0,0.5", "1,0.4", "", "overflow", *lines(",", cells(T), cells(A))],
        "found",
    ),
    "a last line that is none of words": (["Time [s],A [g]", *lines(",", cells(T), cells(A)), "", "12"], "columns"),
    "a rate below the numbers that contradicts": (
        ["Sample rate: 12800 Hz", "A [g]", *cells(A), "", "Sample rate: 25600 Hz"], "several sampling rates",
    ),
    "the size of a count beside values": (
        ["# sensor: ADXL345, 3.9 mg/LSB", "# ODR: 12800 Hz", "x", *cells(A)], "unit is missing",
    ),
    "two sizes of a count": (
        ["# 16 g: 3.9 mg/LSB, 8 g: 1.95 mg/LSB", "# ODR: 12800 Hz", "x", *cells(np.round(1e4 * A), "{:.0f}")],
        "unit is missing",
    ),
    "a rate that the stamps contradict": (
        ["Fréquence d'échantillonnage : 25,6 kHz", "Horodatage;A (m/s²)",
         *lines(";", stamps("%d.%m.%Y %H:%M:%S,FFF"), cells(A, **COMMA))], "several sampling rates",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_open_or_broken_is_not_read(kind: str, tmp_path: Path) -> None:
    text, words = REFUSED[kind]
    with pytest.raises(sw.SpallwatchError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize("word", ["m/s²", "Gerüst °C", "Fréquence²]"])
def test_western_signs_are_not_taken_for_chinese(word: str, tmp_path: Path) -> None:
    text = ["Abtastrate: 12800 Hz", f"Ort: {word}", "Beschl. [m/s²]", *cells(A)]
    signal = read(tmp_path, text, "cp1252")
    expect(signal, 1.0)
    assert [str(name) for name in signal.channel.values] == ["Beschl."]


def test_a_segment_of_labview_is_dated_with_a_decimal_comma(tmp_path: Path) -> None:
    text = [
        "LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t,", "X_Columns\tOne", "***End_of_Header***\t",
        "Channels\t1", f"Samples\t{COUNT}", "Date\t2025/03/21", "Time\t08:15:00,2500000000000000",
        "Y_Unit_Label\tm/s^2", "X_Dimension\tTime", f"Delta_X\t{1 / RATE:.9f}".replace(".", ","),
        "***End_of_Header***\t", "X_Value\tBeschleunigung\tComment", *ROWS,
    ]  # fmt: skip
    expect(read(tmp_path, text, name="x.lvm"), 1.0, start=f"{DATED}.25")


FULL_SCALES = {
    "of each": (["Channel A full scale: 196 m/s2 pk", "Channel B full scale: 98 m/s2 pk"], (196.0, 0.6 * 98.0)),
    "of all": (["Full scale: 20 g"], (20.0 * GRAVITY, 12.0 * GRAVITY)),
}


def wav(folder: Path, note: Sequence[str]) -> Path:
    soundfile.write(folder / "x.wav", np.stack([A, B], axis=1) / 8.0, int(RATE), subtype="PCM_24")
    (folder / "x.txt").write_text("\n".join([*note, "Recorded: 2025-03-21 08:15:00"]))
    return folder / "x.wav"


@pytest.mark.parametrize("kind", FULL_SCALES)
def test_full_scale_of_sound_is_read_from_the_text_beside(kind: str, tmp_path: Path) -> None:
    note, level = FULL_SCALES[kind]
    expect(sw.read(wav(tmp_path, note)), *(value / 8.0 for value in level), start=DATED)


@pytest.mark.parametrize(
    "note",
    [["Channel A full scale: 196 m/s2"], ["Full scale: 10 V"], ["Full scale: 20 g RMS"], ["Range: 20 g"]],
)
def test_full_scale_that_is_open_is_asked(note: list[str], tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match=r"unit is missing|no unit|full scale"):
        sw.read(wav(tmp_path, note))


def test_full_scale_beside_another_configured_one_is_refused(tmp_path: Path) -> None:
    with pytest.raises(sw.SpallwatchError, match="20 g at full scale by the recording, 50 by range_g"):
        sw.read(wav(tmp_path, ["Full scale: 20 g"]), unit="g", range_g=50.0)


def signal_of(row: np.ndarray, label: str, factor: float = 1.0, step: float = 1.0 / RATE, time: str = "s") -> Any:
    quantity = {"label": label, "unit_transformation": {"factor": factor, "offset": 0.0}}
    return {
        "x_values": {"start_value": 0.0, "increment": step, "quantity": {"label": time}},
        "y_values": {"values": row[:, None], "quantity": quantity},
    }


@pytest.mark.parametrize(("time", "step"), [("s", 1.0 / RATE), ("ms", 1e3 / RATE)])
def test_axes_of_a_structure_state_rate_and_unit(time: str, step: float, tmp_path: Path) -> None:
    signals = {"S_0": signal_of(A, "m/s^2", step=step, time=time), "S_1": signal_of(B, "g", step=step, time=time)}
    scipy.io.savemat(tmp_path / "x.mat", signals)
    expect(sw.read(tmp_path / "x.mat"), 1.0, 0.6 * GRAVITY)


def test_a_unit_with_a_factor_beside_it_is_asked(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"S_0": signal_of(A, "g", factor=GRAVITY)})
    with pytest.raises(sw.SpallwatchError, match="unit"):
        sw.read(tmp_path / "x.mat")


def test_steps_of_two_structures_are_compared(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"S_0": signal_of(A, "g"), "S_1": signal_of(B, "g", step=1e-4)})
    with pytest.raises(sw.SpallwatchError, match="several sampling rates"):
        sw.read(tmp_path / "x.mat")


@pytest.mark.parametrize(
    ("names", "starts"),
    [
        (["Rec 01-45 PM", "Rec 11-45 AM", "Rec 12-45 PM"], ["11:45", "12:45", "13:45"]),
        (["12.15AM", "12.15PM", "03.15AM"], ["00:15", "03:15", "12:15"]),
        (["pump_08-15-30 pm", "pump_08-15-30 am"], ["08:15:30", "20:15:30"]),
    ],
)
def test_files_below_a_day_are_in_the_order_of_their_times(names: list[str], starts: list[str], tmp_path: Path) -> None:
    folder = tmp_path / "21.03.2025"
    folder.mkdir()
    for number, name in enumerate(names, start=1):
        rows = lines(",", cells(T, "{:.8f}"), cells(number * A))
        (folder / f"{name}.csv").write_text("\n".join(["t [s],a [m/s2]", *rows, ""]))
    blocks = list(sw.blocks(tmp_path, block_s="file"))
    assert [block.attrs["start_utc"][:16] for block in blocks] == [f"2025-03-21T{start[:5]}" for start in starts]
