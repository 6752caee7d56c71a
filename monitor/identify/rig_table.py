"""The ``[rig]`` table that ``identify`` writes, and what an identification claims: whether the rig is calibrated and
why not, on which priors its intervals lean, and what speaks against it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.identify.evidence import SCALES
from models.identify.intervals import coordinate_derivatives
from models.identify.run import Identification
from models.identify.space import ORDER
from models.identify.volume import VolumePoint, VolumeSpread, objections, volume_spread
from models.machine.bearing import CatalogueEntry
from models.machine.contact_estimates import estimate_stiffness
from models.work.runner import Runner
from monitor.commands.common import finite
from monitor.config.bearing import RIG_KEYS, STIFFNESS_KEYS, sealed
from monitor.config.load import Config
from monitor.words.calibration import ASSUMED

if TYPE_CHECKING:
    from numpy.typing import NDArray

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


LEANS = 1.5
"""A parameter leans on a prior without which its standard deviation would be larger by this factor."""
# Information in units of the prior of a flat coordinate of the cube, so that none is infinite.
_FLAT = 12.0


def leaning(found: Identification) -> dict[str, tuple[str, ...]]:
    """Return the parameters whose uncertainty, by the information at the best fit, rests on priors, with these.

    Priors are named by their parameter. Limits of the space count as a uniform distribution between them.
    """
    problem, space = found.problem, found.space
    priors = problem.evidence.priors
    if not priors:
        return {}
    jacobian = problem.jacobian(space, found.best.point)
    transform = coordinate_derivatives(space, found.best)
    first = len(jacobian) - len(priors)
    whole = _deviations(jacobian, transform)
    leans: dict[str, list[str]] = {}
    for number, prior in enumerate(priors):
        without = _deviations(np.delete(jacobian, first + number, axis=0), transform)
        for name, before, after in zip(space.free, whole, without, strict=True):
            if after > LEANS * before:
                leans.setdefault(name, []).append(prior.name)
    return {name: tuple(priors) for name, priors in leans.items()}


def _deviations(jacobian: NDArray[np.float64], transform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard deviations of the parameters from derivatives by coordinates and those of parameters."""
    information = jacobian.T @ jacobian + _FLAT * np.eye(jacobian.shape[1])
    return np.sqrt(np.diag(transform @ np.linalg.inv(information) @ transform.T))


# Speed at which V_eq is judged where no other is known, Hz.
_SPEED = 30.0


@dataclass(frozen=True)
class IdentificationVerdict:
    """What an identification claims.

    Attributes:
        found: the identification.
        spread: of V_eq over the rigs that the data leave possible.
        why_not: why the rig may not be called calibrated, in words; nothing where it may.
        leans: priors on which the interval of a parameter leans.
    """

    found: Identification
    spread: tuple[VolumeSpread, ...]
    why_not: tuple[str, ...]
    leans: Mapping[str, tuple[str, ...]]

    def values(self, fits: bool) -> dict[str, Any]:
        """Return the keys of the answer; ``fits`` is whether the model describes the tests."""
        evidence, element = self.found.problem.evidence, self.found.space.rig.element
        return {
            "calibrated": fits and not self.why_not,
            "why_uncalibrated": list(self.why_not),
            "identification": None if self.why_not else self.found.hash,
            "peaks": len(evidence.peaks),
            "resonances": [
                {
                    "load_newton": peak.load,
                    "direction": peak.direction or None,
                    "frequency_hz": peak.frequency,
                    "damping": peak.damping,
                    "extracted": peak.extracted,
                }
                for peak in evidence.peaks
            ],
            "priors": [
                {
                    "name": key_of(prior.name, element),
                    "value": prior.value,
                    "sd": prior.sd,
                    "source": prior.source,
                    "at_least": prior.at_least,
                }
                for prior in evidence.priors
            ],
            "leans_on": {
                key_of(name, element): [key_of(each, element) for each in priors] for name, priors in self.leans.items()
            },
            "v_eq_spread": [
                {"v_eq_mm2": each.volume * 1e6, "lower": finite(each.low), "upper": finite(each.high)}
                for each in self.spread
            ],
        }


def judge(found: Identification, config: Config, entry: CatalogueEntry, runner: Runner) -> IdentificationVerdict:
    """Return what an identification claims, at the operating point of the machine or of its largest load."""
    problem = found.problem
    load = config.operating.load_newton or max(found.space.loads)
    speeds = [condition.speed for condition in problem.trials.conditions]
    speed = config.operating.speed_hz or max(speeds, default=_SPEED)
    spread = volume_spread(found, VolumePoint(load, speed, problem.evaluator.band), runner)
    element = found.space.rig.element
    assumed = config.rig.assumed_keys(geometric=element == "roller" or not config.owns_rig(entry))
    configured = {name for name in SCALES if key_of(name, element) not in assumed}
    return IdentificationVerdict(found, spread, tuple(objections(found, spread, configured)), leaning(found))


def verdict_lines(values: Mapping[str, Any]) -> Iterator[str]:
    """Yield a verdict in words."""
    for prior in values["priors"]:
        relation = "at least " if prior["at_least"] else ""
        yield f"prior of {prior['name']}: {relation}{prior['value']:.4g}, {100 * prior['sd']:.2g} % ({prior['source']})"
    for key, priors in values["leans_on"].items():
        yield f"the interval of {key} leans on the prior of {', '.join(priors)}"
    for spread in values["v_eq_spread"]:
        ends = ["beyond the map" if spread[end] is None else f"{spread[end]:.3g}" for end in ("lower", "upper")]
        yield f"V_eq for the level of {spread['v_eq_mm2']:g} mm3/mm: {' to '.join(ends)} times it, over possible rigs"
