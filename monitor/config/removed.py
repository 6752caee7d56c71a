"""What a configuration removes before the envelope: ``[[interference]]``, and the meshes of ``[gear]`` unasked."""

from __future__ import annotations

from monitor.config.load import Config
from monitor.health.gears.interference import gear_interference
from monitor.health.spectrum.interference import Interference


def removed_lines(config: Config) -> tuple[Interference, ...]:
    """Return all lines that are removed, in the order of the file, those of ``[gear]`` last.

    The lines of gears are sought as far as the speed may be off.
    """
    found = tuple(section.to_interference() for section in config.interference)
    if config.gear is None:
        return found
    operating = config.operating
    doubt = 0.0 if operating.speed_exact else operating.speed_tolerance
    return found + gear_interference(config.gear.to_settings(), max(Interference.tolerance, doubt))
