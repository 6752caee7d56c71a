"""Makers and checks that tests of commands identify share."""

from __future__ import annotations

MACHINE = """
[[bearing]]
name = "test"
designation = "1205 ETN9"
[[source]]
name = "logger"
block_s = 1
rate_hz = 25600
[[channel]]
name = "casing"
source = "logger"
column = 1
unit = "g"
bearing = "test"
rms_band_hz = [0, 9500]
track = true
"""


RATE = 25600.0
