"""Reports of maps and scenes: what is drawn, what is said, and what is refused."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from models.machine.bearing import from_catalogue, kinematics
from models.machine.hertz import element_angles
from models.machine.scene import Defect, Floor, Scene, Slip
from models.maps.build import build_map
from models.maps.data import RmsMap
from models.maps.file import save_map
from models.maps.plan import MAP_ACCURACY, MapPlan
from models.path.defect import ball_path
from models.solve.simulate import simulate
from monitor.cli import main
from monitor.commands.maps import command as map_command
from monitor.commands.simulate.command import command as simulate_command
from monitor.report.figures.rms_map import cut_nodes, map_sheet, node_errors, node_miss
from monitor.report.figures.scene import SensorSignal, passages, resonances, scene_sheet, signal_of, ways
from monitor.report.figures.sheet import write_sheet
from reference.periods import period_of
from streams.types.block import STANDARD_GRAVITY
from tests.support.effort import effort_count

pytestmark = pytest.mark.usefixtures("plain_layout")

BEARING = from_catalogue("1205 ETN9")


def small_map(**changes: object) -> RmsMap:
    plan = MapPlan(
        load=(3000.0, 4000.0),
        speed=(40.0,),
        h_d=tuple(np.linspace(0.0, 20e-6, 5).tolist()),
        dphi_d=tuple(np.radians([0.0, 2.0, 3.0, 5.0, 9.0, 10.0]).tolist()),
        floor=Floor("rough"),
        floors=2,
        bearing=BEARING,
    )
    return build_map(replace(plan, **changes))  # pyright: ignore[reportArgumentType]


@pytest.fixture(scope="module")
def rms_map() -> RmsMap:
    return small_map()


def scene_with(defect: Defect | None = None, **changes: object) -> Scene:
    return replace(Scene(30.0, 2000.0, defect=defect), **changes)  # pyright: ignore[reportArgumentType]


PIT = Defect(math.radians(4.236), 500e-6)


@given(
    coefficients=st.lists(st.floats(-10, 10), min_size=4, max_size=4),
    steps=st.lists(st.floats(0.1, 3.0), min_size=2, max_size=8),
)
def test_bilinear_surfaces_miss_no_node(coefficients: list[float], steps: list[float]) -> None:
    x, y = np.cumsum(steps), np.cumsum(steps[::-1])
    a, b, c, d = coefficients
    surface = a + b * x[None, :] + c * y[:, None] + d * x[None, :] * y[:, None]
    scale = 1.0 + np.abs(surface).max()
    assert node_miss(surface, x, 1).max() <= 1e-12 * scale
    assert node_miss(surface, y, 0).max() <= 1e-12 * scale


def test_a_parabola_misses_its_nodes_by_half_the_curvature() -> None:
    x = np.linspace(0.0, 3.0, 7)
    found = node_miss(np.vstack([x**2, -(x**2)]), x, 1)
    assert found[:, 1:-1] == pytest.approx(np.full((2, 5), 0.25))
    assert not found[:, [0, -1]].any()


@pytest.mark.parametrize(("size", "nodes"), [(2, [1]), (3, [1, 2]), (5, [1, 2, 3, 4]), (33, [8, 16, 24, 32])])
def test_cuts_are_spread_and_end_with_the_axis(size: int, nodes: list[int]) -> None:
    assert cut_nodes(size) == nodes


def test_a_map_report_draws_the_values_of_the_map(rms_map: RmsMap) -> None:
    sheet = map_sheet(rms_map)
    levels, cuts, trust = sheet.parts
    assert [part.name for part in sheet.parts] == ["levels", "cuts", "doubts"]
    assert levels.data["load_newton"] == [3000.0, 4000.0]
    assert levels.data["rms_most_g"] == pytest.approx(rms_map.rms.max(axis=(1, 2, 3)) / STANDARD_GRAVITY)
    assert levels.data["falls_with_depth"] == np.count_nonzero(rms_map.falling("h_d"), axis=(1, 2, 3)).tolist()
    assert cuts.data["rms_at_20_um_g"] == pytest.approx(rms_map.rms[0, 0, -1] / STANDARD_GRAVITY)
    assert cuts.data["rms_at_10_deg_g"] == pytest.approx(rms_map.rms[0, 0, :, -1] / STANDARD_GRAVITY)
    kinds = {error.name: error.percent for error in node_errors(rms_map.slice_at(3000.0, 40.0))}
    assert set(kinds) == {"nodes", "numerical", "floors"}
    # The steps' error is asked for, and settling adds a hundredth of it.
    assert np.nanmax(kinds["numerical"]) <= 101.0 * MAP_ACCURACY
    assert trust.data["floors_most_percent"] == pytest.approx(np.nanmax(kinds["floors"]))
    assert kinds["nodes"].max() > 1.0
    assert "not calibrated" in sheet.lead
    facts = dict(sheet.facts)
    assert facts["Floor"] == "rough, 1.00 µm, mean of 2 floors, from seed 0"
    assert facts["Between nodes"].startswith("wrong by")
    assert facts["Hash"] == rms_map.hash[:16]


def test_many_conditions_are_cut_short_and_a_line_of_nodes_has_levels_only() -> None:
    many = small_map(load=tuple(np.linspace(3000.0, 4200.0, 13).tolist()), h_d=(0.0, 1e-5), dphi_d=(0.0, 0.1), floors=1)
    levels = map_sheet(many).parts[0]
    assert len(levels.data["load_newton"]) == 12
    assert "1 more conditions are not shown" in levels.caption


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"h_d": (1e-5,)}, "10 µm deep"),
        ({"dphi_d": (0.1,)}, "5.73° wide"),
        ({"h_d": (0.0,), "dphi_d": (0.0,)}, "0 µm deep"),
    ],
)
def test_maps_of_one_depth_or_extent_are_lines(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    thin = small_map(**changes)
    [part] = map_sheet(thin).parts
    assert words in part.caption
    assert part.data["rms_at_3000_newton_40_hz_g"] == pytest.approx(thin.rms[0].ravel() / STANDARD_GRAVITY)
    write_sheet(map_sheet(thin), tmp_path / "map.png")


def test_holes_in_a_map_are_left_out(rms_map: RmsMap, tmp_path: Path) -> None:
    holes, nothing = rms_map.rms.copy(), np.full_like(rms_map.rms, np.nan)
    holes[0, 0, 2, 3] = np.nan
    write_sheet(map_sheet(replace(rms_map, rms=holes)), tmp_path / "holes.html")
    # A picture in base64 may hold the letters.
    assert "NaN" not in re.sub(r"base64,[^\"]*", "", (tmp_path / "holes.html").read_text(encoding="utf-8"))
    assert map_sheet(replace(rms_map, rms=holes)).parts[0].data["rms_most_g"][1] == pytest.approx(
        rms_map.rms[1].max() / STANDARD_GRAVITY
    )
    empty = map_sheet(replace(rms_map, rms=nothing))
    assert empty.lead.startswith("No simulation ended well")
    write_sheet(map_sheet(replace(rms_map, rms=nothing)), tmp_path / "nothing.html")
    write_sheet(map_sheet(replace(rms_map, rms=np.zeros_like(nothing))), tmp_path / "silent.svg")


def test_names_with_html_in_them_do_no_harm(tmp_path: Path) -> None:
    wild = small_map(bearing=replace(BEARING, designation="<script>alert(1)</script>&"), load=(3000.0,), floors=1)
    write_sheet(map_sheet(wild), tmp_path / "map.html")
    text = (tmp_path / "map.html").read_text(encoding="utf-8")
    assert "<script" not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;&amp;" in text


@pytest.mark.usefixtures("arranged_layout")
@pytest.mark.parametrize("ending", [".PNG", ".html", ".svg", ".png"][: effort_count(quick=2, full=4)])
def test_a_map_is_shown_as_picture_or_page(tmp_path: Path, rms_map: RmsMap, ending: str) -> None:
    save_map(rms_map, tmp_path / "map.nc")
    out = tmp_path / f"map{ending}"
    result = CliRunner().invoke(map_command, ["show", str(tmp_path / "map.nc"), "--out", str(out)])
    assert result.exit_code == 0, result.output
    content = out.read_bytes()
    if ending.lower() == ".png":
        assert content.startswith(b"\x89PNG")
        return
    text = content.decode()
    for words in ("RMS over extent and depth", "Cuts through the map", "How far to trust it", "falls with depth"):
        assert words in text
    if ending == ".html":
        # Nothing is fetched: addresses stand in names of name spaces only.
        assert not re.search(r'(?:src|href)="(?!#|data:)', text)
        values = re.search(r'data-name="levels" data-values="([^"]*)"', text)
        assert values is not None
        assert json.loads(values[1].replace("&#34;", '"'))["load_newton"] == [3000.0, 4000.0]


@pytest.mark.parametrize("name", ["map.pdf", "map", "map.svgz"])
def test_other_endings_are_refused_before_anything_is_read(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (
        ["map", "show", str(tmp_path / "missing.nc"), "--out", str(tmp_path / name)],
        ["simulate", "--dphi-deg", "4", "--h-d-um", "20", "--plot", str(tmp_path / name)],
    ):
        monkeypatch.setattr("sys.argv", ["spallwatch", *arguments])
        with pytest.raises(SystemExit) as caught:
            main()
        assert caught.value.code == 2
        message = capsys.readouterr().err
        assert name in message
        assert "expected a name that ends in .png, .svg or .html" in message
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", ["png", "html"])
def test_a_place_that_cannot_be_written_is_said(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / f"scene.{ending}"
    monkeypatch.setattr("sys.argv", ["spallwatch", "simulate", "--plot", str(out)])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert "--plot" in capsys.readouterr().err


@pytest.mark.parametrize("position", [0.0, 0.1, -0.4])
@pytest.mark.parametrize("rows", [1, 2])
@pytest.mark.parametrize("extent", [2.0, 20.0, 40.0])
def test_passages_are_when_a_ball_is_over_the_defect(position: float, rows: int, extent: float) -> None:
    scene = scene_with(Defect(math.radians(extent), 1e-5, position=position, rows=rows))
    assert scene.defect is not None
    path, ftf = ball_path(BEARING, scene.defect), kinematics(BEARING, scene.speed).ftf
    assert path is not None
    marked = passages(scene, 0.05)
    for t in np.random.default_rng(0).uniform(0.0, 0.05, effort_count(quick=60, full=1000)):
        angles = element_angles(BEARING, 2.0 * math.pi * ftf * t)[: rows * BEARING.n_elements]
        sunk = bool(
            np.any(path(np.remainder(angles - position + math.pi, 2.0 * math.pi) - math.pi + position)[0] > 0.0)
        )
        assert sunk == any(begin < t < end for begin, end in marked)


def test_passages_are_those_of_the_simulation() -> None:
    scene = scene_with(PIT)
    period, omega = period_of(scene), 2.0 * math.pi * kinematics(BEARING, scene.speed).ftf
    nodes = period.nodes
    middles = np.arctan2(nodes.turn[:, 1, 1], nodes.turn[:, 1, 0]) / omega
    sunk = np.any(nodes.depth[:, 1] > 0.0, axis=1)
    marked = passages(scene, float(period.time[-1]))
    assert sunk.any()
    assert not sunk.all()
    assert sunk.tolist() == [any(begin < t < end for begin, end in marked) for t in middles]


def test_what_does_not_repeat_has_no_marks() -> None:
    assert passages(scene_with(None), 0.1) == []
    assert passages(scene_with(PIT, slip=Slip(0.01)), 0.1) == []
    assert passages(scene_with(replace(PIT, part="inner")), 0.1) == []


def test_resonances_are_near_the_printed_ones() -> None:
    assert resonances(scene_with()) == pytest.approx([357.1, 1543.8, 7392.6], rel=5e-3)


def test_ways_by_part_and_floor() -> None:
    local = ways(scene_with(PIT), PIT)
    assert list(local) == ["way of the ball"]
    path = ball_path(BEARING, PIT)
    assert path is not None
    assert local["way of the ball"][1].max() == pytest.approx(1e6 * path(np.zeros(1))[0][0], rel=1e-6)
    rough = Defect(math.radians(20.0), 20e-6, Floor("rough"))
    assert list(ways(scene_with(rough), rough)) == ["rough floor", "smooth floor"]
    spot = replace(PIT, part="ball")
    both = ways(scene_with(spot), spot)
    assert list(both) == ["outer race", "inner race"]
    # A ball's flat leaves it nearer to the outer race, which bends the same way, than to the inner one.
    assert both["outer race"][1].max() < both["inner race"][1].max()


@pytest.mark.parametrize(("defect", "words"), [(PIT, "does not reach"), (Defect(0.35, 2e-5), "touches")])
def test_a_scene_report_says_what_the_model_gives(defect: Defect, words: str) -> None:
    scene = scene_with(defect)
    response = simulate(scene)
    sheet = scene_sheet(scene, signal_of(response, "mo", response.bpfo), sensor="mo", title="a scene")
    signal, way, spectrum = sheet.parts
    assert f"{response.rms / STANDARD_GRAVITY:.2g}"[:3] in sheet.lead
    assert "converged" in sheet.lead
    assert words in way.caption
    values = np.array(signal.data["acceleration_g"])
    assert np.sqrt(np.mean(values**2)) == pytest.approx(response.rms / STANDARD_GRAVITY, rel=2e-2)
    assert len(signal.data["passage_begin_ms"]) == len(signal.data["passage_end_ms"]) == 5
    strongest = int(np.argmax(spectrum.data["amplitude_g"]))
    frequency, amplitude = response.lines()
    assert spectrum.data["frequency_hz"][strongest] == pytest.approx(frequency[np.argmax(amplitude)])
    assert spectrum.data["amplitude_g"][strongest] == pytest.approx(amplitude.max() / STANDARD_GRAVITY)


def test_a_band_of_the_rms_is_said() -> None:
    scene = scene_with(PIT)
    response = simulate(scene, band=(0.0, 9500.0))
    sensed = signal_of(response, "mo", response.bpfo)
    assert "in 0 to 9500 Hz" in scene_sheet(scene, sensed, sensor="mo", title="a scene").lead


def test_a_silent_scene_has_a_report() -> None:
    none = np.zeros(8)
    silent = SensorSignal(np.arange(8.0), none, np.arange(1.0, 9.0), none, True, 0.0, "converged", "six_dof")
    sheet = scene_sheet(scene_with(), silent, sensor="mr", title="healthy")
    assert [part.name for part in sheet.parts] == ["signal", "spectrum"]
    assert sheet.lead == "RMS 0 g over full bandwidth on the resonator (converged)."


@pytest.mark.parametrize("options", [["--fault", "inner"], ["--slip-deg", "0.5"], ["--fault", "ball"]])
def test_a_motion_that_does_not_repeat_is_drawn(tmp_path: Path, options: list[str]) -> None:
    out = tmp_path / "scene.svg"
    arguments = ["--dphi-deg", "4", "--h-d-um", "500", "--duration-s", "0.2", *options, "--plot", str(out)]
    result = CliRunner().invoke(simulate_command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    text = out.read_text(encoding="utf-8")
    assert "about the loudest moment" in text
    assert "Hann window" in text


@pytest.mark.usefixtures("arranged_layout")
def test_a_sensor_across_the_load_is_drawn_over_a_ball_period(tmp_path: Path) -> None:
    out = tmp_path / "scene.svg"
    arguments = ["--dphi-deg", "4", "--h-d-um", "500", "--gravity", "--direction-deg", "90", "--plot", str(out)]
    result = CliRunner().invoke(simulate_command, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    assert "converged" in result.output
    assert "about the loudest moment" not in out.read_text(encoding="utf-8")
