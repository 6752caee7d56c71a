"""A replay of files: what is offered is accepted, rejected, ignored or pending, and repetitions take no number."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from monitor.commands import replay as replay_command
from monitor.health.record import Record
from monitor.records.store import Store
from tests.support.commands import run_command
from tests.support.small_machine import BLOCK, RATE, small_machine

CONFIG = small_machine()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    (tmp_path / "in").mkdir()
    return tmp_path


def put(folder: Path, name: str | bytes, seed: int | None) -> None:
    samples = np.zeros(BLOCK) if seed is None else np.random.default_rng(seed).standard_normal(BLOCK)
    np.save(os.fsdecode(os.fsencode(folder / "in") + b"/" + os.fsencode(name)), samples.astype(np.float32))


def replay(folder: Path, *options: str, out: str = "out") -> dict[str, Any]:
    arguments = ("replay", "in", "--config", "m.toml", "--out", out, "--json", "--no-report", *options)
    result = run_command(*arguments, cwd=folder)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    rejected = sum(summary["rejected"].values())
    assert summary["blocks"] == summary["accepted"] + rejected
    counted = summary["files"]["ignored"]
    assert summary["offered"] == summary["accepted"] + rejected + counted + summary["pending"]
    files = summary["files"]
    assert files["offered"] == files["accepted"] + files["rejected"] + files["ignored"] + files["pending"]
    return summary


def records(folder: Path, out: str = "out") -> list[Record]:
    with Store.open(folder / out / "state.db", read_only=True) as store:
        assert store.check() == []
        return list(store.records())


def test_a_replay_has_its_folder_alone_until_its_report_is_written(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(folder, "a.npy", 1)
    refused: list[str] = []
    write = replay_command.write_report

    def written(*arguments: Any) -> Path:
        refused.append(run_command("replay", "in", "--config", "m.toml", "--out", "out", "--resume").stderr)
        return write(*arguments)

    monkeypatch.setattr(replay_command, "write_report", written)
    result = run_command("replay", "in", "--config", "m.toml", "--out", "out", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert refused == ["spallwatch: --out out: another process is writing it\n"]
    assert {path.name for path in folder.iterdir()} == {"m.toml", "in", "out"}


def test_names_that_are_not_utf_8_are_escaped_in_records_and_report(folder: Path) -> None:
    put(folder, b"Pr\xfcfstand.npy", 1)
    Path(os.fsdecode(os.fsencode(folder / "in") + b"/\xe4.npy")).write_bytes(b"none")
    result = run_command("replay", "in", "--config", "m.toml", "--out", "out", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "\\xe4.npy" in result.stdout
    assert [(record.name, record.status) for record in records(folder)] == [
        ("Pr\\xfcfstand.npy", "ok"),
        ("\\xe4.npy", "unreadable"),
    ]
    assert "\\xe4.npy" in (folder / "out" / "report.html").read_text(encoding="utf-8")


def test_the_path_may_have_such_a_name_too(folder: Path) -> None:
    put(folder, b"Pr\xfcf.npy", 1)
    path = os.fsdecode(os.fsencode(folder / "in") + b"/Pr\xfcf.npy")
    result = run_command("replay", path, "--config", "m.toml", "--out", "out", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "Pr\\xfcf.npy" in (folder / "out" / "report.html").read_text(encoding="utf-8")


def test_what_was_offered_is_counted_and_named(folder: Path) -> None:
    for number in range(4):
        put(folder, f"f{number}.npy", number)
    shutil.copy(folder / "in" / "f1.npy", folder / "in" / "f9.npy")
    for name in ("dead1.npy", "dead2.npy"):
        put(folder, name, None)
    (folder / "in" / "notes.txt").write_text("words\n")
    (folder / "in" / "empty.npy").touch()
    summary = replay(folder)
    assert summary["ignored"] == {"notes.txt": "of another format than npy (*.npy)"}
    assert summary["rejected"] == {"duplicate": 1, "empty": 1}
    assert summary["flagged"] == {"flat": 2}
    assert (summary["offered"], summary["accepted"], summary["pending"]) == (9, 6, 0)
    assert summary["files"] == {"offered": 9, "accepted": 6, "rejected": 2, "ignored": 1, "pending": 0}
    assert [record.sequence for record in records(folder)] == list(range(1, 8))
    words = run_command("replay", "in", "--config", "m.toml", "--out", "again", "--no-report", cwd=folder).stdout
    assert "1 file ignored, of another format than npy (*.npy): notes.txt" in words


def test_a_limit_leaves_the_rest_pending(folder: Path) -> None:
    for number in range(4):
        put(folder, f"f{number}.npy", number)
    (folder / "in" / "notes.txt").write_text("words\n")
    summary = replay(folder, "--limit", "3")
    assert (summary["offered"], summary["blocks"], summary["pending"]) == (5, 3, 1)
    assert summary["files"] == {"offered": 5, "accepted": 3, "rejected": 0, "ignored": 1, "pending": 1}


@pytest.mark.parametrize("block_s", ['"file"', str(BLOCK / RATE)])
def test_a_resumed_replay_counts_copies_once(folder: Path, block_s: str) -> None:
    (folder / "m.toml").write_text(CONFIG.replace(f"block_s = {BLOCK / RATE}", f"block_s = {block_s}"))
    for number in range(5):
        put(folder, f"f{number}.npy", number)
        for copy in range(number % 3):
            shutil.copy(folder / "in" / f"f{number}.npy", folder / "in" / f"f{number}-{copy}.npy")
    whole = replay(folder, out="whole")
    for number in range(1, 6):
        options = ("--resume",) if number > 1 else ()
        part = replay(folder, "--limit", "1", *options, out="parts")
        assert part["accepted"] == number
    last = replay(folder, "--resume", out="parts")
    assert whole["rejected"] == last["rejected"] == {"duplicate": 4}
    assert (whole["blocks"], whole["pending"]) == (last["blocks"], last["pending"]) == (9, 0)
    assert records(folder, "whole") == records(folder, "parts")
