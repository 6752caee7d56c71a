"""Records as one run per machine and time axis, read from netCDF files, a store or a dataset."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from models.words.errors import WrongInputError
from monitor.health.schema import REJECTIONS, SCHEMA_VERSION, VARIABLES
from monitor.health.signal.waterfall import SpectrumRow
from monitor.health.size.filter.particles import Particles
from monitor.records.database import StoreError
from monitor.records.dataset import words
from monitor.records.publish import PublishError, day_dataset, days
from monitor.records.published_folder import absence_text, moved_days
from monitor.records.queries import condensed_blocks
from monitor.records.store import Store
from monitor.report.store_details import StoredBeside, read_beside
from monitor.words.numbers import count

Records = xr.Dataset | Store | Path | str

ABSENCE = "records_missing"
"""Attribute of a dataset that says which records are not in the same place."""
_LEDGER = ("source", "name", "status", "flags", "reason", "events")


class ReportError(WrongInputError):
    """A report cannot be made; the message names the file and the cause."""


@dataclass(frozen=True, eq=False)
class Channel:
    """The variables of one channel over the n blocks of its source; the arrays of all fields have n rows.

    Attributes:
        time: s, UTC since 1970 or from the first block.
        sequence: block numbers.
        numbers: variables of numbers, shape (n, values of all other dimensions), NaN for no value.
        words: variables of words, shape (n, values of all other dimensions), "" for no value.
    """

    name: str
    time: NDArray[np.float64]
    sequence: NDArray[np.int64]
    status: NDArray[np.object_]
    numbers: Mapping[str, NDArray[np.float64]]
    words: Mapping[str, NDArray[np.object_]]

    def column(self, name: str, place: int = 0) -> NDArray[np.float64]:
        """Return one number per block: of the band or threshold at ``place``, NaN past the last recorded one."""
        values = self.numbers[name]
        return values[:, place] if place < values.shape[1] else np.full(values.shape[0], np.nan)

    def word(self, name: str) -> NDArray[np.object_]:
        """Return a variable as one word per block: of the first threshold."""
        return self.words[name][:, 0]

    def fitted_rows(self) -> NDArray[np.intp]:
        """Return the rows with the three coefficients of the thesis' law for the first threshold."""
        coefficients = self.numbers["tt_coefficients"][:, :3]
        return np.flatnonzero(np.isfinite(coefficients).all(axis=1) & (coefficients.shape[1] == 3))

    def last_row(self, name: str) -> int | None:
        """Return the row of the last finite value of a variable, None without any."""
        rows = np.flatnonzero(np.isfinite(self.column(name)))
        return int(rows[-1]) if rows.size else None

    def baseline(self, name: str) -> float:
        """Return the median of a variable over the learning window, NaN with fewer than two values."""
        values = self.column(name)[self.word("stage") == "learning"]
        values = values[np.isfinite(values)]
        return float(np.median(values)) if values.size > 1 else math.nan

    @property
    def has_level(self) -> bool:
        """Whether its accelerations are in m/s2 rather than in an unknown unit."""
        return "no" not in self.word("absolute_level") and "no_absolute_level" not in self.word("edv_status")


@dataclass(frozen=True, eq=False)
class Run:
    """The records of one machine on one time axis.

    Attributes:
        dated: whether times are UTC rather than seconds from the first block.
        time: s, of every block.
        ledger: ``source``, ``name``, ``status``, ``flags``, ``reason`` and ``sequence`` of every block.
        counts: blocks by status.
        events: in order, each with its ``source`` and ``block``.
        attributes: provenance of the records; values joined by "; " where parts differ.
        spectra: kept envelope spectra by channel; empty unless read from a store.
        views: the newest spectrum with raw spectrum and waveform by channel, after one from before the onset.
        ias: likewise rows with a spectrum of the angular speed, by the one channel of a source that has it.
        particles: of the physical tracker after the last block, by channel; empty unless read from a store.
        label: unique among the runs of a report: the machine, with the folder where several have its name.
    """

    machine: str
    dated: bool
    time: NDArray[np.float64]
    ledger: Mapping[str, NDArray[Any]]
    channels: Mapping[str, Channel]
    counts: Mapping[str, int]
    events: Sequence[Mapping[str, Any]]
    attributes: Mapping[str, str] = field(default_factory=dict)
    spectra: Mapping[str, Sequence[SpectrumRow]] = field(default_factory=dict)
    views: Mapping[str, Sequence[SpectrumRow]] = field(default_factory=dict)
    ias: Mapping[str, Sequence[SpectrumRow]] = field(default_factory=dict)
    particles: Mapping[str, Particles] = field(default_factory=dict)
    label: str = ""


def read_runs(records: Records | Sequence[Records]) -> list[Run]:
    """Read records into one run per machine and time axis, in order of appearance.

    Undated blocks that were all rejected are counted with the dated ones of their machine.

    Args:
        records: datasets as :func:`monitor.records.dataset.to_dataset` makes them, stores, paths of ``.nc`` files or
            of a store, folders of them, or a sequence of these.

    Raises:
        ReportError: nothing is found, or a file cannot be read.
    """
    items = [records] if isinstance(records, xr.Dataset | Store | Path | str) else list(records)
    parts: dict[_Key, list[xr.Dataset]] = {}
    stores: dict[tuple[str, str], StoredBeside] = {}
    for item in items:
        place = _place(item) if len(items) > 1 else ""
        for dataset, store in _datasets(item):
            machine = str(dataset.attrs.get("machine", "machine"))
            if dataset.sizes["time"]:
                parts.setdefault((machine, place, dataset.attrs.get("dated") == "yes"), []).append(dataset)
            if store is not None:
                stores[machine, place] = store
    if not parts:
        raise ReportError("there are no records to report")
    runs = {key: _run(key[0], key[2], datasets) for key, datasets in parts.items()}
    for machine, place in dict.fromkeys(key[:2] for key in runs):
        _fold_rejected(runs, machine, place)
        if (machine, place) in stores:
            _complete(runs, machine, place, stores[machine, place])
    return _labelled(runs)


_Key = tuple[str, str, bool]
"""Machine, place (a store or a folder is a run of its own, files and datasets of a machine are one), and if dated."""


def _place(item: Records) -> str:
    """Return the folder of a store or of records, "" for files and datasets."""
    if isinstance(item, xr.Dataset):
        return ""
    path = item.path if isinstance(item, Store) else Path(item)
    if path.suffix == ".nc":
        return ""
    return str(path.resolve().parent if path.is_file() else path.resolve())


def _labelled(runs: Mapping[_Key, Run]) -> list[Run]:
    machines = [machine for machine, _, _ in runs]
    labelled = []
    for (machine, place, dated), run in runs.items():
        label = machine
        if machines.count(machine) > 1:
            label += f", {Path(place).name}" if place else (", dated" if dated else ", undated")
        labelled.append(replace(run, label=label))
    return labelled


def _datasets(item: Records) -> Iterable[tuple[xr.Dataset, StoredBeside | None]]:
    """Yield the datasets of one item, with what its store holds beside records."""
    if isinstance(item, xr.Dataset):
        yield item, None
    elif isinstance(item, Store):
        beside: StoredBeside | None = None
        absent = _condensed_text(item)
        for day, _ in days(item):
            beside = beside or read_beside(item)
            yield _with_absence(day_dataset(item, day), absent), beside
    else:
        found: dict[str, str | None] = {}
        for path in _files(Path(item)):
            if path.suffix == ".nc":
                dataset = _read_netcdf(path)
                machine = str(dataset.attrs.get("machine", ""))
                if machine not in found:
                    found[machine] = absence_text(moved_days(path.parent, machine))
                yield _with_absence(dataset, found[machine]), None
            else:
                try:
                    with Store.open(path, read_only=True) as store:
                        yield from _datasets(store)
                except (StoreError, PublishError) as error:
                    raise ReportError(str(error)) from error


def _with_absence(dataset: xr.Dataset, text: str | None) -> xr.Dataset:
    """Add a sentence on records that are elsewhere."""
    return dataset if text is None else dataset.assign_attrs({ABSENCE: text})


def _condensed_text(store: Store) -> str | None:
    """Return how many blocks of a store have no full record there as a sentence, or None."""
    blocks = condensed_blocks(store)
    return f"full records of {count(blocks, 'older block')} are in the published files only" if blocks else None


def _files(path: Path) -> list[Path]:
    """Return the files of records of a path: itself, or those in a folder."""
    if not path.is_dir():
        if not path.exists():
            raise ReportError(f"{path}: no such file or folder")
        return [path]
    # A store holds more than the files published from it.
    found = sorted(path.glob("*.db")) or sorted(path.glob("*.nc")) or sorted((path / "records").glob("*.nc"))
    if not found:
        raise ReportError(f"{path}: holds neither .nc files of records nor a state.db")
    return found


def _read_netcdf(path: Path) -> xr.Dataset:
    try:
        with xr.open_dataset(path, engine="netcdf4", decode_cf=False) as dataset:
            loaded = dataset.load()
    except (OSError, ValueError, RuntimeError) as error:
        raise ReportError(f"{path}: cannot be read as netCDF: {error}") from error
    version = loaded.attrs.get("schema_version")
    if version is None or "time" not in loaded:
        raise ReportError(f"{path}: is netCDF, but holds no health records")
    if int(version) > SCHEMA_VERSION:
        raise ReportError(f"{path}: has schema version {version}; this program knows versions up to {SCHEMA_VERSION}")
    return loaded


def _run(machine: str, dated: bool, datasets: Sequence[xr.Dataset]) -> Run:
    datasets = sorted(datasets, key=lambda dataset: float(_seconds_or_numbers(dataset.time)[0]))
    time = np.concatenate([_seconds_or_numbers(dataset.time) for dataset in datasets])
    ledger: dict[str, NDArray[Any]] = {
        name: np.concatenate([dataset[name].values.astype(object) for dataset in datasets]) for name in _LEDGER
    }
    ledger["sequence"] = np.concatenate([dataset["sequence"].values.astype(np.int64) for dataset in datasets])
    names = dict.fromkeys(str(name) for dataset in datasets for name in dataset.channel.values)
    columns = {name: _columns(name, datasets) for name in names}
    events = [
        {"source": source, "block": int(block), **event}
        for source, block, text in zip(ledger["source"], ledger["sequence"], ledger.pop("events"), strict=True)
        for event in json.loads(text or "[]")
    ]
    return Run(
        machine=machine,
        dated=dated,
        time=time,
        ledger=ledger,
        channels={name: _channel(name, time, ledger, *both) for name, both in columns.items()},
        counts=Counter(sorted(str(status) for status in ledger["status"])),
        events=events,
        attributes=_joined([dataset.attrs for dataset in datasets]),
    )


def _columns(
    channel: str, datasets: Sequence[xr.Dataset]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.object_]]]:
    """Join the variables of one channel over all datasets, padded where one has more bands or thresholds."""
    numbers: dict[str, NDArray[np.float64]] = {}
    texts: dict[str, NDArray[np.object_]] = {}
    places = [np.flatnonzero(dataset.variables["channel"].values.astype(str) == channel) for dataset in datasets]
    for variable in VARIABLES.values():
        worded = variable.kind in ("flag", "mask")
        blocks: list[NDArray[Any]] = []
        for dataset, place in zip(datasets, places, strict=True):
            # A data array for each variable would take most of the time of a report without figures.
            if variable.name not in dataset.variables or not place.size:
                missing: Any = "" if worded else np.nan
                blocks.append(np.full((dataset.sizes["time"], 1), missing, dtype=object if worded else np.float64))
                continue
            array = dataset.variables[variable.name].isel(channel=int(place[0]))
            values = words(array) if worded else _seconds_or_numbers(array)
            if variable.kind == "int":
                values = np.where(values < 0, np.nan, values)
            blocks.append(values.reshape(values.shape[0], -1))
        width = max(int(block.shape[1]) for block in blocks)
        absent = "" if worded else np.nan
        joined = np.concatenate(
            [
                np.hstack([block, np.full((block.shape[0], width - block.shape[1]), absent, dtype=block.dtype)])
                for block in blocks
            ]
        )
        if worded:
            texts[variable.name] = joined
        else:
            numbers[variable.name] = joined
    return numbers, texts


def _seconds_or_numbers(array: xr.DataArray | xr.Variable) -> NDArray[np.float64]:
    """Return float64, dates that xarray decoded as seconds since 1970."""
    values = array.values
    if np.issubdtype(values.dtype, np.datetime64):
        return np.where(np.isnat(values), np.nan, values.astype("datetime64[ns]").astype(np.int64) / 1e9)
    return values.astype(np.float64)


def _channel(
    name: str,
    time: NDArray[np.float64],
    ledger: Mapping[str, NDArray[Any]],
    numbers: Mapping[str, NDArray[np.float64]],
    texts: Mapping[str, NDArray[np.object_]],
) -> Channel:
    """Keep the blocks of the channel's own sources."""
    judged = (texts["stage"][:, 0] != "") | (texts["quality_status"][:, 0] != "")
    said = judged | np.isfinite(numbers["rms"][:, 0])
    rows = np.isin(ledger["source"].astype(str), np.unique(ledger["source"][said].astype(str)))
    return Channel(
        name=name,
        time=time[rows],
        sequence=ledger["sequence"][rows],
        status=ledger["status"][rows],
        numbers={key: values[rows] for key, values in numbers.items()},
        words={key: values[rows] for key, values in texts.items()},
    )


def _joined(attributes: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the attributes of several datasets as text, different values joined by "; "."""
    found: dict[str, list[str]] = {}
    for mapping in attributes:
        for key, value in mapping.items():
            text = " to ".join(f"{item:g}" for item in value) if isinstance(value, list | np.ndarray) else str(value)
            values = found.setdefault(str(key), [])
            if text not in values:
                values.append(text)
    return {key: "; ".join(values) for key, values in found.items()}


def _fold_rejected(runs: dict[_Key, Run], machine: str, place: str) -> None:
    """Count undated blocks of a dated machine with the dated ones if all of them were rejected."""
    undated, dated = runs.get((machine, place, False)), runs.get((machine, place, True))
    if undated is None or dated is None or any(status not in REJECTIONS for status in undated.counts):
        return
    runs[machine, place, True] = replace(dated, counts=Counter(dated.counts) + Counter(undated.counts))
    del runs[machine, place, False]


def _complete(runs: dict[_Key, Run], machine: str, place: str, store: StoredBeside) -> None:
    """Add what the store holds beside records, if it holds one run; its counts include blocks without a record."""
    keys = [key for key in runs if key[:2] == (machine, place)]
    if len(keys) == 1:
        found = runs[keys[0]]
        mine = {name: rows for name, rows in store.spectra.items() if rows and name in found.channels}
        beside = {"views": store.views, "ias": store.ias, "particles": store.particles}
        runs[keys[0]] = replace(found, counts=store.counts, spectra=mine, **beside)
