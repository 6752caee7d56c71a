"""The assembled bearing against one solution with all contacts of a bearing on one mesh, in plane strain."""

import pytest

from models.fe.extra import has_extra

pytestmark = pytest.mark.skipif(not has_extra(), reason="scikit-fem is not installed")


def test_the_assembled_bearing_is_the_direct_solution():
    # Coarse meshes, which differ between both: within 0.1 % on fine ones (docs/evidence/finite-elements.md).
    from tests.oracles.plane_bearing import compared
    from tests.oracles.plane_rings import Fineness

    rows = compared(1000.0 / 5.6e-3, Fineness(columns=4, growth=2.0, largest=0.2), sinusoidal=True)
    differences = {str(row["quantity"]): float(row["difference_percent"] or 0.0) for row in rows}
    for name, difference in differences.items():
        assert abs(difference) < (1.5 if "stiffness" in name else 0.5), name
