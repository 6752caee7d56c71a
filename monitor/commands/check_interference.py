"""What ``check`` says of ``[[interference]]``, and what it proposes for a recording."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from models.machine.bearing import kinematics
from monitor.config.interference import families_removed, words_of
from monitor.config.load import Config, ConfigError
from monitor.config.removed import removed_lines
from monitor.health.output import ChannelOutput
from monitor.health.signal.interference import Interference, all_combs
from monitor.health.signal.interference_search import Proposal, propose
from streams.types.block import Block

_DEPTH = 0.1
"""The best family of the bearing, if it is this deep, is taken for damage, named or not: its lines are not proposed."""


def interference_lines(config: Config) -> Iterator[str]:
    """Yield what is removed before the envelope."""
    for lines in removed_lines(config):
        yield f"interference {words_of(lines)}, removed before the envelope"


def taken_families(config: Config) -> Iterator[str]:
    """Yield which ``[[interference]]``, or mesh of ``[gear]``, would remove the comb of a part of a bearing."""
    speed = config.operating.speed_hz
    for place, lines in enumerate(removed_lines(config)):
        for bearing in config.bearing if speed is not None else ():
            assert speed is not None
            for fault in families_removed(lines, kinematics(bearing.to_bearing(), speed)):
                who = lines.name or f"number {place + 1}"
                yield (
                    f"interference {who}: within 2 % of the {fault} line of bearing {bearing.name!r}: "
                    "damage of that part can be removed with it"
                )


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
