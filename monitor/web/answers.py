"""Input and output of handlers: numbers of a query, an answer in bytes, or a refusal."""

from __future__ import annotations

import gzip
import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.words.errors import SpallwatchError

_MIN_PACKED_BYTES = 1000
VIEWS = {
    "records": "api:records",
    "map": "channel_view:map_of",
    **{
        name: f"channel_view:{name}"
        for name in ("spectrum", "raw", "ias", "cyclic", "waveform", "waterfall", "kurtogram")
    },
}
"""Answers of a channel by the last part of their address: functions below ``monitor.web``."""
JSON_TYPE = "application/json"
Query = Mapping[str, str]
_FOLDERS = re.compile(r"(?<![\w/.])(?:/[^\s/:;,'\"]+)+/([^\s/:;,'\"]*)")


def without_folders(text: str) -> str:
    """Return a sentence with its file names but without their folders."""
    return _FOLDERS.sub(r"\1", text)


class RequestError(SpallwatchError):
    """A request that is answered with a status other than 200 and one sentence."""

    def __init__(self, status: int, sentence: str) -> None:
        """Take the HTTP status and what is wrong."""
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


@dataclass(frozen=True)
class Answer:
    """A complete answer; ``packed`` is the body with gzip, ``tag`` is for If-None-Match."""

    body: bytes
    media_type: str = JSON_TYPE
    packed: bytes | None = None
    tag: str | None = None
    status: int = 200


def answer_of(body: bytes, media_type: str, *, status: int = 200, level: int = 1) -> Answer:
    """Return an answer with its tag, compressed unless it is short; level 1 is four times as fast as 9."""
    packed = gzip.compress(body, level, mtime=0) if len(body) >= _MIN_PACKED_BYTES else None
    tag = f'"{hashlib.blake2b(body, digest_size=12).hexdigest()}"'
    return Answer(body, media_type, packed, tag, status)


def json_answer(value: Mapping[str, Any], status: int = 200) -> Answer:
    """Return an object as an answer; ValueError for NaN."""
    body = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":")).encode()
    return answer_of(body, JSON_TYPE, status=status)


def json_object(body: bytes) -> dict[str, Any] | None:
    """Return the JSON object in a body; None for anything else, also for one nested too deeply to be read."""
    try:
        found = json.loads(body)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def numbers(values: NDArray[np.floating], digits: int = 7) -> list[float | None]:
    """Return numbers (n,) for JSON, to so many significant digits; None for NaN and infinity."""
    found: list[float | None] = []
    form = f"%.{digits}g"
    for value, finite in zip(values.tolist(), np.isfinite(values).tolist(), strict=True):
        found.append(float(form % value) if finite else None)
    return found


def times(values: NDArray[np.floating]) -> list[float]:
    """Return times for JSON, s, to the millisecond."""
    return np.round(values, 3).tolist()


def optional_number(query: Query, key: str) -> float | None:
    """Return a number of the query, or None; raise :class:`RequestError` 400 for other text."""
    text = query.get(key, "")
    if text == "":
        return None
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise RequestError(400, f"{key} must be a number")
    return value


def whole_number(query: Query, key: str, default: int, low: int, high: int) -> int:
    """Return a whole number of the query, limited to ``low`` to ``high``; :class:`RequestError` 400 for others."""
    value = optional_number(query, key)
    if value is None:
        return default
    if value != math.floor(value):
        raise RequestError(400, f"{key} must be a whole number")
    return int(min(max(value, low), high))
