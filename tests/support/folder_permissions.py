"""Makers and checks that tests of folder permissions share."""

from __future__ import annotations

import os

BOUND = ("setpriv", "--bounding-set=-dac_override,-dac_read_search") if os.geteuid() == 0 else ()
