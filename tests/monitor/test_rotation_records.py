"""What records, kept spectra and words say of the rotation of the shaft in a block."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.commands.replay import summary_lines
from monitor.config.load import load_config
from monitor.health.channel import step
from monitor.health.later_stages import ChannelBlock
from monitor.health.output import ChannelOutput
from monitor.health.record import Record
from monitor.health.record_values import record_values, rotation_values, spectrum_row
from monitor.health.schema import DOMAINS, ROTATION_STATUSES
from monitor.health.signal.condition import Quantity
from monitor.health.signal.quality import Verdict, rejected
from monitor.health.signal.rotation.rotation import PulseCounts, Rotation
from monitor.health.signal.rotation.shaft_angle import FoundRotation
from monitor.health.signal.spectra import BlockView, RawSpectra
from monitor.health.signal.waterfall import SpectrumChange
from monitor.health.state import ChannelState
from monitor.records.dataset import from_dataset, to_dataset
from monitor.records.queries import StoredRecord
from monitor.records.spectra import read_block_view, read_ias, read_spectra
from monitor.records.store import Store
from monitor.report.figures.spectrum import SpectrumView
from monitor.service.neighbours.points import channel_values
from monitor.service.replay import replay
from monitor.words.statuses import DOMAINS as DOMAIN_WORDS
from monitor.words.statuses import ROTATION_REFUSALS, speed_words
from streams.types.block import Block
from tests.support import varying_speed
from tests.support.pipeline import base
from tests.support.velocity_signals import RATE

NEW = (
    *("speed_min", "speed_max", "acceleration", "revolutions", "rotation_status"),
    *("pulses_missing", "pulses_extra", "encoder_error", "level_rms", "level_status"),
)
SAMPLES = np.random.default_rng(3).normal(size=int(RATE)).astype(np.float32)


NOTHING = FoundRotation()


def rotation() -> Rotation:
    """Return a shaft that speeds up from 20 to 30 Hz in a second."""
    time = np.array([0.0, 1.0])
    return Rotation(time, np.array([0.0, 25.0]), np.array([20.0, 30.0]), 1.0)


def output_of(found: FoundRotation = NOTHING, verdict: Verdict | None = None) -> tuple[ChannelState, ChannelOutput]:
    block = ChannelBlock(SAMPLES, RATE, 1, 0.0, verdict or Verdict(), Quantity(25.0, "block", 0.0), found=found)
    return step(ChannelState(), block, base())


def values_of(found: FoundRotation = NOTHING, verdict: Verdict | None = None) -> dict[str, Any]:
    state, output = output_of(found, verdict)
    return record_values(state.detect, output)


def test_the_record_has_the_speeds_of_the_block_and_what_was_repaired() -> None:
    values = values_of(FoundRotation(rotation(), "ok", PulseCounts(3, 1, math.radians(0.1))))
    assert (values["speed_min"], values["speed_max"]) == (20.0, 30.0)
    assert values["acceleration"] == pytest.approx(10.0)
    assert values["revolutions"] == pytest.approx(25.0)
    assert (values["rotation_status"], values["pulses_missing"], values["pulses_extra"]) == ("ok", 3, 1)
    assert values["encoder_error"] == pytest.approx(math.radians(0.1))
    assert values["domain"] in DOMAINS


def test_a_machine_without_an_angle_has_none_of_it() -> None:
    values = values_of()
    assert values["domain"] == "hertz"
    assert not set(NEW) & set(values)


def test_a_speed_beyond_what_is_warped_says_so() -> None:
    wide = Rotation(np.array([0.0, 1.0]), np.array([0.0, 25.0]), np.array([5.0, 45.0]), 1.0)
    assert rotation_values(FoundRotation(wide, "ok"), warped=False)["rotation_status"] == "too_wide"
    assert rotation_values(FoundRotation(wide, "ok"))["rotation_status"] == "ok"
    assert rotation_values(FoundRotation(rotation(), "ok"), warped=False)["rotation_status"] == "ok"


@pytest.mark.parametrize("status", ROTATION_STATUSES[1:])
def test_a_block_without_an_angle_says_why_and_gives_no_speeds(status: str) -> None:
    values = values_of(FoundRotation(None, status, PulseCounts()))
    assert values["rotation_status"] == status
    assert not {"speed_min", "speed_max", "acceleration", "revolutions"} & set(values)
    assert values["encoder_error"] is None
    words = speed_words(status, values["domain"], None, None)
    assert words == f"no angle of the shaft: {ROTATION_REFUSALS[status]}; spectra in Hz"


def test_a_rejected_channel_keeps_the_status_of_its_angle() -> None:
    values = values_of(FoundRotation(None, "irregular"), rejected("nan", "not finite"))
    assert values["rotation_status"] == "irregular"
    assert "domain" not in values


def test_each_status_and_domain_has_its_words() -> None:
    assert tuple(ROTATION_REFUSALS) == ROTATION_STATUSES[1:]
    assert tuple(DOMAIN_WORDS) == DOMAINS
    said = speed_words("ok", "order", 22.12, 27.93)
    assert said == "speed from 22.1 to 27.9 Hz in this block; spectra in orders of the shaft"
    assert speed_words("ok", "hertz", 25.0, 25.001) == "speed 25 Hz in this block; spectra in Hz"
    assert speed_words(None, None, 25.0, 25.0) is None


def test_the_kept_spectrum_comes_back_with_its_speeds(tmp_path: Path) -> None:
    _, output = output_of(FoundRotation(rotation(), "ok"))
    block = Block(SAMPLES[None, :], RATE, ("x",), ("m/s2",), "s", 1, "b1")
    row = spectrum_row(block, output)
    assert row is not None
    assert row.speed_course is not None
    assert row.speed_course[0] == 20.0
    assert row.speed_course[-1] == 30.0
    assert row.order[-1] == pytest.approx(row.frequency[-1] / 25.0)
    with Store.open(tmp_path / "state.db", machine="m") as store:
        store.commit_many([(Record("s", 1, "b1", "h"), {})], spectra=[SpectrumChange(row, "kept")])
        (read,) = read_spectra(store, "one")
    assert (read.domain, read.speed_range, read.speed_course) == (row.domain, (20.0, 30.0), row.speed_course)


def test_the_spectrum_of_the_angular_speed_is_kept_for_the_source(tmp_path: Path) -> None:
    _, output = output_of(FoundRotation(rotation(), "ok"))
    block = Block(SAMPLES[None, :], RATE, ("x",), ("m/s2",), "s", 1, "b1")
    row = spectrum_row(block, output)
    assert row is not None
    raw = RawSpectra(1.0, np.arange(50.0), 4.0, np.arange(20.0))
    ias = RawSpectra(0.04, np.linspace(0.0, 2.0, 300), 0.1, np.linspace(0.0, 3.0, 200))
    rows = [
        replace(row, sequence=number, view=BlockView(RATE, 64, raw, SAMPLES[:64], kept))
        for number, kept in ((1, ias), (2, None))
    ]
    with Store.open(tmp_path / "state.db", machine="m") as store:
        records = [(Record("s", one.sequence, "b", "h"), {}) for one in rows]
        store.commit_many(records, spectra=[SpectrumChange(one, "kept") for one in rows])
        found, none = read_ias(store, "s"), read_ias(store, "other")
        assert read_ias(store, "s", until=0) is None
        without = read_block_view(store, "one")
    assert found is not None
    assert found.view is not None
    assert found.view.ias is not None
    assert found.sequence == 1
    assert none is None
    np.testing.assert_allclose(found.view.ias.amplitude, ias.amplitude, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(found.view.ias.highest, ias.highest, rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(found.view.waveform, SAMPLES[:64], atol=1e-3)
    assert without is not None
    assert without.view is not None
    assert without.view.ias is None


def test_published_files_give_the_values_back(tmp_path: Path) -> None:
    values = {"rms": 1.0, "stage": "healthy", "domain": "order", "rotation_status": "ok", "speed_min": 22.0}
    values |= {"speed_max": 28.0, "acceleration": -0.5, "revolutions": 25.0, "pulses_missing": 2, "pulses_extra": 0}
    values |= {"encoder_error": 1e-3, "level_rms": 1.1}
    old = {"rms": 1.0, "stage": "healthy"}
    with Store.open(tmp_path / "state.db", machine="m") as store:
        records = [
            Record("s", place, "b", "h", elapsed=float(place), channels={"x": given})
            for place, given in enumerate((old, values), 1)
        ]
        store.commit_many([(record, {}) for record in records])
        dataset = to_dataset(store.stored(), dated=False, attributes={})
    before, after = (row.to_record().channels["x"] for row in from_dataset(dataset))
    assert {name: after[name] for name in values} == values
    assert all(before[name] is None for name in set(values) - set(old))
    assert dataset["encoder_error"].attrs["units"] == "rad"


def test_messages_have_units_in_their_names() -> None:
    channels = {"x": {"encoder_error": math.radians(0.1), "acceleration": 2.0, "speed_min": 22.0, "domain": "order"}}
    message = channel_values(StoredRecord("m", "s", 1, "ok", "", "", None, 0.0, channels), "x")
    assert message["encoder_error_deg"] == pytest.approx(0.1)
    assert (message["acceleration_hz_per_s"], message["speed_min_hz"], message["domain"]) == (2.0, 22.0, "order")
    assert message["rotation_status"] is None


def test_the_report_of_a_replay_has_its_own_spectrum_over_orders(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    np.save(tmp_path / "in" / "b0001.npy", varying_speed.block(110))
    text = varying_speed.TEXT.format(
        folder=tmp_path, rate=varying_speed.RATE, begin="2026-03-02T06:00:00Z", interval=60.0, pulses=8,
        designation=varying_speed.DESIGNATION,
    )  # fmt: skip
    (tmp_path / "winch.toml").write_text(text)
    found = replay(load_config(tmp_path / "winch.toml"), None, tmp_path / "out")
    drawn: tuple[Any, ...] = found.spectra["radial"]
    view = SpectrumView(*drawn)
    assert (view.domain, view.unit, view.label) == ("order", "g", "block 1")
    highest = view.frequency_hz[np.argmax(view.amplitude_g)]
    assert highest == pytest.approx(view.fundamentals_hz["outer"], rel=2e-3)
    channel = found.summary["channels"]["radial"]
    assert (channel["domain"], channel["rotation_status"], channel["pulses_missing"]) == ("order", "ok", 0)
    assert "spectra in orders of the shaft" in "\n".join(summary_lines(found.summary))
