"""Write netCDF-4 files, every variable declared before the first value, and read single variables of them.

Between a declaration and a value the library writes all that it has declared so far, so that the time of
``Dataset.to_netcdf``, which alternates between them, grows with the square of the number of variables.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import netCDF4
import xarray as xr
from xarray.backends import NetCDF4DataStore

Encoding = Mapping[str, Mapping[str, Any]]


class _ValuesLast:
    """Writer of xarray that keeps the values of declared variables until :meth:`write`."""

    def __init__(self) -> None:
        self._pending: list[tuple[Any, Any]] = []

    def add(self, source: Any, target: Any, region: Any = None) -> None:
        """Take the values of a variable; xarray calls this for each that it declares."""
        self._pending.append((source, target))

    def write(self) -> None:
        """Write all values."""
        for source, target in self._pending:
            target[...] = source


def write_netcdf(path: Path, groups: Mapping[str, tuple[xr.Dataset, Encoding]]) -> None:
    """Write datasets as groups of one new file, "" being the root; readers see what ``Dataset.to_netcdf`` writes.

    Raises:
        OSError, RuntimeError: the file cannot be written.
    """
    writer = _ValuesLast()
    with netCDF4.Dataset(path, "w", format="NETCDF4") as file:
        for name, (dataset, encoding) in groups.items():
            store = NetCDF4DataStore(file.createGroup(name) if name else file)
            dataset.dump_to_store(store, writer=writer, encoding=encoding)
        writer.write()


def read_variables(path: Path, names: Iterable[str]) -> dict[str, list[Any]]:
    """Return the values of some variables of a file as they are stored.

    It takes half of the time of ``xarray.open_dataset``, which also reads all other variables' attributes.

    Raises:
        OSError, RuntimeError: the file cannot be read.
        KeyError: it has no such variable.
    """
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        return {name: file.variables[name][...].tolist() for name in names}
