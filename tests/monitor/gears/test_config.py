"""``[gear]`` in a configuration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import Config, ConfigError, validate
from monitor.gears.config.section import GearSection
from tests.support.config import MINIMAL

TWO_STAGES: dict[str, Any] = {
    "bearing_shaft": "middle",
    "wheel": [
        {"name": "a", "teeth": 23, "shaft": "input"},
        {"name": "b", "teeth": 71, "shaft": "middle"},
        {"name": "c", "teeth": 17, "shaft": "middle"},
        {"name": "d", "teeth": 53},
    ],
    "pair": [{"wheels": ["a", "b"]}, {"wheels": ["c", "d"]}],
}
IDLER: dict[str, Any] = {
    "wheel": [{"name": name, "teeth": teeth} for name, teeth in (("a", 20), ("b", 30), ("c", 40))],
    "pair": [{"wheels": ["a", "b"]}, {"wheels": ["b", "c"]}],
}


def config_of(gear: object) -> Config:
    return validate({**MINIMAL, "gear": gear}, Path("machine.toml"))


def gear_of(gear: object) -> GearSection:
    found = config_of(gear).gear
    assert isinstance(found, GearSection)
    return found


def test_turns_follow_from_teeth_through_the_shafts() -> None:
    settings = gear_of(TWO_STAGES).to_settings()
    assert [wheel.turns for wheel in settings.wheels] == [71 / 23, 1.0, 1.0, 17 / 53]
    assert settings.mesh_orders() == (71.0, 17.0)


def test_an_idler_meshes_with_two_and_changes_no_ratio() -> None:
    settings = gear_of(IDLER).to_settings()
    assert [wheel.turns for wheel in settings.wheels] == pytest.approx([1.0, 2 / 3, 0.5])
    assert settings.mesh_orders() == (20.0,)


def changed(where: str, index: int, **values: object) -> dict[str, Any]:
    """Return the two stages with keys of one table changed; None removes a key."""
    tables = [dict(table) for table in TWO_STAGES[where]]
    tables[index] = {key: value for key, value in {**tables[index], **values}.items() if value is not None}
    return {**TWO_STAGES, where: tables}


@pytest.mark.parametrize(
    ("gear", "said"),
    [
        ({}, ["gear.wheel", "gear.pair", "missing"]),
        (changed("wheel", 0, teeth=3), ["gear.wheel[0].teeth", "greater than or equal to 4", "3"]),
        (changed("wheel", 0, teeth=None, z=23), ["gear.wheel[0].z = 23", "write teeth = 23"]),
        (changed("wheel", 1, name="a"), ["gear.wheel[1].name", "'a'", "twice"]),
        (changed("wheel", 3, shaft="middle"), ["gear.pair[1].wheels", "'c' and 'd'", "one shaft", "'middle'"]),
        (changed("wheel", 2, shaft="third"), ["gear.wheel[2].shaft", "joins", "'third'", "'middle'"]),
        (changed("pair", 1, wheels=["c", "dd"]), ["gear.pair[1].wheels", "'dd'", "a, b, c, d", "did you mean 'd'"]),
        (changed("pair", 1, wheels=["c", "c"]), ["gear.pair[1].wheels", "two wheels", "'c'"]),
        (changed("pair", 1, wheels=["b", "a"]), ["gear.pair[1].wheels", "'b' and 'a'", "given twice"]),
        (changed("pair", 1, wheels=["c"]), ["gear.pair[1].wheels"]),
        ({**TWO_STAGES, "bearing_shaft": "midle"}, ["gear.bearing_shaft", "'midle'", "did you mean 'middle'"]),
        ({**TWO_STAGES, "pair": TWO_STAGES["pair"][:1]}, ["gear.wheel[2].name", "'c'", "in no [[gear.pair]]"]),
        ({**IDLER, "pair": [*IDLER["pair"], {"wheels": ["c", "a"]}]}, ["gear.pair[2].wheels", "locks", "'c' and 'a'"]),
        ({**TWO_STAGES, "wheel": {"name": "a", "teeth": 9}}, ["gear.wheel", "write [[gear.wheel]] with double"]),
    ],
)
def test_what_cannot_turn_is_refused_with_its_place(gear: dict[str, Any], said: list[str]) -> None:
    with pytest.raises(ConfigError) as raised:
        config_of(gear)
    for words in said:
        assert words in str(raised.value)


def test_a_ring_of_four_wheels_turns_where_its_teeth_fit() -> None:
    wheels = [{"name": name, "teeth": teeth} for name, teeth in (("a", 20), ("b", 30), ("c", 40), ("d", 25))]
    pairs = [{"wheels": list(pair)} for pair in ("ab", "bc", "cd", "da")]
    assert gear_of({"wheel": wheels, "pair": pairs}).turns() == {"a": 1.0, "b": -2 / 3, "c": 0.5, "d": -0.8}


def test_a_ring_of_wheels_that_does_not_close_locks() -> None:
    ring = {**TWO_STAGES, "pair": [*TWO_STAGES["pair"], {"wheels": ["a", "d"]}]}
    with pytest.raises(ConfigError, match=r"gear.pair\[2\].wheels: the train locks: .* 'a' and 'd'"):
        config_of(ring)


def test_the_hash_names_the_gears_only_where_there_are_some() -> None:
    plain, geared = validate(MINIMAL, Path("machine.toml")), config_of(TWO_STAGES)
    assert plain.gear is None
    assert geared.hash not in (plain.hash, config_of(changed("wheel", 3, teeth=54)).hash)
