"""Keep credentials out of what is written: logs, messages, indexes, reports, JSON, tracebacks of failed chunks.

What is hidden: user info and signed queries of URLs, headers and quoted options by their names, and the values of this
process's own credentials wherever they appear (environment, fsspec configuration, the files of AWS).
"""

from __future__ import annotations

import configparser
import json
import os
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any, cast
from urllib.parse import quote, urlsplit, urlunsplit

HIDDEN = "***"
MIN_SECRET_CHARACTERS = 8
"""Shorter values of environment variables are not searched for: they would be parts of ordinary words."""

_SECRET_NAME = (
    r"(?:secret|passw(?:or)?d|passphrase|token|credential|signature|access_?key|account_?key|api_?key|shared_?key"
    r"|private_?key|sas|connection_?string|authorization)"
)
_SECRET_VARIABLE = re.compile(rf"(?i){_SECRET_NAME}")
_PLACE_OF_SECRET = re.compile(r"(?i)(?:_FILE|_PATH|_DIR|_URI|_URL|_RELATIVE_URI|_EXPIRATION)$")
_FSSPEC_OPTION = re.compile(rf"(?i)^(?:key|user(?:name)?|auth|sig)$|{_SECRET_NAME}")

# A secret key of AWS may hold "/"; a port is told from a password by its digits. Repetitions are bounded: a text of one
# long word must not cost its square.
_USER_INFO = re.compile(
    r"""(?<=://)(?:[^\s/?#'"<>]{0,2048}@|(?![^\s/@:]{0,256}:\d{1,5}(?:[/?#\s]|$))[^\s/@:'"<>]{0,256}:[^\s@'"<>]{0,2048}@)"""
)
_SIGNED_PARAMETER = re.compile(
    rf"""(?i)((?:[?&;]|&amp;|%26|%3f)(?:sig|[\w%.-]{{0,64}}?(?:{_SECRET_NAME}|key|auth|pwd)[\w%.-]{{0,64}}?)(?:=|%3d))"""
    r"""[^\s&;#'"<>]*[^\s&;#'"<>:,.)\]}]"""
)
_LONG_PARAMETER = re.compile(
    r"""([?&;][\w%.-]{1,64}=)(?=[^\s&;#'"<>]*\d)(?=[^\s&;#'"<>]*[A-Za-z])[A-Za-z0-9%+/_=~-]{24,}(?=[\s&;#'"<>:,.)\]}]|$)"""
)
_HEADER = re.compile(r"""(?i)(\b(?:proxy-)?authorization['"]?\s*[:=]\s*(?:b?['"])?)[^\r\n'"]+""")
_SIGNATURE = re.compile(
    r"""(?i)(\b(?:signature|credential|security-token)['"]?\s*[:=]\s*(?:b?['"])?)(?!\*\*\*)[\w%+/=-]{8,}"""
)
_OPTION = re.compile(rf"""(?i)({_SECRET_NAME}[\w-]{{0,64}}['"]?\s*[:=]\s*b?)(['"])(?:(?!\2).)+\2""")
_AWS_KEY = re.compile(r"\b(?:AKIA|ASIA)[A-Z0-9]{16}\b")


def redact(text: str) -> str:
    """Return a text with ``***`` in the place of credentials; redacting it again changes nothing."""
    return _redacted(text, _secrets())


def redactor() -> Callable[[str], str]:
    """Return :func:`redact` for many texts, with the credentials that this process has now."""
    secrets = _secrets()
    return lambda text: _redacted(text, secrets)


def _redacted(text: str, secrets: Sequence[str]) -> str:
    for secret in secrets:
        text = text.replace(secret, HIDDEN)
    text = _USER_INFO.sub(f"{HIDDEN}@", text)
    text = _SIGNED_PARAMETER.sub(rf"\g<1>{HIDDEN}", text)
    text = _LONG_PARAMETER.sub(rf"\g<1>{HIDDEN}", text)
    text = _HEADER.sub(rf"\g<1>{HIDDEN}", text)
    text = _OPTION.sub(rf"\g<1>\g<2>{HIDDEN}\g<2>", text)
    text = _SIGNATURE.sub(rf"\g<1>{HIDDEN}", text)
    return _AWS_KEY.sub(HIDDEN, text)


def bare_url(url: str, hide: Callable[[str], str] = redact) -> str:
    """Return a URL without user info, and that of HTTP without query and fragment: its signature changes each day.

    ``hide`` is from :func:`redactor` where there are many.
    """
    parts = urlsplit(url)
    if parts.scheme.lower() not in ("http", "https"):
        # A bucket may hold objects with "?" or "#" in their names.
        return hide(_USER_INFO.sub("", url))
    return hide(urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", "")))


def has_signed_url(data: bytes) -> bool:
    """Return whether bytes hold a URL with a parameter that looks like a signature or a key."""
    if b"://" not in data:
        return False
    text = data.decode("latin-1")
    return _SIGNED_PARAMETER.search(text) is not None or _LONG_PARAMETER.search(text) is not None


def redacted_traceback(error: BaseException) -> str:
    """Return the traceback of an exception without credentials."""
    return redact("".join(traceback.format_exception(error)))


def has_user_info(url: str) -> bool:
    """Return whether a URL holds a user name or password before its host."""
    return _USER_INFO.search(url) is not None


def _secrets() -> list[str]:
    """Return the credentials of this process in all spellings of URLs and JSON, the longest first."""
    values = {*_of_environment(os.environ), *_of_fsspec(), *_of_aws_files()}
    spellings: set[str] = set()
    for value in values:
        if len(value) >= MIN_SECRET_CHARACTERS:
            spellings |= {value, quote(value), quote(value, safe=""), json.dumps(value)[1:-1], repr(value)[1:-1]}
    return sorted(spellings, key=lambda text: (-len(text), text))


def _of_environment(environment: Mapping[str, str]) -> Iterator[str]:
    for name, value in environment.items():
        if name.startswith("FSSPEC_"):
            yield from _of_fsspec_variable(name, value)
        elif _SECRET_VARIABLE.search(name) and not _PLACE_OF_SECRET.search(name):
            yield value


def _of_fsspec_variable(name: str, value: str) -> Iterator[str]:
    """Yield the secrets of ``FSSPEC_S3='{"key": ...}'`` and of ``FSSPEC_S3_SECRET=...``."""
    option = name.removeprefix("FSSPEC_").partition("_")[2]
    try:
        parsed: object = json.loads(value)
    except ValueError:
        parsed = value
    if isinstance(parsed, dict):
        yield from _of_options(cast("dict[str, object]", parsed))
    elif option and _FSSPEC_OPTION.search(option):
        yield value


def _of_fsspec() -> Iterator[str]:
    """Yield the secrets of the configuration of fsspec, where it is loaded."""
    module: Any = sys.modules.get("fsspec.config")
    if module is not None:
        yield from _of_options(cast("dict[str, object]", module.conf))


def _of_options(options: Mapping[str, object]) -> Iterator[str]:
    for name, value in options.items():
        if isinstance(value, dict):
            yield from _of_options(cast("dict[str, object]", value))
        elif isinstance(value, str) and _FSSPEC_OPTION.search(name):
            yield value


def _of_aws_files() -> Iterator[str]:
    for variable, name in (("AWS_SHARED_CREDENTIALS_FILE", "credentials"), ("AWS_CONFIG_FILE", "config")):
        named = os.environ.get(variable)
        # No such file, or no home.
        with suppress(OSError, RuntimeError):
            place = Path(named).expanduser() if named else Path.home() / ".aws" / name
            yield from _read_aws_file(str(place), place.stat().st_mtime_ns)


@lru_cache(maxsize=4)
def _read_aws_file(place: str, changed: int) -> tuple[str, ...]:
    """Return the secrets in a file of AWS; ``changed``, its time of change, makes the answer anew."""
    parser = configparser.RawConfigParser(strict=False)
    try:
        parser.read(place, encoding="utf-8")
    except (OSError, configparser.Error, UnicodeError):
        return ()
    pairs = (pair for section in parser.sections() for pair in parser.items(section))
    return tuple(value for name, value in pairs if _SECRET_VARIABLE.search(name))
