"""``spallwatch examples``: the files of ``examples/``, from a checkout or from an installed program."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import click

from models.platform.process_signals import ROOT
from monitor.commands import option
from monitor.commands.common import InputError, emit

_FOLDER = "share/spallwatch/examples"
"""Where the wheel has them, below the folder of the installation."""


def example_files(root: Path = ROOT) -> dict[str, Path]:
    """Return the examples by name, such as "notebooks/name_a_recording.ipynb".

    Args:
        root: the folder that holds the packages of this program.
    """
    if (root / "examples").is_dir():
        paths = {path.relative_to(root / "examples").as_posix(): path for path in (root / "examples").rglob("*.*")}
        return {name: path for name, path in sorted(paths.items()) if path.is_file() and _is_example(name)}
    try:
        files = importlib.metadata.files("spallwatch") or []
    except importlib.metadata.PackageNotFoundError:
        files = []
    found = {file.as_posix().partition(f"{_FOLDER}/")[2]: Path(str(file.locate())) for file in files}
    return {name: path.resolve() for name, path in sorted(found.items()) if _is_example(name)}


def _is_example(name: str) -> bool:
    """Return whether a name is that of an example, not of what Python or an editor put beside it."""
    return bool(name) and "__pycache__" not in name and "/." not in f"/{name}"


@click.command("examples")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--out", type=option.FOLDER, default=".", help="Folder to copy the named ones to.")
@option.output
def command(names: tuple[str, ...], out: Path, as_json: bool, quiet: bool) -> None:
    """List the examples, or copy the ones that are named: configurations, notebooks, a sender.

    A file of that name that is already there is not replaced.
    """
    del quiet
    known = example_files()
    if not names:
        emit({"examples": list(known)}, known, as_json=as_json)
        return
    for name in names:
        if name not in known:
            raise InputError(f"there is no example {name!r}; expected one of: {', '.join(known) or 'none installed'}")
        if (out / Path(name).name).exists():
            raise InputError(f"{out / Path(name).name} is there already; choose another --out")
    out.mkdir(parents=True, exist_ok=True)
    copied = [out / Path(name).name for name in names]
    for name, target in zip(names, copied, strict=True):
        target.write_bytes(known[name].read_bytes())
    emit({"out": [str(path) for path in copied]}, map(str, copied), as_json=as_json)
