"""Figures of the gallery that need no motion: stiffness, modes, damping and the way of a ball (Figs. 36 to 43, 53)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.figure import FigureBase

from benchmarks.gallery_plate import Claim, Plate, letter, number, words
from models.machine.bearing import from_catalogue
from models.machine.hertz import mean_bearing_stiffness
from models.machine.load_distribution import StiffnessPassage, stiffness_over_passage
from models.machine.rig import Rig, contact_damping, natural_frequencies
from models.machine.scene import Defect, Floor
from models.path.defect import ball_path
from models.published.thesis import EXTENTS_DEG, SEEDED_DEPTH
from monitor.report.figures.drawing import BLUE, GREY, INK, ORANGE, SHADE, VERMILION, legend_above

BEARING = "1205 ETN9"
LOADS = {1000.0: (BLUE, "-"), 2000.0: (VERMILION, "--")}
F_1, F_2 = 400.0, 1500.0
"""Frequencies of the two damping ratios, Hz (section 4.4.1)."""
BETA_C = (0.25e-5, 2.5e-5)
"""Limits of beta_c, s (section 4.4.1)."""
_TERMS = (("k_xx", 1, 1), ("k_yy", 0, 0), ("k_xy", 0, 1))


def passages(defect: Defect | None) -> dict[float, StiffnessPassage]:
    """Return the stiffness over one spacing of the balls of a row, by load."""
    bearing = from_catalogue(BEARING)
    return {load: stiffness_over_passage(bearing, load, Rig().k_c, defect=defect, points=240) for load in LOADS}


def _passage_plate(found: dict[float, StiffnessPassage], caption: str, claims: list[Claim]) -> Plate:
    data: dict[str, Any] = {}
    for load, passage in found.items():
        data["cage_angle_deg"] = np.degrees(passage.cage_angle)[::4]
        for name, i, j in _TERMS:
            data[f"{name}_at_{load:g}_newton_meganewton_per_m"] = 1e-6 * passage.matrix[::4, i, j]

    def draw(made: FigureBase) -> None:
        panels = made.subplots(1, 3)
        for place, (axes, (name, i, j)) in enumerate(zip(panels, _TERMS, strict=True)):
            for load, (color, stroke) in LOADS.items():
                angle, values = np.degrees(found[load].cage_angle), 1e-6 * found[load].matrix[:, i, j]
                axes.plot(angle, values, color=color, ls=stroke, label=f"{load:g} N")
            axes.set(xlabel="cage angle (degrees)", xlim=(0.0, 30.0))
            letter(axes, place, f"{name} (MN/m)")
        panels[-1].legend(loc="upper right")

    label = "Stiffness terms of the bearing over one spacing of the balls of a row, at 1000 and 2000 N."
    return Plate(caption, label, 2.7, draw, data, claims)


def figure_36() -> Plate:
    """Return the stiffness of the healthy bearing while the balls pass."""
    found = passages(None)
    swing = found[1000.0].swing
    coupling = max(p.largest_coupling / float(np.min(p.matrix[:, 0, 0])) for p in found.values())
    claims = [
        number("swing of k_xx", 7.5, 100.0 * float(swing[1]), "%", 0.05),
        Claim(
            "swing of k_yy", "< 0.02 %", f"{100 * float(swing[0]):.4f} %", "agrees" if swing[0] < 2e-4 else "differs"
        ),
        number("mean k_xx at 1000 N (Table 17)", 102.3, 1e-6 * float(found[1000.0].mean[1, 1]), "MN/m", 0.05),
        number("mean k_yy at 1000 N (Table 17)", 152.3, 1e-6 * float(found[1000.0].mean[0, 0]), "MN/m", 0.05),
        Claim(
            "k_xy lies several orders below the others",
            "in words",
            f"{coupling:.1e} of k_yy at most",
            "agrees" if coupling < 1e-2 else "differs",
        ),
    ]
    return _passage_plate(found, "Stiffness of the healthy bearing over one spacing of the balls of a row.", claims)


def figure_37() -> Plate:
    """Return the stiffness of the bearing with D3 while the balls pass."""
    found = passages(Defect(math.radians(EXTENTS_DEG["D3"]), SEEDED_DEPTH))
    healthy = passages(None)
    claims = []
    for load, passage in found.items():
        loss = 100.0 * (1.0 - float(np.min(passage.matrix[:, 0, 0])) / float(healthy[load].mean[0, 0]))
        claims.append(number(f"loss of k_yy with a ball over D3, {load:g} N", 12.5, loss, "%", 0.05))
    rises = [float(np.max(p.matrix[:, 1, 1])) > float(np.max(healthy[w].matrix[:, 1, 1])) for w, p in found.items()]
    claims.append(words("k_xx rises where a ball enters", rises))
    return _passage_plate(found, "The same with D3 in one row, deeper than a ball reaches.", claims)


def _grid() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return m_r (kg), k_r (N/m) and the six natural frequencies (Hz) over both at 2000 N."""
    k_b = mean_bearing_stiffness(from_catalogue(BEARING), 2000.0, Rig().k_c)
    m_r, k_r = np.linspace(0.1, 5.0, 50), 1e9 * np.linspace(0.1, 10.0, 50)
    found = np.array(
        [[natural_frequencies(replace(Rig(), m_r=m, k_r=k), k_b[1, 1], k_b[0, 0]) for m in m_r] for k in k_r]
    )
    return m_r, k_r, found


def _own() -> np.ndarray:
    k_b = mean_bearing_stiffness(from_catalogue(BEARING), 2000.0, Rig().k_c)
    return natural_frequencies(Rig(), k_b[1, 1], k_b[0, 0])


def figure_38() -> Plate:
    """Return the natural frequency of the resonator over its mass and stiffness."""
    m_r, k_r, found = _grid()
    f_r = found[..., 5]

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.contourf(m_r, 1e-9 * k_r, f_r, levels=[4500.0, 9500.0], colors=[SHADE])
        lines = axes.contour(m_r, 1e-9 * k_r, f_r, levels=np.arange(3000.0, 12001.0, 1000.0), colors=BLUE, linewidths=1)
        axes.clabel(lines, fmt="%g Hz", fontsize=8)
        axes.contour(m_r, 1e-9 * k_r, f_r, levels=[4500.0, 9500.0], colors=INK, linewidths=1.6, linestyles="--")
        axes.plot(Rig().m_r, 1e-9 * Rig().k_r, "s", color=VERMILION, label="Table 18")
        axes.set(xlabel="mass of the resonator m_r (kg)", ylabel="stiffness of the resonator k_r (GN/m)")
        axes.legend(loc="lower right", frameon=True)

    caption = (
        "Highest natural frequency over m_r and k_r, healthy bearing at 2000 N, as the lines of (b) of the print; its "
        "surface (a) is the same figure once more. Shaded between dashed lines: 4500 to 9500 Hz, what is admitted."
    )
    claims = [number("f_r of Table 18 (m_r 3.01 kg, k_r 4.25 GN/m)", 7388.0, float(_own()[5]), "Hz", 0.5)]
    data = {"m_r_kg": m_r[::7], "k_r_giganewton_per_m": 1e-9 * k_r[::7], "f_r_hz": f_r[::7, ::7]}
    return Plate(caption, "Contours of the natural frequency of the resonator.", 3.6, draw, data, claims)


def figure_39() -> Plate:
    """Return the first four natural frequencies over mass and stiffness of the resonator."""
    m_r, k_r, found = _grid()

    def draw(made: FigureBase) -> None:
        panels = made.subplots(2, 2, sharex=True, sharey=True)
        for place, axes in enumerate(panels.flat):
            # Evenly over where k_r is stiff: below, modes change places and lines crowd.
            low, high = np.percentile(found[k_r >= 1e9][..., place], (1.0, 99.0))
            levels = np.linspace(low, high, 9)
            lines = axes.contour(m_r, 1e-9 * k_r, found[..., place], levels=levels, colors=BLUE, linewidths=1.0)
            axes.clabel(lines, fmt="%.0f", fontsize=7.5)
            axes.plot(Rig().m_r, 1e-9 * Rig().k_r, "s", color=VERMILION, ms=5)
            letter(axes, place, f"mode {place + 1} (Hz), {'x' if place % 2 == 0 else 'y'}")
        for axes in panels[-1]:
            axes.set_xlabel("m_r (kg)")
        for axes in panels[:, 0]:
            axes.set_ylabel("k_r (GN/m)")

    # Beyond 1 GN/m, where the resonator stands above the other modes.
    stiff = k_r >= 1e9
    by_mass = np.ptp(found[stiff], axis=1).mean(axis=0)[:4] / found[..., :4].mean(axis=(0, 1))
    by_stiffness = np.ptp(found[stiff], axis=0).mean(axis=0)[:4] / found[..., :4].mean(axis=(0, 1))
    claims = [
        Claim(
            "m_r matters, in particular in modes 1 and 2; k_r (from 1 GN/m) hardly",
            "in words",
            "m_r moves them by "
            + ", ".join(f"{100 * v:.0f} %" for v in by_mass)
            + "; k_r by "
            + ", ".join(f"{100 * v:.1f} %" for v in by_stiffness),
            "agrees" if by_stiffness.max() < by_mass.min() else "in part",
        ),
        number("mode 2 (text of Fig. 48)", 357.1, float(_own()[1]), "Hz", 0.05),
        number("mode 4 (text of Fig. 48)", 1543.8, float(_own()[3]), "Hz", 0.05),
    ]
    data = {"m_r_kg": m_r[::7], "k_r_giganewton_per_m": 1e-9 * k_r[::7]}
    data |= {f"mode_{n + 1}_hz": found[::7, ::7, n] for n in range(4)}
    caption = (
        "Natural frequencies of the first four modes over m_r and k_r, healthy bearing at 2000 N; y is along the load. "
        "Square: Table 18."
    )
    return Plate(caption, "Contours of the first four natural frequencies.", 5.2, draw, data, claims)


def figure_40() -> Plate:
    """Return which damping ratios and coefficients are admitted."""
    omega = 2.0 * math.pi * np.array([F_1, F_2])
    span = omega[1] ** 2 - omega[0] ** 2
    zeta_1 = np.linspace(0.001, 0.15, 60)
    limits = {beta: (beta * span / 2.0 + omega[0] * zeta_1) / omega[1] for beta in BETA_C}
    no_alpha = omega[1] * zeta_1 / omega[0]
    alpha, beta = np.meshgrid(np.linspace(0.0, 900.0, 181), np.linspace(0.0, 3e-5, 121))
    zeta = [0.5 * (alpha / w + beta * w) for w in omega]
    admitted = (zeta[0] <= 0.15) & (zeta[1] <= 0.15) & (beta >= BETA_C[0]) & (beta <= BETA_C[1])

    def draw(made: FigureBase) -> None:
        left, right = made.subplots(1, 2)
        low = limits[BETA_C[0]]
        high = np.minimum(np.minimum(limits[BETA_C[1]], no_alpha), 0.15)
        left.fill_between(100 * zeta_1, 100 * low, 100 * high, where=(high > low).tolist(), color=SHADE, lw=0)
        for value, stroke in zip(BETA_C, ("-", "--"), strict=True):
            left.plot(100 * zeta_1, 100 * limits[value], color=BLUE, ls=stroke, label=f"β_c = {value:.2g} s")
        left.plot(100 * zeta_1, 100 * no_alpha, color=VERMILION, ls="-.", label="α_c = 0")
        left.plot(6.22, 12.6, "s", color=INK, label="Table 18")
        left.set(xlabel="ζ_1 (%)", ylabel="ζ_2 (%)", xlim=(0, 15), ylim=(0, 15))
        letter(left, 0, "")
        left.legend(loc="lower right", fontsize=7.5, frameon=True)
        right.contourf(alpha, 1e5 * beta, admitted.astype(float), levels=[0.5, 1.5], colors=[SHADE])
        for value, stroke in zip(BETA_C, ("-", "--"), strict=True):
            right.axhline(1e5 * value, color=BLUE, ls=stroke)
        right.plot(154.9, 2.5, "s", color=INK)
        right.set(xlabel="α_c (1/s)", ylabel="β_c (10⁻⁵ s)", ylim=(0, 3))
        letter(right, 1, "")

    found = contact_damping(0.0622, 0.126, F_1, F_2)
    edge = [float(alpha[row][admitted[row]].max()) for row in range(len(beta)) if admitted[row].any()]
    claims = [
        number("α_c of Table 18", 154.9, found[0], "1/s", 0.05),
        number("β_c of Table 18, on the upper limit", 2.5e-5, found[1], "s", 0.05e-5),
        words("the admitted α_c rises as β_c falls", [edge[0] > edge[-1]]),
    ]
    caption = (
        "Admitted damping of the contacts (shaded): (a) ratios at 400 and 1500 Hz, (b) coefficients (Eqs. 70 to 74)."
    )
    data = {"zeta_1": zeta_1[::6], **{f"zeta_2_at_beta_c_{b:.2g}_s": v[::6] for b, v in limits.items()}}
    data |= {"zeta_2_at_alpha_c_0": no_alpha[::6]}
    return Plate(caption, "Admitted damping ratios and coefficients.", 3.1, draw, data, claims)


def figure_43() -> Plate:
    """Return the natural frequency of the resonator over the masses that the print's optimisation found."""
    k_b = mean_bearing_stiffness(from_catalogue(BEARING), 2000.0, Rig().k_c)
    m_r = np.linspace(3.0, 3.09, 10)
    f_r = np.array([natural_frequencies(replace(Rig(), m_r=float(m)), k_b[1, 1], k_b[0, 0])[5] for m in m_r])

    def draw(made: FigureBase) -> None:
        axes = made.subplots(1, 1)
        axes.axhspan(7320.0, 7400.0, color=SHADE, lw=0, label="the print's range, 7.32 to 7.4 kHz")
        axes.plot(m_r, f_r, color=BLUE, marker="o", label="k_r = 4.25 GN/m")
        axes.set(xlabel="mass of the resonator m_r (kg)", ylabel="natural frequency (Hz)")
        legend_above(axes)

    claims = [
        number("lowest, at m_r = 3.09 kg", 7320.0, float(f_r[-1]), "Hz", 5.0),
        number("highest, at m_r = 3.00 kg", 7400.0, float(f_r[0]), "Hz", 5.0),
    ]
    caption = (
        "Natural frequency of the resonator over the range of m_r that the text of Fig. 42 states, with its k_r. The "
        "points of the print are those of its optimisation, which needs the measured signals."
    )
    return Plate(caption, "Natural frequency against mass.", 2.6, draw, {"m_r_kg": m_r, "f_r_hz": f_r}, claims)


def figure_53() -> Plate:
    """Return the way of the ball over a localised and over an extended defect."""
    bearing = from_catalogue(BEARING)
    local = Defect(math.radians(2.0), SEEDED_DEPTH)
    extended = Defect(math.radians(20.0), 20e-6)
    rough = replace(extended, floor=Floor("rough"))
    ways = {}
    for name, defect in (("local", local), ("smooth", extended), ("rough", rough)):
        angle, path = np.linspace(-0.6, 0.6, 801) * defect.dphi_d, ball_path(bearing, defect)
        if path is None:
            raise ValueError(f"{name}: no defect")
        ways[name] = np.degrees(angle), 1e6 * path(angle)[0]

    def draw(made: FigureBase) -> None:
        left, right = made.subplots(1, 2)
        left.plot(*ways["local"], color=INK)
        right.plot(*ways["rough"], color=INK, label="rough floor")
        right.plot(*ways["smooth"], color=ORANGE, ls="-.", label="smooth floor")
        letter(left, 0, "Δφ_d = 2°, floor not reached")
        letter(right, 1, "Δφ_d = 20°, h_d = 20 µm, R = 10 µm")
        right.legend(loc="upper center")
        for axes in (left, right):
            axes.axhline(0.0, color=GREY, lw=0.7)
            axes.invert_yaxis()
            axes.set_xlabel("angle from the middle of the defect (degrees)")
        left.set_ylabel("sunk (µm)")

    middle = np.abs(ways["rough"][0]) < 8.0
    off = float(np.max(np.abs(ways["rough"][1] - ways["smooth"][1])[middle]))
    claims = [
        Claim("the way leaves h_d by less than R", "< 10 µm", f"{off:.2g} µm", "agrees" if off < 10.0 else "differs"),
        words("the localised defect is left without touching its floor", [float(ways["local"][1].max()) < 500.0]),
    ]
    data: dict[str, Any] = {}
    for name, (x, y) in ways.items():
        data |= {f"angle_{name}_deg": x[::8], f"sunk_{name}_um": y[::8]}
    caption = (
        "The way of the ball over (a) a localised defect and (b) an extended one. The print does not give its random "
        "profile: ours has a standard deviation of 1 µm after the filter of Eq. 87 and a seed of its own, so that the "
        "bumps stand elsewhere."
    )
    return Plate(caption, "Depth of the ball's way over a localised and an extended defect.", 2.7, draw, data, claims)


FIGURES: dict[str, Callable[[], Plate]] = {
    "36": figure_36,
    "37": figure_37,
    "38": figure_38,
    "39": figure_39,
    "40": figure_40,
    "43": figure_43,
    "53": figure_53,
}
