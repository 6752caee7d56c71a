"""Makers and checks that tests of spectra share."""

from __future__ import annotations

import re

RAW = "Acceleration, velocity, waveform"


SPECTRUM_ADDRESS = re.compile(r"/spectrum(\?|$)")
