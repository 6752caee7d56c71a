"""Files in which values come last, against those that xarray writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr

from monitor.health.record import Record
from monitor.records.dataset import to_dataset
from monitor.records.publish import encoding_of
from monitor.records.second_copy import Encoding, read_variables, write_netcdf
from monitor.records.store import Store


def records(number: int) -> list[Record]:
    full = {
        "rms": 1.5,
        "stage": "final",
        "quality_flags": ("gap",),
        "t_fs": 5.0,
        "t_fs_block": 1,
        "band_lo": (1.0, 2.0),
    }
    return [
        Record(source="s", sequence=place, name=f"ü{place}", content_hash="h", time=1.7e9 + place, channels={"x": full})
        for place in range(1, number + 1)
    ]


def dataset_of(folder: Path, made: list[Record]) -> xr.Dataset:
    with Store.open(folder / "state.db", machine="m") as store:
        store.commit_many([(record, {}) for record in made])
        return to_dataset(store.stored(), dated=True, attributes={"title": "records", "band": (0.0, 9500.0)})


def group_of(length: int) -> xr.Dataset:
    texts = np.array(["a", "", "β"], dtype=object)
    return xr.Dataset({"block": ("time", np.arange(length)), "runs": ("runs", texts)}, attrs={"names": ["x", "y"]})


def content(group: Any) -> dict[str, Any]:
    """Return everything in a group that a reader can see, values as bytes."""
    variables = {}
    for name, variable in group.variables.items():
        variable.set_auto_maskandscale(False)
        values = np.asarray(variable[...])
        variables[name] = {
            "type": (str(variable.dtype), variable.endian(), values.dtype.str),
            "dims": (variable.dimensions, variable.shape, variable.chunking(), variable.filters()),
            "attributes": attributes(variable),
            "values": values.tolist() if values.dtype == object else values.tobytes(),
        }
    return {
        "dimensions": [(name, len(dim), dim.isunlimited()) for name, dim in group.dimensions.items()],
        "attributes": attributes(group),
        "variables": list(variables.items()),
        "groups": [(name, content(inner)) for name, inner in group.groups.items()],
    }


def attributes(owner: Any) -> list[tuple[str, str, str]]:
    found = {name: owner.getncattr(name) for name in owner.ncattrs()}
    return [(name, type(value).__name__, repr(value)) for name, value in found.items()]


def encoding_read(dataset: xr.Dataset, name: Any) -> dict[str, str]:
    return {key: repr(value) for key, value in dataset[name].encoding.items() if key != "source"}


@pytest.mark.parametrize("made", [records(3), [], [Record("s", 1, "b", "", status="unreadable")]])
def test_a_file_is_what_xarray_writes(tmp_path: Path, made: list[Record]) -> None:
    dataset, ledger = dataset_of(tmp_path, made), group_of(len(made))
    encoding: Encoding = encoding_of(dataset)
    plain: Encoding = {str(name): {"_FillValue": None} for name in ledger.variables}
    write_netcdf(tmp_path / "ours.nc", {"": (dataset, encoding), "ledger": (ledger, plain)})
    theirs = tmp_path / "theirs.nc"
    dataset.to_netcdf(theirs, engine="netcdf4", format="NETCDF4", encoding=encoding)
    ledger.to_netcdf(theirs, mode="a", group="ledger", engine="netcdf4", encoding=plain)
    with netCDF4.Dataset(tmp_path / "ours.nc") as ours, netCDF4.Dataset(theirs) as expected:
        assert len(expected.variables) > 60
        assert content(ours) == content(expected)
    for group in (None, "ledger"):
        with (
            xr.open_dataset(tmp_path / "ours.nc", group=group) as ours,
            xr.open_dataset(theirs, group=group) as expected,
        ):
            xr.testing.assert_identical(ours, expected)
            for name in expected.variables:
                assert encoding_read(ours, name) == encoding_read(expected, name)


def test_times_and_units_of_their_own_are_encoded(tmp_path: Path) -> None:
    moments = np.array(["2026-11-22T10:00", "2026-11-22T11:00"], dtype="datetime64[ns]")
    dataset = xr.Dataset({"x": ("time", [1.0, np.nan])}, {"time": moments, "on": ("time", [True, False])})
    write_netcdf(tmp_path / "ours.nc", {"": (dataset, {})})
    dataset.to_netcdf(tmp_path / "theirs.nc", engine="netcdf4", format="NETCDF4")
    with netCDF4.Dataset(tmp_path / "ours.nc") as ours, netCDF4.Dataset(tmp_path / "theirs.nc") as expected:
        assert content(ours) == content(expected)


def test_a_file_that_cannot_be_made_raises(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"denied|No such file"):
        write_netcdf(tmp_path / "missing" / "x.nc", {"": (group_of(3), {})})


def test_variables_are_read_as_they_are_stored(tmp_path: Path) -> None:
    made = records(3)
    dataset = dataset_of(tmp_path, made)
    write_netcdf(tmp_path / "x.nc", {"": (dataset, encoding_of(dataset))})
    found = read_variables(tmp_path / "x.nc", ("name", "sequence", "t_fs_block"))
    assert found == {"name": [record.name for record in made], "sequence": [1, 2, 3], "t_fs_block": [[1], [1], [1]]}
    with pytest.raises(KeyError, match="nothing"):
        read_variables(tmp_path / "x.nc", ("nothing",))
    (tmp_path / "cut.nc").write_bytes((tmp_path / "x.nc").read_bytes()[:1000])
    with pytest.raises((OSError, RuntimeError)):
        read_variables(tmp_path / "cut.nc", ("name",))
