"""Which schedulers and workers are refused, and how that is told."""

from __future__ import annotations

import pytest

from models.fleet.connect import RefusedWorkerError
from models.fleet.member import PROGRAM_BYTES, answer_name, differences, facts, offered_memory
from models.fleet.roster import Roster
from models.work.folder_store import FolderStore
from models.work.program import program

MINE = {"python": "CPython 3.11.2", "numpy": "2.4.6", "dask": "2026.8.0", "program": "ab" * 20}


def test_facts_name_the_program_and_what_both_ends_share():
    found = facts()
    assert found["program"] == program()
    assert {"python", "numpy", "scipy", "numba", "pyfftw", "dask", "distributed", "cloudpickle"} <= set(found)
    assert {"netcdf4", "xarray", "zarr"} <= set(found)
    assert differences(found, facts()) == ""


def test_differences_are_told_by_name_and_version():
    theirs = MINE | {"numpy": "2.3.0", "program": "cd" * 20}
    assert differences(theirs, MINE) == "numpy 2.3.0, expected 2.4.6"
    assert (
        differences(MINE | {"program": "cd" * 20}, MINE)
        == "spallwatch of other files, digest cdcdcdcdcdcd, expected abababababab"
    )
    assert differences({"python": "CPython 3.11.2", "program": "ab" * 20, "numpy": "2.4.6"}, MINE) == (
        "dask unknown, expected 2026.8.0"
    )
    assert differences(MINE | {"gpu": "1"}, MINE) == "gpu 1, expected unknown"


class Scheduler:
    """A client of a scheduler that answers so."""

    status = "running"

    def __init__(self, answer: dict[str, str] | Exception) -> None:
        self.answer = answer

    def run_on_scheduler(self, function: object) -> dict[str, str]:
        assert function is facts
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (facts() | {"numpy": "9.9"}, r"scheduler tls://h:1 cannot be used: numpy 9\.9, expected \d"),
        (facts() | {"program": "0"}, "scheduler tls://h:1 cannot be used: spallwatch of other files"),
        (ModuleNotFoundError("No module named 'models'"), "spallwatch is not installed there"),
    ],
)
def test_a_scheduler_of_another_program_is_refused(answer, told, tmp_path):
    with pytest.raises(RefusedWorkerError, match=told):
        Roster("tls://h:1", FolderStore(tmp_path), print).use(Scheduler(answer))


def test_a_scheduler_of_the_same_program_is_taken(tmp_path):
    roster = Roster("tls://h:1", FolderStore(tmp_path), print)
    roster.use(Scheduler(facts()))
    assert roster.resource == f"spallwatch-{program()[:12]}"
    assert roster.memory() == roster.threads() == 0


def test_answers_of_workers_have_names_of_their_own():
    names = {answer_name("preflight/ab", address) for address in ("tls://10.0.0.1:1234", "tls://[::1]:99")}
    assert names == {"preflight/ab-tls___10_0_0_1_1234", "preflight/ab-tls______1__99"}


def test_a_worker_offers_what_neither_pauses_nor_ends_it():
    assert offered_memory(2_000_000_000, 0.8) == 1_600_000_000 - PROGRAM_BYTES
    assert offered_memory(2_000_000_000, False) == 2_000_000_000 - PROGRAM_BYTES
    assert offered_memory(100_000_000, 0.8) == 0
    # Without a limit it is the machine's.
    assert offered_memory(None, 0.8) == offered_memory(0, 0.8) > 0
