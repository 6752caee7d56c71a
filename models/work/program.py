"""What the values of a result depend on besides its inputs: the program, and the kind of processor."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import platform
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

PACKAGES = ("models", "streams", "monitor", "spallwatch")
DISTRIBUTIONS = ("numpy", "scipy", "numba", "llvmlite", "pyfftw")
"""What computes beside the packages; other dependencies read, write and draw."""
_VECTORS = ("avx512f", "avx2", "avx", "sse4_2", "sse2", "sve2", "sve", "asimd")


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of DISTRIBUTIONS, "missing" where one is not installed."""
    found = {"python": f"{platform.python_implementation()} {platform.python_version()}"}
    for name in DISTRIBUTIONS:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


@cache
def program() -> str:
    """Return a digest of all files of the packages, and of ``versions()``.

    A comment changes it, too: no change that matters is overlooked.
    """
    folders = [folder for package in PACKAGES for folder in package_folders(package)]
    return digest_of_program(folders, versions())


def digest_of_program(folders: Iterable[Path], versions: Mapping[str, str]) -> str:
    """Return a digest of the files of packages, except what Python and numba compiled, and of versions."""
    digest = hashlib.blake2b(digest_size=20)
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if "__pycache__" in path.parts or not path.is_file():
                continue
            content = path.read_bytes()
            # The lengths keep names and contents apart.
            digest.update(f"{path.relative_to(folder.parent).as_posix()}\0{len(content)}\0".encode() + content)
    for name, version in versions.items():
        digest.update(f"{name} {version}\0".encode())
    return digest.hexdigest()


def package_folders(package: str) -> list[Path]:
    """Return the folders of an installed package, without importing it."""
    found = importlib.util.find_spec(package)
    return [] if found is None else sorted(Path(place) for place in found.submodule_search_locations or ())


@cache
def processor() -> str:
    """Return the kind of processor: results of one kind are equal bit for bit.

    Compilers and libraries choose instructions by family and model, and by the widest vectors that they find.
    """
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").partition("\n\n")[0]
    except OSError:
        text = ""
    facts = dict(re.findall(r"^(.+?)\s*:[ \t]*(.*?)\s*$", text, re.MULTILINE))
    flags = set((facts.get("flags") or facts.get("Features") or "").split())
    name = facts.get("model name") or platform.processor() or "unknown"
    kind = [facts[key] for key in ("vendor_id", "cpu family", "model") if key in facts]
    kind += [facts[key] for key in ("CPU implementer", "CPU part") if key in facts]
    vector = next((flag for flag in _VECTORS if flag in flags), "")
    return ", ".join(part for part in (platform.machine(), name, "/".join(kind), vector) if part)
