"""Keys of network sources: from the file to the receiver."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import ConfigError, validate
from monitor.desk.judge.problems import find_problems
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


def test_keys_of_tcp_reach_the_source() -> None:
    files = {"stream_key_file": "press.key", "tls_cert_file": "press.pem", "tls_key_file": "tls.key"}
    loaded = config(url="tcp://127.0.0.1:5777", max_gap_blocks=7, **files)
    spec = source_spec(loaded, loaded.source[0])
    assert spec.max_gap_blocks == 7
    assert source_spec(config(), config().source[0]).max_gap_blocks == 100_000
    for key, name in files.items():
        assert getattr(spec.network, key) == Path("/etc/spallwatch") / name


def problems(**source: Any) -> str:
    found = find_problems(config(**source))
    return "\n".join(doubt.text for doubt in found if "press" in doubt.key)


def test_check_says_who_may_send_without_proof(tmp_path: Path) -> None:
    key, weak = tmp_path / "key", tmp_path / "weak"
    key.write_text("correct horse battery staple\n", encoding="utf-8")
    key.chmod(0o600)
    weak.write_text("short", encoding="utf-8")
    everywhere = {"url": "tcp://0.0.0.0:5777"}
    local = {"url": "tcp://127.0.0.1:5777"}
    assert "every user of this computer may send without a key" in problems(**local)
    assert problems(**local, stream_key_file=str(key)) == ""
    assert problems(**everywhere, stream_key_file=str(key)) == ""
    assert "run refuses it, without a key" in problems(**everywhere)
    assert "machines among peers may send without a key" in problems(**everywhere, peers=["10.1.0.0/16"])
    assert "has 5 characters" in problems(**everywhere, stream_key_file=str(weak))
    assert "cannot be read" in problems(**everywhere, stream_key_file=str(tmp_path / "gone"))
    tls = {"tls_cert_file": str(tmp_path / "gone"), "tls_key_file": str(key)}
    assert "tls_cert_file, tls_key_file cannot be used" in problems(**everywhere, stream_key_file=str(key), **tls)
    assert "who publishes" in problems(url="mqtt://broker/plant/press")
    assert problems(url="mqtt://broker/plant/press", username_file="user") == ""
    secret = {"username_file": "user", "password_file": "secret"}
    assert "password goes to the broker in the clear" in problems(url="mqtt://broker/plant/press", **secret)
    assert problems(url="mqtt://broker/plant/press", ca_file="ca", **secret) == ""
    assert problems(url="mqtt://127.0.0.1/plant/press", **secret) == ""


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ({"peers": ["10.1.0.5/16"]}, "not a network"),
        ({"max_connections": 0}, "max_connections"),
        ({"client_id": "a b"}, "client_id"),
        ({"password": "let me in"}, "unknown key"),
        ({"max_gap_blocks": 0}, "max_gap_blocks"),
        ({"stream_key_file": "key"}, "stream_key_file belongs to tcp://"),
        ({"url": "tcp://127.0.0.1:1", "tls_cert_file": "cert"}, "come together"),
    ],
)
def test_wrong_keys_are_named(source: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        config(**source)
