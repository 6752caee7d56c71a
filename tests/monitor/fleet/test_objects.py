"""``spallwatch archive`` between object storages: the records of files in a folder, and no credentials anywhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import spallwatch as sw
from models.fleet.object_store import ObjectStore
from streams.types.block import STANDARD_GRAVITY
from tests.monitor.fleet.fleet_files import CONFIG, write_files
from tests.support.commands import run_command
from tests.support.effort import effort_count
from tests.support.object_storage import use_account

pytestmark = pytest.mark.cluster

RECORDS = ("days", "zarr")[effort_count(quick=0, full=1)]
"""A Zarr store has hundreds of objects."""


def replay(folder: Path, manifest: str, out: str, *options: object) -> tuple[int, str]:
    ended = run_command(
        "archive",
        "replay",
        manifest,
        "--out",
        out,
        "--records",
        RECORDS,
        "--workers",
        1,
        "--json",
        *options,
        cwd=folder,
    )
    return ended.returncode, ended.stdout + ended.stderr


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    (tmp_path / "m.toml").write_text(CONFIG)
    write_files(tmp_path / "press", 2)
    write_files(tmp_path / "fan", 1, seed=2)
    return tmp_path


def test_recordings_and_records_in_object_storage(fleet, storage, monkeypatch):
    use_account(storage.environment, monkeypatch)
    store = ObjectStore(storage.url("recorded"))
    files = [path for name in ("press", "fan") for path in sorted((fleet / name).iterdir())]
    for path in files:
        store.write(f"{path.parent.name}/{path.name}", path.read_bytes())
    signed = storage.presigned(f"recorded/fan/{files[-1].name}")
    rows = [f"press,m.toml,{store.url}/pr*", f"fan,m.toml,{signed}", f"fan,m.toml,{store.url}/lost.npy"]
    (fleet / "remote.csv").write_text("\n".join(["machine,config,recording", *rows]) + "\n")

    out = storage.url("archived")
    code, said = replay(fleet, "remote.csv", out)
    assert code == 1
    ((failed),) = json.loads(said.partition("\nspallwatch")[0])["failed"]
    assert failed["reason"] == f"{store.url}/lost.npy: there is no such object, and none below it"
    ended = run_command("archive", "status", out)
    assert (ended.returncode, "3 recordings: 2 done, 1 failed" in ended.stdout) == (0, True), ended.stderr
    store.write("lost.npy", files[0].read_bytes())
    code, resumed = replay(fleet, "remote.csv", out, "--resume")
    assert code == 0, resumed

    written = ObjectStore(out)
    if RECORDS == "zarr":
        with sw.open_archive(out) as archive:
            found = archive["rms"].to_numpy()[:, 0]
        expected = [np.std(np.load(path)) * STANDARD_GRAVITY for path in (*files, files[0])]
        assert found == pytest.approx(expected, rel=1e-6)
    else:
        one = next(name for name in written.names("press/") if name.endswith(".nc"))
        (fleet / "one.nc").write_bytes(written.read(one) or b"")
        with sw.open_records(fleet / "one.nc") as records:
            assert records["rms"].to_numpy()[0, 0] == pytest.approx(np.std(np.load(files[0])) * STANDARD_GRAVITY)

    content = {name: written.read(name) or b"" for name in written.names()}
    assert "index.db" in content
    secrets = [*storage.secrets(), signed.rpartition("=")[2]]
    assert not [name for name, data in content.items() if any(secret.encode() in data for secret in secrets)]
    assert not [secret for secret in secrets if secret in said + resumed + ended.stdout]
