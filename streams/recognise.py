"""What the files of a recording are: by configuration, else by what is found in them, never by a guess."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import PurePosixPath
from zoneinfo import ZoneInfo

from streams.dataset import DATA_SETS, DataSet, FileFacts, data_set_named
from streams.files import Files, Item, is_archive, natural_key
from streams.readers.mat import mat_variables, read_mat
from streams.readers.npy import read_npy
from streams.readers.packed import unpack, unpacked_name
from streams.readers.reading import ReaderError, Reading
from streams.readers.text import read_text
from streams.readers.wav import read_wav
from streams.spec import SourceError, SourceSpec

FORMATS = {
    "csv": (".csv", ".txt", ".tsv", ".dat", ".asc"),
    "npy": (".npy",),
    "wav": (".wav", ".flac"),
    "mat": (".mat",),
}
"""The plain formats and the endings by which they are recognised."""

_XJTU_HEADER = "Horizontal_vibration_signals"


def plain(kind: str, spec: SourceSpec, endings: tuple[str, ...]) -> DataSet:
    """Describe files of a plain format, which belong to no data set.

    Args:
        kind: one of FORMATS.
        spec: the configuration; the keys of its channels say which variables of a MAT file are wanted.
        endings: of the files that are meant; none: all are.

    Returns:
        A data set without a unit and, but for WAV, without a rate.
    """
    keys = tuple(channel.key for channel in spec.channels if channel.key is not None)
    readers: dict[str, Callable[[bytes, str], Reading]] = {
        "csv": read_text,
        "npy": read_npy,
        "wav": read_wav,
        "mat": lambda data, path: read_mat(data, path, keys or ("*",)),
    }

    def facts(path: str, place: str, zone: ZoneInfo) -> FileFacts | None:
        meant = not endings or unpacked_name(path).lower().endswith(endings)
        return FileFacts(natural_key(path)) if meant else None

    shown = ", ".join(f"*{ending}" for ending in endings) or "any name"
    return DataSet(kind, shown, facts, readers[kind], unit=None, states_rate=kind == "wav")


def data_set_of(spec: SourceSpec, files: Files, kind: str) -> DataSet:
    """Find what a recording is.

    Args:
        spec: the configuration of the source.
        files: where it lies.
        kind: name of a data set or of a format, or "auto".

    Returns:
        The data set, or the description of a plain format.

    Raises:
        SourceError: the name is not known, or nothing is recognised.
    """
    where = f"[[source]] {spec.name}"
    wanted = kind.strip().lower()
    wanted = {"text": "csv", "flac": "wav"}.get(wanted, wanted)
    if wanted in FORMATS:
        return plain(wanted, spec, FORMATS[wanted] if files.several else ())
    if wanted != "auto":
        named = data_set_named(kind)
        if named is None:
            known = ", ".join(["auto", *FORMATS, *DATA_SETS])
            raise SourceError(f"{where}: format or data set {kind!r} is not known; expected one of {known}")
        return named
    found: DataSet | None = None
    paths: list[str] = []
    try:
        for item in files:
            paths.append(item.path)
            by_name = _recognised_by_name(item, files)
            if by_name is not None:
                return by_name
            found = found or _recognised_by_content(item, spec, files)
            if found is not None and found.name in DATA_SETS:
                return found
    except ReaderError as error:
        if found is None:
            raise SourceError(f"{where}: url: {error}") from error
    if found is None:
        raise SourceError(f"{where}: url: {files.root} {_nothing(paths)}")
    return found


def _nothing(paths: list[str]) -> str:
    if not paths:
        return "holds no files"
    archives = [path for path in paths if is_archive(path)]
    if archives:
        return f"holds archives ({', '.join(archives[:5])}); name one of them"
    endings = ", ".join(ending for endings in FORMATS.values() for ending in endings)
    return (
        f"holds nothing that is recognised; expected a known data set ({', '.join(DATA_SETS)}) "
        f"or files ending in {endings}; or give format"
    )


def _recognised_by_name(item: Item, files: Files) -> DataSet | None:
    for name in ("pronostia", "ims"):
        if DATA_SETS[name].facts(item.path, str(files.root), ZoneInfo("UTC")) is not None:
            return DATA_SETS[name]
    return None


def _recognised_by_content(item: Item, spec: SourceSpec, files: Files) -> DataSet | None:
    """Recognise a recording by one of its files; None where this file says nothing."""
    ending = PurePosixPath(unpacked_name(item.path)).suffix.lower()
    kind = next((kind for kind, endings in FORMATS.items() if ending in endings), None)
    if kind is None:
        return None
    if kind == "mat":
        return _recognised_mat(item, files) or plain(kind, spec, (ending,))
    if kind == "csv" and ending != ".csv" and files.several and not _is_numbers(item):
        # A folder may well hold a README.txt.
        return None
    if kind == "csv" and DATA_SETS["xjtu_sy"].facts(item.path, str(files.root), ZoneInfo("UTC")) is not None:
        data = _bytes(item)
        if data is not None and _XJTU_HEADER.encode() in data[:200]:
            return DATA_SETS["xjtu_sy"]
    return plain(kind, spec, (ending,))


def _is_numbers(item: Item) -> bool:
    data = _bytes(item)
    try:
        return data is not None and bool(read_text(data, item.path).names)
    except ReaderError:
        return False


def _bytes(item: Item) -> bytes | None:
    try:
        return unpack(item.read(), item.path)
    except ReaderError:
        return None


def _recognised_mat(item: Item, files: Files) -> DataSet | None:
    """Recognise a data set by the variables of a MAT file."""
    data = _bytes(item)
    if data is None:
        return None
    try:
        variables = mat_variables(data, item.path)
    except ReaderError:
        return None
    if any(name.startswith("X") and name.endswith(("_DE_time", "_FE_time", "_BA_time")) for name in variables):
        return DATA_SETS["cwru"]
    if variables.get("bearing", ((), ""))[1] == "struct":
        return DATA_SETS["mfpt"]
    if {"Data", "SampleFrequency"} <= variables.keys():
        return DATA_SETS["uestc"]
    vectors = [shape for shape, kind in variables.values() if kind == "double" and max(shape, default=0) > 1]
    hit_sm = DATA_SETS["hit_sm"]
    if vectors == [(262144, 1)] and hit_sm.facts(item.path, str(files.root), ZoneInfo("UTC")) is not None:
        return hit_sm
    return None
