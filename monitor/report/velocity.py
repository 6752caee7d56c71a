"""The velocity of a channel and its zone after ISO 20816, after its last block that has one."""

from __future__ import annotations

import math

import numpy as np

from monitor.report.finding import Finding
from monitor.report.runs import Channel, Run
from monitor.words.numbers import figure
from monitor.words.statuses import VELOCITY_REFUSALS
from monitor.words.zones import MACHINE_CLASSES, MachineClass, zone_words

_QUESTION = "How much does the machine vibrate?"
_NOT_BEARINGS = "It judges the vibration of the machine, not its bearings."


def velocity_findings(run: Run, channel: Channel) -> tuple[Finding, ...]:
    """Return the velocity and its zone; nothing for records without, or where no class asks for what is missing."""
    statuses = channel.word("velocity_status")
    rows = np.flatnonzero(statuses != "")
    judged = class_of(run)
    if not rows.size:
        return ()
    row = channel.last_row("velocity_rms")
    if row is None:
        status = str(statuses[rows[-1]])
        why = VELOCITY_REFUSALS.get(status, status)
        return (Finding(_QUESTION, "No velocity.", f"{why[:1].upper()}{why[1:]}.", known=False),) if judged else ()
    velocity, floor = (1e3 * float(channel.column(name)[row]) for name in ("velocity_rms", "velocity_floor"))
    zone = str(channel.word("velocity_zone")[row])
    sentences = [f"RMS of the velocity from 10 to 1000 Hz at block {channel.sequence[row]:,}."]
    if zone and judged is not None:
        limits = ", ".join(f"{1e3 * limit:g}" for limit in judged.limits)
        sentences.append(f"{judged.text}: limits {limits} mm/s ({judged.table}). {_NOT_BEARINGS}")
    elif judged is not None:
        sentences.append("No zone: none is given at this speed, or for a block with such flags.")
    if math.isfinite(floor) and floor > 0.5 * velocity:
        sentences.append(f"{figure(floor, 2)} mm/s of it are continuous, as noise of the sensor is.")
    answer = f"{figure(velocity)} mm/s{f': {zone_words(zone)}' if zone else ''}."
    return (Finding(_QUESTION, answer, " ".join(sentences), brief=f"{figure(velocity, 2)} mm/s {zone}".strip()),)


def class_of(run: Run) -> MachineClass | None:
    """Return the class of the machine, None where none or several are stated."""
    return MACHINE_CLASSES.get(str(run.attributes.get("iso_class", "")))
