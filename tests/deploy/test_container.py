"""The container file: it copies what the wheel is built of, and calls the program as it can be called.

No engine builds it here.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

from deploy.runtime_lock import BUILD_LOCK, BUILDERS, closure, locked
from deploy.runtime_lock import LOCK as LOCK_FILE
from tests.support.commands import run_command

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "deploy" / "Containerfile").read_text(encoding="utf-8").replace("\\\n", " ")

(LOCK,) = re.findall(r"^ARG LOCK=(.*)$", TEXT, re.MULTILINE)
TEXT = TEXT.replace("${LOCK}", LOCK)


def instructions(name: str) -> list[str]:
    return re.findall(rf"^{name} (.*)$", TEXT, re.MULTILINE)


def test_it_copies_all_that_the_wheel_is_built_of() -> None:
    copied = {path for line in instructions("COPY") if "--from" not in line for path in line.split()[:-1]}
    assert all((ROOT / path).exists() for path in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert {*wheel["packages"], *wheel["shared-data"], project["project"]["readme"], "LICENSE"} <= copied
    assert {"pyproject.toml", LOCK} <= copied
    assert LOCK == "deploy/requirements.lock"


def unhashed(text: str) -> list[str]:
    """Return the calls that install or fetch something that no hash names; a wheel of the build itself needs none."""
    commands = [
        part for line in re.findall(r"^(?:RUN|ADD) .*$", text, re.MULTILINE) for part in re.split(r"&&|;", line)
    ]
    fetching = [part for part in commands if re.search(r"\b(install|download|ADD|curl|wget|add-apt|apt-get)\b", part)]
    locked = re.compile(
        r"pip install .*--only-binary :all: --require-hashes --requirement /tmp/(build_)?requirements\.lock *$"
    )
    own = re.compile(r"pip install .*--no-deps /wheels/\*\.whl *$")
    return [part.strip() for part in fetching if not locked.search(part) and not own.search(part)]


def test_all_that_it_installs_is_named_by_a_hash() -> None:
    assert unhashed(TEXT) == []
    assert unhashed('RUN python -m pip install "hatchling>=1.27" && true') == [
        'RUN python -m pip install "hatchling>=1.27"'
    ]
    assert unhashed("RUN pip install --require-hashes --requirement /tmp/requirements.lock flask") != []
    assert unhashed("RUN pip install --require-hashes --requirement /tmp/requirements.lock") != []
    assert unhashed("ADD https://example.com/x /x") != []
    # Each lock file comes from the folder, and each of its packages has a hash.
    files = re.findall(r"--requirement (\S+)", TEXT)
    assert len(files) == 2
    sources = {place: source for line in instructions("COPY") for source, place in [line.split()[-2:]]}
    for file in files:
        entries = locked(ROOT / sources[file])
        assert entries
        assert all("==" in entry and "--hash=sha256:" in entry for entry in entries.values())
    assert instructions("USER") == ["spallwatch"]


def test_what_builds_the_wheel_is_that_of_the_lock_file() -> None:
    entries, all_entries = locked(BUILD_LOCK), locked(LOCK_FILE)
    assert set(entries) == set(closure(map(Requirement, BUILDERS))), "python -m deploy.runtime_lock writes it anew"
    assert entries.items() <= all_entries.items()
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert {Requirement(item).name for item in asked} <= set(entries)


def test_its_base_is_named_by_a_digest_alone() -> None:
    stages = re.findall(r"^FROM (\S+)", TEXT, re.MULTILINE)
    assert set(stages) == {"docker.io/library/python@${BASE_DIGEST}"}
    assert len(stages) == 2
    # Without a value "python@" is no name of an image: no build goes by a tag.
    assert instructions("ARG")[0] == "BASE_DIGEST"
    assert TEXT.index("ARG BASE_DIGEST") < TEXT.index("FROM ")


def test_its_commands_are_those_of_the_program() -> None:
    assert instructions("CMD") == ['["run", "--config", "/etc/spallwatch/machine.toml"]']
    for words in (("run",), ("status",), ("page",)):
        help_text = run_command(*words, "--help").stdout
        assert "--config" in help_text
    (check,) = instructions("HEALTHCHECK")
    assert '"spallwatch", "status", "--check", "--config", "/etc/spallwatch/machine.toml"' in check
    assert "--check" in run_command("status", "--help").stdout
