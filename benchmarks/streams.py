"""Live streams: what a channel costs, how long a block takes to its record, how many channels one machine carries.

    python -m benchmarks.streams [--quick] [--json FILE]

64 channels of 25.6 kHz come over TCP from another process as eight streams of eight channels (float32, blocks of 5 s,
evenly staggered) and go through the whole line: frame, quality, features, detection, naming, store. The delay is taken
by the sender, from the first byte of a block to the acknowledgement of its commit. The store is on a disk that honours
fsync; on one that does not the commit costs less than it should.

The same blocks sent as fast as they are taken say how many channels could be carried, and the time of each part, on one
block of eight channels, says what limits them.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from google_crc32c import value as crc32c

from benchmarks.common import arguments, interleaved_ms, print_table, write_json
from monitor.config.load import Config, validate
from monitor.health.state import SourceSettings
from monitor.records.ledger import StoreLedger
from monitor.records.store import Store
from monitor.service.ingest import Ingest
from monitor.service.setup import source_settings
from streams.block import Block
from streams.link.arrivals import Arrivals
from streams.link.sender import TcpLink
from streams.link.tcp import TcpReceiver
from streams.link.wire import Frame, encode_frame
from streams.reblock import samples_hash
from streams.samples import Samples
from streams.spec import Address, SourceSpec
from tests.support.memory_ledger import MemoryLedger
from tests.support.steps import Steps

STREAMS, CHANNELS, RATE, SECONDS = 8, 8, 25600.0, 5.0
_SAMPLES = round(RATE * SECONDS)
_NAMES = tuple(f"c{i}" for i in range(CHANNELS))


def config(port: int) -> Config:
    """Return the machine that is watched: each stream a source, each of its channels on a bearing."""
    sources = [{"name": f"s{i}", "url": f"tcp://127.0.0.1:{port}", "rate_hz": RATE} for i in range(STREAMS)]
    channels = [
        {"name": name, "source": source["name"], "unit": "g", "bearing": "b", "band_hz": [[7000, 9000]]}
        for source in sources[:1]
        for name in _NAMES
    ]
    channels += [
        {
            "name": f"{name}-{i}",
            "column": name,
            "source": f"s{i}",
            "unit": "g",
            "bearing": "b",
            "band_hz": [[7000, 9000]],
        }
        for i in range(1, STREAMS)
        for name in _NAMES
    ]
    return validate(
        {
            "machine": {"name": "bench"},
            "bearing": [{"name": "b", "designation": "1205 ETN9"}],
            "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
            "source": sources,
            "channel": channels,
        },
        Path("bench.toml"),
    )


def _frame(sequence: int, seed: int) -> bytes:
    rng = np.random.default_rng([seed, sequence])
    values = rng.standard_normal((CHANNELS, _SAMPLES), dtype=np.float32)
    start = 1_700_000_000_000_000_000 + round(sequence * SECONDS * 1e9)
    return encode_frame(Frame(sequence, Samples(values, _NAMES, units=("g",) * CHANNELS, rate=RATE), start))


def send(port: int, blocks: int, pace: bool) -> None:
    """Be the sender: print the delay of each block, and when the first was sent and the last committed."""
    links = [TcpLink(Address("tcp", "127.0.0.1", port), f"s{i}", 120.0) for i in range(STREAMS)]
    for link in links:
        link.connect()
    delays: list[float] = []
    began = time.monotonic()
    if pace:
        # Made beforehand, so that the sender does not take the processor from the receiver.
        frames = {(n, i): _frame(n, i) for n in range(1, blocks + 1) for i in range(STREAMS)}
        print("ready", flush=True)
        sys.stdin.readline()
        began = time.monotonic()
        threads = [
            threading.Thread(target=_send_paced, args=(links[i], i, frames, blocks, delays)) for i in range(STREAMS)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    else:
        frames = {(n, i): _frame(n, i) for n in range(1, blocks + 1) for i in range(STREAMS)}
        print("ready", flush=True)
        sys.stdin.readline()
        began = time.monotonic()
        for n in range(1, blocks + 1):
            for i, link in enumerate(links):
                link.send(frames[n, i])
        for link in links:
            while (link.committed(1.0) or 0) < blocks:
                pass
    print(json.dumps({"delays": delays, "seconds": time.monotonic() - began}), flush=True)


def _send_paced(
    link: TcpLink, number: int, frames: dict[tuple[int, int], bytes], blocks: int, delays: list[float]
) -> None:
    began = time.monotonic() + number * SECONDS / STREAMS
    for n in range(1, blocks + 1):
        time.sleep(max(0.0, began + n * SECONDS - SECONDS - time.monotonic()))
        sent = time.monotonic()
        link.send(frames[n, number])
        while (link.committed(SECONDS) or 0) < n:
            pass
        delays.append(time.monotonic() - sent)


def run(blocks: int, *, pace: bool) -> dict[str, Any]:
    """Receive from another process; return its figures and the processor time spent here."""
    with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "state.db", machine="bench") as store:
        ledger = StoreLedger(store)
        machine = config(1)
        specs = [SourceSpec(f"s{i}", "tcp://127.0.0.1:0") for i in range(STREAMS)]
        receiver = TcpReceiver(specs)
        receiver.open(ledger)
        settings = {f"s{i}": _settings(machine, i) for i in range(STREAMS)}
        command = [
            sys.executable,
            "-m",
            "benchmarks.streams",
            "--send",
            str(receiver.port),
            str(blocks),
            str(int(pace)),
        ]
        with (
            Ingest(store, ledger, [receiver], settings) as ingest,
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as sender,
        ):
            if sender.stdin is None or sender.stdout is None:
                raise RuntimeError("the sender has no pipes")
            sender.stdout.readline()
            stop = threading.Event()
            before = time.process_time()
            sender.stdin.write("go\n")
            sender.stdin.flush()
            done = 0
            while done < blocks * STREAMS:
                done += ingest.step(stop) is not None
            spent = time.process_time() - before
            answer = json.loads(sender.stdout.readline())
        counts = store.counts()
    if set(counts) - {"ok"}:
        raise RuntimeError(f"not all blocks are ok: {counts}")
    return {**answer, "cpu": spent, "blocks": done}


def _settings(machine: Config, number: int) -> SourceSettings:
    found = source_settings(machine, machine.source[number]).channels.values()
    # Named as the frames name them: the allow-list of channels is not what is measured here.
    channels = [replace(channel, name=channel.name.partition("-")[0]) for channel in found]
    return SourceSettings(f"s{number}", {channel.name: channel for channel in channels}, RATE)


def real_time(blocks: int) -> dict[str, Any]:
    """Return the row of the 64 channels in real time."""
    result = run(blocks, pace=True)
    delays = np.sort(result["delays"]) * 1e3
    channel_seconds = result["blocks"] * CHANNELS * SECONDS
    return {
        "channels": STREAMS * CHANNELS,
        "seconds": result["seconds"],
        "blocks": result["blocks"],
        "cpu_ms_per_channel_s": 1e3 * result["cpu"] / channel_seconds,
        "cpu_share_of_one_core": result["cpu"] / result["seconds"],
        "delay_p50_ms": float(np.percentile(delays, 50)),
        "delay_p99_ms": float(np.percentile(delays, 99)),
        "delay_max_ms": float(delays[-1]),
    }


def capacity(blocks: int) -> dict[str, Any]:
    """Return the row of blocks as fast as they are taken."""
    result = run(blocks, pace=False)
    channel_seconds = result["blocks"] * CHANNELS * SECONDS
    return {
        "blocks": result["blocks"],
        "seconds": result["seconds"],
        "channels_carried": channel_seconds / result["seconds"],
        "mb_per_s": result["blocks"] * CHANNELS * _SAMPLES * 4e-6 / result["seconds"],
        "cpu_cores": result["cpu"] / result["seconds"],
    }


def parts(rounds: int) -> list[dict[str, Any]]:
    """Return the time of each part for one block of eight channels."""
    data = _frame(1, 0)
    rows = np.random.default_rng(0).standard_normal((CHANNELS, _SAMPLES), dtype=np.float32)
    machine = config(1)
    steps = Steps(_settings(machine, 0))
    number = 0

    def block() -> Block:
        nonlocal number
        number += 1
        return Block(rows, RATE, _NAMES, ("g",) * CHANNELS, "s0", number, "x", start=1.7e9 + SECONDS * number)

    def take() -> None:
        arrivals = Arrivals({"s0": SourceSpec("s0", "tcp://127.0.0.1:0")}, 1 << 30)
        arrivals.open(MemoryLedger())
        arrivals.take("s0", data)

    with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "state.db", machine="bench") as store:
        functions: dict[str, Callable[[], object]] = {
            "frame to block (all)": take,
            "  of it CRC-32C": lambda: crc32c(data),
            "  of it content hash": lambda: samples_hash(rows, RATE, _NAMES),
            "quality to record": lambda: steps.take(block()),
            "the same and commit": lambda: store.commit(steps.take(block()), steps.stored()),
        }
        times = interleaved_ms(functions, rounds)
    return [
        {"part": name, "ms_per_block": value, "ms_per_channel_s": value / (CHANNELS * SECONDS)}
        for name, value in times.items()
    ]


def main() -> None:
    """Print the tables, or be the sender."""
    if len(sys.argv) == 5 and sys.argv[1] == "--send":
        send(int(sys.argv[2]), int(sys.argv[3]), bool(int(sys.argv[4])))
        return
    options = arguments(__doc__ or "")
    live = real_time(4 if options.quick else 12)
    print_table("64 channels of 25.6 kHz in real time", [live])
    most = capacity(4 if options.quick else 12)
    print_table("As fast as they are taken", [most])
    pieces = parts(5 if options.quick else 30)
    print_table("One block of eight channels, processor time", pieces)
    write_json(options.json, {"real_time": live, "capacity": most, "parts": pieces})


if __name__ == "__main__":
    main()
