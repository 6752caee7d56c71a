"""The configuration of a machine with one bearing and short blocks, for tests of what is around the analysis."""

from __future__ import annotations

RATE = 2560
BLOCK = 256
"""Samples of a file, which is a block."""
BAND = "band_hz = [[500, 1200]]"


def small_machine(
    *, rate: int = RATE, block_s: str = "0.1", source: str = "", channels: int = 1, channel: str = BAND, more: str = ""
) -> str:
    """Return it as TOML.

    Args:
        rate: of the samples, Hz.
        block_s: value of that key.
        source: further lines of the source.
        channels: their number; the columns 1, 2, ... of the source.
        channel: further lines of each channel.
        more: further tables.
    """
    names = ("de", *(f"de-{number}" for number in range(2, channels + 1)))
    tables = [_CHANNEL.format(name=name, column=column, lines=channel) for column, name in enumerate(names, 1)]
    return _MACHINE.format(rate=rate, block_s=block_s, lines=source) + "".join(tables) + more


_MACHINE = """
[machine]
name = "m"
[[bearing]]
name = "test"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "s"
rate_hz = {rate}
block_s = {block_s}
{lines}
"""
_CHANNEL = """
[[channel]]
name = "{name}"
source = "s"
column = {column}
unit = "g"
bearing = "test"
{lines}
"""
