"""The bill of materials: what CycloneDX 1.6 requires of it, and that it says what the lock file and packages say."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from email.message import Message
from pathlib import Path
from typing import Any

import pytest

from deploy import sbom
from deploy.runtime_lock import LOCK, ROOT, RUNTIME_LOCK, closure, declared, locked
from monitor import __version__

OWN = f"pkg:pypi/spallwatch@{__version__}"
SCOPES = ("required", "optional", "excluded")


@pytest.fixture(scope="module")
def bill() -> dict[str, Any]:
    return sbom.bill(LOCK, {})


def check_rules(bill: dict[str, Any]) -> None:
    """Check what the schema of CycloneDX 1.6 asks of what is written, and that each name leads somewhere."""
    head = {"$schema", "bomFormat", "specVersion", "serialNumber", "version"}
    assert set(bill) <= head | {"metadata", "components", "dependencies"}
    assert (bill["bomFormat"], bill["specVersion"], bill["version"]) == ("CycloneDX", "1.6", 1)
    # As the schema writes it.
    uuid = r"urn:uuid:[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}"
    assert re.fullmatch(uuid, bill["serialNumber"])
    components = [bill["metadata"]["component"], *bill["components"]]
    known = {"type", "bom-ref", "name", "version", "scope", "hashes", "licenses", "purl"}
    for item in components:
        assert {"type", "name"} <= set(item) <= known, item["name"]
        assert item["type"] in ("application", "library")
        assert item.get("scope", "required") in SCOPES
        assert re.fullmatch(r"pkg:pypi/[a-z0-9]+(-[a-z0-9]+)*@[^@/\s]+", item["purl"])
        for found in item.get("hashes", ()):
            assert set(found) == {"alg", "content"}
            assert found["alg"] == "SHA-256"
            assert re.fullmatch(r"[0-9a-f]{64}", found["content"])
        stated = item.get("licenses", [])
        # Either one expression, or licences that each have a name or an identifier.
        if any("expression" in each for each in stated):
            assert [set(each) for each in stated] == [{"expression"}]
        assert all(each["license"]["name"] for each in stated if "license" in each)
    references = [item["bom-ref"] for item in components]
    assert len(set(references)) == len(references)
    assert [each["ref"] for each in bill["dependencies"]] == list(
        dict.fromkeys(each["ref"] for each in bill["dependencies"])
    )
    for each in bill["dependencies"]:
        assert {each["ref"], *each["dependsOn"]} <= set(references)
        assert len(set(each["dependsOn"])) == len(each["dependsOn"])
        assert each["ref"] not in each["dependsOn"]


def test_it_keeps_the_rules(bill: dict[str, Any]) -> None:
    check_rules(bill)
    for wrong in (
        {**bill, "specVersion": "9"},
        {**bill, "dependencies": [{"ref": OWN, "dependsOn": ["pkg:pypi/none@1"]}]},
    ):
        with pytest.raises(AssertionError):
            check_rules(wrong)


def test_it_holds_each_locked_package_with_its_hashes_and_the_project(bill: dict[str, Any]) -> None:
    entries = locked(LOCK)
    components = {item["name"]: item for item in bill["components"]}
    assert set(components) == set(entries)
    for name, item in components.items():
        assert f"{name}=={item['version']}" == entries[name].split()[0].lower()
        assert [each["content"] for each in item["hashes"]] == re.findall("sha256:([0-9a-f]+)", entries[name])
        assert item["hashes"]
    assert bill["metadata"]["component"]["bom-ref"] == OWN
    assert components["numpy"]["scope"] == "required"
    assert components["asyncua"]["scope"] == "optional"
    assert components["pytest"]["scope"] == "excluded"
    assert {name for name, item in components.items() if item["scope"] == "required"} == set(closure(declared(())))
    assert all(components[name]["scope"] != "excluded" for name in locked(RUNTIME_LOCK))
    assert all(item.get("licenses") for item in components.values())
    assert components["scipy"]["licenses"]
    assert components["tqdm"]["licenses"] == [{"expression": "MPL-2.0 AND MIT"}]


def test_its_graph_is_that_of_the_packages(bill: dict[str, Any]) -> None:
    graph = {each["ref"].partition("@")[0]: each["dependsOn"] for each in bill["dependencies"]}
    named = {ref: {each.partition("@")[0].rpartition("/")[2] for each in needs} for ref, needs in graph.items()}
    assert {"numpy", "uvicorn", "asyncua", "gmsh"} <= named["pkg:pypi/spallwatch"]
    assert not {"pytest", "h11", "spallwatch"} & named["pkg:pypi/spallwatch"]
    assert "h11" in named["pkg:pypi/uvicorn"]
    assert "llvmlite" in named["pkg:pypi/numba"]
    # From the project one reaches what is not a tool of development, and nothing else.
    reached, waiting = set(), ["pkg:pypi/spallwatch"]
    while waiting:
        for name in named[waiting.pop()] - reached:
            reached.add(name)
            waiting.append(f"pkg:pypi/{name}")
    assert reached == {item["name"] for item in bill["components"] if item["scope"] != "excluded"}


def test_a_package_of_another_version_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "requirements.lock"
    installed = locked(LOCK)["numpy"].split()[0]
    other.write_text(LOCK.read_text(encoding="utf-8").replace(installed, "numpy==0.9"))
    with pytest.raises(sbom.BillError, match=r"numpy: expected 0\.9 of the lock file to be installed, found"):
        sbom.bill(other, {})
    other.write_text("\n".join(entry for name, entry in locked(LOCK).items() if name != "numpy"))
    with pytest.raises(sbom.BillError, match="numpy is missing, which the project needs"):
        sbom.bill(other, {})


@pytest.mark.parametrize(
    ("fields", "stated"),
    [
        ((("License-Expression", "mit"),), [{"expression": "MIT"}]),
        ((("License", "Apache-2.0"), ("Classifier", "License :: OSI Approved :: X")), [{"expression": "Apache-2.0"}]),
        (
            (("License", "BSD 3"), ("Classifier", "License :: OSI Approved :: BSD License")),
            [{"license": {"name": "BSD License"}}],
        ),
        ((("License", "Copyright (c) someone\nmore"),), [{"license": {"name": "Copyright (c) someone"}}]),
        ((), []),
    ],
)
def test_a_licence_is_what_the_package_states(fields: tuple[tuple[str, str], ...], stated: list[Any]) -> None:
    metadata = Message()
    for key, value in fields:
        metadata[key] = value
    assert sbom.licences(metadata) == stated


@pytest.mark.process
def test_make_writes_the_same_bytes_each_time(tmp_path: Path) -> None:
    for name in ("a.json", "b.json"):
        command = [sys.executable, "-m", "deploy.sbom", str(tmp_path / name)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()
    assert "python -m deploy.sbom" in (ROOT / "Makefile").read_text(encoding="utf-8").replace("$(BIN)/", "")
    check_rules(json.loads((tmp_path / "a.json").read_text(encoding="utf-8")))
    dated = sbom.bill(LOCK, {"SOURCE_DATE_EPOCH": "1700000000"})
    assert dated["metadata"]["timestamp"] == "2023-11-14T22:13:20+00:00"
