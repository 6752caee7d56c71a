"""The ``[rig]`` table that ``identify`` writes: its keys, its claim, and what speaks against it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from models.identify.run import Identification
from models.identify.space import ORDER
from models.machine.bearing import CatalogueEntry
from models.machine.contact_estimates import estimate_stiffness
from monitor.config.bearing import RIG_KEYS, STIFFNESS_KEYS, sealed
from monitor.config.load import Config
from monitor.words.calibration import ASSUMED

MICRO = 1e6
KEYS = {**RIG_KEYS, "clearance": "clearance_um"}
"""Keys of the configuration of the parameters that can be free, but of the contact stiffness."""
NAMES = {key: name for name, key in KEYS.items()} | dict.fromkeys(STIFFNESS_KEYS.values(), "k_c")
"""Parameters by their keys."""

MAX_SCATTER = 0.5
"""Relative standard deviation of the tests about the model beyond which a result is no calibration.

The published identification (mean differences of 17.9 % in RMS and 35.8 % in A*) lies below it.
"""
USUAL_SCATTER = 0.1
"""The same, beyond which the model and not the repetition of a test is the likelier cause."""


def key_of(name: str, element: str) -> str:
    """Return the key of the configuration of a parameter."""
    return STIFFNESS_KEYS[element] if name == "k_c" else KEYS[name]


def is_calibration(found: Identification) -> bool:
    """Return whether a result describes its tests well enough to be called calibrated."""
    return not found.noise > MAX_SCATTER


def find_warnings(found: Identification, config: Config, entry: CatalogueEntry) -> Iterator[str]:
    """Yield what speaks against a result, in sentences; ``entry`` is the bearing of the tests."""
    if found.noise > USUAL_SCATTER:
        worth = "" if is_calibration(found) else ", so that this is no calibration"
        yield (
            f"the model misses the tests by {100.0 * found.noise:.3g} %{worth}; compare units, speed_hz, sizes of the "
            "defects, the band of the RMS, and the numbers of [rig] that were not free"
        )
    space = found.space
    element = space.rig.element
    free = {key_of(name, element) for name in space.free}
    geometric = element == "roller" or not config.owns_rig(entry)
    assumed = [key for key in config.rig.assumed_keys(geometric=geometric) if key not in free]
    if assumed:
        yield f"{', '.join(assumed)}: {ASSUMED}"
    if STIFFNESS_KEYS["ball"] in assumed:
        estimate = estimate_stiffness(entry)
        yield f"{STIFFNESS_KEYS['ball']} is {estimate.value:.3g} by the geometry of the bearing"


def rig_toml(found: Identification, config: Config, bearing: str, values: Mapping[str, Any]) -> str:
    """Return the ``[rig]`` table of a result as TOML.

    Args:
        bearing: name of the bearing of the tests.
        values: the answer of the command.
    """
    element, free = found.space.rig.element, found.space.free
    lines = [
        f"# Identified from {', '.join(_grounds(values))}.",
        *(f"# Warning: {text}." for text in values["warnings"]),
        "[rig]",
        f'bearing = "{bearing}"',
    ]
    numbers: dict[str, float] = {}
    for name in ORDER:
        key, text = key_of(name, element), f"{found.best.values[name] * (MICRO if name == 'clearance' else 1.0):.12g}"
        if name == "clearance":
            if name in free:
                lines.append(f"# clearance_um = {text} belongs to [[bearing]]{_remark(key, values)}")
        elif name != "m_b" or element == "ball" or "m_b" in free or key in config.rig.model_fields_set:
            numbers[key] = float(text)
            lines.append(f"{key} = {text}{_remark(key, values)}")
    if values["calibrated"]:
        lines += ["calibrated = true", f'identification = "{sealed(found.hash, numbers)}"']
        if values["posterior"]["out"] is not None:
            name = json.dumps(Path(values["posterior"]["out"]).name)
            lines.append(f"posterior = {name}  # draws, beside this file, for the spread of maps and libraries")
        lines.append("")
    else:
        lines += ["calibrated = false", ""]
    return "\n".join(lines)


def _grounds(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield what a result rests on."""
    if values["tests"]:
        yield f"{values['tests']} tests at {values['conditions']} conditions"
    yield from (f"{len(values[name])} {name}" for name in ("resonances", "priors") if values[name])
    yield from (f"mean difference of {name} (Eq. 56) {value:.3g} %" for name, value in values["objectives"].items())


def _remark(key: str, values: Mapping[str, Any]) -> str:
    if key not in values["intervals"]:
        return ""
    low, high = values["intervals"][key]
    words = f"  # {100 * values['level']:.3g} % interval {low:.4g} to {high:.4g}"
    return words + (", undetermined" if key in values["undetermined"] else "")
