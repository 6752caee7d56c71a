"""Figures that the five sources print and this program does not compute, each with the reason.

"INPUT" is a datum that the models take as printed, "NO" a result that cannot be computed here, "FE" one that finite
elements obtain: docs/evidence/finite-elements.md, and the table of them in docs/evidence/published-figures.md.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

THESIS, CERUTI, MARIN = "Gabrielli 2022", "Ceruti 2021", "Marin 2014"
SASSI, THIBAULT = "Sassi 2007", "Thibault et al. 2022"


class UncomputedFigure(NamedTuple):
    """Printed figures of one kind.

    Attributes:
        source: document.
        places: tables, figures and sections, such as "Table 5".
        quantity: what is printed.
        printed: values and unit, the range where there are many.
        status: whether it is a datum or is not reproduced.
        reason: what the datum is used for, or what is missing.
    """

    source: str
    places: tuple[str, ...]
    quantity: str
    printed: str
    status: Literal["INPUT", "NO", "FE"]
    reason: str


_OTHER_ELEMENTS = "shells and plates by finite elements are outside this program"
_SIGNALS = "needs the measured signals, which are not at hand"
_HISTORIES = "needs the measured histories, which are not at hand"
_DRAWN = "drawn, without values"


def uncomputed_figures() -> list[UncomputedFigure]:
    """Return all of them, source by source in the order of the seeds 000 to 004."""
    return [*_thesis(), *_ceruti(), *_thibault(), *_marin(), *_sassi()]


def _tables(*numbers: int | str) -> tuple[str, ...]:
    return tuple(f"Table {number}" for number in numbers)


def _thesis() -> list[UncomputedFigure]:
    return [
        UncomputedFigure(THESIS, _tables(1, 4), "geometry of the bearings", "mm", "INPUT", "models/bearings.toml"),
        UncomputedFigure(
            THESIS, ("Table 2", "Fig. 10"), "widths of the seeded defects", "0.928, 1.664, 2.501 mm", "INPUT",
            "measured; the angular extents that follow are in the first table",
        ),
        UncomputedFigure(
            THESIS, _tables(5, 6, 9), "sizes and nodes of the meshes", "mm, -", "FE",
            "meshes of the same sizes; nodes differ with the mesher",
        ),
        UncomputedFigure(
            THESIS, _tables(7, 8, 10), "stiffness against Hertz, and computing time", "-1.1 to 17.6 %, 1 to 129 s",
            "FE", "sub-model of section 3.3 with hexahedra and tetrahedra",
        ),
        UncomputedFigure(
            THESIS, ("Figs. 22 to 28 (text)",), "differences of finite elements", "3, 3.3, 4.6, 6.7, 7.5, 12.3 %",
            "FE", "assembled bearings; Eq. 19, with which they are compared, is in the first table",
        ),
        UncomputedFigure(THESIS, _tables(14), "masses and stiffnesses", "kg, N/m", "INPUT", "models.machine.rig.Rig"),
        UncomputedFigure(
            THESIS, _tables(15), "stiffness of the shaft", "73.72 to 75.93 MN/m", "FE",
            "as a trend: the shaft's dimensions are not printed; 75 MN/m is a datum",
        ),
        UncomputedFigure(
            THESIS, _tables(16), "limits of the parameters", "0.1 to 15 %, 0.1 to 5 kg, 0.1 to 10 GN/m", "INPUT",
            "limits of spallwatch identify",
        ),
        UncomputedFigure(
            THESIS, ("Table 18", "Figs. 41 and 42 (text)"), "damping ratios and resonator of the best fit",
            "0.11 to 15 %, 3.01 kg, 4.25 GN/m", "INPUT", "the search itself " + _SIGNALS,
        ),
        UncomputedFigure(
            THESIS, ("Section 4.3",), "resonances of the measured spectra", "400, 1500 and 7000 to 9000 Hz", "INPUT",
            "measured; the first two are the frequencies at which the contact damping is given",
        ),
        UncomputedFigure(
            THESIS, ("Section 4.4.5",), "angles of slip", "0.005, 0.01 and 0.02 rad", "INPUT", "Scene.slip"
        ),
        UncomputedFigure(
            THESIS, ("Section 4.4.2",), "least differences of RMS and A*", "17.9 to 21.3 %, 35.83 to 35.9 %", "NO",
            _SIGNALS,
        ),
        UncomputedFigure(THESIS, _tables(19), "fits of one defect at a time", "24 values", "NO", _SIGNALS),
        UncomputedFigure(
            THESIS, ("Figs. 31 to 34", "Figs. 45 to 51"), "features of stationary conditions", _DRAWN, "NO",
            "compared in kind: section on stationary conditions",
        ),
        UncomputedFigure(
            THESIS, _tables(20), "begin and end of the final stage", "28:20 to 473:55 h:min", "INPUT",
            "measured; what follows is in the first table",
        ),
        UncomputedFigure(THESIS, _tables(21), "RMS at the end of tests", "2.8 to 6.6 g", "NO", _HISTORIES),
        UncomputedFigure(
            THESIS, _tables(22), "quadratics of V_eq and their R2", "0.55 to 6.62e-7, ..., 0.921 to 0.989", "NO",
            _HISTORIES + "; what follows from the coefficients is in tests/published/test_table22.py",
        ),
        UncomputedFigure(
            THESIS, ("Section 5.4",), "end of a test, and V_eq before it rises", "20 g, 0.05 to 0.01 mm3/mm", "NO",
            _HISTORIES,
        ),
        UncomputedFigure(
            THESIS, ("Section 5.4",), "threshold of V_eq", "0.05 mm3/mm", "INPUT", "default of the forecast"
        ),
        *_gearbox(),
    ]  # fmt: skip


def _gearbox() -> list[UncomputedFigure]:
    confidential = "teeth and k_m(t) are confidential, Eqs. 98 and 99 are missing from the text at hand"
    casing = "the casing's geometry is not printed"
    return [
        UncomputedFigure(
            THESIS, _tables(23), "speed, power, teeth", "506.4 rpm, 50 kW, 37", "INPUT", "models.gears.published"
        ),
        UncomputedFigure(
            THESIS, _tables(24), "masses, inertias, stiffness, damping of nine degrees of freedom",
            "kg, kg m2, N/m, s", "INPUT", "models.gears.published; base radii, needed beside them, are not printed",
        ),
        UncomputedFigure(
            THESIS, ("Fig. 74",), "reaction forces on the bearings", "drawn, values of the axis withheld", "NO",
            confidential,
        ),
        UncomputedFigure(
            THESIS, _tables(25), "natural frequencies of the casing and MAC",
            "828, 1221; 835, 1143 Hz; 0.66, 0.73", "NO",
            casing + "; MAC of a casing of our own: docs/evidence/gears.md",
        ),
        UncomputedFigure(
            THESIS, _tables(26), "modal damping of the casing", "0.5 to 7.6 %", "INPUT",
            "measured; models.fe.casing.modes.THESIS_DAMPING",
        ),
        UncomputedFigure(
            THESIS, _tables(27), "reduction of the acceleration by Mod1", "-5.3, -6.1; -7.3, -5.5 dB", "NO",
            casing + "; " + confidential,
        ),
        UncomputedFigure(
            THESIS, _tables(28), "reduction of the sound pressure by Mod1", "-3.5, -4.9; -3.3, -4.9 dB(A)", "NO",
            casing + "; " + confidential,
        ),
        UncomputedFigure(
            THESIS, ("Figs. 73, 77 and 78",), "third-octave levels of pressure and acceleration",
            "drawn, values of the axis withheld", "NO", "measurements are not at hand; " + casing,
        ),
        UncomputedFigure(
            THESIS, ("Figs. 70 to 72, 75 and 76",), "meshes, microphones, mode shapes, sensors", _DRAWN, "NO", casing
        ),
    ]  # fmt: skip


def _ceruti() -> list[UncomputedFigure]:
    return [
        UncomputedFigure(
            CERUTI, _tables("2.1", "5.1", "5.2", "5.3"), "bearings, rotor, integration", "mm, N, s", "INPUT",
            "models.solve.rotor.rig.RotorRig, models.published.ceruti",
        ),
        UncomputedFigure(
            CERUTI, ("Section 2.3", "Section 2.4.1"), "linear stiffness, limits of the damping c_b",
            "1e5 N/mm, 0.25 to 2.5e-5 K_lin", "INPUT", "c_b = 1 N s/mm; called tentative, and no force is linear in it",
        ),
        UncomputedFigure(
            CERUTI, _tables("4.1"), "bands of the envelope", "5 to 40,000 Hz", "INPUT",
            "500 to 10,000 Hz here, as in the source",
        ),
        UncomputedFigure(
            CERUTI, ("Figs. 6.1 to 6.32",), "signals, spectra, orbits", _DRAWN, "NO",
            "compared in kind: tests/published/test_ceruti.py",
        ),
    ]  # fmt: skip


def _thibault() -> list[UncomputedFigure]:
    return [
        UncomputedFigure(
            THIBAULT, _tables(1, 2), "geometry, material and operating conditions", "mm, N, rpm", "INPUT",
            "models.published.thibault",
        ),
        UncomputedFigure(
            THIBAULT, ("II.1",), "stiffness of the couplings", "1300 N m/rad", "INPUT", "models.published.thibault"
        ),
        UncomputedFigure(
            THIBAULT, ("II.4",), "width of the spall over that of the race", "25 %", "NO",
            "the race's width is not printed; 30 degrees of 120 would be it",
        ),
        UncomputedFigure(
            THIBAULT, ("Fig. 7",), "forces and angles against RBS2", _DRAWN, "NO",
            "bearing and displacements of that comparison are not printed",
        ),
        UncomputedFigure(
            THIBAULT, ("Figs. 9 to 17",), "levels of angular speed, acceleration and contact forces", _DRAWN, "NO",
            "inertias, torque, damping, groove radii and clearance are not printed; compared in kind: "
            "tests/published/test_thibault_shaft.py",
        ),
    ]  # fmt: skip


def _marin() -> list[UncomputedFigure]:
    return [
        UncomputedFigure(
            MARIN, _tables(2), "masses, damping, load and speeds", "kg, N s/mm, N, 300 to 3000 rpm", "INPUT",
            "models.solve.ball_inertia.rig.BallInertiaRig; Table 1 holds symbols only",
        ),
        UncomputedFigure(
            MARIN, ("Fig. 15(a)",), "highest line of the measured envelope", "36.2 Hz", "NO",
            "a measurement; the model's line is row M2",
        ),
        UncomputedFigure(
            MARIN, ("Figs. 6 to 9", "Figs. 12 to 16"), "signals, envelopes, spectral power against speed", _DRAWN, "NO",
            "depth and length of the defect are not printed; compared in kind: tests/published/test_marin.py",
        ),
    ]  # fmt: skip


def _sassi() -> list[UncomputedFigure]:
    return [
        UncomputedFigure(
            SASSI, ("Table 1", "Table 2"), "finite elements beside the formulas", "631 N; 10,460 and 3828 Hz", "NO",
            _OTHER_ELEMENTS,
        ),
        UncomputedFigure(
            SASSI, ("Section 4.1", "Section 4.2"), "stiffness of rings and ball", "248, 59.6 and 8300 MN/m", "INPUT",
            "finite elements; models.solve.ring_impact.rig.RingImpactRig, where the element is rigid",
        ),
        UncomputedFigure(
            SASSI, _tables(4), "PEAK and RMS, both columns", "10.1, 10.26, 2.1, 2.09", "NO",
            "unit and gain are not printed; section 7 makes the RMS equal by calibration (CF, KU, IF, SF: row S2)",
        ),
        UncomputedFigure(SASSI, _tables(3), "definitions of the indicators", "-", "INPUT", "models.published.beat"),
        UncomputedFigure(
            SASSI, ("Figs. 5 and 8 to 12",), "pulses, signals and spectra", _DRAWN, "NO",
            "pulse, masses, films and gain are not printed; compared in kind: tests/published/test_sassi.py",
        ),
        UncomputedFigure(
            SASSI, ("Section 9",), "degree of confidence", "> 85 %", "NO", "how it is computed is not printed"
        ),
    ]  # fmt: skip
