"""Every exception of the three floors derives from the base, and the exit codes are those that users rely on."""

from __future__ import annotations

import importlib
import pickle
import pkgutil

import pytest

from models.words.errors import SpallwatchError, WrongInputError
from monitor import cli

WRONG_INPUT = {
    "ConfigError",
    "DeskError",
    "FeError",
    "FeGeometryError",
    "FeMeshError",
    "FrfError",
    "LocatedError",
    "GearTableError",
    "HistoryError",
    "InputError",
    "LawError",
    "LeaseHeldError",
    "LibraryError",
    "ManifestError",
    "MapError",
    "LearnedFileError",
    "MemoryBoundError",
    "MemoryNeedError",
    "MissingExtraError",
    "MoveFailedError",
    "MovedDaysError",
    "NoFinalStageError",
    "ObliqueError",
    "OpcUaError",
    "OtherProgramError",
    "SpaceError",
    "OutsideMapError",
    "PageError",
    "RefusedError",
    "RefusedWorkerError",
    "SharedFolderError",
    "ReportError",
    "SurfaceError",
    "TransferVectorError",
    "WavError",
    "ScoreError",
    "SourceError",
    "StoreDamagedError",
    "StoreError",
    "UnstorableError",
    "UsersError",
    "PosteriorError",
    "WrongInputError",
}


WHILE_RUNNING = {"MoveFailedError", "StoreDamagedError"}
"""Kinds of wrong input that arise amid a run, which has then failed."""


def exceptions() -> list[type[BaseException]]:
    found = set()
    for floor in ("models", "streams", "monitor"):
        package = importlib.import_module(floor)
        for module in pkgutil.walk_packages(package.__path__, f"{floor}."):
            values = vars(importlib.import_module(module.name)).values()
            found |= {
                value
                for value in values
                if isinstance(value, type) and issubclass(value, BaseException) and value.__module__ == module.name
            }
    return sorted(found, key=lambda kind: kind.__name__)


KINDS = exceptions()


def test_all_exceptions_of_the_floors_are_found():
    names = {kind.__name__ for kind in KINDS}
    assert names >= {*WRONG_INPUT, "ReaderError", "PublishError", "PageError", "WireError"}


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_an_exception_derives_from_the_base_and_carries_its_exit_code(kind):
    assert issubclass(kind, SpallwatchError)
    assert issubclass(kind, WrongInputError) == (kind.__name__ in WRONG_INPUT)
    assert kind.exit_code == (cli.WRONG if kind.__name__ in WRONG_INPUT - WHILE_RUNNING else cli.FAILED)


@pytest.mark.parametrize("error", [SpallwatchError("a.npy: broken"), WrongInputError("--pace: expected a number")])
def test_the_command_line_takes_words_and_code_from_the_exception(error, monkeypatch, capsys):
    monkeypatch.setattr(cli.spallwatch, "main", lambda **_: (_ for _ in ()).throw(error))
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == error.exit_code
    assert capsys.readouterr().err == f"spallwatch: {error}\n"


def test_what_was_not_foreseen_is_told_with_its_class(monkeypatch, capsys):
    monkeypatch.setattr(cli.spallwatch, "main", lambda **_: 1 // 0)
    with pytest.raises(SystemExit) as left:
        cli.main()
    assert left.value.code == cli.FAILED
    assert capsys.readouterr().err.startswith("spallwatch: failed: ZeroDivisionError: ")


def test_an_exception_crosses_processes():
    error = pickle.loads(pickle.dumps(WrongInputError("a: b")))
    assert (type(error), str(error)) == (WrongInputError, "a: b")
