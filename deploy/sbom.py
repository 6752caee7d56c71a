"""Write the bill of materials of ``requirements.lock``: CycloneDX 1.6, JSON.

Run as ``python -m deploy.sbom [FILE]`` in an environment that holds all that the lock file lists: versions and hashes
come from the lock file, licences and what asks for what from the installed packages. The same lock file gives the same
bytes; a time is written where ``SOURCE_DATE_EPOCH`` gives one.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import os
import re
import tomllib
import uuid
from collections.abc import Mapping
from datetime import UTC, datetime
from email.message import Message
from pathlib import Path
from typing import Any

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from deploy.runtime_lock import LOCK, ROOT, closure, declared, locked
from monitor import __version__

SPEC_VERSION = "1.6"
OUT = ROOT / "build" / "sbom.json"
_NAME = "spallwatch"
_MAX_NAME = 80


class BillError(Exception):
    """The environment is not that of the lock file; the message says what differs."""


def version_of(entry: str) -> str:
    """Return the version that an entry of a lock file names."""
    return entry.partition("==")[2].split()[0]


def purl(name: str, version: str) -> str:
    """Return the package URL of a package of Python."""
    return f"pkg:pypi/{name}@{version}"


def licences(metadata: Message) -> list[dict[str, Any]]:
    """Return what a package states of its licence, for ``licenses``: an SPDX expression, else names."""
    free = metadata.get("License") or ""
    for stated in (metadata.get("License-Expression"), free):
        try:
            if stated:
                return [{"expression": str(canonicalize_license_expression(stated))}]
        except InvalidLicenseExpression:
            continue
    classifiers = [text for text in metadata.get_all("Classifier") or [] if text.startswith("License :: ")]
    first = free.strip().partition("\n")[0]
    names = [text.rpartition(" :: ")[2] for text in classifiers] or [first[:_MAX_NAME]]
    return [{"license": {"name": name}} for name in dict.fromkeys(names) if name]


def bill(lock: Path = LOCK, environment: Mapping[str, str] = os.environ) -> dict[str, Any]:
    """Return the bill of a lock file.

    Raises:
        BillError: a package is not installed in the version of the lock file.
    """
    entries = locked(lock)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = [name for name in project["project"]["optional-dependencies"] if name != "all"]
    tools = [Requirement(item) for item in project["dependency-groups"]["dev"]]
    try:
        scopes = {"required": closure(declared(())), "optional": closure(declared(extras)), "excluded": closure(tools)}
    except importlib.metadata.PackageNotFoundError as error:
        raise BillError(f"{error}; expected all packages of {lock.name} to be installed: make setup") from error
    references = {name: purl(name, version_of(entry)) for name, entry in entries.items()}
    own = purl(_NAME, __version__)
    asked: dict[str, set[str]] = {name: set() for name in references}
    for found in scopes.values():
        for name, needs in found.items():
            if name not in asked:
                raise BillError(f"{lock}: {name} is missing, which the project needs: make lock")
            asked[name] |= needs
    direct = {canonicalize_name(item.name) for item in declared(extras)}
    dependencies = {own: direct, **{references[name]: needs for name, needs in asked.items()}}
    content = lock.read_bytes() + json.dumps([own, sorted(direct)]).encode()
    return {
        "$schema": f"http://cyclonedx.org/schema/bom-{SPEC_VERSION}.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": SPEC_VERSION,
        "serialNumber": uuid.uuid5(uuid.NAMESPACE_URL, content.hex()).urn,
        "version": 1,
        "metadata": {
            **_when(environment),
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": _NAME,
                "version": __version__,
                "licenses": [{"expression": project["project"]["license"]}],
                "purl": own,
            },
            "properties": [
                {"name": "spallwatch:lock", "value": lock.name},
                {"name": "spallwatch:hashes", "value": "of each file in which a version is distributed"},
            ],
        },
        "components": [
            _component(name, entry, next((kind for kind, found in scopes.items() if name in found), "excluded"))
            for name, entry in sorted(entries.items())
        ],
        "dependencies": [
            {"ref": reference, "dependsOn": sorted(references[name] for name in needs)}
            for reference, needs in dependencies.items()
        ],
    }


def _component(name: str, entry: str, scope: str) -> dict[str, Any]:
    version = version_of(entry)
    found = importlib.metadata.distribution(name)
    if found.version != version:
        raise BillError(
            f"{name}: expected {version} of the lock file to be installed, found {found.version}: make setup"
        )
    stated = licences(found.metadata)  # pyright: ignore[reportArgumentType]
    return {
        "type": "library",
        "bom-ref": purl(name, version),
        "name": name,
        "version": version,
        "scope": scope,
        "hashes": [{"alg": "SHA-256", "content": each} for each in re.findall(r"--hash=sha256:([0-9a-f]{64})", entry)],
        **({"licenses": stated} if stated else {}),
        "purl": purl(name, version),
    }


def _when(environment: Mapping[str, str]) -> dict[str, str]:
    epoch = environment.get("SOURCE_DATE_EPOCH")
    return {"timestamp": datetime.fromtimestamp(int(epoch), UTC).isoformat()} if epoch else {}


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("file", nargs="?", type=Path, default=OUT)
    out = parser.parse_args().file
    try:
        found = bill()
    except BillError as error:
        parser.exit(2, f"{error}\n")
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{out}: CycloneDX {SPEC_VERSION}, {len(found['components'])} packages")


if __name__ == "__main__":
    main()
