"""Addresses of clusters: what is allowed, and how a missing scheduler or certificate is told."""

from __future__ import annotations

import socket

import pytest

from models.fleet import connect, open_executor
from models.fleet.connect import ClusterError, RefusedWorkerError, Remote, check_addresses, checked_address, is_loopback
from models.words.errors import WrongInputError
from models.work.folder_store import FolderStore


@pytest.mark.parametrize(
    "address",
    ["tcp://127.0.0.1:8786", "tcp://localhost:8786", "tcp://[::1]:8786", "tls://node7:8786", "tls://[fe80::1]:8786"],
)
def test_allowed_addresses(address):
    assert checked_address(address) == address
    assert checked_address(f"{address}/") == address


@pytest.mark.parametrize("host", ["10.0.0.7", "0.0.0.0", "[2001:db8::1]", "192.168.1.1"])
def test_other_machines_need_encryption(host):
    with pytest.raises(WrongInputError, match=r"dask runs what it is sent: expected tls://"):
        checked_address(f"tcp://{host}:8786")


@pytest.mark.parametrize(
    "address",
    [
        "localhost:8786",
        "tcp://127.0.0.1",
        "http://127.0.0.1:80",
        "tls://h:99999",
        "tls://h:x",
        "tls://h:1/x",
        "tls://[h:1",
    ],
)
def test_what_is_no_address_is_refused(address):
    with pytest.raises(WrongInputError, match=r"--cluster: expected tls://HOST:PORT"):
        checked_address(address)


@pytest.mark.parametrize("address", ["tls://me:planted-secret@host:8786", "tls://me:planted/secret@host:8786"])
def test_credentials_are_not_repeated(address):
    with pytest.raises(WrongInputError) as caught:
        checked_address(address)
    assert "planted" not in str(caught.value)


def test_a_name_is_loopback_where_all_its_addresses_are(monkeypatch):
    def found(host: str, _port: None) -> list:
        if host == "unknown":
            raise socket.gaierror
        addresses = {"here": ["127.0.0.1", "::1"], "mixed": ["127.0.0.1", "10.0.0.1"]}[host]
        return [(0, 0, 0, "", (address, 0)) for address in addresses]

    monkeypatch.setattr(socket, "getaddrinfo", found)
    assert is_loopback("here")
    assert not is_loopback("mixed")
    assert not is_loopback("unknown")


def test_workers_on_other_machines_need_encryption_too():
    check_addresses(["tls://10.0.0.7:1", "tcp://127.0.0.1:2"])
    with pytest.raises(RefusedWorkerError, match=r"expected tls://: tcp://10\.0\.0\.7:1$"):
        check_addresses(["tcp://127.0.0.1:2", "tcp://10.0.0.7:1"])


def test_a_negative_number_of_workers_is_refused(tmp_path):
    with pytest.raises(ValueError, match="workers must not be negative, got -1"):
        open_executor("local", -1, FolderStore(tmp_path), print)


@pytest.mark.parametrize("missing", ["distributed", "cryptography"])
def test_without_dask_the_extra_is_named(tmp_path, monkeypatch, missing):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == missing else name)
    with pytest.raises(WrongInputError, match=rf"pip install \"spallwatch\[cluster\]\" \({missing} missing\)"):
        open_executor("local", 1, FolderStore(tmp_path), print)


@pytest.mark.cluster
def test_missing_certificates_are_named():
    with pytest.raises(WrongInputError, match=r"ca-file, client\.cert .*DASK_DISTRIBUTED__COMM__TLS__CA_FILE"):
        Remote("tls://127.0.0.1:1", 0)


@pytest.mark.cluster
def test_unreadable_certificates_are_named(tmp_path):
    from dask import config

    path = tmp_path / "ca.pem"
    path.write_text("nonsense")
    tls = {f"distributed.comm.tls.{name}": str(path) for name in ("ca-file", "client.cert")}
    with (
        config.set(tls),
        pytest.raises(WrongInputError, match=r"certificates cannot be used .*ca\.pem"),
    ):
        Remote("tls://127.0.0.1:1", 0)


@pytest.mark.cluster
def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(connect, "CONNECT_S", 0.2)
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        port = held.getsockname()[1]
        with pytest.raises(ClusterError, match=f"^no dask scheduler answers at tcp://127.0.0.1:{port}: [^<>]*$"):
            Remote(f"tcp://127.0.0.1:{port}", 0).connect()


@pytest.mark.parametrize(
    ("raised", "told"),
    [
        (
            "in <distributed.comm.tcp.TCPConnector object at 0x7f>: ConnectionRefusedError: [Errno 111] refused",
            "refused",
        ),
        ("in <TLS (closed) local=a remote=b>: SSLError: [SSL: UNKNOWN_CA] unknown ca", "[SSL: UNKNOWN_CA] unknown ca"),
        ("[Errno 104] Connection reset by peer", "Connection reset by peer"),
        ("Timed out after 3 s", "Timed out after 3 s"),
        ("", "OSError"),
    ],
)
def test_causes_are_told_without_classes_and_objects(raised, told):
    assert connect._cause(OSError(raised)) == told
