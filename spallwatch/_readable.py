"""Datasets of records in the form in which people read them: words as strings, dates, one dimension for the parts."""

from __future__ import annotations

import numpy as np
import xarray as xr

from monitor.records.dataset import INT_FILL, words

PART = "part"
"""The dimension of the parts of a bearing. In files it is called ``fault``, as is the name of the damaged part."""


def readable(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset of records, read without decoding, with words as strings and parts by name.

    Missing words are "", missing whole numbers NaN.
    """
    given = dataset.reset_coords("fault") if "fault" in dataset.coords else dataset
    decoded: dict[str, xr.Variable] = {}
    for name, array in given.variables.items():
        attributes = {key: value for key, value in array.attrs.items() if not key.startswith("flag_")}
        dims = tuple(PART if dim == "fault" else str(dim) for dim in array.dims)
        values = array.values
        if "flag_meanings" in array.attrs:
            values = words(array)
        elif array.dtype == np.int32 and name not in given.coords:
            values = np.where(values == INT_FILL, np.nan, values)
        decoded[str(name)] = xr.Variable(dims, values, attributes)
    labels = decoded.pop("fault_name", None)
    found = xr.Dataset({name: array for name, array in decoded.items() if name not in given.coords}, attrs=given.attrs)
    found = found.assign_coords({name: array for name, array in decoded.items() if name in given.coords})
    return found if labels is None else found.assign_coords({PART: (PART, labels.values, labels.attrs)})
