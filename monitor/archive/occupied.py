"""What must not be in the place of an archive that is begun: results of another one whose index is gone."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor

from models.work.task import Store
from monitor.archive.index import INDEX_NAME, Index
from monitor.archive.manifest import WORK_NAME, ManifestError
from monitor.archive.result import RESULT_NAME, RecordingResult

OWN = re.compile(r"(inputs|states)/[0-9a-f]{40}|records/[^/]+/[^/]+/([^/]+\.nc|result\.json)")
"""Files that an archive keeps in ``archive-work``."""
_LISTERS = 16
"""Machines that are listed at a time: object storage answers late."""


def refuse_lost_work(work: Store) -> None:
    """Refuse to begin where states or records of an archive are left.

    Raises:
        ManifestError: naming the first of them.
    """
    # Configurations alone are left by a process that was killed while it planned.
    ours = (name for name in work.names() if OWN.fullmatch(name) and not name.startswith("inputs/"))
    if (found := next(ours, None)) is not None:
        raise _lost(f"{WORK_NAME}/{found}")


def refuse_lost_results(index: Index, out: Store) -> None:
    """Refuse to begin where a machine of the index has results of an archive already.

    Raises:
        ManifestError: naming the first of them.
    """
    machines = [name for (name,) in index.run("SELECT name FROM machines ORDER BY id").fetchall()]

    def first_result(machine: str) -> str | None:
        ours = re.compile(rf"{re.escape(machine)}/[^/]+/{re.escape(RESULT_NAME)}")
        listed = (name for name in out.names(f"{machine}/") if ours.fullmatch(name))
        return next((name for name in listed if _is_result(out.read(name))), None)

    with ThreadPoolExecutor(_LISTERS) as pool:
        for found in pool.map(first_result, machines):
            if found is not None:
                raise _lost(found)


def _is_result(data: bytes | None) -> bool:
    try:
        RecordingResult.from_json(data or b"")
    except (ValueError, KeyError, TypeError, AttributeError):
        return False
    return True


def _lost(name: str) -> ManifestError:
    return ManifestError(
        f"--out: holds {name} of an archive, and its {INDEX_NAME} is gone; take another --out, or delete what is left"
    )
