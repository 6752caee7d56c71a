"""Single files compressed by xz, bzip2 or gzip."""

from __future__ import annotations

import bz2
import gzip
import io
import lzma
import zlib

from streams.readers.reading import MAX_BYTES, ReaderError

_SUFFIXES = (".xz", ".bz2", ".gz")


def packed_suffix(name: str) -> str:
    """Return ".xz", ".bz2" or ".gz" where a file name ends so, else ""."""
    return next((suffix for suffix in _SUFFIXES if name.lower().endswith(suffix)), "")


def unpacked_name(name: str) -> str:
    """Return a file name without its compression suffix."""
    suffix = packed_suffix(name)
    return name[: -len(suffix)] if suffix else name


def unpack(data: bytes, name: str, limit: int = MAX_BYTES) -> bytes:
    """Decompress a file if its name says that it is compressed.

    Args:
        data: the bytes of the file.
        name: its name, which decides.
        limit: most bytes to give.

    Returns:
        The decompressed bytes, or ``data`` itself.

    Raises:
        ReaderError: ``incomplete`` where the file breaks off, ``unreadable`` where it is no such file, ``refused``
            where it would become larger than ``limit``.
    """
    suffix = packed_suffix(name)
    if not suffix or not data:
        return data
    try:
        with _open(suffix, data) as stream:
            raw = stream.read(limit + 1)
    except EOFError as error:
        raise ReaderError("incomplete", f"{name}: the compressed file breaks off before its end") from error
    except (OSError, lzma.LZMAError, zlib.error, ValueError) as error:
        raise ReaderError("unreadable", f"{name}: not a valid {suffix} file ({error})") from error
    if len(raw) > limit:
        raise ReaderError("refused", f"{name}: larger than {limit} bytes when unpacked")
    return raw


def _open(suffix: str, data: bytes) -> lzma.LZMAFile | bz2.BZ2File | gzip.GzipFile:
    if suffix == ".xz":
        return lzma.LZMAFile(io.BytesIO(data))
    return bz2.BZ2File(io.BytesIO(data)) if suffix == ".bz2" else gzip.GzipFile(fileobj=io.BytesIO(data))
