"""What ``check`` says of the tacho of a source, of lines that are removed, and of extras that are missing."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

from models.machine.bearing import kinematics
from monitor.config.interference import families_removed, removed_lines, words_of
from monitor.config.load import Config, ConfigError
from monitor.config.plausible.doubt import Doubt
from monitor.config.plausible.rules import JudgedConfig
from monitor.config.source import SourceSection
from monitor.health.output import ChannelOutput
from monitor.health.signal.interference import Interference, all_combs
from monitor.health.signal.interference_search import Proposal, propose
from monitor.words.numbers import count
from streams.types.block import Block


@dataclass(frozen=True)
class TachoView:
    """The pulses of one block.

    Attributes:
        file: name of the block.
        status: "ok", or why the block has no angle, as in its record.
        pulses: that came.
        per_revolution: pulses of a whole turn, as they are counted.
        missing: pulses, by the repair, ``extra`` those that are too many.
        speed_min_hz: least speed of the shaft, ``speed_max_hz`` the highest; None without an angle.
    """

    file: str
    status: str
    pulses: int
    per_revolution: int
    missing: int
    extra: int
    speed_min_hz: float | None
    speed_max_hz: float | None


def tacho_view(block: Block, config: Config, section: SourceSection) -> TachoView | None:
    """Return what the tacho of a source shows in a block; None where none is configured, and none comes with it."""
    from monitor.health.signal.rotation.shaft_angle import find_rotation
    from streams.turns.tacho import edge_times

    condition = config.operating.to_condition(pulses=section.pulses is not None)
    tacho = condition.tacho
    if block.pulses is None and tacho.channel is None and not tacho.of_source:
        return None
    found = find_rotation(block, condition)
    seen = 0 if block.pulses is None else block.pulses.times.size
    if block.pulses is None and tacho.channel in block.channels:
        row = block.samples[block.channels.index(tacho.channel)]
        seen = edge_times(row, block.rate, tacho.level, falling=tacho.edge == "falling").size
    stated = block.pulses_per_revolution if block.pulses is None else block.pulses.per_revolution
    speeds = (None, None) if found.rotation is None else found.rotation.speed_range
    return TachoView(
        file=block.name,
        status=found.status or "none",
        pulses=int(seen),
        per_revolution=stated or tacho.per_revolution,
        missing=0 if found.pulses is None else found.pulses.missing,
        extra=0 if found.pulses is None else found.pulses.extra,
        speed_min_hz=speeds[0],
        speed_max_hz=speeds[1],
    )


def tacho_words(view: TachoView) -> str:
    """Return the same as a line."""
    words = f"tacho: {count(view.pulses, 'pulse')} in {view.file}, {view.per_revolution} a revolution"
    if view.speed_min_hz is not None and view.speed_max_hz is not None:
        words += f": {view.speed_min_hz:.4g} to {view.speed_max_hz:.4g} Hz"
    else:
        words += f": no angle ({view.status})"
    return f"{words}; {view.missing} missing, {view.extra} too many"


_DEPTH = 0.1
"""The best family of the bearing, if it is this deep, is taken for damage, named or not: its lines are not proposed."""


def interference_lines(config: Config) -> Iterator[str]:
    """Yield what is removed before the envelope."""
    for lines in removed_lines(config):
        yield f"interference {words_of(lines)}, removed before the envelope"


def taken_families(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield which ``[[interference]]``, or mesh of ``[gear]``, would remove the comb of a part of a bearing."""
    config = subject.config
    speed = config.operating.speed_hz
    if speed is None:
        return
    for at, lines in enumerate(removed_lines(config)):
        given = at < len(config.interference)
        place = ("interference", at) if given else ("gear",)
        for bearing in config.bearing:
            for fault in families_removed(lines, kinematics(bearing.to_bearing(), speed)):
                who = lines.name or f"number {at + 1}"
                came = (
                    f"interference {who}: within 2 % of the {fault} line of bearing {bearing.name!r}: "
                    "damage of that part can be removed with it"
                )
                yield subject.doubt("interference", "warning", place, "lines apart from those of the bearings", came)


def propose_interference(config: Config, recording: str) -> list[dict[str, Any]]:
    """Return the strong narrow lines in the bands of the first accepted block of a recording, by channel.

    Raises:
        ConfigError: the machine has several sources, the recording does not fit it, or has no accepted block.
    """
    from monitor.service.setup import accepted_blocks

    for block, outputs, settings in accepted_blocks(config, recording, "--recording"):
        return [
            {"channel": name, **_values(found)}
            for name, channel in outputs.items()
            for found in _proposals(block, name, channel, settings[name].interference)
        ]
    raise ConfigError(f"{recording}: no block of it is accepted; replay says why")


def _proposals(
    block: Block, name: str, output: ChannelOutput, configured: tuple[Interference, ...]
) -> tuple[Proposal, ...]:
    """Return the proposals of a channel; none where a part is named, whose lines and sidebands would be among them."""
    if output.naming is None or output.naming.fault is not None:
        return ()
    best = output.naming.evidence
    own = [] if best is None or best.depth < _DEPTH else [best.fundamental]
    samples = block.samples[block.channels.index(name)]
    known = all_combs(configured, output.block.speed.value)
    return propose(samples, block.rate, output.bands[output.leading], output.block.speed.value, own, known)


def _values(found: Proposal) -> dict[str, Any]:
    """Return a proposal as plain values, the frequency with its unit."""
    values = asdict(found)
    return {"fundamental_hz": values.pop("fundamental"), **values}


def proposal_words(found: dict[str, Any]) -> str:
    """Return a proposal as a line for people, with the section that would remove it."""
    order, count = found["order"], found["harmonics"]
    keys = f"lines_hz = [{found['fundamental_hz']:.1f}]" if order is None else f"orders = [{order}]"
    keys += ", harmonics = 1" if count == 1 else ""
    keys += ", sidebands = 3" if found["sidebands"] else ""
    lines = f"{count} narrow lines" if count > 1 else "a narrow line"
    return (
        f"channel {found['channel']}: {lines} at {found['fundamental_hz']:.1f} Hz with {100 * found['share']:.0f} % of "
        f"the power of its band; if not the bearing's: [[interference]] {keys}"
    )


def missing_extras(subject: JudgedConfig) -> Iterator[Doubt]:
    """Yield what to install for sections whose packages are missing; the daemon runs without them."""
    config = subject.config
    sections = (
        ("publish.mqtt", config.publish.mqtt, "mqtt", ("paho",)),
        ("publish.sparkplug", config.publish.sparkplug, "sparkplug", ("paho", "google.protobuf")),
        ("publish.opcua", config.publish.opcua, "opcua", ("asyncua",)),
        ("operating.opcua", config.operating.opcua, "opcua", ("asyncua",)),
        ("notify.mqtt", config.notify.mqtt, "mqtt", ("paho",)),
    )
    for name, section, extra, modules in sections:
        if section is not None and not all(map(_is_installed, modules)):
            came = f'[{name}] needs more packages: pip install "spallwatch[{extra}]"'
            yield subject.doubt("extra", "problem", tuple(name.split(".")), "its packages", came)


def _is_installed(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False
