"""OPC UA: a real client of the real server sees each value with its type, quality and time, and can change nothing."""

from __future__ import annotations

import asyncio
import contextlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from asyncua import ua
from asyncua.client.client import Client
from asyncua.common.node import Node
from asyncua.crypto.cert_gen import (
    dump_private_key_as_pem,
    generate_private_key,
    generate_self_signed_app_certificate,
)
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.ua.attribute_ids import AttributeIds
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from cryptography.x509.oid import ExtendedKeyUsageOID

from monitor.config.load import ConfigError
from monitor.config.machine import OpcUaCondition
from monitor.desk.judge.problems import find_problems
from monitor.service.companions import Companions
from monitor.service.neighbours.condition import follow
from monitor.service.neighbours.opcua_server import OpcUaError
from tests.monitor.service.neighbours.machines import Machine, serving
from tests.support.daemons import free_port
from tests.support.effort import effort_count
from tests.support.waiting import PATIENCE_S, wait_until


def make_rsa_certificate(folder: Path, name: str) -> tuple[Path, Path]:
    """Make a certificate of an application, which is its own authority, and its key."""
    cert, key = folder / f"{name}.pem", folder / f"{name}-key.pem"
    private = generate_private_key()
    names: list[x509.GeneralName] = [
        x509.UniformResourceIdentifier(f"urn:spallwatch:{name}"),
        x509.DNSName("localhost"),
    ]
    usage = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
    made = generate_self_signed_app_certificate(private, name, {"countryName": "IT"}, names, usage, days=2)
    key.write_bytes(dump_private_key_as_pem(private))
    cert.write_bytes(made.public_bytes(Encoding.PEM))
    return cert, key


STRANGER = {"cert": "stranger.pem", "key": "stranger-key.pem"}


class Reader:
    """A client with the values of the machine pump by their path."""

    def __init__(self, client: Client) -> None:
        self.client = client

    def node(self, path: str) -> Node:
        return self.client.get_node(ua.NodeId.from_string(f"ns=2;s=pump{path}"))

    async def value(self, path: str) -> tuple[Any, str]:
        found = await self.node(path).read_data_value(raise_on_bad_status=False)
        assert found.StatusCode is not None
        return (None if found.Value is None else found.Value.Value), found.StatusCode.name


@pytest.fixture(scope="module")
def encrypted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Machine, str, Path]]:
    """A machine whose server asks for a certificate, a name and a password."""
    folder = tmp_path_factory.mktemp("encrypted")
    # Of PEM or DER, whatever the name of the file.
    make_rsa_certificate(folder, "pump")[1].rename(folder / "pump.key")
    (folder / "trusted").mkdir()
    for name in ("client", "stranger"):
        make_rsa_certificate(folder, name)
    (folder / "client.pem").rename(folder / "trusted" / "client.pem")
    (folder / "user").write_text("scada\n")
    (folder / "password").write_text("right secret\n")
    machine = Machine(
        folder,
        f'[publish.opcua]\nurl = "opc.tcp://127.0.0.1:{free_port()}/pump"\n'
        'cert_file = "pump.pem"\nkey_file = "pump.key"\ntrusted_dir = "trusted"\n'
        'username_file = "user"\npassword_file = "password"\n',
    )
    machine.add()
    with serving(machine) as url:
        yield machine, url, folder
    machine.close()


async def connect(
    url: str, folder: Path, *, cert: str = "trusted/client.pem", key: str = "client-key.pem", password: str | None
) -> Client:
    client = Client(url, timeout=PATIENCE_S)
    client.application_uri = "urn:spallwatch:client"
    if password is not None:
        client.set_user("scada")
        client.set_password(password)
    await client.set_security(
        SecurityPolicyBasic256Sha256, str(folder / cert), str(folder / key), server_certificate=str(folder / "pump.pem")
    )
    await client.connect()
    return client


def with_client(given: tuple[Machine, str, Path], act: Callable[[Reader], Any]) -> None:
    """Run a coroutine function with a client that has all it needs."""

    async def run() -> None:
        client = await connect(given[1], given[2], password="right secret")
        try:
            await act(Reader(client))
        finally:
            await client.disconnect()

    asyncio.run(run())


def test_values_have_type_quality_and_time_and_follow_the_store(encrypted: tuple[Machine, str, Path]) -> None:
    machine = encrypted[0]

    async def act(reader: Reader) -> None:
        expected = {
            ":state": ("maintenance_required", "Good"),
            ":device_health": (4, "Good"),
            ":unacknowledged": (2, "Good"),
            "/de:fault": ("outer", "Good"),
            "/de/x:stage": ("final", "Good"),
            "/de/x:t_fs_block": (1, "Good"),
            "/de/x:tt_s": (3600.0, "Good"),
            "/de/x:edv_status": ("widened", "Good"),
            # The status of the value has a reservation.
            "/de/x:v_eq_mm2": (pytest.approx(0.02), "UncertainSubNormal"),
            # There is none, and the status says why.
            "/de/y:v_eq_mm2": (None, "BadNoData"),
            "/de/y:edv_status": ("not_final_stage", "Good"),
            # It was measured, and nothing has come since.
            "/de/y:rms_g": (pytest.approx(1.0), "UncertainLastUsableValue"),
            "/de/y:device_health": (1, "Good"),
        }
        assert {path: await reader.value(path) for path in expected} == expected
        level = await reader.node("/de/x:rms_g").read_data_value()
        assert level.SourceTimestamp is not None
        assert level.SourceTimestamp.isoformat().startswith(f"2026-09-21T14:13:{20 + machine.last}")
        # By their names a client finds them, too.
        found = await reader.client.nodes.objects.get_child(["2:pump", "2:de", "2:x", "2:rms_g"])
        assert found.nodeid == reader.node("/de/x:rms_g").nodeid
        assert await found.read_data_type_as_variant_type() == ua.VariantType.Double

        news: asyncio.Queue[float] = asyncio.Queue()

        class Handler:
            def datachange_notification(self, node: Node, val: float, data: Any) -> None:
                news.put_nowait(val)

        subscription = await reader.client.create_subscription(50, Handler())
        await subscription.subscribe_data_change(reader.node("/de/x:rms_g"))
        assert await asyncio.wait_for(news.get(), PATIENCE_S) == pytest.approx(machine.last)
        machine.add(status="clipped", flags=("clipped",), reason="the sensor was at its limit")
        assert await asyncio.wait_for(news.get(), PATIENCE_S) == pytest.approx(machine.last)
        assert (await reader.value("/de/x:rms_g"))[1] == "UncertainSubNormal"
        assert await reader.value("/de/x:flags") == ("clipped", "Good")

    with_client(encrypted, act)


def test_nothing_can_be_changed(encrypted: tuple[Machine, str, Path]) -> None:
    async def act(reader: Reader) -> None:
        node = reader.node("/de/x:rms_g")
        before = await reader.value("/de/x:rms_g")
        for attempt in (
            node.write_value(0.0),
            node.write_attribute(AttributeIds.DisplayName, ua.DataValue(ua.Variant(ua.LocalizedText("z")))),
            reader.client.nodes.objects.add_object(2, "mine"),
            reader.client.delete_nodes([node]),
            node.set_writable(),
        ):
            with pytest.raises(ua.UaStatusCodeError):
                await attempt
        assert await reader.value("/de/x:rms_g") == before

    with_client(encrypted, act)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"password": "wrong"}, ua.uaerrors.BadUserAccessDenied),
        ({"password": None}, ua.uaerrors.BadIdentityTokenRejected),
        (
            {"password": "right secret", "cert": "stranger.pem", "key": "stranger-key.pem"},
            ua.uaerrors.BadCertificateUntrusted,
        ),
    ],
    ids=["a wrong password", "no password", "an unknown certificate"],
)
def test_who_is_not_known_is_refused(
    encrypted: tuple[Machine, str, Path], given: dict[str, Any], expected: type[Exception]
) -> None:
    _, url, folder = encrypted

    async def run() -> None:
        with pytest.raises(expected):
            await connect(url, folder, **given)

    asyncio.run(run())


def test_the_client_for_speed_and_load_reads_over_an_encrypted_connection(
    encrypted: tuple[Machine, str, Path],
) -> None:
    machine, url, folder = encrypted
    keys: dict[str, Any] = {
        "url": url,
        "speed_node": "ns=2;s=pump/de/x:t_fs_block",
        "speed_scale": 25.0,
        "username_file": folder / "user",
        "password_file": folder / "password",
        "cert_file": folder / "trusted" / "client.pem",
        # PEM or DER whatever the name.
        "key_file": (folder / "client-key.pem").rename(folder / "client.secret"),
        "server_cert_file": folder / "pump.pem",
    }
    heard: list[dict[str, Any]] = []

    async def first(**more: Any) -> dict[str, Any]:
        heard.clear()
        task = asyncio.create_task(follow(OpcUaCondition(**keys | more), heard.append))
        async with asyncio.timeout(PATIENCE_S):
            while not heard and not task.done():
                await asyncio.sleep(0.01)
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task
        return heard[0]

    try:
        assert asyncio.run(first())["reading"][1:] == [25.0, None]
        (folder / "wrong").write_text("wrong\n")
        refused = asyncio.run(first(password_file=folder / "wrong"))["problem"]
        assert "BadUserAccessDenied" in refused
        assert "wrong" not in refused
        with pytest.raises(OpcUaError, match="cannot be used"):
            asyncio.run(first(key_file=folder / "user"))
    finally:
        (folder / "client.secret").rename(folder / "client-key.pem")
    assert machine.last >= 1


def test_without_encryption_there_is_no_way_in(encrypted: tuple[Machine, str, Path]) -> None:
    async def run() -> None:
        client = Client(encrypted[1], timeout=PATIENCE_S)
        with pytest.raises(ua.UaError, match="No matching endpoints"):
            await client.connect()

    asyncio.run(run())


def test_without_the_library_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine(tmp_path, "[publish.opcua]\n")
    monkeypatch.setitem(sys.modules, "asyncua.server.server", None)
    monkeypatch.delitem(sys.modules, "monitor.service.neighbours.opcua_front", raising=False)
    with pytest.raises(OpcUaError, match=r'pip install "spallwatch\[opcua\]"'), serving(machine):
        pass
    machine.close()


@pytest.mark.process
@pytest.mark.skipif(effort_count(quick=0, full=1) == 0, reason="starts for seconds: SPALLWATCH_EFFORT=full")
def test_a_daemon_serves_it_beside_its_own_thread(tmp_path: Path) -> None:
    url = f"opc.tcp://127.0.0.1:{free_port()}"
    machine = Machine(tmp_path, f'[publish.opcua]\nurl = "{url}"\n')
    machine.add()
    companions = Companions(machine.config, machine.store, machine.path)

    def answers() -> bool:
        companions.tick(room=False)
        with contextlib.suppress(ConnectionError, TimeoutError):
            return asyncio.run(read_level()) == pytest.approx(1.0)
        return False

    async def read_level() -> float:
        async with Client(url, timeout=PATIENCE_S) as client:
            return await Reader(client).node("/de/x:rms_g").read_value()

    try:
        wait_until(answers)
        assert companions.problems() == {}
    finally:
        companions.end(room=False)
        companions.close()
        machine.close()


def test_check_says_what_to_install_and_that_the_speed_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    more = '[publish.opcua]\n[publish.sparkplug]\nurl = "mqtt://127.0.0.1/plant"\n'
    more += '[operating.opcua]\nurl = "opc.tcp://127.0.0.1"\nspeed_node = "i=5"\n'
    machine = Machine(tmp_path, more)
    machine.close()
    assert list(find_problems(machine.config)) == []
    missing = {"asyncua", "google.protobuf"}
    monkeypatch.setattr("monitor.desk.judge.sections._is_installed", lambda name: name not in missing)
    problems = list(find_problems(machine.config))
    assert [doubt.came.partition(" needs")[0] for doubt in problems] == [
        "[publish.sparkplug]",
        "[publish.opcua]",
        "[operating.opcua]",
    ]
    assert problems[0].came.endswith('pip install "spallwatch[sparkplug]"')


def test_what_cannot_be_served_is_a_sentence_without_secrets(tmp_path: Path) -> None:
    (tmp_path / "user").write_text("scada\n")
    (tmp_path / "password").write_text("\n")
    (tmp_path / "pump.pem").write_text("none")
    machine = Machine(
        tmp_path,
        '[publish.opcua]\ncert_file = "pump.pem"\nkey_file = "pump.pem"\n'
        'username_file = "user"\npassword_file = "password"\n',
    )
    with pytest.raises(OpcUaError, match=r"first line of .*password is empty"), serving(machine):
        pass
    machine.close()


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ('url = "opc.tcp://0.0.0.0:4840"', "username_file and password_file, or anonymous = true"),
        ('url = "opc.tcp://me:pw@127.0.0.1"', "a name or password does not belong here"),
        ('url = "http://127.0.0.1:4840"', "url"),
        ('username_file = "u"\npassword_file = "p"', "password_file needs cert_file"),
        ('cert_file = "c"', "cert_file and key_file come together"),
        ('trusted_dir = "t"', "trusted_dir needs cert_file"),
        (
            'cert_file = "c"\nkey_file = "k"\nusername_file = "u"\npassword_file = "p"\nanonymous = true',
            "anonymous = true and username_file",
        ),
    ],
)
def test_a_section_that_would_let_others_in_is_refused(tmp_path: Path, lines: str, expected: str) -> None:
    machine = Machine(tmp_path, f"[publish.opcua]\n{lines}\n")
    machine.close()
    with pytest.raises(ConfigError, match=expected) as found:
        _ = machine.config
    assert ":pw" not in str(found.value)
