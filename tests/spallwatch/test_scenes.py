"""Scenes, maps and figures."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import spallwatch as sw


@pytest.fixture(scope="module")
def damaged():
    scene = sw.scene(dphi_deg=8.0, h_d_um=20.0)
    return scene, sw.simulate(scene)


@pytest.fixture(scope="module")
def rms_map():
    return sw.build_map(
        load_newton=4000.0, speed_hz=40.0, dphi_deg=[0, 4, 8], h_d_um=[0, 10, 20], interpolation_tolerance=0.0
    )


def test_the_default_scene_is_the_bench_of_the_thesis():
    scene = sw.scene()
    assert (scene.bearing.designation, scene.speed, scene.load, scene.defect) == ("1205 ETN9", 40.0, 4000.0, None)


def test_a_simulated_signal_has_the_level_and_the_lines_of_its_scene(damaged):
    scene, response = damaged
    signal = sw.acceleration(response, rate_hz=102400.0, duration_s=1.0)
    assert float(np.sqrt(np.mean(signal.values**2))) == pytest.approx(response.rms, rel=0.02)
    found = sw.name_fault(signal, bearing=scene.bearing, speed_hz=scene.speed, speed_exact=True)
    assert found.fault == "outer"


def test_a_map_has_the_level_of_a_scene_at_a_node(damaged, rms_map):
    found = sw.map_dataset(rms_map)
    at = found.sel(dphi_d=np.radians(8.0), h_d=20e-6, method="nearest")
    assert at.rms.item() == pytest.approx(damaged[1].rms, rel=0.01)
    assert at.v_eq.item() == pytest.approx(rms_map.part_radius * np.radians(8.0) * 20e-6)
    assert found.rms.dims == ("load", "speed", "h_d", "dphi_d")


def test_a_map_is_read_as_it_was_written(tmp_path, rms_map):
    sw.save_map(rms_map, tmp_path / "map.nc")
    again = sw.open_map(tmp_path / "map.nc")
    assert again.hash == rms_map.hash
    np.testing.assert_array_equal(again.rms, rms_map.rms)


@pytest.mark.parametrize(
    "wrong",
    [{"bearing": "none such"}, {"speed_hz": -40.0}, {"load_newton": -1.0}],
)
def test_wrong_values_are_refused(wrong):
    with pytest.raises(sw.SpallwatchError, match=next(iter(wrong)).split("_", maxsplit=1)[0]):
        sw.scene(**wrong)


def test_figures_are_returned(damaged, rms_map, tmp_path):
    scene, response = damaged
    signal = sw.acceleration(response)
    lines = sw.fault_frequencies(scene.bearing, scene.speed)
    spectrum = sw.envelope_spectrum(signal, (2000.0, 8000.0))
    figures = [
        sw.plot_signal(signal),
        sw.plot_spectrum(spectrum, lines),
        sw.plot_spectrum(sw.spectrum(signal), log=True),
        sw.plot_scene(scene, response),
        sw.plot_map(rms_map),
    ]
    for number, figure in enumerate(figures):
        assert isinstance(figure, Figure)
        figure.savefig(tmp_path / f"{number}.png")
    marked = figures[1].axes[0].get_legend_handles_labels()[1]
    assert marked == ["outer race", "inner race", "rolling element", "cage"]


def test_a_figure_of_records_refuses_words(tmp_path):
    np.save(tmp_path / "x.npy", np.random.default_rng(4).standard_normal(12000))
    records = sw.replay(tmp_path / "x.npy", bearing="6205", speed_hz=10.0, rate_hz=4000.0, unit="g", block_s=1.0)
    assert len(sw.plot_records(records, ["rms", "kurtosis"]).axes) == 2
    assert (records.domain.values == "hertz").all()
    assert not sw.plot_records(records, ["speed"]).axes[0].collections
    ranges = {name: records.speed + part for name, part in (("speed_min", -2.0), ("speed_max", 2.0))}
    assert len(sw.plot_records(records.assign(ranges), ["speed"]).axes[0].collections) == 1
    with pytest.raises(sw.SpallwatchError, match="stage"):
        sw.plot_records(records, ["stage"])
