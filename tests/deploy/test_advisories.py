"""Versions against known advisories: what is named, what is not, and that nothing is claimed without a list."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import pytest

from deploy import advisories
from deploy.advisories import ListError, compare
from deploy.runtime_lock import LOCK, locked
from deploy.sbom import version_of

HAVE = {"numpy": "2.1.0", "wait-for2": "0.4.1"}


def osv(name: str = "numpy", *, versions: tuple[str, ...] = (), ranges: Any = (), **more: Any) -> dict[str, Any]:
    package = {"ecosystem": "PyPI", "name": name}
    part = {"package": package, "versions": list(versions), "ranges": list(ranges)}
    return {"id": "PYSEC-1", "modified": "2026-01-02T00:00:00Z", "affected": [part], **more}


def between(*events: dict[str, str], kind: str = "ECOSYSTEM") -> dict[str, Any]:
    return {"type": kind, "events": list(events)}


def put(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("record", "named"),
    [
        (osv(versions=("2.1", "2.0")), True),
        (osv(versions=("2.0",)), False),
        (osv(ranges=[between({"introduced": "0"}, {"fixed": "2.1.0"})]), False),
        (osv(ranges=[between({"introduced": "0"}, {"fixed": "2.1.1"})]), True),
        (osv(ranges=[between({"introduced": "0"}, {"last_affected": "2.1.0"})]), True),
        (osv(ranges=[between({"introduced": "0"}, {"last_affected": "2.0.9"})]), False),
        (osv(ranges=[between({"introduced": "2.1.1"})]), False),
        # In any order; two branches that were mended each on its own.
        (osv(ranges=[between({"fixed": "1.9"}, {"introduced": "2.0"}, {"introduced": "1.0"}, {"fixed": "2.2"})]), True),
        (
            osv(ranges=[between({"introduced": "1.0"}, {"fixed": "1.9"}, {"introduced": "2.0"}, {"fixed": "2.0.5"})]),
            False,
        ),
        (osv("NumPy", versions=("2.1.0",)), True),
        (osv("Wait_For2", versions=("0.4.1",)), True),
        (osv("flask", versions=("2.1.0",)), False),
        (osv(versions=("2.1.0",), withdrawn="2026-01-03T00:00:00Z"), False),
    ],
)
def test_an_advisory_names_the_versions_that_it_states(record: dict[str, Any], named: bool, tmp_path: Path) -> None:
    found = compare(put(tmp_path / "a.json", record), HAVE)
    assert bool(found.named) is named
    assert found.doubtful == []
    assert found.advisories == 1
    assert found.compared == set(HAVE)


def test_what_mends_it_and_its_other_names_are_said(tmp_path: Path) -> None:
    record = osv(ranges=[between({"introduced": "0"}, {"fixed": "2.1.1"})], aliases=["CVE-1", "PYSEC-1"])
    assert compare(put(tmp_path / "a.json", record), HAVE).named == ["numpy 2.1.0: PYSEC-1, CVE-1; mended in 2.1.1"]


def test_one_that_states_no_versions_is_not_taken_for_harmless(tmp_path: Path) -> None:
    record = osv(ranges=[between({"introduced": "0"}, {"fixed": "abc"}, kind="GIT")])
    found = compare(put(tmp_path / "a.json", record), HAVE)
    assert found.named == []
    assert found.doubtful == ["numpy 2.1.0: PYSEC-1 states neither versions nor a range of them"]


def test_folders_archives_and_lists_are_read_alike(tmp_path: Path) -> None:
    one, other = osv(versions=("2.1.0",)), {**osv("wait-for2", versions=("0.4.1",)), "id": "PYSEC-2"}
    folder = tmp_path / "all"
    folder.mkdir()
    put(folder / "1.json", one)
    put(folder / "2.json", other)
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for file in folder.iterdir():
            archive.write(file, file.name)
    places = [folder, tmp_path / "all.zip", put(tmp_path / "l.json", [one, other])]
    places.append(put(tmp_path / "v.json", {"vulns": [one, other]}))
    found = [compare(place, HAVE) for place in places]
    assert all(each == found[0] for each in found)
    assert len(found[0].named) == 2


def test_a_report_of_pip_audit_speaks_of_the_versions_that_it_saw(tmp_path: Path) -> None:
    vulns = [{"id": "PYSEC-1", "fix_versions": ["2.1.1"], "aliases": ["CVE-1"]}]
    seen = {"name": "numpy", "version": "2.1.0", "vulns": vulns}
    report = {"dependencies": [seen, {"name": "wait_for2", "skip_reason": "x"}], "fixes": []}
    found = compare(put(tmp_path / "a.json", report), HAVE)
    assert found.named == ["numpy 2.1.0: PYSEC-1, CVE-1; mended in 2.1.1"]
    assert found.compared == {"numpy"}
    with pytest.raises(ListError, match="none on PyPI"):
        compare(put(tmp_path / "a.json", [{**seen, "version": "2.0.0"}]), HAVE)


@pytest.mark.parametrize(
    ("content", "came"),
    [
        ("{", "no JSON"),
        ("[1]", r"came \[1\]"),
        ('{"a": 1}', r'came {"a": 1}'),
        ("[]", "came 0 records"),
        (
            '{"id": "x", "affected": [{"package": {"ecosystem": "npm", "name": "numpy"}}]}',
            "came 1 records, none on PyPI",
        ),
        ('{"affected": [{"package": {"ecosystem": "PyPI", "name": "numpy"}, "versions": ["2.1.0"]}]}', "KeyError"),
    ],
)
def test_a_file_that_is_no_list_is_refused(content: str, came: str, tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(content)
    with pytest.raises(ListError, match=came) as refused:
        compare(path, HAVE)
    assert str(path) in str(refused.value)
    assert "expected advisories in the OSV format" in str(refused.value)


def test_it_claims_nothing_without_a_list(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in ([], [""], [str(tmp_path / "none.json")]):
        assert advisories.main(arguments) == 2
        said = capsys.readouterr()
        assert said.out == ""
        assert said.err.startswith("not compared: ")


def test_the_exit_code_tells_what_was_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    versions = {name: version_of(entry) for name, entry in locked(LOCK).items()}
    harmless = put(tmp_path / "a.json", osv(versions=("0.0.1",)))
    assert advisories.main([str(harmless)]) == 0
    assert f"{len(versions)} of {len(versions)} packages compared with 1 advisories" in capsys.readouterr().out
    assert advisories.main([str(put(tmp_path / "b.json", osv(versions=(versions["numpy"],))))]) == 1
    assert capsys.readouterr().out.startswith(f"named: numpy {versions['numpy']}: PYSEC-1")
    audit = [{"name": "numpy", "version": versions["numpy"], "vulns": []}]
    assert advisories.main([str(put(tmp_path / "c.json", audit))]) == 1
    assert "not compared: about-time, " in capsys.readouterr().out
