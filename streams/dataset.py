"""Recorded test-rig data sets: what the published descriptions say of their files, as one table.

A data set's own statements (rate, unit, speed by file name) count as configured. What a set does not state is None, and
is for the configuration or a side-car to say.
"""

from __future__ import annotations

import re

from streams.datasets import mat_sets, text_sets
from streams.datasets.description import POUND_FORCE, DataSet, FileFacts

__all__ = ["DATA_SETS", "POUND_FORCE", "DataSet", "FileFacts", "data_set_named"]

DATA_SETS = {data_set.name: data_set for data_set in (*text_sets.SETS, *mat_sets.SETS)}
"""The data sets by name."""


def data_set_named(name: str) -> DataSet | None:
    """Return the data set of a name, in any case, "-" and " " standing for "_", or None."""
    return DATA_SETS.get(re.sub(r"[-\s]", "_", name.strip().lower()))
