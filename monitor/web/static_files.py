"""The page's own files: exactly those that lie in its folder."""

from __future__ import annotations

import mimetypes
import threading
from pathlib import Path

from monitor.web.answers import Answer, RequestError, answer_of

_FOLDER = Path(__file__).parent / "static"
_TYPES = {".js": "text/javascript", ".mjs": "text/javascript", ".svg": "image/svg+xml", ".LICENSE": "text/plain"}
_lock = threading.Lock()
_known: dict[str, tuple[tuple[int, int], Answer]] = {}


def static_file(name: str, folder: Path = _FOLDER) -> Answer:
    """Return a file of the page, kept in memory until it changes.

    Args:
        name: below the folder, with "/" between folders.
        folder: where the files are.

    Raises:
        RequestError: 404, it is not one of them.
    """
    if name not in {path.relative_to(folder).as_posix() for path in folder.rglob("*") if _is_plain(path)}:
        raise RequestError(404, "there is no such file")
    path = folder / name
    found = path.stat()
    state = (found.st_mtime_ns, found.st_size)
    with _lock:
        known = _known.get(str(path))
        if known is None or known[0] != state:
            known = _known[str(path)] = (state, answer_of(path.read_bytes(), _type_of(path), level=9))
        return known[1]


def _is_plain(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _type_of(path: Path) -> str:
    kind = _TYPES.get(path.suffix) or mimetypes.guess_type(path.name)[0] or "application/octet-stream"
    return f"{kind}; charset=utf-8" if kind.startswith("text/") else kind
