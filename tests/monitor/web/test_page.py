"""The page as a process beside a daemon: started, started again, never outliving who started it."""

from __future__ import annotations

import json
import os
import signal
import socket
import ssl
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from monitor.config.load import load_config
from monitor.config.outputs import WebSection
from monitor.service.children import ServerProcess, page_server
from tests.support.daemons import ROOT, free_port, make_machine
from tests.support.waiting import PATIENCE_S, wait_until

pytestmark = pytest.mark.process

_PARENT = """
import sys, time
from pathlib import Path
from monitor.service.children import page_server
from monitor.config.outputs import WebSection
page = page_server(Path(sys.argv[1]), WebSection(port=0), Path(sys.argv[2]))
while page.url is None:
    page.tick()
    time.sleep(0.02)
print(page.pid, page.url, flush=True)
time.sleep(60)
"""


@contextmanager
def page_process(config: Path, **web: Any) -> Iterator[ServerProcess]:
    state_dir = load_config(config).machine.state_dir
    page = page_server(config, WebSection(**{"port": 0, **web}), state_dir)
    try:
        yield page
    finally:
        page.close()


def reached(page: ServerProcess) -> bool:
    page.tick()
    return page.url is not None


def troubled(page: ServerProcess) -> bool:
    page.tick()
    return page.problem is not None


def ask(page: ServerProcess, path: str) -> dict[str, Any]:
    assert page.url is not None
    with urllib.request.urlopen(page.url + path, timeout=PATIENCE_S) as answer:
        return json.loads(answer.read())


def alive(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


def test_it_is_there_after_a_while_and_gone_at_once(tmp_path: Path) -> None:
    with page_process(make_machine(tmp_path)) as page:
        assert page.url is None
        assert page.pid is None
        wait_until(lambda: reached(page))
        assert ask(page, "readyz") == {"status": "ready"}
        assert page.problem is None
        pid = page.pid
        assert pid is not None
        page.close()
        assert not alive(pid)
        assert page.url is None
        page.tick()
        assert page.pid is None


def test_one_that_is_killed_is_started_again(tmp_path: Path) -> None:
    with page_process(make_machine(tmp_path)) as page:
        wait_until(lambda: reached(page))
        assert page.pid is not None
        os.kill(page.pid, signal.SIGKILL)
        wait_until(lambda: troubled(page))
        assert page.url is None
        assert page.problem == "the page ended unexpectedly"
        wait_until(lambda: reached(page))
        assert page.problem is None
        assert ask(page, "readyz") == {"status": "ready"}


def test_one_that_hangs_is_replaced(tmp_path: Path) -> None:
    now = [0.0]
    page = page_server(make_machine(tmp_path), WebSection(port=0), tmp_path / "state", lambda: now[0])
    try:
        wait_until(lambda: reached(page))
        pid = page.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        now[0] += 61.0
        wait_until(lambda: troubled(page))
        assert page.problem is not None
        assert "said nothing" in page.problem
        assert not alive(pid)
        now[0] += 2.0
        wait_until(lambda: reached(page))
    finally:
        page.close()


def test_it_survives_what_a_service_manager_sends_to_all(tmp_path: Path) -> None:
    with page_process(make_machine(tmp_path)) as page:
        wait_until(lambda: reached(page))
        assert page.pid is not None
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            os.kill(page.pid, number)
        assert ask(page, "readyz") == {"status": "ready"}


def test_it_ends_with_its_parent_however_that_ends(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    command = [sys.executable, "-c", _PARENT, str(config), str(tmp_path / "state")]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline().split()[0])
        assert alive(pid)
        parent.kill()
        parent.wait()
    wait_until(lambda: not alive(pid))


@pytest.mark.parametrize("spoilt", ["port", "token", "certificate"])
def test_what_keeps_it_away_is_said_and_tried_again(tmp_path: Path, spoilt: str) -> None:
    config, port = make_machine(tmp_path), free_port()
    token, keys = tmp_path / "token", {}
    token.write_text("a secret of some length\n")
    token.chmod(0o600)
    expected = ""
    if spoilt == "token":
        token.chmod(0o644)
        expected = "others may read"
    elif spoilt == "certificate":
        keys = {"cert_file": token, "key_file": token}
        expected = "cert_file"
    with page_process(config, port=port, token_file=token, **keys) as page:
        if spoilt == "port":
            expected = f"port = {port}"
            with socket.create_server(("127.0.0.1", port)):
                wait_until(lambda: troubled(page))
        else:
            wait_until(lambda: troubled(page))
        assert page.problem is not None
        assert expected in page.problem
        assert page.url is None
        token.chmod(0o600)
        if spoilt != "certificate":
            wait_until(lambda: reached(page))
            assert page.problem is None


def test_a_configuration_that_became_invalid_is_a_problem_of_the_page(tmp_path: Path) -> None:
    config = make_machine(tmp_path)
    valid = config.read_text()
    with page_process(config) as page:
        config.write_text("invalid")
        wait_until(lambda: troubled(page))
        assert page.problem is not None
        assert "m.toml" in page.problem
        config.write_text(valid)
        wait_until(lambda: reached(page))
        assert page.problem is None


def test_it_speaks_tls(tmp_path: Path) -> None:
    certificate, key = tmp_path / "cert.pem", tmp_path / "key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes"]
    more = ["-keyout", str(key), "-out", str(certificate), "-days", "2", "-subj", "/CN=localhost"]
    subprocess.run([*command, *more, "-addext", "subjectAltName=IP:127.0.0.1"], check=True, capture_output=True)
    with page_process(make_machine(tmp_path), cert_file=certificate, key_file=key) as page:
        wait_until(lambda: reached(page))
        assert page.url is not None
        assert page.url.startswith("https://")
        context = ssl.create_default_context(cafile=str(certificate))
        token = (tmp_path / "state" / "web.token").read_text().strip()
        login = urllib.request.Request(
            f"{page.url}login",
            json.dumps({"token": token}).encode(),
            {"content-type": "application/json"},
        )
        with urllib.request.urlopen(login, context=context, timeout=PATIENCE_S) as answer:
            assert answer.status == 204
            assert "Secure" in answer.headers["set-cookie"]
            assert "strict-transport-security" in answer.headers


def test_the_daemon_that_starts_it_loads_nothing_of_it(tmp_path: Path) -> None:
    wanted = "{'starlette', 'uvicorn', 'prometheus_client'}"
    program = f"import sys, monitor.service.children; print(sorted({wanted} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
