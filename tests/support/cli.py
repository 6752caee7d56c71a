"""Makers and checks that tests of cli share."""

from __future__ import annotations

CONFIG = """
[[bearing]]
name = "test"
designation = "6205"
[operating]
speed_hz = 30
[[source]]
name = "recording"
rate_hz = 12800
block_s = 1
[[channel]]
name = "de"
source = "recording"
column = 1
unit = "g"
bearing = "test"
band_hz = [[2000, 6000]]
"""
