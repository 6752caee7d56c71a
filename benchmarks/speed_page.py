"""The diagram and tables of docs/evidence/speed-against-error.md, from what benchmarks/integrators.py measured."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.common import REFERENCE_MS, Row, circumstances
from monitor.report.figures.drawing import GREY, STYLE

RESULTS = Path(__file__).resolve().parent / "results"
MATLAB = "rtol 1e-3, atol 1e-6"
DEFAULT_STEP = "10.0 us"
INGREDIENTS_STEP = "9.8 us"

# Colour (of a palette that the colour-blind can tell apart), marker and line of each method.
STYLES = {
    "this project's kernel": ("#000000", "o", "-"),
    "Lawson, kinks, one-sided, contacts": ("#d55e00", "s", "-"),
    "Lawson, kinks, one-sided": ("#e69f00", "D", "-"),
    "Lawson, steps on kinks": ("#e69f00", "D", ":"),
    "Lawson, equal steps": ("#d55e00", "s", ":"),
    "explicit RK4, kinks, one-sided": ("#0072b2", "^", "-"),
    "explicit RK4, equal steps": ("#0072b2", "^", ":"),
    "ETD-AB3, equal steps": ("#009e73", "v", ":"),
    "ETD-AB4, equal steps": ("#009e73", "P", "--"),
    "Dormand-Prince 5(4)": ("#cc79a7", "X", "-"),
    "solve_ivp RK23": ("#56b4e9", "1", "-"),
    "solve_ivp RK45": ("#56b4e9", "x", "--"),
    "solve_ivp DOP853": ("#56b4e9", "*", "-"),
    "solve_ivp LSODA": ("#5b6470", "+", "--"),
    "solve_ivp BDF": ("#5b6470", "2", ":"),
    "solve_ivp Radau": ("#5b6470", "d", "-"),
}


def number(row: Row, key: str) -> float:
    """Return a figure of a row.

    Raises:
        ValueError: if it is not a number.
    """
    value = row[key]
    if isinstance(value, str) or value is None:
        raise ValueError(f"{key} of a row must be a number, got {value!r}")
    return float(value)


def of(rows: Sequence[Row], **wanted: str) -> list[Row]:
    """Return the rows that have all of these texts."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def names(rows: Sequence[Row], key: str) -> list[str]:
    """Return the texts under a key, each once, in their order."""
    return list(dict.fromkeys(str(row[key]) for row in rows))


def time_to_reach(rows: Sequence[Row], error: float) -> str:
    """Return the time from which on a method stays below a waveform error, ms, interpolated between its settings.

    Settings with MATLAB's tolerances lie on no line with the others and are left out.
    """
    line = sorted((number(r, "ms a second"), number(r, "waveform error")) for r in rows if r["setting"] != MATLAB)
    if not line or line[-1][1] > error:
        return "–"
    k = len(line) - 1
    while k > 0 and line[k - 1][1] <= error:
        k -= 1
    if k == 0:
        return f"≤ {_short(line[0][0])}"
    (t0, e0), (t1, e1) = line[k - 1], line[k]
    share = (math.log(e0) - math.log(error)) / (math.log(e0) - math.log(e1))
    return _short(math.exp(math.log(t0) + share * (math.log(t1) - math.log(t0))))


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else f"{value:.1f}"


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Return a table of texts, the first column to the left."""
    rule = [":---", *["---:"] * (len(head) - 1)]
    return "".join("| " + " | ".join(line) + " |\n" for line in [head, rule, *lines])


def reach_table(runs: Sequence[Row]) -> str:
    """Return the times that methods need for waveform errors of 1 % and 0.1 %."""
    scenes = names(runs, "scene")
    lines = []
    for method in STYLES:
        found = [of(runs, method=method, scene=scene) for scene in scenes]
        if any(found):
            lines.append([method, *(f"{time_to_reach(r, 1e-2)} / {time_to_reach(r, 1e-3)}" for r in found)])
    return markdown(["ms a second for 1 % / 0.1 %", *scenes], lines)


def errors_table(runs: Sequence[Row], wanted: Sequence[tuple[str, str]]) -> str:
    """Return time and errors of named methods and settings, one line each."""
    scenes = names(runs, "scene")
    lines = []
    for method, setting in wanted:
        cells, times = [], []
        for scene in scenes:
            for row in of(runs, method=method, setting=setting, scene=scene):
                cells.append(f"{number(row, 'RMS error'):+.1e} / {number(row, 'waveform error'):.1e}")
                times.append(number(row, "ms a second"))
        if times:
            lines.append([f"{method}; {setting}", _short(sorted(times)[len(times) // 2]), *cells])
    return markdown(["error of RMS / waveform", "ms", *scenes], lines)


def settled_table(settled: Sequence[Row]) -> str:
    """Return the errors of the RMS that simulate() gives, one line for each accuracy."""
    lines = []
    for accuracy in dict.fromkeys(number(row, "accuracy") for row in settled):
        found = [row for row in settled if row["accuracy"] == accuracy]
        lines.append([f"{accuracy:g}", *(f"{number(row, 'RMS error'):+.1e}" for row in found)])
    return markdown(["accuracy", *names(settled, "scene")], lines)


def reference_table(references: Sequence[Row]) -> str:
    """Return the references beside DOP853."""
    lines = [
        [
            str(row["scene"]),
            f"{number(row, 'RMS m/s2'):.5g}",
            f"{number(row, 'RMS against DOP853'):+.1e}",
            f"{number(row, 'waveform against DOP853'):.1e}",
        ]
        for row in references
    ]
    return markdown(["scene", "RMS, m/s²", "RMS against DOP853", "waveform against DOP853"], lines)


def speed_table() -> str:
    """Return what benchmarks.six_dof and benchmarks.lanes left in their files of results."""
    lines: list[list[str]] = []
    one, many = _results("six_dof"), _results("lanes")
    for row in one.get("integrated", []):
        what = f"one scene, an integrated second, accuracy {row['asked for']:g}"
        lines.append([what, "six_dof", f"{row['ms a second, median']:.1f} ms", ""])
    for row in one.get("settled scenes", []):
        what = f"one settled scene, {row['floor']} floor, accuracy {row['asked for']:g}"
        cost = f"{row['ms seen']:.2f} ms ({row['ms first']:.2f} at a new load or speed)"
        lines.append([what, "six_dof", cost, f"{row['RMS error rms']:.1e}"])
    lines += [
        [f"maps, {row['nodes']} nodes", "six_dof", f"{row['cpu seconds']:.1f} s", f"{row['error rms']:.1e}"]
        for row in one.get("map", [])
    ]
    for row in many.get("errors", []):
        what = f"many scenes at once, an integrated second of one, {row['steps']} steps a period"
        lines.append([what, "lanes", f"{row['ms a second and scene']:.1f} ms", f"{row['RMS error rms']:.1e}"])
    return markdown(["what", "benchmark", "thread time", "RMS error, rms over scenes"], lines)


def families_table() -> str:
    """Return what benchmarks.engine_families left in its file of results."""
    lines = [
        [
            str(row["family"]),
            f"{row['asked for']:g}",
            f"{row['steps, median']:.0f}",
            f"{row['RMS error rms']:.1e}",
            f"{row['max']:.1e}",
            f"{row['estimate bounds it']:.2f}",
            f"{row['inaccurate']}",
            f"{row['ms, median']:.2g}",
            f"{row['ms, most']:.2g}",
        ]
        for row in _results("engine_families").get("families", [])
    ]
    head = ["family", "asked for", "steps", "RMS error, rms", "most", "estimate bounds it", "inaccurate"]
    return markdown([*head, "ms, median", "ms, most"], lines)


def _results(name: str) -> dict[str, list[dict[str, float]]]:
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def circumstances_text(references: Sequence[Row]) -> str:
    """Return when and on what the figures were measured."""
    found = circumstances()
    times = [number(row, "calibration FFT ms") for row in references]
    return (
        f"Measured {found['date'][:10]} on {found['machine']}, Python {found['python']}; the calibration FFT of\n"
        f"benchmarks/common.py took {min(times):.2f} to {max(times):.2f} ms beside it; targets refer to a machine\n"
        f"where it takes {REFERENCE_MS} ms.\n"
    )


@mpl.rc_context(STYLE)
def draw(runs: Sequence[Row], path: Path) -> None:
    """Draw waveform error against time, one panel a scene, as PNG, as the figures of reports are drawn."""
    scenes = names(runs, "scene")
    figure = Figure(figsize=(13.5, 8.4), layout="constrained")
    grid = figure.subplots(2, 3, sharex=True, sharey=True)
    panels: list[Axes] = list(grid.flat)
    for axes, scene in zip(panels, scenes, strict=False):
        _panel(axes, of(runs, scene=scene))
        axes.set_title(scene, fontsize=11, loc="left")
        axes.set(ylabel="relative waveform error", xlabel="thread time (ms per integrated second)")
        axes.label_outer()
    panels[2].tick_params(labelbottom=True)
    panels[2].set_xlabel("thread time (ms per integrated second)")
    for axes in panels[len(scenes) :]:
        axes.set_axis_off()
    handles, labels = panels[0].get_legend_handles_labels()
    panels[-1].legend(handles, labels, loc="center", fontsize=9.5)
    figure.savefig(path.with_suffix(".png"), dpi=85, facecolor="white")


def _panel(axes: Axes, runs: Sequence[Row]) -> None:
    for method, (color, marker, line) in STYLES.items():
        found = [r for r in of(runs, method=method) if math.isfinite(number(r, "waveform error"))]
        points = sorted(
            (number(r, "ms a second"), number(r, "waveform error")) for r in found if r["setting"] != MATLAB
        )
        own = method == "this project's kernel"
        if points:
            x, y = zip(*points, strict=True)
            width, size = (2.4, 6.0) if own else (1.2, 5.0)
            axes.loglog(
                x, y, color=color, marker=marker, ls=line, lw=width, ms=size, label=method, zorder=5 if own else 3
            )
    for row in of(runs, method="Dormand-Prince 5(4)", setting=MATLAB):
        place = number(row, "ms a second"), number(row, "waveform error")
        axes.loglog(*place, "X", color="#cc79a7", mec="black", ms=11, ls="none", zorder=6, label="ode45 defaults")
    for level in (1e-2, 1e-3):
        axes.axhline(level, color=GREY, lw=0.6, alpha=0.6)


def renew(document: Path, tables: Mapping[str, Sequence[Row]]) -> None:
    """Renew all tables of the page, each between its marks, and draw the diagram beside it.

    Raises:
        ValueError: if the page lacks a mark.
    """
    runs, references = tables["runs"], tables["references"]
    ingredients = [name for name in STYLES if name.startswith(("Lawson", "explicit"))][::-1]
    adaptive = [name for name in STYLES if name.startswith(("Dormand", "solve_ivp"))]
    steps = [str(r["setting"]) for r in of(runs, method="this project's kernel", scene=names(runs, "scene")[0])]
    parts = {
        "circumstances": circumstances_text(references),
        "references": reference_table(references),
        "reach": reach_table(runs),
        "ingredients": errors_table(runs, [(name, INGREDIENTS_STEP) for name in ingredients]),
        "adaptive": errors_table(runs, [(name, MATLAB) for name in adaptive]),
        "steps": errors_table(runs, [("this project's kernel", step) for step in steps]),
        "settled": settled_table(tables["settled"]),
        "speed": speed_table(),
        "families": families_table(),
    }
    text = document.read_text(encoding="utf-8")
    for name, part in parts.items():
        text = _replaced(text, name, part)
    document.write_text(text, encoding="utf-8")
    draw(runs, document)


def _replaced(text: str, name: str, part: str) -> str:
    start, end = f"<!-- {name} of benchmarks.integrators -->\n", f"<!-- end of {name} -->\n"
    before, first, rest = text.partition(start)
    _, last, after = rest.partition(end)
    if not first or not last:
        raise ValueError(f"the page lacks the lines {start.strip()!r} and {end.strip()!r}")
    return before + first + part + last + after
