"""What a configuration removes before the envelope: ``[[interference]]``, and the meshes of ``[gear]`` unasked."""

from __future__ import annotations

from monitor.config.load import Config
from monitor.health.gears.settings import gear_interference
from monitor.health.signal.interference import Interference
from monitor.health.signal.shaft import ACCEPTED


def removed_lines(config: Config) -> tuple[Interference, ...]:
    """Return all lines that are removed, in the order of the file, those of ``[gear]`` last.

    The lines of gears are sought as far as the shaft itself is, unless its speed is exact.
    """
    found = tuple(section.to_interference() for section in config.interference)
    if config.gear is None:
        return found
    tolerance = Interference.tolerance if config.operating.speed_exact else ACCEPTED
    return found + gear_interference(config.gear.to_settings(), tolerance)
