"""Recognise the files of a recording by configuration, names and content."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any
from zoneinfo import ZoneInfo

from streams.files.container import Files, Item, is_archive
from streams.files.datasets import DATA_SETS, DataSet, FileFacts, is_of_ims
from streams.files.foreign import HEAD_BYTES, HOW_TO_STATE, described
from streams.files.formats.hdf5 import read_hdf5
from streams.files.formats.mat import mat_variables, read_mat
from streams.files.formats.netcdf import read_netcdf
from streams.files.formats.npy_wav import read_plain_npy, read_wav
from streams.files.formats.parquet import read_parquet
from streams.files.formats.raw import RAW_ENDINGS, Layout, described_samples, undescribed
from streams.files.formats.tdms import read_tdms
from streams.files.formats.text import first_characters, read_layout
from streams.files.formats.uff import read_uff
from streams.files.formats.xlsx import read_xlsx
from streams.files.groups import with_files
from streams.files.judge import opened_rate
from streams.files.notes import apply_note, note_of
from streams.files.parse.child import isolated
from streams.files.sidecar import (
    FOLDER_NAMES,
    SideCar,
    apply_sidecar,
    find_sidecar,
    is_beside,
    is_pulse_file,
    is_sidecar,
    with_pulse_files,
)
from streams.files.statements import is_of_vibration
from streams.types.large import Data
from streams.types.listing import natural_key, shown, unpacked_name
from streams.types.samples import ReaderError, Samples
from streams.types.spec import ChannelSpec, SourceError, SourceSpec


def check_stated(spec: SourceSpec, data_set: DataSet, facts: FileFacts, samples: Samples | None) -> None:
    """Check that rate and units are stated, and only once.

    Args:
        spec: of the source.
        data_set: of its files.
        facts: stated by the path of the first file.
        samples: of the first file, where it was read.

    Raises:
        SourceError: rate or unit are missing, or the unit is another one.
    """
    where = f"[[source]] {spec.name}"
    states_rate = data_set.states_rate and (samples is None or samples.rate is not None)
    if samples is not None and spec.rate is None and facts.rate is None and samples.rate_readings:
        opened = opened_rate(samples)
        raise SourceError(f"{where}: rate_hz is missing: {opened.written} may mean {opened.meant}")
    if facts.rate is None and not states_rate and spec.rate is None:
        raise SourceError(f"{where}: rate_hz is missing: neither the files nor {data_set.name} state a rate")
    states_unit = data_set.states_unit and (
        samples is None
        or any(map(is_of_vibration, samples.units))
        or any(scale is not None for scale in samples.count_scales)
        or None not in samples.units
    )
    if data_set.unit is None and not states_unit and not spec.channels:
        raise SourceError(f"{where}: a [[channel]] with its unit is missing: these files do not state one")
    for channel in spec.channels:
        stated = data_set.unit
        if stated is None and channel.unit is None and not states_unit:
            raise SourceError(f"[[channel]] {channel.name}: unit is missing: the files of {spec.name} state none")
        if channel.unit is not None and stated not in (None, "unknown", channel.unit):
            raise SourceError(
                f"[[channel]] {channel.name}: unit is {channel.unit!r}, but {data_set.name} is in {stated}"
            )


FORMATS = {
    "csv": (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm"),
    "npy": (".npy",),
    "wav": (".wav", ".flac"),
    "mat": (".mat",),
    "tdms": (".tdms",),
    "hdf5": (".h5", ".hdf5", ".hdf"),
    "uff": (".uff", ".unv", ".bunv", ".uf"),
    "netcdf": (".nc", ".nc4", ".cdf"),
    "xlsx": (".xlsx", ".xlsm"),
    "parquet": (".parquet", ".pq"),
    "raw": RAW_ENDINGS,
}
"""The plain formats and their file endings."""
DIGITS = tuple("0123456789")
"""Ends of names of texts without an ending: a date in points."""
_ALIASES = {"text": "csv", "lvm": "csv", "flac": "wav", "h5": "hdf5", "uff58": "uff", "unv": "uff", "nc": "netcdf"}
_ALIASES |= {"excel": "xlsx", "xlsm": "xlsx", "pq": "parquet"}
_SILENT = ("npy", "raw")
"""Formats that state neither rate nor unit; sound states its rate."""
_EXTRAS = {
    "tdms": ("nptdms", "tdms"), "hdf5": ("h5py", "hdf5"), "uff": ("pyuff", "uff"), "parquet": ("pyarrow", "tables")
}  # fmt: skip
_RECORDED = (".csv", ".tsv", ".lvm")
"""Endings of text that is recorded: another text among several files may be a note."""
_MAX_SEEN = 5
"""Files of which it is said what was seen in them."""
_MATRICES = ("mat", "hdf5", "netcdf")
_HOLD_PULSES = ("mat", "hdf5", "netcdf", "tdms")
_XJTU_HEADER = "Horizontal_vibration_signals"


def plain(kind: str, spec: SourceSpec, endings: tuple[str, ...]) -> DataSet:
    """Describe the files of a plain format with some ``endings`` (none: all).

    The keys of the configured channels select the variables of a file.

    Raises:
        SourceError: the format needs a library that is not installed.
    """
    if kind in _EXTRAS and importlib.util.find_spec(_EXTRAS[kind][0]) is None:
        library, extra = _EXTRAS[kind]
        raise SourceError(
            f"[[source]] {spec.name}: {kind} files need {library}, which is not installed: "
            f'pip install "spallwatch[{extra}]"'
        )
    # The rows of files that are read together have other names than in their files.
    asked = spec.channels if len(spec.files) < 2 else ()
    keys = [channel.key for channel in asked if channel.key is not None]
    # A matrix gives rows NAME_1, NAME_2, ...
    keys += [key[: match.start()] for key in keys if (match := re.search(r"_\d+$", key)) and kind in _MATRICES]
    if len(asked) > len([channel for channel in asked if channel.key is not None]):
        # A channel that is found by its column or name may be any variable.
        keys = []
    zone = spec.timezone
    inside = None if is_beside(spec.pulses) else spec.pulses
    if inside is not None and kind not in _HOLD_PULSES:
        raise SourceError(
            f"[[source]] {spec.name}: pulses = {inside!r}: files of {kind} hold no array of pulses besides their "
            "channels; give a file beside them, such as {stem}.pulses.csv, or [operating] tacho_channel"
        )
    wishes = [_titles(asked, any_unit=False), _titles(asked, any_unit=True)]
    readers: dict[str, Callable[[Data, str], Samples]] = {
        "csv": isolated(read_layout, zone, spec.disregard),
        "npy": read_plain_npy,
        "wav": isolated(read_wav),
        "mat": isolated(read_mat, keys or ["*"], zone, inside, *wishes, spec.disregard),
        "tdms": isolated(read_tdms, keys, zone, inside, *wishes, spec.disregard),
        "hdf5": isolated(read_hdf5, keys, zone, inside, *wishes, spec.disregard),
        "uff": isolated(read_uff, keys, zone, spec.disregard),
        "netcdf": isolated(read_netcdf, keys, zone, inside, *wishes, spec.disregard),
        "xlsx": isolated(read_xlsx, [*keys, *wishes[0], *wishes[1]], zone, spec.disregard),
        "parquet": isolated(read_parquet, zone, spec.disregard),
        "raw": undescribed,
    }

    def facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
        meant = not endings or unpacked_name(path).lower().endswith(endings)
        return FileFacts(natural_key(path)) if meant else None

    shown = ", ".join(f"*{ending}" for ending in endings if ending not in DIGITS) or "any name"
    rate, unit = kind not in _SILENT, kind not in (*_SILENT, "wav")
    return DataSet(
        kind, shown, facts, readers[kind], unit=None, states_rate=rate, states_unit=unit, plain=True, endings=endings
    )


def _titles(channels: Sequence[ChannelSpec], *, any_unit: bool) -> list[str]:
    """Return the patterns of the rows of channels, of those that are taken in any unit or the others."""
    return [
        channel.key or as_pattern(channel.column if isinstance(channel.column, str) else channel.name)
        for channel in channels
        if channel.any_unit == any_unit and not isinstance(channel.column, int)
    ]


def as_pattern(title: str) -> str:
    """Return the key that matches a title and nothing else."""
    return re.sub(r"([*?\[])", r"[\1]", title)


def data_set_of(spec: SourceSpec, files: Files, kind: str, endings: tuple[str, ...] | None = None) -> DataSet:
    """Return the data set or format of a recording ("auto": recognised), with side-cars.

    ``endings``: of the files of a plain format that was recognised before; no file is opened then.

    Raises:
        SourceError: the name is not known, nothing is recognised, or a library is missing.
    """
    known = endings is not None and kind in FORMATS
    found = plain(kind, spec, endings or ()) if known else _found_data_set(spec, files, kind)
    if spec.files and not found.plain:
        raise SourceError(
            f"[[source]] {spec.name}: files = {spec.files[0]!r}: {found.name} says which files are its own"
        )
    if len(spec.files) > 1 and files.sequential:
        raise SourceError(f"[[source]] {spec.name}: files = {list(spec.files)}: archives have no files beside files")
    found = _with_beside(found, spec, files)
    return with_files(found, spec, files.root) if spec.files else found


def _with_beside(found: DataSet, spec: SourceSpec, files: Files) -> DataSet:
    """Return the data set with side-cars, and with files of pulses."""
    if is_beside(spec.pulses):
        if files.sequential:
            raise SourceError(f"[[source]] {spec.name}: pulses = {spec.pulses!r}: archives have no files beside files")
        return with_pulse_files(_with_sidecars(found, spec, files), spec, files.root)
    if spec.pulses is not None and not found.plain:
        raise SourceError(f"[[source]] {spec.name}: pulses = {spec.pulses!r}: {found.name} has none that is known")
    return found if files.sequential else _with_sidecars(found, spec, files)


def one_run(paths: Iterable[str], name: str, data_set: DataSet) -> list[str]:
    """Return the paths; SourceError where they are of several runs."""
    kept = list(paths)
    if data_set.snapshot:
        folders = sorted({path.rpartition("/")[0] or "." for path in kept})
        if len(folders) > 1:
            shown = ", ".join(folders[:5])
            raise SourceError(f"[[source]] {name}: url: holds several runs ({shown}); name the folder of one of them")
    return kept


def _with_sidecars(data_set: DataSet, spec: SourceSpec, files: Files) -> DataSet:
    """Return the data set with a reader that applies the side-car of each file."""
    root = files.root

    def read(data: Data, path: str) -> Samples:
        sidecar, note = find_sidecar(root, path, spec.timezone), note_of(root, path)
        layout = None if sidecar is None else _layout_in(sidecar, path, data_set.name)
        samples = data_set.read(data, path) if layout is None else described_samples(data, path, layout)
        if note is not None:
            samples = apply_note(samples, note, path, spec.timezone, spec.disregard)
        return samples if sidecar is None else samples.of_each(lambda one: apply_sidecar(one, sidecar, path))

    there = _has_sidecars(root, files)
    return replace(
        data_set, read=read, states_rate=data_set.states_rate or there, states_unit=data_set.states_unit or there
    )


def _layout_in(sidecar: SideCar, path: str, kind: str) -> Layout | None:
    """Return the layout of a file of a kind; ReaderError where its own side-car has one and the kind has none."""
    if kind != "raw" and sidecar.layout is not None and sidecar.path == f"{path}.json":
        raise ReaderError("unreadable", f'{path}: {sidecar.path} states a layout, of format = "raw", not of {kind}')
    return sidecar.layout if kind == "raw" else None


def _has_sidecars(root: Path, files: Files) -> bool:
    """Return whether there may be side-cars, of single files or of a folder."""
    if any((root / name).exists() for name in FOLDER_NAMES):
        return True
    several = {item.path.rpartition("/")[2] for item in files} if files.several else set[str]()
    names = several or {path.name for path in (root.iterdir() if root.is_dir() else ())}
    return any(is_sidecar(name, names) for name in names)


def _found_data_set(spec: SourceSpec, files: Files, kind: str) -> DataSet:
    where = f"[[source]] {spec.name}"
    wanted = kind.strip().lower()
    wanted = _ALIASES.get(wanted, wanted)
    if wanted in FORMATS:
        return plain(wanted, spec, (*FORMATS[wanted], *DIGITS * (wanted == "csv")) if files.several else ())
    if wanted != "auto":
        named = DATA_SETS.get(re.sub(r"[-\s]", "_", wanted))
        if named is None:
            known = ", ".join(["auto", *FORMATS, *DATA_SETS])
            raise SourceError(f"{where}: format or data set {kind!r} is not known; expected one of {known}")
        return named
    found: DataSet | None = None
    paths: list[str] = []
    seen: dict[str, str] = {}
    unfilled: list[Item] = []
    try:
        for item in files:
            if is_pulse_file(spec.pulses, item.path) or not fnmatchcase(item.path, (*spec.files, "*")[0]):
                continue
            paths.append(item.path)
            if not item.filled:
                unfilled.append(item)
                continue
            named = _recognised_by_name(item, files)
            if named is not None:
                return named
            found = found or _recognised_by_content(item, spec, files, seen)
            if found is not None and found.name in DATA_SETS:
                return found
    except ReaderError as error:
        if found is None:
            raise SourceError(f"{where}: url: {error}") from error
    # A file without content, or one that is refused, counts only where there is no other.
    by_name = (_recognised_by_name(item, files) or _recognised_by_ending(item, spec, files) for item in unfilled)
    found = found or next((data_set for data_set in by_name if data_set is not None), None)
    if found is None:
        raise SourceError(f"{where}: url: {files.root} {_nothing(paths, seen)}")
    return found


def _recognised_by_name(item: Item, files: Files) -> DataSet | None:
    name = next((name for name in ("pronostia", "ims", "paderborn") if _is_named_as(name, item, files)), None)
    other = (name == "ims" and not is_of_ims(item.path)) or (name == "pronostia" and not _is_clocked(item))
    return None if name is None or other else DATA_SETS[name]


def _is_clocked(item: Item) -> bool:
    """Return whether a file that can be read begins with six numbers, as those of PRONOSTIA."""
    line = ((_asked(first_characters, item) if item.filled else None) or "").lstrip().partition("\n")[0]
    return not line or re.fullmatch(r"(?:[-+\d.einfa\s]+[,;]){5}[-+\d.einfa\s]+", line.lower()) is not None


def _kind_by_ending(item: Item) -> tuple[str | None, str]:
    """Return the plain format that the ending of a name stands for, or None, and the ending."""
    ending = PurePosixPath(unpacked_name(item.path)).suffix.lower()
    if ending[1:].isdigit():
        return "csv", ending
    return next((kind for kind, endings in FORMATS.items() if ending in endings), None), ending


def _recognised_by_ending(item: Item, spec: SourceSpec, files: Files) -> DataSet | None:
    """Return the plain format that an ending stands for; among several files a .txt may be anything."""
    kind, ending = _kind_by_ending(item)
    unclear = kind == "csv" and ending not in _RECORDED and files.several
    return None if kind is None or unclear else plain(kind, spec, DIGITS if ending[1:].isdigit() else (ending,))


def _nothing(paths: list[str], seen: Mapping[str, str]) -> str:
    """Return in words that no file of a recording is read, with what was ``seen`` in some of them."""
    if not paths:
        return "holds no files"
    archives = [path for path in paths if is_archive(path)]
    if archives:
        return f"holds archives ({', '.join(archives[:5])}); name one of them"
    endings = ", ".join(dict.fromkeys(ending for endings in FORMATS.values() for ending in endings))
    told = "".join(f"; {shown(path)}: {words}" for path, words in seen.items())
    return (
        f"holds nothing that is recognised{told}; expected a known data set ({', '.join(DATA_SETS)}) "
        f"or files ending in {endings}; or give format"
    )


def _is_named_as(name: str, item: Item, files: Files) -> bool:
    """Return whether a file is named as those of a data set."""
    return DATA_SETS[name].facts(item.path, str(files.root), ZoneInfo("UTC")) is not None


def _recognised_by_content(item: Item, spec: SourceSpec, files: Files, seen: dict[str, str]) -> DataSet | None:
    """Return the data set or format that one file shows, or None; then add to ``seen`` what was seen in it."""
    kind, ending = _kind_by_ending(item)
    if (kind is None or ending in RAW_ENDINGS) and not files.sequential:
        sidecar = find_sidecar(files.root, item.path)
        if sidecar is not None and sidecar.layout is not None:
            return plain("raw", spec, (ending,))
    if kind in (None, "raw"):
        if len(seen) < _MAX_SEEN:
            with suppress(ReaderError):
                data = item.read()
                seen[item.path] = described(item.path, len(data), bytes(data[:HEAD_BYTES]))
                if kind == "raw":
                    seen[item.path] += f"; {HOW_TO_STATE.format(name=item.path.rpartition('/')[2])}"
        return None
    if kind == "mat":
        return _recognised_mat(item, files) or plain(kind, spec, (ending,))
    if kind == "csv" and ending not in _RECORDED and files.several:
        # It may be a README.txt.
        try:
            isolated(read_layout)(item.read(), item.path)
        except ReaderError as error:
            seen |= {item.path: str(error).removeprefix(f"{item.path}: ")} if len(seen) < _MAX_SEEN else {}
            return None
    is_named = kind == "csv" and _is_named_as("xjtu_sy", item, files)
    if is_named and _XJTU_HEADER in (_asked(first_characters, item) or ""):
        return DATA_SETS["xjtu_sy"]
    return plain(kind, spec, DIGITS if ending[1:].isdigit() else (ending,))


def _asked(function: Callable[[bytes, str], Any], item: Item) -> Any:
    """Return what a function finds in a file, called in the child process; None where it cannot be read."""
    try:
        return isolated(function)(item.read(), item.path)
    except ReaderError:
        return None


def _recognised_mat(item: Item, files: Files) -> DataSet | None:
    """Return the data set that the variables of a MAT file show, or None."""
    listed = _asked(mat_variables, item)
    if listed is None:
        return None
    variables = {name: (tuple(shape), kind) for name, (shape, kind) in listed.items()}
    if any(name.startswith("X") and name.endswith(("_DE_time", "_FE_time", "_BA_time")) for name in variables):
        return DATA_SETS["cwru"]
    if variables.get("bearing", ((), ""))[1] == "struct":
        return DATA_SETS["mfpt"]
    if {"Data", "SampleFrequency"} <= variables.keys():
        return DATA_SETS["uestc"]
    vectors = [shape for shape, kind in variables.values() if kind == "double" and max(shape, default=0) > 1]
    return DATA_SETS["hit_sm"] if vectors == [(262144, 1)] and _is_named_as("hit_sm", item, files) else None
