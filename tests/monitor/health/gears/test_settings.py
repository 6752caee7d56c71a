"""Which gears run beside a bearing, and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from monitor.health.gears.settings import GearPairing, GearSettings, GearWheel


def pair(driver: int, driven: int, turns: float = 1.0) -> GearSettings:
    """Return a pair whose driver makes so many turns in one of the bearing's shaft."""
    wheels = (GearWheel("pinion", driver, turns), GearWheel("wheel", driven, turns * driver / driven))
    return GearSettings(wheels, (GearPairing("pinion", "wheel"),))


@given(st.integers(5, 200), st.integers(5, 200), st.floats(0.01, 100.0))
def test_a_pair_has_one_mesh_order_and_joins_wheels_that_turn_alike(driver: int, driven: int, turns: float) -> None:
    settings = pair(driver, driven, turns)
    assert settings.mesh_orders() == pytest.approx((driver * turns,))
    assert settings.groups() == ((("pinion", "wheel"),) if driver == driven else (("pinion",), ("wheel",)))


def test_wheels_of_one_shaft_stand_together() -> None:
    wheels = (GearWheel("in", 20, 1.0), GearWheel("a", 40, 0.5), GearWheel("b", 25, 0.5), GearWheel("out", 50, 0.25))
    settings = GearSettings(wheels, (GearPairing("in", "a"), GearPairing("b", "out")))
    assert settings.mesh_orders() == (20.0, 12.5)
    assert settings.groups() == (("in",), ("a", "b"), ("out",))


def test_the_orders_of_an_idler_are_given_once() -> None:
    wheels = (GearWheel("sun", 20, 1.0), GearWheel("idler", 30, 2.0 / 3.0), GearWheel("out", 40, 0.5))
    settings = GearSettings(wheels, (GearPairing("sun", "idler"), GearPairing("idler", "out")))
    assert settings.mesh_orders() == (20.0,)


@pytest.mark.parametrize(
    ("wheels", "pairs", "said"),
    [
        ([("a", 20, 1.0), ("a", 20, 1.0)], [("a", "a")], "'a' twice"),
        ([("a", 20, 1.0), ("b", 40, 0.5)], [("a", "c")], "'c' is none of a, b"),
        ([("a", 20, 1.0), ("b", 40, 0.5)], [("a", "a"), ("a", "b")], "got one twice"),
        ([("a", 20, 1.0), ("b", 40, 0.6)], [("a", "b")], "got 20 and 24"),
        ([("a", 20, 1.0), ("b", 40, 0.5), ("c", 40, 0.5)], [("a", "b")], "'c': it must mesh"),
        ([("a|b", 20, 1.0)], [], "'a|b'"),
        ([("a", 0, 1.0)], [], "teeth must be 1 to"),
        ([("a", 20, float("nan"))], [], "turns must be positive"),
    ],
)
def test_what_does_not_fit_is_refused(
    wheels: list[tuple[str, int, float]], pairs: list[tuple[str, str]], said: str
) -> None:
    with pytest.raises(ValueError, match=said.replace("|", r"\|")):
        GearSettings(tuple(GearWheel(*one) for one in wheels), tuple(GearPairing(*one) for one in pairs))
