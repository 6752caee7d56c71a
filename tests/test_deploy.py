"""The service: what its units promise, what the installer puts where, and what it leaves alone."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from deploy.runtime_lock import LOCK, RUNTIME_LOCK, closure, declared, locked
from monitor.commands.backup import command as backup_command
from monitor.config.fleet import load_fleet
from monitor.config.load import load_config
from monitor.records.store import Store
from tests.effort import effort_count
from tests.faults.daemons import make_machine, start_program, status
from tests.streams.folders import csv_bytes, noise
from tests.waiting import stop, wait_until

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[1]
SYSTEMD = ROOT / "deploy" / "systemd"
COMMON = SYSTEMD / "common.conf"
UNITS = ("spallwatch@.service", "spallwatch-page.service")
BACKUP, TIMER = "spallwatch-backup@.service", "spallwatch-backup@.timer"
INSTALLER = ROOT / "deploy" / "install.sh"
GUIDE = ROOT / "docs" / "how-to" / "deployment.md"
ANALYZE = shutil.which("systemd-analyze")
_SET_MDWE, _REFUSE_EXEC_GAIN = 65, 1


def directives(unit: Path) -> list[tuple[str, str]]:
    """Return the keys and values of a unit in order, comments aside; a section is a key without value."""
    found = []
    for line in unit.read_text().splitlines():
        if line.startswith("["):
            found.append((line, ""))
        elif line and not line.startswith("#"):
            key, _, value = line.partition("=")
            found.append((key, value))
    return found


def promised() -> Iterator[tuple[str, str]]:
    """Yield the directives that the guide lists."""
    text = GUIDE.read_text().partition("compares this list with common.conf -->")[2].partition("\n\n")[0]
    for item in re.findall(r"`([^`]*)`", text):
        key, _, value = item.partition("=")
        yield key, value


def install(
    destination: Path, what: str = "install", more: Mapping[str, str] | None = None, code: int = 0
) -> subprocess.CompletedProcess[str]:
    """Run the installer, without the program unless the environment in ``more`` says otherwise."""
    known = {"PATH": os.environ["PATH"], "DESTDIR": str(destination), "PROGRAM": "no", "BUILDER": sys.executable}
    done = subprocess.run(
        [str(INSTALLER), what], env={**known, **(more or {})}, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    return done


def tree(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return all files and folders below one, with their rights and what they hold."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"")
        for path in sorted(folder.rglob("*"))
    }


def test_the_units_do_what_the_guide_promises() -> None:
    listed = list(promised())
    assert len(listed) > 40
    common = directives(COMMON)
    assert [item for item in listed if item not in common] == []
    # Nothing takes back what was promised: except for the lists, each key is there once, in the drop-in or the unit.
    for unit in UNITS:
        keys = [key for key, _ in common + directives(SYSTEMD / unit)]
        keys = [key for key in keys if key not in ("SystemCallFilter", "Environment", "[Service]")]
        assert sorted(keys) == sorted(set(keys))
    filters = [value for key, value in common if key == "SystemCallFilter"]
    assert filters == ["@system-service", "~@privileged @resources", "setpriority"]


def test_a_backup_is_made_each_day_with_options_that_exist() -> None:
    unit, other = dict(directives(SYSTEMD / BACKUP)), dict(directives(SYSTEMD / "backup.conf"))
    assert (other["Type"], other["WatchdogSec"], other["Restart"]) == ("oneshot", "0", "no")
    timer = dict(directives(SYSTEMD / TIMER))
    assert (timer["OnCalendar"], timer["Persistent"], timer["WantedBy"]) == ("daily", "yes", "timers.target")
    program, *words = unit["ExecStart"].split()
    assert (Path(program).name, words[0]) == ("spallwatch", "backup")
    known = {option for item in backup_command.params for option in item.opts}
    assert {word for word in words if word.startswith("--")} <= known
    set_here = {item.partition("=")[0] for item in unit["Environment"].split()}
    assert set(re.findall(r"\$\{(\w+)\}", unit["ExecStart"])) == set_here
    folder = re.search(r"BACKUP_DIR=/var/lib/(\S+)", unit["Environment"])
    assert folder is not None
    assert other["StateDirectory"] == folder[1]


def test_a_machine_is_never_given_up() -> None:
    assert ("Restart", "on-failure") in directives(COMMON)
    for unit in UNITS:
        assert ("StartLimitIntervalSec", "0") in directives(SYSTEMD / unit)


@pytest.mark.skipif(ANALYZE is None, reason="systemd-analyze is missing (Debian package systemd)")
def test_systemd_accepts_the_units_and_rates_them_as_the_guide_says(tmp_path: Path) -> None:
    assert ANALYZE is not None
    install(tmp_path)
    folder = tmp_path / "etc" / "systemd" / "system"
    said = re.search(r"exposure of\s+\*\*([\d.]+)\*\* of 10", GUIDE.read_text())
    assert said is not None
    for name in ("spallwatch@fan-1.service", "spallwatch-page.service", "spallwatch-backup@fan-1.service"):
        template = folder / name.replace("@fan-1", "@")
        unit = folder / name
        unit.write_text(template.read_text().replace("/opt/spallwatch/venv/bin/spallwatch", "/bin/true"))
        verified = subprocess.run([ANALYZE, "verify", str(unit)], capture_output=True, text=True, check=False)
        assert (verified.returncode, verified.stderr) == (0, "")
        command = [ANALYZE, "security", "--offline=true", "--no-pager", str(unit)]
        rated = subprocess.run(command, capture_output=True, text=True, check=False)
        found = re.search(rf"exposure level for {name}: ([\d.]+)", rated.stdout)
        assert found is not None
        # Other versions of systemd count other directives.
        assert float(found[1]) <= float(said[1]) + 0.5


def test_what_is_installed_where(tmp_path: Path) -> None:
    done = install(tmp_path)
    assert "write /etc/spallwatch/NAME.toml after /etc/spallwatch/machine.toml.example" in done.stdout
    found = tree(tmp_path)
    files = [name for name, (mode, _) in found.items() if not mode & 0o040000]
    assert files == [
        "etc/spallwatch/machine.toml.example",
        "etc/systemd/system/spallwatch-backup@.service",
        "etc/systemd/system/spallwatch-backup@.service.d/10-common.conf",
        "etc/systemd/system/spallwatch-backup@.service.d/20-backup.conf",
        "etc/systemd/system/spallwatch-backup@.timer",
        "etc/systemd/system/spallwatch-page.service",
        "etc/systemd/system/spallwatch-page.service.d/10-common.conf",
        "etc/systemd/system/spallwatch.slice",
        "etc/systemd/system/spallwatch@.service",
        "etc/systemd/system/spallwatch@.service.d/10-common.conf",
        "etc/sysusers.d/spallwatch.conf",
        "opt/spallwatch/doc/config.toml",
        "opt/spallwatch/doc/deployment.md",
    ]
    assert found["etc/spallwatch/secrets"][0] & 0o777 == 0o700
    assert all(found[name][0] & 0o777 == 0o644 for name in files)
    sources = (BACKUP, COMMON, "backup.conf", TIMER, UNITS[1], COMMON, "spallwatch.slice", UNITS[0], COMMON)
    for name, source in zip(files[1:10], sources, strict=True):
        assert (tmp_path / name).read_text() == (SYSTEMD / source).read_text()


def links(destination: Path, target: str = "multi-user") -> dict[str, str]:
    """Return the enabled units of a target below a destination and where they point."""
    folder = destination / "etc" / "systemd" / "system" / f"{target}.target.wants"
    return {path.name: str(path.readlink()) for path in sorted(folder.glob("*"))}


def test_each_configuration_is_an_enabled_service_and_the_page_is_one(tmp_path: Path) -> None:
    install(tmp_path)
    assert links(tmp_path) == {}
    config = tmp_path / "etc" / "spallwatch"
    for name in ("fan-1", "fan-2"):
        (config / f"{name}.toml").touch()
    done = install(tmp_path)
    assert "enabled: spallwatch@fan-1.service spallwatch@fan-2.service spallwatch-page.service" in done.stdout
    template = "/etc/systemd/system/spallwatch@.service"
    page = {"spallwatch-page.service": "/etc/systemd/system/spallwatch-page.service"}
    assert links(tmp_path) == {"spallwatch@fan-1.service": template, "spallwatch@fan-2.service": template} | page
    timer = f"/etc/systemd/system/{TIMER}"
    both = {"spallwatch-backup@fan-1.timer": timer, "spallwatch-backup@fan-2.timer": timer}
    assert links(tmp_path, "timers") == both
    # A file that has gone, and the service of an older version.
    (config / "fan-1.toml").unlink()
    old = tmp_path / "etc" / "systemd" / "system" / "spallwatch.service"
    old.touch()
    (old.parent / "multi-user.target.wants" / old.name).symlink_to(f"/etc/systemd/system/{old.name}")
    install(tmp_path)
    assert links(tmp_path) == {"spallwatch@fan-2.service": template} | page
    assert links(tmp_path, "timers") == {"spallwatch-backup@fan-2.timer": timer}
    assert not old.exists()
    install(tmp_path, "uninstall")
    assert links(tmp_path) == links(tmp_path, "timers") == {}


def test_a_file_name_that_no_service_can_have_is_refused(tmp_path: Path) -> None:
    install(tmp_path)
    (tmp_path / "etc" / "spallwatch" / "fan 1.toml").touch()
    before = tree(tmp_path)
    assert "fan 1.toml: expected a name of letters, digits" in install(tmp_path, code=2).stderr
    assert tree(tmp_path) == before


def test_doing_it_again_changes_nothing_and_no_configuration(tmp_path: Path) -> None:
    install(tmp_path)
    config = tmp_path / "etc" / "spallwatch"
    (config / "fan-1.toml").write_text("mine")
    (config / "secrets" / "mail_password").write_text("secret")
    (config / "secrets" / "mail_password").chmod(0o600)
    install(tmp_path)
    before = tree(tmp_path)
    install(tmp_path)
    assert tree(tmp_path) == before


def test_taking_it_away_leaves_what_is_not_its_own(tmp_path: Path) -> None:
    install(tmp_path)
    config, state = tmp_path / "etc" / "spallwatch", tmp_path / "var" / "lib" / "spallwatch" / "fan-1" / "state"
    (config / "fan-1.toml").write_text("mine")
    (config / "secrets" / "mail_password").write_text("secret")
    state.mkdir(parents=True)
    (state / "state.db").write_text("truth")
    for _ in range(2):
        install(tmp_path, "uninstall")
        assert sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()) == [
            "etc/spallwatch/fan-1.toml",
            "etc/spallwatch/secrets/mail_password",
            "var/lib/spallwatch/fan-1/state/state.db",
        ]
    assert not (tmp_path / "opt" / "spallwatch").exists()


def test_other_places_are_in_the_unit_and_the_example(tmp_path: Path) -> None:
    install(tmp_path, more={"PREFIX": "/srv/sw", "CONFIG": "/srv/sw-config"})
    folder = tmp_path / "etc" / "systemd" / "system"
    machine, page, common = (dict(directives(folder / unit)) for unit in (*UNITS, f"{UNITS[0]}.d/10-common.conf"))
    assert machine["ExecStart"] == "/srv/sw/venv/bin/spallwatch run --no-page --config /srv/sw-config/%i.toml"
    assert page["ExecStart"] == "/srv/sw/venv/bin/spallwatch page --config /srv/sw-config"
    assert common["LoadCredential"] == "secrets:/srv/sw-config/secrets"
    assert (tmp_path / "srv" / "sw-config" / "machine.toml.example").exists()
    assert not (tmp_path / "opt").exists()


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"PREFIX": "opt/sw"}, "opt/sw: expected an absolute path"),
        ({"CONFIG": "/home/me/sw"}, "/home/me/sw: the service sees no home folder"),
        ({"PREFIX": "/opt/a b"}, "/opt/a b: expected letters, digits"),
        ({"PREFIX": "/opt/a#b"}, "/opt/a#b: expected letters, digits"),
        ({"PROGRAM": "yes", "PYTHON": "/no/python"}, "/no/python"),
    ],
)
def test_what_cannot_work_is_refused_and_nothing_is_put_anywhere(
    tmp_path: Path, more: dict[str, str], said: str
) -> None:
    assert said in install(tmp_path, more=more, code=2).stderr
    assert tree(tmp_path) == {}


def test_a_python_that_the_service_cannot_see_is_refused(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text('#!/bin/sh\ncase "$2" in *base_prefix*) echo /home/me/.python ;; esac\n')
    python.chmod(0o755)
    told = install(tmp_path / "to", more={"PROGRAM": "yes", "PYTHON": str(python)}, code=2).stderr
    assert "lives in /home/me/.python, and the service sees no home folder" in told
    assert not (tmp_path / "to").exists()


def test_without_root_and_without_a_destination_it_is_refused() -> None:
    done = subprocess.run(
        ["/bin/sh", "-s", "install"],
        input=INSTALLER.read_text().replace('"$(cd "$(dirname "$0")/.." && pwd)"', "/nowhere"),
        env={"PATH": os.environ["PATH"], "PROGRAM": "no"},
        cwd="/",
        capture_output=True,
        text=True,
        check=False,
        user=65534 if os.geteuid() == 0 else None,
    )
    assert done.returncode == 2
    assert "must be run by root" in done.stderr


def test_make_hands_the_places_on() -> None:
    done = subprocess.run(
        ["make", "--dry-run", "install-service", "PREFIX=/srv/sw", "DESTDIR=/stage", "PYTHON=/usr/bin/python3"],
        cwd=ROOT,
        # The suite may itself be run by make, which would then say where it goes.
        env={name: value for name, value in os.environ.items() if name not in ("MAKEFLAGS", "MAKELEVEL")},
        capture_output=True,
        text=True,
        check=True,
    )
    called = done.stdout.splitlines()[-1]
    assert called.endswith("deploy/install.sh install")
    assert all(item in called for item in ("PREFIX='/srv/sw'", "CONFIG='/etc/spallwatch'", "DESTDIR='/stage'"))


def test_machines_after_the_example_can_be_followed_together(tmp_path: Path) -> None:
    example = (ROOT / "deploy" / "machine.toml.example").read_text()
    for name in ("fan-1", "fan-2"):
        (tmp_path / f"{name}.toml").write_text(example.replace("fan-1", name))
    fleet = load_fleet(tmp_path)
    assert [machine.config.machine.name for machine in fleet.machines] == ["fan-1", "fan-2"]
    assert fleet.machines[1].config.machine.state_dir == Path("/var/lib/spallwatch/fan-2/state")
    # What is commented out works, too.
    (tmp_path / "fan-1.toml").write_text(re.sub(r"^# (?=\[|[a-z_]+ = )", "", example, flags=re.MULTILINE))
    notify = load_config(tmp_path / "fan-1.toml").notify
    assert notify.smtp is not None
    assert str(notify.smtp.password_file) == "/run/credentials/spallwatch@fan-1.service/secrets_mail_password"


def test_the_service_gets_what_it_needs_and_no_tools_of_development() -> None:
    try:
        needed = set(closure(declared()))
    except PackageNotFoundError as error:
        pytest.fail(f"the environment lacks {error}: make setup")
    entries = locked(RUNTIME_LOCK)
    assert set(entries) == needed, "python -m deploy.runtime_lock writes it anew"
    assert entries.items() <= locked(LOCK).items()
    assert all("--hash=sha256:" in entry for entry in entries.values())
    assert {"pytest", "ruff", "basedpyright", "playwright", "hatchling"}.isdisjoint(entries)


@contextmanager
def daemon_of(config: Path, **more: Any) -> Iterator[None]:
    """Run a daemon, which must end in order."""
    daemon = start_program(config, **more)
    try:
        yield
        log = stop(daemon)
        assert daemon.returncode == 0, log
    finally:
        daemon.kill()
        daemon.communicate()


def forbid_executable_memory() -> None:
    """Make this process and its children unable to turn memory executable, as MemoryDenyWriteExecute= does."""
    if ctypes.CDLL(None, use_errno=True).prctl(_SET_MDWE, _REFUSE_EXEC_GAIN, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_MDWE)")


def test_the_daemon_works_where_no_memory_can_become_executable(tmp_path: Path) -> None:
    tried = "import mmap; mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)"
    try:
        done = subprocess.run(
            [sys.executable, "-c", tried], preexec_fn=forbid_executable_memory, capture_output=True, check=False
        )
    except subprocess.SubprocessError:
        pytest.skip("the kernel is older than 6.3 and cannot forbid it")
    assert b"PermissionError" in done.stderr
    config = make_machine(tmp_path)
    path = tmp_path / "in0" / "f1.csv"
    path.write_bytes(csv_bytes(noise(512, 1)))
    with daemon_of(config, preexec_fn=forbid_executable_memory):
        wait_until(lambda: status(config).get("blocks") == 2)
        wait_until(lambda: (tmp_path / "records" / "m-undated.nc").exists())
    with xr.open_dataset(tmp_path / "records" / "m-undated.nc") as dataset:
        assert dataset.sizes["time"] == 2


def test_a_backup_of_a_running_store_can_be_put_back(tmp_path: Path) -> None:
    config, database = make_machine(tmp_path), tmp_path / "state" / "state.db"
    (tmp_path / "in0" / "f1.csv").write_bytes(csv_bytes(noise(512, 1)))
    with daemon_of(config):
        wait_until(lambda: status(config).get("blocks") == 2)
        # What .backup of the sqlite3 shell does.
        with closing(sqlite3.connect(database)) as running, closing(sqlite3.connect(tmp_path / "copy.db")) as copy:
            running.backup(copy)
    shutil.rmtree(tmp_path / "state")
    database.parent.mkdir()
    (tmp_path / "copy.db").rename(database)
    (tmp_path / "in0" / "f2.csv").write_bytes(csv_bytes(noise(512, 2)))
    with daemon_of(config):
        # The first file is known already.
        wait_until(lambda: status(config).get("blocks") == 2)
    with Store.open(database, read_only=True) as store:
        assert [record.sequence for record in store.records()] == [1, 2, 3, 4]
        assert store.check() == []


@pytest.mark.skipif(effort_count(quick=0, full=1) == 0, reason="installs all packages: SPALLWATCH_EFFORT=full")
def test_the_program_runs_from_where_it_was_put(tmp_path: Path) -> None:
    base = "/usr/bin/python3.11" if Path("/usr/bin/python3.11").exists() else sys.executable
    more = {key: value for key, value in os.environ.items() if key.startswith(("PIP_", "HOME", "SSL_"))}
    for _ in range(2):
        install(tmp_path, more={**more, "PROGRAM": "yes", "PYTHON": base})
    program = tmp_path / "opt" / "spallwatch" / "venv"
    assert (program / "bin" / "spallwatch").read_text().startswith("#!/opt/spallwatch/venv/bin/python")
    assert (tmp_path / "usr" / "local" / "bin" / "spallwatch").readlink() == Path("/opt/spallwatch/venv/bin/spallwatch")
    assert program.with_name("venv.old").exists()
    said = subprocess.run(
        [program / "bin" / "python", "-I", "-c", "from monitor.cli import main; main()", "--version"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert said.stdout.startswith("spallwatch, version")
    install(tmp_path, "uninstall")
    assert not (tmp_path / "opt").exists() or not (tmp_path / "opt" / "spallwatch").exists()
    assert not (tmp_path / "usr" / "local" / "bin" / "spallwatch").is_symlink()
