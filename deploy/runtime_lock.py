"""Write what a service, a worker or a build needs of the lock file, without the other tools of development.

Run as ``python -m deploy.runtime_lock`` in an environment that holds all that ``requirements.lock`` lists: what depends
on what is read from the installed packages, versions and hashes from the lock file.
"""

from __future__ import annotations

import importlib.metadata
import re
import tomllib
from collections.abc import Iterable
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parents[1]
LOCK = ROOT / "requirements.lock"
RUNTIME_LOCK = ROOT / "deploy" / "requirements.lock"
CLUSTER_LOCK = ROOT / "deploy" / "cluster" / "requirements.lock"
EXTRAS = ("hdf5", "tdms", "uff", "tables", "mqtt", "opcua", "sparkplug", "pdf")
LOCKS = {RUNTIME_LOCK: EXTRAS, CLUSTER_LOCK: ("hdf5", "tdms", "uff", "tables", "pdf", "identify", "cluster", "s3")}
"""Extras of each lock file: those that a service may need, and those that a worker may need."""
BUILD_LOCK, BUILDERS = ROOT / "deploy" / "build_requirements.lock", ("build", "hatchling")
"""What the container file builds the wheel with."""
DEMO = ROOT / "deploy" / "demo_packages.txt"
"""Names of the packages of ``requirements.lock`` that ``make demo`` installs."""
DEMO_EXTRAS, BUILDER = ("hdf5", "tdms", "uff", "mqtt"), ("editables", "hatchling")
"""Extras that the commands of the README can need, and what installs the project itself."""


def locked(path: Path) -> dict[str, str]:
    """Return the entries of a lock file by normalised name: version and hashes as they stand there."""
    entries = re.split(r"\n(?=\S)", path.read_text(encoding="utf-8").strip())
    return {canonicalize_name(entry.partition("==")[0]): entry for entry in entries if not entry.startswith("#")}


def declared(extras: Iterable[str] = EXTRAS) -> list[Requirement]:
    """Return what the project itself asks for at run time, with some extras."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    more = [item for extra in extras for item in project["optional-dependencies"][extra]]
    return [Requirement(item) for item in [*project["dependencies"], *more]]


def closure(requirements: Iterable[Requirement]) -> dict[str, set[str]]:
    """Return all packages that requirements lead to on this platform, and what each of them asks for: normalised names.

    Raises:
        PackageNotFoundError: one of them is not installed here.
    """
    seen: set[tuple[str, str]] = set()
    waiting = [(item, "", "") for item in requirements]
    found: dict[str, set[str]] = {}
    while waiting:
        item, extra, asker = waiting.pop()
        if item.marker is not None and not item.marker.evaluate({"extra": extra}):
            continue
        name = canonicalize_name(item.name)
        found.setdefault(name, set())
        # An extra of a package may name the package itself, with other extras.
        if asker not in ("", name):
            found[asker].add(name)
        for wanted in ("", *item.extras):
            if (name, wanted) not in seen:
                seen.add((name, wanted))
                waiting += [(Requirement(text), wanted, name) for text in importlib.metadata.requires(name) or ()]
    return found


def demo_packages() -> list[str]:
    """Return the names of the packages that ``make demo`` installs."""
    return sorted(set(closure([*declared(DEMO_EXTRAS), *map(Requirement, BUILDER)])))


def main() -> None:
    """Write the files."""
    entries = locked(LOCK)
    DEMO.write_text("".join(f"{name}\n" for name in demo_packages()), encoding="utf-8")
    wanted = {path: declared(extras) for path, extras in LOCKS.items()}
    for path, requirements in {**wanted, BUILD_LOCK: [*map(Requirement, BUILDERS)]}.items():
        names = sorted(closure(requirements))
        path.write_text("".join(f"{entries[name]}\n" for name in names), encoding="utf-8")


if __name__ == "__main__":
    main()
