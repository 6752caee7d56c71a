"""What a physicist doubts at first sight in a configuration; pure rules, shared by the commands."""

from __future__ import annotations

from collections.abc import Mapping

from monitor.config.load import Config
from monitor.config.plausible.clocks import clock_doubts
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.machine import machine_doubts
from monitor.config.plausible.rules import JudgedConfig, SourceFacts
from monitor.config.plausible.signal import signal_doubts
from monitor.config.plausible.stages import stage_doubts


def find_doubts(config: Config, facts: Mapping[str, SourceFacts] | None = None) -> list[Doubt]:
    """Return what is doubtful in the values of a configuration.

    Args:
        facts: what the files of its sources state, by name.
    """
    subject = JudgedConfig(config, facts or {})
    return [*machine_doubts(subject), *signal_doubts(subject), *stage_doubts(subject), *clock_doubts(subject)]
