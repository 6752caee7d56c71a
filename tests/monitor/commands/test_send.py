"""``spallwatch send``: a recording goes to a receiver, and its numbers come back."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from monitor.cli import spallwatch
from monitor.commands.common import InputError
from streams.link.sender import SendError
from streams.link.tcp import TcpReceiver
from streams.types.block import Block
from streams.types.spec import NetworkSpec, SourceError, SourceSpec
from tests.streams.tcp_peers import receiving
from tests.support.committing import committing
from tests.support.memory_ledger import MemoryLedger

CONFIG = """
[[bearing]]
name = "b"
designation = "6205"
[[source]]
name = "press"
rate_hz = 1000.0
block_s = 0.5
[[channel]]
name = "x"
source = "press"
unit = "g"
bearing = "b"
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    np.save(tmp_path / "run.npy", np.random.default_rng(0).standard_normal(3000).astype(np.float32))
    (tmp_path / "machine.toml").write_text(CONFIG, encoding="utf-8")
    return tmp_path / "run.npy"


def send(*arguments: object) -> dict[str, object]:
    result = CliRunner().invoke(spallwatch, ["send", *(str(a) for a in arguments), "--json"], catch_exceptions=False)
    assert result.exit_code == 0
    return json.loads(result.stdout)


def test_a_recording_is_sent_and_sent_on(recording: Path) -> None:
    ledger, done = MemoryLedger(), threading.Event()
    with TcpReceiver([SourceSpec("press", "tcp://127.0.0.1:0")]) as receiver:
        receiver.open(ledger)

        def work() -> None:
            while not done.is_set():
                delivery = receiver.next(0.02)
                if delivery is not None:
                    ledger.commit(delivery.item)
                    receiver.acknowledge(delivery)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            common = (
                recording,
                "--to",
                f"tcp://127.0.0.1:{receiver.port}",
                "--config",
                recording.parent / "machine.toml",
            )
            first = send(*common, "--limit", 4)
            second = send(*common)
        finally:
            done.set()
            thread.join()
    assert (first["sent"], first["acknowledged"], first["stream"]) == (4, 4, "press")
    assert (second["sent"], second["acknowledged"], second["skipped"]) == (2, 6, 4)
    assert sorted(ledger.blocks("press")) == [1, 2, 3, 4, 5, 6]


def test_a_key_is_read_from_its_file(recording: Path) -> None:
    ledger = MemoryLedger()
    key_file = recording.parent / "press.key"
    key_file.write_text("correct horse battery staple\n", encoding="utf-8")
    key_file.chmod(0o600)
    network = NetworkSpec(stream_key_file=key_file)
    with receiving(ledger, network) as receiver, committing(receiver, ledger):
        common = (recording, "--to", f"tcp://127.0.0.1:{receiver.port}", "--config", recording.parent / "machine.toml")
        assert send(*common, "--stream-key-file", key_file)["acknowledged"] == 6


def test_what_is_wrong_is_named(recording: Path) -> None:
    runner = CliRunner()
    for url, words in (("ftp://h:1", "--to"), ("mqtt://h/#", "expected tcp")):
        with pytest.raises(SourceError, match=words):
            runner.invoke(spallwatch, ["send", str(recording), "--to", url], catch_exceptions=False)
    config = ["--config", str(recording.parent / "machine.toml")]
    for url, option, other in (("mqtt://h/t", "--stream-key-file", "tcp"), ("tcp://h:1", "--ca-file", "mqtt")):
        words = f"{option} belongs to {other}://"
        with pytest.raises(InputError, match=words):
            runner.invoke(
                spallwatch,
                ["send", str(recording), "--to", url, option, str(recording), *config],
                catch_exceptions=False,
            )
    with pytest.raises(InputError, match="--stream"):
        runner.invoke(
            spallwatch,
            ["send", str(recording), "--to", "tcp://127.0.0.1:9", "--stream", "x" * 65, *config],
            catch_exceptions=False,
        )
    with pytest.raises(SendError, match="refused"):
        runner.invoke(
            spallwatch,
            ["send", str(recording), "--to", "tcp://127.0.0.1:9", "--patience-s", "0", *config],
            catch_exceptions=False,
        )


@pytest.mark.parametrize("configured", [True, False])
def test_pulses_are_sent_with_their_recording(recording: Path, configured: bool) -> None:
    pattern = "{stem}.pulses"
    (recording.parent / "run.pulses").write_text("ppr: 2\n" + "".join(f"{0.05 + 0.1 * k:.2f}\n" for k in range(30)))
    text = CONFIG.replace("block_s = 0.5", f'block_s = 0.5\npulses = "{pattern}"')
    (recording.parent / "machine.toml").write_text(text, encoding="utf-8")
    options = ("--config", recording.parent / "machine.toml")
    if not configured:
        samples = np.load(recording)
        (recording.parent / "run.csv").write_text("acc [g]\n" + "".join(f"{value:.5f}\n" for value in samples))
        recording = recording.with_suffix(".csv")
        options = ("--rate-hz", 1000, "--block-s", 0.5, "--pulses", pattern)
    ledger = MemoryLedger()
    with receiving(ledger) as receiver, committing(receiver, ledger) as items:
        values = send(recording, "--to", f"tcp://127.0.0.1:{receiver.port}", "--stream", "press", *options)
    assert (values["sent"], values["acknowledged"]) == (6, 6)
    for item in items:
        assert isinstance(item, Block)
        assert item.pulses is not None
        assert item.pulses.per_revolution == 2
        np.testing.assert_allclose(item.pulses.times, 0.05 + 0.1 * np.arange(5), atol=1e-12)
