"""The gearbox of appendix A of Gabrielli's thesis: what follows from the figures that it prints (Tables 23 to 25).

Three wheels of 37 teeth in a row, each on a shaft of its own: nine degrees of freedom. Not printed, and chosen here:
module and pressure angle (the base radii), where the axes lie (on a line), and which stiffness each wheel rests on
(k_b, as in Table 24; two bearings carry each shaft). k_m(t) is confidential, and Eqs. 98 and 99 are missing from the
text at hand: forces and levels are therefore not compared. All three J are printed with 10^10 and read as 10^-2.
"""

from __future__ import annotations

import itertools
import math

from models.gears.sound.levels import Bands
from models.gears.teeth.mesh import MeshStiffness
from models.gears.train.linear import with_rayleigh
from models.gears.train.parts import Body, GearTrain, Mesh, Support, Wheel, alike, line_of_action
from models.published.acceptance import AcceptanceRow, Status

SOURCE = "Gabrielli 2022"
OWN = "not in the source: from its Tables 23 and 24"
SPEED = 506.4 / 60.0
"""Of all three shafts, Hz."""
POWER = 50e3
TEETH = 37
NAMES = ("1", "3", "5")
MASS = (15.88, 16.85, 10.69)
INERTIA = (2.36e-2, 5.38e-2, 1.72e-2)
K_B = 1.82e9
K_MESH = {"Baseline": 7.73e8, "Mod1": 7.26e8}
ALPHA = 1.0
BETA = {"gear 1": 1e-4, "gear 3": 5e-4, "gear 5": 6e-4, "wheel 1-wheel 3": 1e-4, "wheel 3-wheel 5": 5e-4}
"""As printed, s."""


def torque() -> float:
    """Return power over speed, N m."""
    return POWER / (2.0 * math.pi * SPEED)


def appendix_train(
    module: float, *, profile: str = "Baseline", bearings: float = 1.0, pressure_angle: float = math.radians(20.0)
) -> GearTrain:
    """Return the train of Table 24 with the mean mesh stiffness of a profile.

    Args:
        module: m; not printed.
        profile: "Baseline" or "Mod1".
        bearings: that k_b counts for each wheel.
        pressure_angle: rad; not printed.
    """
    radius = 0.5 * TEETH * module * math.cos(pressure_angle)
    stiffness = MeshStiffness.harmonic((TEETH, TEETH), K_MESH[profile], [])
    bodies = tuple(
        Body(
            f"gear {name}",
            mass,
            inertia,
            (Support(f"bearings {name}", alike(bearings * K_B)),),
            torque=-torque() if name == NAMES[-1] else 0.0,
        )
        for name, mass, inertia in zip(NAMES, MASS, INERTIA, strict=True)
    )
    meshes = tuple(
        Mesh(
            f"wheel {driver}",
            f"wheel {driven}",
            stiffness,
            line_of_action(0.0, pressure_angle, counterclockwise=driver == "1"),
        )
        for driver, driven in itertools.pairwise(NAMES)
    )
    wheels = tuple(Wheel(f"wheel {name}", f"gear {name}", TEETH, radius) for name in NAMES)
    train = GearTrain(bodies, wheels, meshes, drive="gear 1", speed=SPEED)
    return with_rayleigh(train, ALPHA, BETA)


def acceptance_rows() -> list[AcceptanceRow]:
    """Return the rows A1 to A4."""
    train = appendix_train(4e-3)
    mesh = train.mesh_frequencies()["wheel 1-wheel 3"]
    low, high = (float(Bands.between(630.0, 2500.0).edges[k]) for k in (0, -1))
    rounded = "37 x 8.4 Hz; of the exact speed 312.28 Hz"
    slip = "the text calls the band of 2500 Hz that of 2818 Hz"
    return [
        _row("A1", "Table 23", "rotational frequency", "Hz", "8.4", SPEED, "EXACT", 6e-3),
        _row("A1", "Table 23", "mesh frequency", "Hz", "310.8", mesh, "EXACT", 5e-3, rounded),
        _row("A1", "Table 23", "mesh frequency, speed rounded", "Hz", "310.8", TEETH * 8.4, "EXACT", 1e-6),
        _own("A1", "torque of the drive", "N m", "942.9", train.drive_torque(), 1e-4, "power over speed"),
        _row("A2", "Section A.3.1", "lower edge, band of 630 Hz", "Hz", "562", low, "EXACT", 1e-3),
        _row("A2", "Section A.3.1", "upper edge, band of 2500 Hz", "Hz", "2818", high, "EXACT", 1e-3, slip),
        *_gyration(),
        _row("A4", "Table 25 (text)", "mode 1, numerical against EMA", "%", "0.9", _apart(835, 828), "EXACT", 0.07),
        _row("A4", "Table 25 (text)", "mode 2, numerical against EMA", "%", "6.4", -_apart(1143, 1221), "EXACT", 0.01),
    ]


def _gyration() -> list[AcceptanceRow]:
    """Return the radii of gyration, with 10^-2, and that 10^10 is none."""
    rows = [
        _own("A3", f"radius of gyration, gear {name}", "mm", text, 1e3 * math.sqrt(inertia / mass), 0.013, "J of 10^-2")
        for name, text, mass, inertia in zip(NAMES, ("39", "57", "40"), MASS, INERTIA, strict=True)
    ]
    note = "all three J carry 10^10 for 10^-2: radii of gyration would be 39 to 57 km"
    return [*rows, AcceptanceRow("A3", f"{SOURCE}, Table 24", "J_1", "kg m2", "2.36e10", INERTIA[0], "NO", None, note)]


def _apart(obtained: float, reference: float) -> float:
    return 100.0 * (obtained / reference - 1.0)


def _row(
    test: str, place: str, quantity: str, unit: str, printed: str, obtained: float, status: Status, tolerance: float,
    note: str = "",
) -> AcceptanceRow:  # fmt: skip
    return AcceptanceRow(test, f"{SOURCE}, {place}", quantity, unit, printed, obtained, status, tolerance, note)


def _own(
    test: str, quantity: str, unit: str, printed: str, obtained: float, tolerance: float, note: str
) -> AcceptanceRow:
    return AcceptanceRow(test, OWN, quantity, unit, printed, obtained, "EXACT", tolerance, note)
