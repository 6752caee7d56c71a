"""The configuration of a machine with one channel and short blocks, for tests of what is around the analysis."""

from __future__ import annotations

RATE = 2560
BLOCK = 256
"""Samples of a file, which is a block."""


def small_machine(*, block_s: str = "0.1", source: str = "", more: str = "") -> str:
    """Return it as TOML.

    Args:
        block_s: value of that key.
        source: further lines of the source.
        more: further tables.
    """
    return f"""
[machine]
name = "m"
[[bearing]]
name = "test"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "s"
rate_hz = {RATE}
block_s = {block_s}
{source}
[[channel]]
name = "de"
source = "s"
column = 1
unit = "g"
bearing = "test"
band_hz = [[500, 1200]]
{more}
"""
