"""Keys of network sources: from the file to the receiver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import ConfigError, validate
from monitor.service.setup import source_spec


def config(**source: Any) -> Any:
    values = {
        "bearing": [{"name": "b", "designation": "6205"}],
        "source": [{"name": "press", "url": "mqtt://broker/plant/press", **source}],
        "channel": [{"name": "x", "source": "press", "unit": "g", "bearing": "b"}],
    }
    return validate(values, Path("/etc/spallwatch/machine.toml"))


def test_keys_reach_the_source() -> None:
    loaded = config(
        peers=["10.1.0.0/16"], max_connections=2, read_timeout_s=5, client_id="mill-1", password_file="secret"
    )
    network = source_spec(loaded, loaded.source[0]).network
    assert network is not None
    assert (network.peers, network.max_connections, network.read_timeout) == (("10.1.0.0/16",), 2, 5.0)
    assert network.client_id == "mill-1"
    assert network.password_file == Path("/etc/spallwatch/secret")
    assert network.ca_file is None


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ({"peers": ["10.1.0.5/16"]}, "not a network"),
        ({"max_connections": 0}, "max_connections"),
        ({"client_id": "a b"}, "client_id"),
        ({"password": "let me in"}, "unknown key"),
    ],
)
def test_wrong_keys_are_named(source: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config(**source)
