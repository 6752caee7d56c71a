"""The digest of the program changes with each file, name and version, and with nothing else."""

from __future__ import annotations

import platform
import shutil

from models.work.program import PACKAGES, digest_of_program, package_folders, processor, program, versions

VERSIONS = {"python": "3", "numpy": "2"}


def test_each_file_and_version_counts_and_what_was_compiled_does_not(tmp_path):
    package = tmp_path / "one" / "package"
    (package / "inner" / "__pycache__").mkdir(parents=True)
    (package / "a.py").write_text("x = 1")
    (package / "inner" / "table.csv").write_text("1,2")
    first = digest_of_program([package], VERSIONS)
    (package / "inner" / "__pycache__" / "a.nbi").write_bytes(b"x")
    elsewhere = shutil.copytree(package, tmp_path / "two" / "package")
    assert digest_of_program([package], VERSIONS) == digest_of_program([elsewhere], VERSIONS) == first
    seen = {first, digest_of_program([package], VERSIONS | {"numpy": "3"}), digest_of_program([], VERSIONS)}
    (elsewhere / "a.py").write_text("x = 2")
    seen.add(digest_of_program([elsewhere], VERSIONS))
    (elsewhere / "a.py").rename(elsewhere / "b.py")
    seen.add(digest_of_program([elsewhere], VERSIONS))
    (package / "inner" / "table.csv").write_text("1,3")
    seen.add(digest_of_program([package], VERSIONS))
    assert len(seen) == 6


def test_the_packages_are_found_and_the_versions_known():
    folders = [folder for package in PACKAGES for folder in package_folders(package)]
    assert all((folder / "__init__.py").is_file() for folder in folders)
    assert [folder.name for folder in folders] == list(PACKAGES)
    assert package_folders("no_such_package") == []
    assert "missing" not in versions().values()
    assert program() == digest_of_program(folders, versions())


def test_the_processor_has_a_name():
    assert platform.machine() in processor()
    assert "  " not in processor()
