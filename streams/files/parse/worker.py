"""The child process of unsafe parsers: a line a request, a line an answer.

Samples are in shared memory. The parent is trusted, the files are not; nothing is pickled in either direction.
"""

from __future__ import annotations

import importlib
import json
import logging
import math
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from models.platform.portable import MemoryFile, limit, read_at, read_into_at, taken_over, write_at
from streams.files.container import unpack
from streams.types import large
from streams.types.large import NOT_OF_CONTENT, FileBytes, NoRoomError, TooLargeError, contiguous, forget_pages
from streams.types.limits import MAX_BYTES, max_loaded_bytes
from streams.types.samples import ReaderError, Samples

Reader = TypeVar("Reader", bound=Callable[..., Any])
_LIBRARIES = {
    "streams.files.datasets": ("pandas",),
    "streams.files.formats.text": ("pandas",),
    "streams.files.formats.hdf5": ("h5py",),
    "streams.files.formats.mat": ("h5py",),
    "streams.files.formats.netcdf": ("h5py",),
    "streams.files.formats.tdms": ("nptdms",),
    "streams.files.formats.uff": ("pyuff",),
    "streams.files.formats.xlsx": ("pandas",),
    "streams.files.formats.parquet": ("pyarrow.parquet", "pandas"),
}
_FROM_DISK = "takes_files_from_disk"
_FIELDS = (
    *("channels", "names", "columns", "units", "rate", "start", "speed", "load", "scaled", "stamp", "stored"),
    *("written", "pulse_epoch", "pulses_per_revolution", "beside", "rate_readings", "rate_resolution", "rate_written"),
    *("sensitivities", "count_scales", "open_gain", "open_multiplier", "stated_speed", "stated_load", "unlisted"),
    "torn",
)


def main() -> None:
    """Answer requests until the parent closes its end.

    The arguments are those of :func:`models.platform.portable.handed_down`.
    """
    requests_fd, answers_fd, input_fd, output_fd = taken_over(sys.argv[1:5])
    # No core dump, no large file; memory and processor time are limited for each file.
    limit("CORE", 0)
    limit("FSIZE", MAX_BYTES)
    # nptdms logs the bytes of the files that it cannot read.
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    with os.fdopen(requests_fd, "rb") as requests, os.fdopen(answers_fd, "wb") as answers:
        for line in requests:
            request = json.loads(line)
            _load_libraries(request["module"])
            # The limit counts all that the process has used, so it moves on with each file.
            limit("CPU", math.ceil(sum(os.times()[:2])) + request["cpu_s"])
            limit("AS", request["memory"])
            # From here on the time is that of the file.
            answers.write(b"\n")
            answers.flush()
            answer = _answer(request, input_fd, output_fd)
            answers.write(json.dumps(answer).encode() + b"\n")
            answers.flush()


def _load_libraries(module: str) -> None:
    """Import what a module of readers imports only when it reads; one that is missing is its error."""
    importlib.import_module(module)
    for library in _LIBRARIES.get(module, ()):
        with suppress(ImportError):
            importlib.import_module(library)


def _answer(request: dict[str, Any], input_fd: int, output_fd: int) -> dict[str, Any]:
    name = request["name"]
    try:
        path = request.get("path")
        data = unpack(read_all(input_fd, request["size"]) if path is None else FileBytes.opened(path), name)
        function = getattr(importlib.import_module(request["module"]), request["function"])
        if isinstance(data, FileBytes) and not hasattr(function, _FROM_DISK):
            data = data[:]
        found = function(data, name, *request["arguments"])
        return _answer_of(found, request, output_fd) if isinstance(found, Samples) else {"value": found}
    except NoRoomError as error:
        return {"no_room": error.size, "reason": error.reason}
    except TooLargeError as error:
        return {"status": "refused", "reason": f"{name}: {error}"}
    except ReaderError as error:
        return {"status": error.status, "reason": str(error)}
    except MemoryError:
        allowed = f"{request['memory'] >> 20} MiB of memory"
        return {"status": "refused", "reason": f"{name}: reading its {request['size']} bytes needs more than {allowed}"}
    except RecursionError:
        return {"status": "unreadable", "reason": f"{name}: nested too deeply"}
    except Exception as error:
        # Third-party parsers raise any exception on corrupt input.
        return {"status": "unreadable", "reason": f"{name}: the reader failed ({type(error).__name__})"}


def from_disk(function: Reader) -> Reader:
    """Mark a reader that takes :class:`streams.types.large.FileBytes`; others get bytes of a large file in memory."""
    setattr(function, _FROM_DISK, True)
    return function


def _answer_of(found: Samples, request: Mapping[str, Any], output_fd: int) -> dict[str, Any]:
    """Write samples to the file that is meant for them, a large array to one on disk; return what is told of them.

    Raises:
        TooLargeError: there are more than a file of this process may hold.
        NoRoomError: there is no room for a large array.
    """
    size = sum(one.values.nbytes for one in found.recordings)
    if size > MAX_BYTES:
        raise TooLargeError(size)
    if request.get("disk") is None or size < large.MAX_IN_MEMORY:
        return _written(found, output_fd)
    with Path(request["disk"]).open("r+b", buffering=0) as disk:
        try:
            return {**_written(found, disk.fileno()), "on_disk": True}
        except OSError as error:
            raise NoRoomError(size, str(error.strerror)) from error


def _written(found: Samples, output_fd: int) -> dict[str, Any]:
    values = found.values
    if values.dtype.kind != "f" or values.dtype.itemsize not in (4, 8):
        raise TypeError(f"a reader gave {values.dtype}")
    array = contiguous(values, values.dtype.newbyteorder("="))
    step = max(1, large.PIECE_BYTES // array.dtype.itemsize)
    flat = array.reshape(-1)
    parts = [flat[begin : begin + step].data for begin in range(0, flat.size, step)]
    answer: dict[str, Any] = {**_told(found), "itemsize": array.dtype.itemsize}
    if found.following:
        answer["following"] = [_told(one) for one in found.following]
        parts += [np.ascontiguousarray(one.values, array.dtype).reshape(-1).data for one in found.following]
    if found.pulses is not None:
        times = np.ascontiguousarray(found.pulses.times, dtype=np.float64)
        parts.append(times.data)
        answer["pulses"] = (times.size, found.pulses.per_revolution)
    write_all(output_fd, *parts)
    return answer


def _told(found: Samples) -> dict[str, Any]:
    """Return the shape and what is stated, without what samples have by default."""
    by_default = vars(Samples(found.values))
    stated = {field: value for field in _FIELDS if (value := getattr(found, field)) != by_default[field]}
    # These are filled in from each other.
    named = {field: getattr(found, field) for field in ("columns", "channels", "names")}
    return {"shape": found.values.shape, "stated": {**stated, **named}}


def write_all(handle: int, *parts: bytes | memoryview) -> None:
    """Make parts, one after the other, the content of an open file; OSError where there is no room."""
    end = 0
    for part in parts:
        # An empty array cannot be cast.
        view, done = memoryview(part).cast("B") if len(part) else memoryview(b""), 0
        while done < len(view):
            done += write_at(handle, view[done:], end + done)
        end += len(view)
        if isinstance(view.obj, np.ndarray):
            forget_pages(view.obj)
    os.ftruncate(handle, end)


def read_all(handle: int, size: int, begin: int = 0) -> bytes:
    """Return ``size`` bytes of an open file, by default the first; EOFError where it is shorter."""
    data = read_at(handle, size, begin)
    while len(data) < size:
        more = read_at(handle, size - len(data), begin + len(data))
        if not more:
            raise EOFError(f"{len(data)} bytes instead of {size}")
        data += more
    return data


def read_into(handle: int, target: memoryview) -> None:
    """Fill ``target`` from an open file; EOFError where it is shorter."""
    view, place = target.cast("B"), 0
    while place < len(view):
        got = read_into_at(handle, view[place:], place)
        if not got:
            raise EOFError(f"{place} bytes instead of {len(view)}")
        place += got


@contextmanager
def readable(name: str, what: str, said: Callable[[Exception], str] | None = None) -> Iterator[None]:
    """Make any failure of a parser that it is not ``what`` ("a readable TDMS file"), and what is ``said`` of it.

    Any exception may come of corrupt input; those that are not of the content stay as they are.
    """
    try:
        yield
    except (ReaderError, *NOT_OF_CONTENT):
        raise
    except Exception as error:
        reason = type(error).__name__ if said is None else said(error)
        raise ReaderError("unreadable", f"{name}: not {what} ({reason})") from error


def check_claim(declared: int, stored: int, name: str) -> None:
    """Raise ``refused`` where a file of ``stored`` bytes claims more than it may have when loaded."""
    allowed = max_loaded_bytes(stored)
    if declared > allowed:
        raise ReaderError("refused", f"{name}: claims {declared} bytes when loaded, {allowed} are allowed")


def library(module: str, extra: str, needed_by: str) -> Any:
    """Return an optional module; ``unreadable`` where it is not installed, with the extra that brings it."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ReaderError("unreadable", f'{needed_by} {module}: pip install "spallwatch[{extra}]"') from error


@contextmanager
def memory_file(data: bytes) -> Iterator[str]:
    """Give a path by which this process can open the bytes, in memory only where the system has that."""
    with closing(MemoryFile("recording")) as file:
        write_all(file.handle, data)
        yield file.path
