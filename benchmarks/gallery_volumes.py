"""Figures of the gallery from tracked volumes (Figs. 62 to 67)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase

from benchmarks.gallery_life_panels import STROKES, TWIN, G, named, not_comparable, pair, six
from benchmarks.gallery_lives import (
    LENGTHS,
    LOADS,
    MINUTE,
    MM2,
    SPEED,
    TABLE_21,
    TESTS,
    V_TH,
    Twin,
    maps,
    printed_law,
    twins,
    with_noise,
)
from benchmarks.gallery_plate import Claim, Plate, letter, words
from monitor.health.size.edv import rms_from_map, rms_history
from monitor.report.figures.drawing import AXIS, BLUE, INK, VERMILION


def figure_62() -> Plate:
    """Return tracked volumes."""
    found = twins()

    def line(test: str, axes: Axes) -> None:
        color, stroke = STROKES[test]
        twin = found[test]
        axes.plot(twin.t / MINUTE, twin.v_eq / MM2, color=color, ls=stroke, label=named(test))
        axes.plot(twin.t / MINUTE, twin.v_true / MM2, color=color, ls=stroke, lw=0.7, alpha=0.45)

    def draw(made: FigureBase) -> None:
        for axes in pair(made, line, "V_eq (mm³/mm)"):
            axes.axhline(V_TH / MM2, color=AXIS, lw=0.8)
            axes.set_ylim(0.0, 0.3)

    low = [float(np.nanmean(twin.v_eq < V_TH)) for twin in found.values()]
    falls = {test: int(np.sum(np.diff(twin.v_eq) < 0.0)) for test, twin in found.items()}
    ratio = [float(np.nanmedian(twin.v_eq / twin.v_true)) for twin in found.values()]
    ends = [bool(np.nanmax(twin.v_eq) > 2.0 * V_TH) for twin in found.values()]
    claims = [
        words("below 0.05 mm³/mm for most of the final stage", [share > 0.5 for share in low]),
        words("rises steeply at the very end (beyond 0.1 mm³/mm)", ends),
        Claim(
            "never falls, but at the very end of one test",
            "in words",
            ", ".join(f"{test} {count}" for test, count in falls.items()) + " falls",
            "agrees" if sum(count > 0 for count in falls.values()) <= 1 else "differs",
        ),
        not_comparable(
            "what the tracker gives of the true volume (median)",
            "unknown",
            ", ".join(f"{test} {100 * value:.0f} %" for test, value in zip(found, ratio, strict=True)),
        ),
    ]
    data: dict[str, Any] = {}
    for test, twin in found.items():
        data |= {f"time_{test}_min": twin.t / MINUTE, f"v_eq_{test}_mm2": twin.v_eq / MM2}
        data |= {f"v_true_{test}_mm2": twin.v_true / MM2}
    caption = (
        "V_eq as the thesis' tracker gives it (strong) and the truth of the simulated lives (thin). It is the least "
        "volume that explains the RMS, and so below the truth."
    )
    return Plate(caption, "Tracked and true volumes of six lives.", 3.2, draw, data, claims, TWIN)


def figure_63() -> Plate:
    """Return the first prognostic model: histories under other loads."""
    found, others = twins(), ("E4", "E5", "E6")
    made_up = {
        (source, other): with_noise(
            rms_history(found[source].dphi_d, found[source].h_d, rms_from_map(maps(), LOADS[other], SPEED))
        )
        for source in ("E1", "E2", "E3")
        for other in others
    }

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 3, sharey=True)
        for place, (axes, other) in enumerate(zip(panels, others, strict=True)):
            for source in ("E1", "E2", "E3"):
                color, stroke = STROKES[source]
                values = made_up[source, other] / G
                axes.plot(found[source].t / MINUTE, values, color=color, ls=stroke, label=f"from {source}")
            axes.plot(found[other].t / MINUTE, found[other].rms / G, color=INK, lw=1.8, label=f"life {other}")
            letter(axes, place, f"{LOADS[other]:g} N")
            axes.set(xlabel="time from t_fs (min)")
            axes.legend(loc="lower right", fontsize=7.5)
        panels[0].set(ylabel="RMS (g)", ylim=(0.0, None))

    claims = []
    for source in ("E1", "E2", "E3"):
        ours = [float(made_up[source, other][np.isfinite(made_up[source, other])][-1]) / G for other in others]
        printed = ", ".join(f"{value:g}" for value in TABLE_21[source])
        text = ", ".join(f"{value:.1f}" for value in ours)
        claims.append(
            not_comparable(
                f"RMS at the end from {source} at 3000, 4700, 5000 N (Table 21)", f"{printed} g", f"{text} g"
            )
        )
    finals = {
        key: float(values[np.isfinite(values)][-1]) for key, values in made_up.items() if np.any(np.isfinite(values))
    }
    claims.append(
        words(
            "histories keep their course and are scaled with the load",
            [finals[s, "E4"] < finals[s, "E5"] < finals[s, "E6"] for s in ("E1", "E2", "E3")],
        )
    )
    data: dict[str, Any] = {}
    for (source, other), values in made_up.items():
        data[f"rms_from_{source}_at_{LOADS[other]:g}_newton_g"] = values / G
    caption = (
        "RMS of the sizes that were tracked at 4000 N (twins of E1 to E3) under other loads, and the simulated life at "
        "that load (black)."
    )
    return Plate(caption, "Histories under other loads.", 3.2, draw, data, claims, TWIN)


def figure_64() -> Plate:
    """Return tracked volumes below the threshold."""
    found = twins()

    def line(test: str, axes: Axes) -> None:
        t, v = found[test].below
        color, stroke = STROKES[test]
        axes.plot(t / MINUTE, v / MM2, color=color, ls=stroke, label=named(test))

    def draw(made: FigureBase) -> None:
        for axes in pair(made, line, "V_eq (mm³/mm)"):
            axes.axhline(V_TH / MM2, color=AXIS, lw=0.8)

    reached = {test: bool(twin.below[1][-1] >= V_TH) for test, twin in found.items()}
    claims = [words("every life reaches 0.05 mm³/mm", list(reached.values()))]
    data: dict[str, Any] = {}
    for test, twin in found.items():
        data |= {f"time_{test}_min": twin.below[0] / MINUTE, f"v_eq_{test}_mm2": twin.below[1] / MM2}
    caption = "V_eq below the threshold of 0.05 mm³/mm; the last point is interpolated between its neighbours."
    return Plate(caption, "Volumes below the threshold.", 3.0, draw, data, claims, TWIN)


def figure_65() -> Plate:
    """Return the fitted quadratics beside the printed ones."""
    found = twins()
    fits = {test: twin.fit for test, twin in found.items()}

    def line(test: str, axes: Axes) -> None:
        t, v = found[test].below
        law, fit = printed_law(test), fits[test]
        axes.plot(t / MINUTE, v / MM2, ".", color=BLUE, ms=3.5, label="tracked")
        if fit is not None:
            axes.plot(t / MINUTE, [fit.value_at(float(x)) / MM2 for x in t], color=VERMILION, ls="--", label="fit")
        until = law.first_crossing(V_TH) or t[-1]
        grid = np.linspace(0.0, until, 60)
        values = [law.value_at(float(x)) / MM2 for x in grid]
        axes.plot(grid / MINUTE, values, color=INK, lw=0.9, label="printed (Table 22)")
        if test == TESTS[0]:
            axes.legend(loc="upper left", fontsize=7.5)

    def draw(made: FigureBase) -> None:
        six("V_eq (mm³/mm)", line, made, "time from t_fs (min)")

    good = [fit is not None and fit.r_squared > 0.92 for fit in fits.values()]
    claims = [words("R² above 0.92", good, "> 0.92 in 6 of 6")]
    for test, fit in fits.items():
        crossing = None if fit is None else fit.first_crossing(V_TH)
        printed = (printed_law(test).first_crossing(V_TH) or 0.0) / MINUTE
        ours = "never" if crossing is None else f"{crossing / MINUTE:.0f} min"
        r2 = "no fit" if fit is None else f"R² {fit.r_squared:.3f}"
        claims.append(not_comparable(f"{test}: 0.05 mm³/mm reached by the fit", f"{printed:.0f} min", f"{ours}, {r2}"))
    data: dict[str, Any] = {}
    for test, fit in fits.items():
        if fit is not None:
            scaled = (fit.a / MM2 * MINUTE**2, fit.b / MM2 * MINUTE, fit.c / MM2)
            data |= {f"a_b_c_{test}_mm2_min": scaled, f"r_squared_{test}": fit.r_squared}
    caption = (
        "Quadratics fitted to the tracked volumes of the simulated lives, beside those that Table 22 prints for the "
        "tests, which are the truth of the lives up to there."
    )
    return Plate(caption, "Fitted and printed quadratics.", 4.2, draw, data, claims, TWIN)


def _tt(twin: Twin, threshold: float) -> tuple[np.ndarray, np.ndarray, float | None]:
    """Return times and forecasts in minutes, and when the tracked volume crosses, minutes (None: it does not)."""
    found = twin.forecasts(threshold)
    tt = np.array([result.tt for result in found]) / MINUTE
    crossed = [result.t_threshold for result in found if result.status == "already_crossed"]
    actual = crossed[-1] / MINUTE if crossed and np.isfinite(crossed[-1]) else None
    return twin.t / MINUTE, tt, actual


def _draw_tt(axes: Axes, twin: Twin, threshold: float) -> None:
    t, tt, actual = _tt(twin, threshold)
    top = max(LENGTHS[twin.test] * 1.5, 100.0)
    shown = tt <= 2.0 * top
    axes.plot(t[shown], tt[shown], ".", color=BLUE, ms=4, label="forecast")
    if actual is not None:
        axes.plot([0.0, actual], [actual, 0.0], color=INK, lw=1.2, label="actual")
    axes.set_ylim(0.0, top)


def _later_better(twin: Twin, threshold: float) -> bool | None:
    t, tt, actual = _tt(twin, threshold)
    if actual is None:
        return None
    error = np.abs(tt - (actual - t))
    early, late = error[t < actual / 3], error[(t >= 2 * actual / 3) & (t < actual)]
    if not np.any(np.isfinite(early)) or not np.any(np.isfinite(late)):
        return None
    return bool(np.nanmedian(late) < np.nanmedian(early))


def figure_66() -> Plate:
    """Return the forecasts of the time to the threshold."""
    found = twins()

    def line(test: str, axes: Axes) -> None:
        _draw_tt(axes, found[test], V_TH)
        if test == "E4":
            axes.legend(loc="upper right", fontsize=7.5)

    def draw(made: FigureBase) -> None:
        six("TT (min)", line, made, "time from t_fs (min)")

    better = [value for twin in found.values() if (value := _later_better(twin, V_TH)) is not None]
    missing = [test for test, twin in found.items() if _tt(twin, V_TH)[2] is None]
    claims = [words("closer in the last third than in the first", better)]
    if missing:
        claims.append(not_comparable("reaches the threshold in its life", "all six", f"not {', '.join(missing)}"))
    data: dict[str, Any] = {}
    for test, twin in found.items():
        t, tt, actual = _tt(twin, V_TH)
        data |= {f"time_{test}_min": t, f"tt_{test}_min": tt, f"crossing_{test}_min": actual}
    caption = (
        "Time to 0.05 mm³/mm as the quadratic through the tracked volumes gives it after every block, and the actual "
        "one where the tracked volume reaches it."
    )
    return Plate(caption, "Forecasts of the time to the threshold.", 4.2, draw, data, claims, TWIN)


def figure_67() -> Plate:
    """Return forecasts of one life to other thresholds."""
    twin, thresholds = twins()["E6"], (0.03, 0.08, 0.1)

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 3, sharey=True)
        for place, (axes, value) in enumerate(zip(panels, thresholds, strict=True)):
            _draw_tt(axes, twin, value * MM2)
            letter(axes, place, f"V_th = {value:g} mm³/mm")
            axes.set_xlabel("time from t_fs (min)")
        panels[0].set_ylabel("TT (min)")
        panels[0].legend(loc="upper right", fontsize=7.5)

    middles = [float(np.nanmedian(_tt(twin, value * MM2)[1])) for value in thresholds]
    claims = [
        words("from 0.08 to 0.1 mm³/mm the curve shifts to higher TT", [middles[1] < middles[2]]),
        words("with 0.03 mm³/mm forecasts are lower than with 0.08", [middles[0] < middles[1]]),
    ]
    data: dict[str, Any] = {"time_min": twin.t / MINUTE}
    data |= {f"tt_to_{value:g}_mm2_min": _tt(twin, value * MM2)[1] for value in thresholds}
    caption = "Time to other thresholds on the twin of E6; the actual one is drawn where its tracked volume reaches it."
    return Plate(caption, "Forecasts to three thresholds.", 2.9, draw, data, claims, TWIN)


FIGURES: dict[str, Callable[[], Plate]] = {
    "62": figure_62,
    "63": figure_63,
    "64": figure_64,
    "65": figure_65,
    "66": figure_66,
    "67": figure_67,
}
