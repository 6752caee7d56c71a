"""``spallwatch gear``: speeds, mesh orders and frequencies, hunting teeth; what names and teeth alone give."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from monitor.commands.common import InputError, finite
from monitor.config.explain import place_words
from monitor.config.load import Config, ConfigError, read_toml, sort_problems, validate
from monitor.config.positions import Place, find_lines
from monitor.gears.config.section import GearSection

_TEETH = re.compile(r"(\d{1,5})/(\d{1,5})")
_REST: dict[str, Any] = {
    "bearing": [{"name": "none", "designation": "6205"}],
    "source": [{"name": "none"}],
}
"""Sections that a configuration needs and a gear train alone has not."""


@dataclass(frozen=True)
class GearInput:
    """A configuration with gears, and where it is from.

    Attributes:
        config: that has ``gear``.
        gear: its section.
        name: of the file or the stages, for messages.
        lines: of the values in the file.
    """

    config: Config
    gear: GearSection
    name: str
    lines: Mapping[Place, int] = field(default_factory=dict[Place, int])

    @property
    def title(self) -> str:
        """What it is called in a picture: the name of the machine, where it has one."""
        machine = self.config.machine
        return machine.name if "name" in machine.model_fields_set else Path(self.name).stem

    def refusal(self, problems: Sequence[tuple[Place, str]]) -> InputError:
        """Return the error of problems at places below ``[gear]``, one line each with that of the file."""
        located = [(("gear", *place), f"{place_words(('gear', *place))}: {text}") for place, text in problems]
        return InputError(sort_problems(located, Path(self.name), self.lines))


def read_gears(path: Path | None, stages: Sequence[str]) -> GearInput:
    """Return a configuration that has gears: of a file, or of stages such as ``23/71``, one behind the other.

    The file may be that of a machine, or hold the gears alone. Without either, it is that of the working directory.

    Raises:
        ConfigError: the file cannot be used.
        InputError: it has no gears, a stage cannot be read, or both are given.
    """
    if stages and path is not None:
        raise InputError(f"{' '.join(stages)} and --config {path}: give one of them")
    if stages:
        name = " ".join(stages)
        config = _validate({"gear": _tables(stages)}, Path(name))
        assert isinstance(config.gear, GearSection)
        return GearInput(config, config.gear, name)
    if path is None:
        path = Path("config.toml")
        if not path.exists():
            raise InputError(
                "neither stages nor --config FILE were given, and there is no config.toml in the working directory; "
                "expected something like: spallwatch gear 23/71 17/53 --speed-hz 25"
            )
    elif path.is_dir():
        raise ConfigError(f"{path}: is a folder; expected the configuration of one machine")
    text, values = read_toml(path)
    config = _validate(values, path, text)
    if not isinstance(config.gear, GearSection):
        raise InputError(f"{path}: has no [gear]; expected [[gear.wheel]] with name and teeth, and [[gear.pair]]")
    return GearInput(config, config.gear, str(path), find_lines(text))


def gear_input(values: Mapping[str, Any], name: str) -> GearInput:
    """Return the gears of the tables of a configuration, or of those of gears alone.

    Raises:
        ConfigError: the tables cannot be used.
        InputError: they have no gears.
    """
    config = _validate(dict(values), Path(name))
    if not isinstance(config.gear, GearSection):
        raise InputError(f"{name}: expected a table gear with wheel and pair")
    return GearInput(config, config.gear, name)


def _validate(values: dict[str, Any], path: Path, text: str = "") -> Config:
    """Validate tables; where they are those of a gear train alone, with the sections that are not used added."""
    if "gear" in values and "source" not in values and "channel" not in values:
        values = {**_REST, **values}
        first: Any = values["bearing"][0] if isinstance(values["bearing"], list) and values["bearing"] else {}
        name = first.get("name", "none") if isinstance(first, dict) else "none"
        values["channel"] = [{"name": "none", "source": "none", "unit": "g", "bearing": name}]
    return validate(values, path, find_lines(text))


def _tables(stages: Sequence[str]) -> dict[str, Any]:
    """Return the tables of pairs that follow each other; the driven wheel of each sits on the shaft of the next."""
    wheels: list[dict[str, Any]] = []
    pairs: list[dict[str, Any]] = []
    for number, stage in enumerate(stages, start=1):
        found = _TEETH.fullmatch(stage)
        if found is None:
            raise InputError(f"{stage!r}: expected the teeth of driver and driven wheel, such as 23/71")
        for place, teeth in enumerate(found.groups()):
            name = str(len(wheels) + 1)
            wheels.append({"name": name, "teeth": int(teeth), "shaft": str(number + place)})
        pairs.append({"wheels": [wheel["name"] for wheel in wheels[-2:]]})
    return {"wheel": wheels, "pair": pairs}


def kinematic_values(gear: GearSection, speed: float | None) -> dict[str, Any]:
    """Return turns, orders and frequencies; those in Hz are None without a speed of ``gear.speed_shaft``, Hz."""
    turns = gear.turns()
    teeth, at = gear.teeth, gear.shaft_of
    return {
        "speed_shaft": gear.speed_shaft,
        "speed_hz": speed,
        "shafts": [
            {"name": name, "turns": turned, "speed_hz": _times(abs(turned), speed)} for name, turned in turns.items()
        ],
        "wheels": [
            {"name": name, "teeth": count, "shaft": at[name], "turns": abs(turns[at[name]])}
            for name, count in teeth.items()
        ],
        "pairs": [_pair_values(gear, pair.wheels, abs(turns[at[pair.wheels[0]]]), speed) for pair in gear.pair],
    }


def _pair_values(gear: GearSection, wheels: tuple[str, str], turns: float, speed: float | None) -> dict[str, Any]:
    driver, driven = wheels
    z1, z2 = gear.teeth[driver], gear.teeth[driven]
    order = z1 * turns
    return {
        "driver": driver,
        "driven": driven,
        "teeth": [z1, z2],
        "ratio": z2 / z1,
        "mesh_order": order,
        "mesh_hz": _times(order, speed),
        "sidebands_hz": [_times(turns, speed), _times(order / z2, speed)],
        "common_factor": math.gcd(z1, z2),
        "hunting_tooth_turns": [math.lcm(z1, z2) // z1, math.lcm(z1, z2) // z2],
        "hunting_tooth_hz": _times(order / math.lcm(z1, z2), speed),
    }


def _times(order: float, speed: float | None) -> float | None:
    return None if speed is None else finite(order * speed)


def kinematic_lines(values: dict[str, Any]) -> Iterator[str]:
    """Yield what :func:`kinematic_values` found, as text."""
    speed = values["speed_hz"]
    yield f"gears; orders and turns are those of shaft {values['speed_shaft']}" + _at(speed, " at {:.6g} Hz")
    for shaft in values["shafts"]:
        on = ", ".join(f"{one['name']} ({one['teeth']})" for one in values["wheels"] if one["shaft"] == shaft["name"])
        way = ", the other way" if shaft["turns"] < 0.0 else ""
        yield (
            f"shaft {shaft['name']}: turns {abs(shaft['turns']):.6g}{_at(shaft['speed_hz'], ', {:.6g} Hz')}{way}; "
            f"wheels {on or 'none'}"
        )
    for pair in values["pairs"]:
        z1, z2 = pair["teeth"]
        yield (
            f"mesh {pair['driver']}-{pair['driven']}: {z1}/{z2}, ratio {pair['ratio']:.5g}, order "
            f"{pair['mesh_order']:.6g}{_at(pair['mesh_hz'], ', {:.6g} Hz')}"
        )
        apart = [_at(one, "{:.5g} Hz") for one in pair["sidebands_hz"]]
        if speed is not None:
            yield f"  sidebands of {pair['driver']} {apart[0]} apart, of {pair['driven']} {apart[1]}"
        first, second = pair["hunting_tooth_turns"]
        how_many = f"common factor {pair['common_factor']}" if pair["common_factor"] > 1 else "no common factor"
        yield (
            f"  hunting tooth: the same two teeth meet every {first} turns of {pair['driver']}, {second} of "
            f"{pair['driven']}{_at(pair['hunting_tooth_hz'], ' ({:.4g} Hz)')}; {how_many}"
        )


def _at(value: float | None, words: str) -> str:
    return "" if value is None else words.format(value)
