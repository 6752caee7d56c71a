"""The gearbox of appendix A of the thesis: its natural frequencies, which the print does not hold, and its damping.

python -m benchmarks.gear_appendix [--quick] [--json FILE]

Module and pressure angle are not printed, so that the base radii are assumed; nor is it said whether k_b is that of
one bearing or of both of a shaft. The same frequencies from springs by hand: tests/published/test_gearbox.py.
``--quick`` changes nothing.
"""

from __future__ import annotations

import numpy as np

from benchmarks.common import Row, arguments, print_table, write_json
from models.gears.published import K_MESH, appendix_train
from models.gears.train.linear import mean_state, natural_frequencies

MODULES_MM = (3.0, 4.0, 5.0, 6.0)
BEARINGS = (1.0, 2.0)
LOW, HIGH = 562.0, 2818.0
"""The range in which the appendix looks for the noise, Hz."""


def modes() -> list[Row]:
    """Return the natural frequencies of every choice, Hz."""
    rows: list[Row] = []
    for bearings in BEARINGS:
        for module in MODULES_MM:
            for profile in K_MESH:
                found = natural_frequencies(appendix_train(1e-3 * module, profile=profile, bearings=bearings))
                rows.append(
                    {
                        "bearings": bearings,
                        "module mm": module,
                        "profile": profile,
                        **{f"f{k}": float(value) for k, value in enumerate(found.frequencies) if k},
                        "in range": int(np.sum((found.frequencies > LOW) & (found.frequencies < HIGH))),
                        "least damping": float(np.nanmin(found.damping_ratios)),
                        "most damping": float(np.nanmax(found.damping_ratios)),
                    }
                )
    return rows


def change() -> list[Row]:
    """Return by how much the mean stiffness of Mod1 alone lowers the natural frequencies, %."""
    rows: list[Row] = []
    for bearings in BEARINGS:
        for module in MODULES_MM:
            both = [
                natural_frequencies(appendix_train(1e-3 * module, profile=profile, bearings=bearings)).frequencies[1:]
                for profile in K_MESH
            ]
            lower = 100.0 * (1.0 - both[1] / both[0])
            rows.append({"bearings": bearings, "module mm": module, "most %": float(lower.max())})
    return rows


def forces() -> list[Row]:
    """Return the mean forces on the supports, N: of modules, for the torque is that of Table 23."""
    rows: list[Row] = []
    for module in MODULES_MM:
        train = appendix_train(1e-3 * module)
        state = mean_state(train)
        size = {name: float(np.hypot(*force)) for name, force in state.support_force.items()}
        rows.append({"module mm": module, "mesh N": float(state.mesh_force[0]), **size})
    return rows


def main() -> None:
    """Print the tables and write the JSON file if one was asked for."""
    options = arguments("Natural frequencies of the gearbox of appendix A.")
    tables = {"natural frequencies": modes(), "change by Mod1": change(), "mean forces": forces()}
    for title, rows in tables.items():
        print_table(title, rows)
    write_json(options.json, tables)


if __name__ == "__main__":
    main()
