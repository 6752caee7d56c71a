"""Whether another process of a cluster runs the same program as this one."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping

from models.work.program import program, versions

_TRANSPORT = ("dask", "distributed", "cloudpickle", "msgpack")
"""Distributions whose versions both ends of a connection must share."""
_FILES = ("netcdf4", "xarray", "zarr")
"""Distributions that write results: their files are compared with those of one process."""
_SHOWN_DIGITS = 12


def facts() -> dict[str, str]:
    """Return what must be equal in all processes of a run: versions, and the digest of the program."""
    found = dict(versions())
    for name in (*_TRANSPORT, *_FILES):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found | {"program": program()}


def differences(theirs: Mapping[str, str], mine: Mapping[str, str]) -> str:
    """Return how the facts of another process differ from those of this one, for people; "" where they do not."""
    different = [name for name in (*mine, *sorted(set(theirs).difference(mine))) if theirs.get(name) != mine.get(name)]
    # The digest depends on the versions: alone it means other files.
    if len(different) > 1 and "program" in different:
        different.remove("program")
    return "; ".join(f"{_called(name)} {_value(theirs, name)}, expected {_value(mine, name)}" for name in different)


def _called(name: str) -> str:
    return "spallwatch of other files, digest" if name == "program" else name


def _value(facts: Mapping[str, str], name: str) -> str:
    value = facts.get(name, "unknown")
    return value[:_SHOWN_DIGITS] if name == "program" else value
