"""The service: what its units promise, and what the installed environment holds."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from deploy.runtime_lock import DEMO, LOCK, RUNTIME_LOCK, closure, declared, demo_packages, locked
from monitor.commands.backup import command as backup_command
from monitor.config.fleet import load_fleet
from monitor.config.load import load_config
from tests.support.installing import BACKUP, COMMON, ROOT, SYSTEMD, TIMER, UNITS, directives, install

GUIDE = ROOT / "docs" / "evidence" / "robustness.md"
ANALYZE = shutil.which("systemd-analyze")


def promised() -> Iterator[tuple[str, str]]:
    """Yield the directives that the guide lists."""
    text = GUIDE.read_text().partition("compares this list with common.conf -->")[2].partition("\n\n")[0]
    for item in re.findall(r"`([^`]*)`", text):
        key, _, value = item.partition("=")
        yield key, value


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


@pytest.mark.process
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


def test_a_demo_is_set_up_with_what_it_needs_of_the_lock() -> None:
    names = DEMO.read_text().split()
    assert names == demo_packages(), "python -m deploy.runtime_lock writes it anew"
    assert set(names) <= set(locked(LOCK))
    assert {"pytest", "ruff", "basedpyright", "playwright", "gmsh", "distributed"}.isdisjoint(names)


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
