"""The store of a URL."""

from __future__ import annotations

from pathlib import Path
from urllib.parse import unquote, urlsplit

from models.words.errors import WrongInputError
from models.words.extras import load
from models.work.folder_store import FolderStore
from models.work.task import Store


def open_store(url: str | Path) -> Store:
    """Return the store of a path or a URL: ``file://`` is a folder, others need the extra ``s3`` or ``cluster``.

    Raises:
        WrongInputError: the URL names no folder and no object store, or a package that it needs is missing.
    """
    if isinstance(url, Path) or "://" not in url:
        return FolderStore(url)
    split = urlsplit(url)
    if split.scheme.lower() == "file":
        if split.netloc not in ("", "localhost") or not split.path:
            raise WrongInputError(f"expected file:///FOLDER, got {url!r}")
        return FolderStore(Path(unquote(split.path)))
    try:
        store = load("work", "objects")
    except ModuleNotFoundError as error:
        raise WrongInputError(
            f'{split.scheme}:// needs object storage: pip install "spallwatch[s3]" ({error.name} is missing)'
        ) from None
    return store(url)
