"""Files of ``deploy/cluster``: their commands are run as processes of this machine, with certificates of the script.

No container engine and no Slurm is at hand: what they would start is started here.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import ssl
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from deploy.runtime_lock import CLUSTER_LOCK, LOCK, LOCKS, closure, declared, locked
from models.words.errors import WrongInputError
from models.work.choose import open_runner
from models.work.task import Work
from tests.models.work.tasks import Shared, scaled
from tests.support.cluster_processes import LOOPBACK, free_port
from tests.support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.cluster
ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy" / "cluster"
SCALED = Work("numbers", scaled, memory=1000)
SERVICE_KEYS = {
    *("image", "build", "network_mode", "user", "init", "cap_drop", "security_opt", "healthcheck", "restart"),
    *("entrypoint", "command", "environment", "env_file", "volumes", "mem_limit", "stop_grace_period", "deploy"),
    *("profiles", "working_dir"),
}
"""Keys of a service that are used, each in the compose specification."""


@pytest.fixture(scope="module")
def tls(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tls")
    subprocess.run(["sh", str(DEPLOY / "certificates.sh"), str(folder), "2"], check=True)
    return folder


def compose(variables: Mapping[str, str]) -> dict[str, Any]:
    """Return the compose file with variables filled in, as an engine does."""
    import yaml

    def value(found: re.Match[str]) -> str:
        return variables.get(found[1], found[2] or "")

    text = (DEPLOY / "compose.yaml").read_text(encoding="utf-8")
    return yaml.safe_load(re.sub(r"\$\{(\w+)(?::-([^}]*))?\}", value, text).replace("$$", "$"))


def environment(values: Mapping[str, str], tls: Path, scratch: Path) -> dict[str, str]:
    """Return the environment of a service, with the places of this machine."""
    places = {"/tls": str(tls), "/scratch": str(scratch), "/tmp": str(scratch)}
    moved = {key: re.sub(r"^(/tls|/scratch|/tmp)", lambda found: places[found[0]], values[key]) for key in values}
    return {**os.environ, **moved, "PYTHONPATH": str(ROOT), "DASK_TEMPORARY_DIRECTORY": str(scratch)}


@contextmanager
def process(command: list[str], variables: Mapping[str, str], log: Path) -> Iterator[None]:
    """Run a command in a process group of its own; kill it at the end."""
    with log.open("ab") as file:
        child = subprocess.Popen(command, env=dict(variables), stdout=file, stderr=file, start_new_session=True)
    try:
        yield
    finally:
        os.killpg(child.pid, signal.SIGKILL)
        child.wait()


@contextmanager
def certificates(variables: Mapping[str, str], tls: Path) -> Iterator[None]:
    """Let clients of this process have the certificates that variables of the environment name."""
    from dask import config

    named = {name: value for name, value in variables.items() if name.startswith("DASK_")}
    keys = {name: name.removeprefix("DASK_").lower().replace("__", ".").replace("_", "-") for name in named}
    found: Any = config
    with found.set({keys[name]: re.sub("^/tls", str(tls), value) for name, value in named.items()}):
        yield


def test_the_services_of_compose_work_together_and_ask_for_certificates(tls: Path, tmp_path: Path) -> None:
    address = f"tls://{LOOPBACK}:{free_port()}"
    services = compose({"SCHEDULER": address, "MEMORY": "1GiB"})["services"]
    assert all(set(service) <= SERVICE_KEYS for service in services.values())
    scheduler, worker, caller = (services[name] for name in ("scheduler", "worker", "caller"))
    assert scheduler["restart"] == worker["restart"] == "always"
    python = [sys.executable, "-W", "error"]
    listen = [word if word != "8786" else address.rpartition(":")[2] for word in scheduler["command"]]
    assert scheduler["entrypoint"][0] == "python"
    kernels, start = worker["entrypoint"][2].split(" && exec ")
    assert (kernels, start) == ("spallwatch warmup --quiet", 'python -m dask worker "$@"')
    arguments = [word.replace("/scratch", str(tmp_path)) for word in worker["command"]]
    with ExitStack() as stack:
        run = [*python, *scheduler["entrypoint"][1:], "--host", LOOPBACK, *listen]
        variables = environment(scheduler["environment"], tls, tmp_path)
        stack.enter_context(process(run, variables, tmp_path / "scheduler.log"))
        run = [*python, "-m", "dask", "worker", "--host", LOOPBACK, *arguments]
        variables = environment(worker["environment"], tls, tmp_path)
        stack.enter_context(process(run, variables, tmp_path / "worker.log"))
        wait_until(lambda: _answers(address, tls))
        with pytest.raises(WrongInputError, match=r"expected certificates in dask's configuration"):
            open_runner(cluster=address, chunks=tmp_path / "chunks")
        with (
            certificates(caller["environment"], tls),
            open_runner(cluster=address, workers=1, chunks=tmp_path / "chunks") as runner,
        ):
            found = [result[0] for result in runner.run(SCALED, Shared(2.0), [1.0, 2.0])]
        assert found == [2.0, 4.0]
        assert not _answers(address, None)


def _answers(address: str, tls: Path | None) -> bool:
    """Return whether a scheduler says anything to a client of these certificates, or without one."""
    import socket

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    if tls is not None:
        context.load_cert_chain(tls / "client.pem", tls / "client.key")
    split = urlsplit(address)
    try:
        with (
            socket.create_connection((split.hostname or "", split.port or 0), 5.0) as plain,
            context.wrap_socket(plain) as encrypted,
        ):
            return bool(encrypted.recv(1))
    except OSError:
        return False


SBATCH = """#!/bin/sh
job=$(mktemp "$SLURM_FOLDER/job-XXXXXX")
cp "$1" "$job"
setsid bash "$job" >>"$job.log" 2>&1 &
echo "Submitted batch job $!"
"""
SCANCEL = """#!/bin/sh
for job in "$@"; do kill -TERM -- "-$job"; done
"""


def test_jobs_of_slurm_join_with_certificates(tls: Path, tmp_path: Path) -> None:
    import yaml
    from dask_jobqueue import slurm

    text = (DEPLOY / "jobqueue.yaml").read_text(encoding="utf-8").replace("/home/NAME/spallwatch-tls", str(tls))
    values: dict[str, Any] = yaml.safe_load(text)
    defaults = yaml.safe_load((Path(slurm.__file__).parent / "jobqueue.yaml").read_text(encoding="utf-8"))
    job = values["jobqueue"]["slurm"]
    assert set(job) <= set(defaults["jobqueue"]["slurm"])
    # A job for this machine.
    job |= {"cores": 1, "processes": 1, "memory": "2GB", "local-directory": str(tmp_path)}
    job["scheduler-options"] |= {"host": LOOPBACK, "port": free_port()}
    configuration = tmp_path / "jobqueue.yaml"
    configuration.write_text(yaml.safe_dump(values))
    for name, script in (("sbatch", SBATCH), ("scancel", SCANCEL)):
        (tmp_path / name).write_text(script)
        (tmp_path / name).chmod(0o755)
    variables = {
        **os.environ,
        "DASK_CONFIG": str(configuration),
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "SLURM_FOLDER": str(tmp_path),
        "HOME": str(tmp_path),
    }
    command = [sys.executable, "-W", "error", str(DEPLOY / "slurm.py")]
    printed = subprocess.run([*command, "--print"], env=variables, check=True, capture_output=True, text=True).stdout
    assert "#SBATCH -t 08:00:00" in printed
    assert f"--tls-key {tls}/worker.key" in printed
    with (tmp_path / "slurm.log").open("wb") as errors:
        scheduler = subprocess.Popen(
            [*command, "--jobs", "1"], env=variables, stdout=subprocess.PIPE, stderr=errors, text=True
        )
    try:
        assert scheduler.stdout is not None
        address = scheduler.stdout.readline().strip()
        assert address.startswith(f"tls://{LOOPBACK}:")
        client = {"DASK_DISTRIBUTED__COMM__TLS__CA_FILE": "/tls/ca.pem"}
        client |= {f"DASK_DISTRIBUTED__COMM__TLS__CLIENT__{part}": f"/tls/client.{end}" for part, end in _PARTS}
        with (
            certificates(client, tls),
            open_runner(cluster=address, workers=1, chunks=tmp_path / "chunks") as runner,
        ):
            assert [result[0] for result in runner.run(SCALED, Shared(3.0), [1.0, 2.0])] == [3.0, 6.0]
    finally:
        scheduler.send_signal(signal.SIGINT)
        scheduler.communicate(timeout=PATIENCE_S)
    assert scheduler.returncode == 0


_PARTS = (("CERT", "pem"), ("KEY", "key"))


def test_certificates_that_are_there_stay_and_keys_are_read_by_the_owner_only(tls: Path) -> None:
    before = {path.name: path.read_bytes() for path in tls.iterdir()}
    subprocess.run(["sh", str(DEPLOY / "certificates.sh"), str(tls)], check=True)
    assert {path.name: path.read_bytes() for path in tls.iterdir()} == before
    assert all(path.stat().st_mode & 0o077 == 0 for path in tls.glob("*.key"))


def test_certificates_that_cannot_be_made_or_used_are_named(tls: Path, tmp_path: Path) -> None:
    def refused(*arguments: str) -> str:
        run = subprocess.run(
            ["sh", str(DEPLOY / "certificates.sh"), *arguments],
            capture_output=True,
            text=True,
            check=False,
            cwd=tmp_path,
        )
        assert run.returncode != 0
        return run.stderr.strip().removeprefix("certificates.sh: ")

    assert refused("made", "1.5") == "DAYS: expected a whole number from 1, got '1.5'"
    assert not (tmp_path / "made").exists()
    folder = tmp_path / "-a folder"
    shutil.copytree(tls, folder)
    for missing in ("ca.key", "worker.pem"):
        (folder / missing).unlink()
    assert refused(folder.name) == "-a folder: ca.key is missing, which makes worker.pem; bring it here for the moment"
    (folder / "ca.pem").unlink()
    # A new authority, of which the others are not.
    assert refused(folder.name).startswith("-a folder: scheduler.pem is not of this ca.pem, or has expired; delete it")
    assert {path.suffix for path in folder.iterdir()} == {".pem", ".key"}


def test_workers_have_the_packages_of_the_lock_file() -> None:
    entries = locked(CLUSTER_LOCK)
    assert set(entries) == set(closure(declared(LOCKS[CLUSTER_LOCK]))), "python -m deploy.runtime_lock writes it anew"
    assert entries.items() <= locked(LOCK).items()
    assert {"distributed", "zarr", "s3fs"} <= set(entries)
    assert {"pytest", "moto", "dask-jobqueue"}.isdisjoint(entries)
