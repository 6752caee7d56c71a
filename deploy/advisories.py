"""Compare the versions of ``requirements.lock`` with a list of known advisories that is at hand; nothing is fetched.

Run as ``python -m deploy.advisories FILE``. FILE is a JSON file, a folder of them or a ZIP archive of them: records in
the OSV format (one, a list, or ``{"vulns": [...]}``; the archive of all advisories of PyPI is one), or the report of
pip-audit. Exit code 0: all packages were compared with it and none is named; 1: one is named, or could not be compared;
2: there is no list, or it is none, and nothing was compared.
"""

from __future__ import annotations

import json
import sys
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import InvalidVersion, Version

from deploy.runtime_lock import LOCK, locked
from deploy.sbom import version_of

_EXPECTED = "expected advisories in the OSV format, or a report of pip-audit"


class ListError(Exception):
    """A list cannot be used; the message names file, what was expected and what came."""


@dataclass
class Comparison:
    """What was found: advisories that name a locked version, those that cannot be judged, and what was compared."""

    named: list[str] = field(default_factory=list)
    doubtful: list[str] = field(default_factory=list)
    compared: set[str] = field(default_factory=set)
    advisories: int = 0
    latest: str = ""


def compare(path: Path, versions: Mapping[str, str]) -> Comparison:
    """Compare versions (by normalised name) with the lists at a path.

    Raises:
        ListError: a file is no list, or no list has an advisory of PyPI.
    """
    found = Comparison()
    records = 0
    for place, content in _documents(path):
        for item in _items(place, content):
            records += 1
            try:
                if "affected" in item or "withdrawn" in item:
                    _by_record(item, versions, found)
                else:
                    _by_audit(item, versions, found)
            except (KeyError, TypeError, AttributeError, InvalidVersion) as error:
                raise ListError(
                    f"{place}: {_EXPECTED}; came {_short(item)} ({type(error).__name__}: {error})"
                ) from error
    if not found.advisories and not found.compared:
        raise ListError(f"{path}: {_EXPECTED} on packages of PyPI; came {records} records, none on PyPI")
    if found.advisories:
        # A list of all advisories says of each package whether there are any.
        found.compared |= set(versions)
    return found


def _documents(path: Path) -> Iterator[tuple[str, Any]]:
    """Yield place and content of each JSON document."""
    try:
        if path.is_dir():
            for file in sorted(path.rglob("*.json")):
                yield str(file), _parsed(str(file), file.read_bytes())
        elif zipfile.is_zipfile(path):
            with zipfile.ZipFile(path) as archive:
                for name in sorted(name for name in archive.namelist() if name.endswith(".json")):
                    yield f"{path}: {name}", _parsed(f"{path}: {name}", archive.read(name))
        else:
            yield str(path), _parsed(str(path), path.read_bytes())
    except (OSError, zipfile.BadZipFile) as error:
        raise ListError(f"{path}: {_EXPECTED}; came {error}") from error


def _parsed(place: str, data: bytes) -> Any:
    try:
        return json.loads(data)
    except ValueError as error:
        raise ListError(f"{place}: {_EXPECTED}; came no JSON ({error})") from error


def _items(place: str, content: Any) -> list[dict[str, Any]]:
    """Return the records of a document: advisories, or packages with theirs."""
    if isinstance(content, dict):
        lists = [content[key] for key in ("vulns", "dependencies") if key in content and "affected" not in content]
        content = lists[0] if lists else [content]
    known = ("affected", "withdrawn", "vulns", "skip_reason")
    if not isinstance(content, list) or not all(isinstance(item, dict) for item in content):
        raise ListError(f"{place}: {_EXPECTED}; came {_short(content)}")
    strange = [item for item in content if not any(key in item for key in known)]
    if strange:
        raise ListError(f"{place}: {_EXPECTED}; came {_short(strange[0])}")
    return content


def _by_record(record: Mapping[str, Any], versions: Mapping[str, str], found: Comparison) -> None:
    """Judge an advisory in the OSV format; one that was withdrawn says nothing."""
    of_python = [part for part in record.get("affected", ()) if part.get("package", {}).get("ecosystem") == "PyPI"]
    if not of_python:
        return
    found.advisories += 1
    found.latest = max(found.latest, str(record.get("modified", "")))
    if "withdrawn" in record:
        return
    verdicts: dict[str, set[bool | None]] = {}
    fixes: dict[str, set[str]] = {}
    for part in of_python:
        name = canonicalize_name(part["package"]["name"])
        if name in versions:
            verdicts.setdefault(name, set()).add(_affects(part, versions[name]))
            events = [event for each in part.get("ranges", ()) for event in each["events"] if each["type"] != "GIT"]
            fixes.setdefault(name, set()).update(event["fixed"] for event in events if "fixed" in event)
    for name, verdict in verdicts.items():
        _note(name, versions[name], verdict, (record["id"], *record.get("aliases", ())), fixes[name], found)


def _by_audit(package: Mapping[str, Any], versions: Mapping[str, str], found: Comparison) -> None:
    """Take what pip-audit said of a package, if it looked at the same version."""
    name = canonicalize_name(package["name"])
    if name not in versions or "vulns" not in package or Version(package["version"]) != Version(versions[name]):
        return
    found.compared.add(name)
    for advisory in package["vulns"]:
        names = (advisory["id"], *advisory.get("aliases", ()))
        _note(name, versions[name], {True}, names, advisory.get("fix_versions", ()), found)


def _note(
    name: str, version: str, verdict: set[bool | None], names: Iterable[str], fixes: Iterable[str], found: Comparison
) -> None:
    """Keep a verdict on a package as a line, if it is not that the package is unaffected."""
    line = f"{name} {version}: {', '.join(dict.fromkeys(names))}"
    if True in verdict:
        mended = ", ".join(sorted(fixes, key=Version))
        found.named.append(f"{line}; {f'mended in {mended}' if mended else 'no version is said to mend it'}")
    elif None in verdict:
        found.doubtful.append(f"{line} states neither versions nor a range of them")


def _affects(part: Mapping[str, Any], version: str) -> bool | None:
    """Return whether an advisory affects a version; None where it states nothing that can be compared."""
    ranges = [each for each in part.get("ranges", ()) if each["type"] in ("ECOSYSTEM", "SEMVER")]
    listed = part.get("versions", ())
    if not ranges and not listed:
        return None
    wanted = Version(version)
    return (
        version in listed
        or any(_same(each, wanted) for each in listed)
        or any(_within(each, wanted) for each in ranges)
    )


def _same(text: str, version: Version) -> bool:
    try:
        return Version(text) == version
    except InvalidVersion:
        return False


def _within(found: Mapping[str, Any], version: Version) -> bool:
    """Return whether a version lies in a range of the OSV format: the last of its events up to the version decides."""
    events = [(Version(text), kind) for event in found["events"] for kind, text in event.items() if kind != "limit"]
    inside = False
    # At one version, an end stands before a new beginning.
    for at, kind in sorted(events, key=lambda event: (event[0], event[1] == "introduced")):
        if kind == "introduced" and at <= version:
            inside = True
        elif (kind == "fixed" and at <= version) or (kind == "last_affected" and at < version):
            inside = False
    return inside


def _short(value: object) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def main(arguments: list[str]) -> int:
    """Print what was found; return the exit code."""
    if len(arguments) != 1 or not arguments[0]:
        print("not compared: give a list of advisories that is at hand, make advisories FILE=osv.json", file=sys.stderr)
        return 2
    versions = {name: version_of(entry) for name, entry in locked(LOCK).items()}
    try:
        found = compare(Path(arguments[0]), versions)
    except ListError as error:
        print(f"not compared: {error}", file=sys.stderr)
        return 2
    missing = sorted(set(versions) - found.compared)
    for line in found.named:
        print(f"named: {line}")
    for line in found.doubtful:
        print(f"not judged: {line}")
    if missing:
        print(f"not compared: {', '.join(missing)}")
    of = f"{found.advisories} advisories, the latest of {found.latest or 'no date'}" if found.advisories else "a report"
    compared = f"{len(versions) - len(missing)} of {len(versions)} packages compared with {of}"
    print(f"{compared}; {len(found.named)} times one is named")
    return 1 if found.named or found.doubtful or missing else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
