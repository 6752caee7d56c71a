"""The installer: what it puts where, what it refuses, and what it leaves alone."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.effort import effort_count
from tests.support.installing import BACKUP, COMMON, INSTALLER, ROOT, SYSTEMD, TIMER, UNITS, directives, install

pytestmark = pytest.mark.process


def tree(folder: Path) -> dict[str, tuple[int, bytes]]:
    """Return all files and folders below one, with their rights and what they hold."""
    return {
        str(path.relative_to(folder)): (path.lstat().st_mode, path.read_bytes() if path.is_file() else b"")
        for path in sorted(folder.rglob("*"))
    }


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
