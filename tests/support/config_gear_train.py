"""Makers and checks that tests of config gear train share."""

from __future__ import annotations

from typing import Any

NAMES = ("driver", "intermediate", "driven")


APPENDIX: dict[str, Any] = {
    "power_kw": 50.0,
    "alpha_c_per_s": 1.0,
    "beta_c_s": 1e-4,
    "shaft": [
        {"name": name, "mass_kg": mass, "inertia_kg_m2": inertia}
        for name, mass, inertia in zip(NAMES, (15.88, 16.85, 10.69), (2.36e-2, 5.38e-2, 1.72e-2), strict=True)
    ],
    "support": [{"name": f"b{n}", "shaft": name, "stiffness_newton_per_m": 1.82e9} for n, name in enumerate(NAMES)],
    "wheel": [{"name": str(n), "teeth": 37, "shaft": name} for n, name in zip((1, 3, 5), NAMES, strict=True)],
    "pair": [
        {"wheels": ["1", "3"], "module_mm": 4.0, "stiffness_newton_per_m": 7.73e8},
        {"wheels": ["3", "5"], "module_mm": 4.0, "stiffness_newton_per_m": 7.73e8, "beta_c_s": 5e-4},
    ],
}


"""The train of the appendix (Table 24, inertias with 10^-2); the module is not printed, 4 mm is ours."""


def changed(where: str, index: int, **values: object) -> dict[str, Any]:
    """Return the train with keys of one table changed; None removes a key."""
    tables = [dict(table) for table in APPENDIX[where]]
    tables[index] = {key: value for key, value in {**tables[index], **values}.items() if value is not None}
    return {**APPENDIX, where: tables}
