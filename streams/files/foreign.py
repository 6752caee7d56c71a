"""Files that no reader takes: what their first bytes and their names show, and how they become files that one takes."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

from streams.types.large import Data
from streams.types.listing import packed_suffix, unpacked_name

HEAD_BYTES = 2048
_BOOK = "save it as .xlsx or CSV"
HOW_TO_STATE = (
    'write {name}.json, or spallwatch.json for its folder: {{"layout": {{"type": "int16", "order": "little", '
    '"channels": 2, "interleaved": true, "header_bytes": 0}}, "rate_hz": 25600, "unit": "g", "scale": 0.001}}'
)
"""What states the layout of a file of some ``name``."""
_LAYOUT = 'a side-car with their "layout" makes them read'
_TABLE = "export the table as CSV"
_EXPORT = "export it as TDMS, MAT, HDF5 or CSV"
_MAGIC: tuple[tuple[bytes, str, str], ...] = (
    (b"ARROW1", "a Feather table", 'pandas.read_feather(FILE).to_csv("x.csv", index=False)'),
    (b"ORC", "an ORC table", _TABLE),
    (b"Obj\x01", "an Avro file", _TABLE),
    (b"SQLite format 3\0", "an SQLite database", _TABLE),
    (b"\xd0\xcf\x11\xe0", "an old or protected Office document", _BOOK),
    (b"%PDF", "a PDF document", "a report holds no samples: take the recording that it is of"),
    (b"MDF     ", "an ASAM MDF measurement", "asammdf exports it as MAT, HDF5 or CSV"),
    (b"UnFinMF ", "an ASAM MDF measurement that was not finished", "close it in its recorder, then export it as MAT"),
    (b"\x80\x04\x95", "a pickle of Python, which is never loaded", "save its arrays by numpy.save"),
    (b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", "unpack it into the folder"),
    (b"Rar!", "a RAR archive", "unpack it into the folder"),
    (b"\x28\xb5\x2f\xfd", "data compressed by zstd", "unpack it, or compress it by xz, bzip2 or gzip"),
    (b"\x89PNG", "a picture", "take the recording that it is of"),
    (b"\xff\xd8\xff", "a picture", "take the recording that it is of"),
    (b"\x7fELF", "a program", "it is no recording"),
    (b"|CF,", "a recording of imc FAMOS", _EXPORT),
)
_XML = "XML; export the samples that it describes as CSV, TDMS or HDF5"
_OWN: tuple[tuple[bytes, str], ...] = (
    (b"\x89HDF\r\n\x1a\n", "hdf5"), (b"TDSm", "tdms"), (b"RIFF", "wav"), (b"fLaC", "wav"), (b"MATLAB 5.0", "mat"),
    (b"CDF\x01", "netcdf"), (b"CDF\x02", "netcdf"), (b"CDF\x05", "netcdf"), (b"\x93NUMPY", "npy"), (b"    -1\n", "uff"),
    (b"    -1\r\n", "uff"), (b"PAR1", "parquet"),
)  # fmt: skip
_PACKED = ((b"\x1f\x8b", ".gz", "gzip"), (b"BZh", ".bz2", "bzip2"), (b"\xfd7zXZ\0", ".xz", "xz"))
_BY_ENDING = {
    ".xls": ("an Excel sheet of before 2007", _BOOK), ".xlsb": ("a binary Excel workbook", _BOOK),
    ".ods": ("a sheet of LibreOffice", _BOOK),
    ".feather": (_MAGIC[0][1], _MAGIC[0][2]), ".db": (_MAGIC[3][1], _TABLE), ".sqlite": (_MAGIC[3][1], _TABLE),
    ".tdm": ("a header of NI DIAdem, whose samples are in .tdx", "export both as TDMS"),
    ".tdx": ("samples of NI DIAdem, described in .tdm", "export both as TDMS"),
    ".tdms_index": ("the index of a TDMS file, which is made anew", "it can be removed"),
    ".dif": ("a header or table in the Data Interchange Format", "export it as CSV"),
    ".d7d": ("a recording of Dewesoft", _EXPORT), ".d7z": ("a recording of Dewesoft", _EXPORT),
    ".dxd": ("a recording of Dewesoft", _EXPORT), ".dxz": ("a recording of Dewesoft", _EXPORT),
    ".sie": ("a recording of SoMat (HBM eDAQ)", "export it as MAT or CSV, in InField or nCode"),
    ".mf4": ("an ASAM MDF measurement", _MAGIC[6][2]), ".mdf": ("an ASAM MDF measurement", _MAGIC[6][2]),
    ".rsp": ("a recording of MTS RPC", _EXPORT), ".rpc": ("a recording of MTS RPC", _EXPORT),
    ".pti": ("a recording of Brüel & Kjær", _EXPORT),
    ".atfx": ("a recording of ASAM ODS", _EXPORT), ".wdf": ("a recording of Yokogawa", _EXPORT),
    ".wdq": ("a recording of WinDaq", _EXPORT), ".adicht": ("a recording of LabChart", _EXPORT),
    ".trc": ("a trace of an oscilloscope", "export it as CSV"),
    ".wfm": ("a trace of an oscilloscope", "export it as CSV"),
    ".pkl": (_MAGIC[8][1], _MAGIC[8][2]), ".npz": ("several arrays of numpy in a zip", "save each by numpy.save"),
    ".zip": ("a zip archive", "unpack it into the folder, or make a tar archive of it"),
    ".pdf": (_MAGIC[5][1], _MAGIC[5][2]),
    ".bin": ("samples without a header", _LAYOUT), ".raw": ("samples without a header", _LAYOUT),
}  # fmt: skip


def seen_in(name: str, head: bytes) -> str | None:
    """Return in words what a file seems to be that is not read as what its name says, and how it is converted.

    Args:
        name: of the file.
        head: its first ``HEAD_BYTES`` bytes; b"" where they are not known: its name alone counts.

    Returns:
        None where neither shows anything.
    """
    ending = PurePosixPath(unpacked_name(name)).suffix.lower()
    found = _by_content(name, head, ending)
    what = _BY_ENDING.get(ending)
    if found is None and what is not None:
        return f"{what[0]}, by its ending; {what[1]}"
    return _XML if found is None and head.startswith(b"<?xml") else found


def _by_content(name: str, head: bytes, ending: str) -> str | None:
    for magic, suffix, packer in _PACKED:
        if head.startswith(magic):
            is_named = packed_suffix(name) == suffix
            return None if is_named else f"data compressed by {packer}; let its name end in {suffix}"
    if head.startswith(b"PK\x03\x04"):
        return _zipped(head, ending)
    for magic, what, how in _MAGIC:
        if head.startswith(magic):
            return f"{what}; {how}"
    for magic, kind in _OWN:
        if head.startswith(magic):
            return _of_kind(kind)
    return None


def _of_kind(kind: str) -> str:
    return f'a file of {kind}, which a [[source]] with format = "{kind}" reads'


def _zipped(head: bytes, ending: str) -> str:
    inside = {b"xl/": ".xlsx", b"opendocument.spreadsheet": ".ods", b".npy": ".npz"}
    kind = next((known for sign, known in inside.items() if sign in head), ending)
    if ending in (".xlsx", ".xlsm"):
        return _of_kind("xlsx")
    if kind == ".xlsx":
        return "an Excel workbook; let its name end in .xlsx"
    what, how = _BY_ENDING.get(kind, _BY_ENDING[".zip"])
    return f"{what}; {how}"


def _is_text(head: bytes) -> bool:
    return b"\0" not in head and sum(byte < 9 or 13 < byte < 32 for byte in head) * 50 <= len(head)


def first_bytes(head: bytes) -> str:
    """Return how a file begins, for people: its text, else bytes in hexadecimal."""
    if not head:
        return "nothing"
    if _is_text(head):
        line = re.sub(r"[^ -~]", "?", head[:32].decode("utf-8", "replace").splitlines()[0])
        return repr(line)
    return " ".join(f"{byte:02x}" for byte in head[:8])


def described(name: str, size: int, head: bytes) -> str:
    """Return what is seen in a file of ``size`` bytes that is not read: how it begins, and what it seems to be."""
    found = seen_in(name, head)
    words = "" if found is None else f": {found}"
    return f"{size} bytes that begin with {first_bytes(head)}{words}"


def with_hint(reason: str, name: str, data: Data) -> str:
    """Return why a file cannot be read, with what it seems to be instead where its bytes show it."""
    head = bytes(data[:HEAD_BYTES])
    found = _by_content(name, head, PurePosixPath(unpacked_name(name)).suffix.lower())
    return reason if found is None or found.startswith("a file of") else f"{reason}; it is {found}"
