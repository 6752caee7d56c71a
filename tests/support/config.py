"""Makers and checks that tests of config share."""

from __future__ import annotations

from pathlib import Path

import pytest

from monitor.config.load import ConfigError, validate

MINIMAL = {
    "bearing": [{"name": "test", "designation": "6205"}],
    "operating": {"speed_hz": 30.0},
    "source": [{"name": "logger", "url": "folder:data", "rate_hz": 25600}],
    "channel": [{"name": "de", "source": "logger", "unit": "g", "bearing": "test"}],
}


def message(values):
    with pytest.raises(ConfigError) as caught:
        validate(values, Path("machine.toml"))
    return str(caught.value)
