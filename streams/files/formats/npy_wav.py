"""Plain arrays (.npy, never pickles) and sound (WAV, FLAC), with checked headers."""

from __future__ import annotations

from math import prod
from typing import Literal

import numpy as np
import soundfile
from numpy.typing import NDArray

from streams.files.parse.child import isolated
from streams.files.parse.complete import npy_header, plain_npy_header
from streams.files.parse.riff import WavSizes, end_of_samples, wav_sizes
from streams.files.parse.worker import check_claim, from_disk
from streams.types import large
from streams.types.large import Data, FileBytes, elementwise, empty_rows, forget_pages, stream_of
from streams.types.limits import MAX_BYTES, MAX_DIMENSIONS
from streams.types.listing import packed_suffix
from streams.types.samples import FRACTIONS, VALUES, ReaderError, Samples, check_rows, rows_of, stored_as

_EXACT_IN_FLOAT32 = ("PCM_S8", "PCM_U8", "PCM_16", "PCM_24", "FLOAT", "ALAW", "ULAW")
_FLOATING = ("FLOAT", "DOUBLE")
_UNKNOWN_FRAMES = 2**63 - 1
"""Of FLAC without a length, which libsndfile cannot read."""
_SAMPLE_BYTES = {
    "PCM_S8": 1, "PCM_U8": 1, "PCM_16": 2, "PCM_24": 3, "PCM_32": 4, "FLOAT": 4, "DOUBLE": 8, "ALAW": 1, "ULAW": 1,
}  # fmt: skip


def read_plain_npy(data: Data, name: str) -> Samples:
    """Read as :func:`read_npy`, in this process where the time and memory for it are bounded by the size of the file.

    So it is where the header is one as numpy writes it, of at most two dimensions, which a pattern recognises without
    evaluating it, and the numbers are copied once at most. Any other file, and a large one, is read in the child
    process.
    """
    if not isinstance(data, FileBytes) and not packed_suffix(name) and plain_npy_header(data) is not None:
        return read_npy(data, name)
    return isolated(read_npy)(data, name)


@from_disk
def read_npy(data: Data, name: str) -> Samples:
    """Read an array of one or two dimensions, the longer axis being time.

    Values that are stored as they are needed are a read-only view of ``data``.

    Raises:
        ReaderError: ``empty``; ``unreadable`` for pickled objects and for what is no .npy file; ``incomplete``
            where the header promises more than there is; ``refused`` beyond the limits; ``wrong_shape``.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    try:
        header = npy_header(data)
    except Exception as error:  # See npy_header.
        raise ReaderError("unreadable", f"{name}: not a .npy file ({error})") from error
    shape, dtype = header.shape, header.dtype
    if dtype.hasobject:
        raise ReaderError("unreadable", f"{name}: holds pickled objects, which are never loaded")
    if len(shape) > MAX_DIMENSIONS:
        found = f"{len(shape)} (shape {str(shape)[:60]})"
        raise ReaderError("wrong_shape", f"{name}: expected 1 or {MAX_DIMENSIONS} dimensions, got {found}")
    declared = header.promised
    if declared > MAX_BYTES:
        raise ReaderError("refused", f"{name}: claims {declared} bytes when loaded, {MAX_BYTES} are allowed")
    present = len(data) - header.end
    if declared > present:
        raise ReaderError("incomplete", f"{name}: the header promises {declared} bytes, {present} are there")
    if declared < present:
        raise ReaderError("unreadable", f"{name}: the header promises {declared} bytes, {present} follow it")
    order = "F" if header.fortran_order else "C"
    held = data.mapped() if isinstance(data, FileBytes) else data
    array = np.frombuffer(held, dtype, prod(shape), header.end).reshape(shape, order=order)
    # Where the writer did not pad the header, the samples begin at any byte.
    rows = rows_of(array if array.flags.aligned else elementwise(np.copy, array), name)
    return Samples(rows, stored=(stored_as(dtype),) * len(rows))


@from_disk
def read_wav(data: Data, name: str) -> Samples:
    """Read a WAV or FLAC file, with the rate of its header.

    Integer samples are given as ``FRACTIONS`` of full scale, -1 to 1, float32 up to 24 bits, else float64. Floating
    samples are given as stored. Where the header leaves the length open, as that of a stream, they are those before
    the chunks at the end of the file.

    Raises:
        ReaderError: ``empty``; ``unreadable``; ``incomplete`` where the header promises more than there is, or the file
            was never closed; ``refused`` beyond the limits.
    """
    if not data:
        raise ReaderError("empty", f"{name}: the file has 0 bytes")
    sizes = wav_sizes(data)
    _check_sizes(sizes, data, name)
    try:
        with stream_of(data) as stream, soundfile.SoundFile(stream) as sound:
            dtype: Literal["float32", "float64"] = "float32" if sound.subtype in _EXACT_IN_FLOAT32 else "float64"
            stored = VALUES if sound.subtype in _FLOATING else FRACTIONS
            if sound.frames >= _UNKNOWN_FRAMES:
                reason = "the header does not state how many samples there are, as that of a stream; encode it again"
                raise ReaderError("incomplete", f"{name}: {reason}")
            open_frames = _open_frames(sizes, data, sound, name)
            frames = sound.frames if open_frames is None else min(sound.frames, open_frames)
            check_claim(frames * sound.channels * np.dtype(dtype).itemsize, len(data), name)
            check_rows(sound.channels, name, "channels")
            rate = float(sound.samplerate)
            rows, there = _sound_rows(sound, frames, dtype)
    except (soundfile.LibsndfileError, RuntimeError, TypeError) as error:
        # The library names the object that it was given.
        reason = str(error).rpartition(">: ")[2]
        raise ReaderError("unreadable", f"{name}: not a readable WAV or FLAC file ({reason})") from error
    if there < frames:
        raise ReaderError("incomplete", f"{name}: the header promises {frames} frames, {there} are there")
    if not there:
        raise ReaderError("empty", f"{name}: holds no samples")
    return Samples(rows, rate=rate, stored=(stored,) * len(rows))


def _sound_rows(
    sound: soundfile.SoundFile, frames: int, dtype: Literal["float32", "float64"]
) -> tuple[NDArray[np.floating], int]:
    """Return the first frames as (channel, frame), and the number of frames that are there."""
    rows = empty_rows((sound.channels, frames), dtype)
    step = max(1, large.PIECE_BYTES // (sound.channels * rows.dtype.itemsize))
    place = 0
    while place < frames:
        target = rows[:, place : place + step].T
        # One channel is read to its place.
        out = target if sound.channels == 1 else None
        part = sound.read(len(target), dtype=dtype, always_2d=True, out=out)
        if not len(part):
            break
        if out is None:
            target[: len(part)] = part
        forget_pages(rows)
        place += len(part)
    return rows, place


def _open_frames(sizes: WavSizes | None, data: Data, sound: soundfile.SoundFile, name: str) -> int | None:
    """Return the number of frames of a WAV file whose header leaves it open, None for another file.

    Raises:
        ReaderError: ``incomplete`` where the file breaks off, or was never closed; ``unreadable``.
    """
    if sizes is None or sizes.begin is None or sizes.samples is not None:
        return None
    width = _SAMPLE_BYTES.get(sound.subtype)
    if width is None:
        raise ReaderError(
            "unreadable", f"{name}: its header states no length, and a sample of {sound.subtype} has none"
        )
    return (end_of_samples(data, sizes.begin) - sizes.begin) // (width * sound.channels)


def _check_sizes(sizes: WavSizes | None, data: Data, name: str) -> None:
    """Compare the data chunk with the file; libsndfile silently shortens it."""
    if sizes is None or (sizes.begin is not None and sizes.samples is None):
        return
    if sizes.begin is None or sizes.samples is None:
        raise ReaderError("incomplete", f"{name}: breaks off before its samples")
    present = len(data) - sizes.begin
    if sizes.samples > present:
        raise ReaderError("incomplete", f"{name}: the header promises {sizes.samples} bytes, {present} are there")
    if not sizes.samples and end_of_samples(data, sizes.begin) > sizes.begin:
        reason = f"the header states no samples, {present} bytes follow: its writer never closed it"
        raise ReaderError("incomplete", f"{name}: {reason}; repair the header, or record it again")
