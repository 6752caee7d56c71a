"""The two trees of source code, each run as a black box through its command line."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

ROOT = Path(__file__).resolve().parents[2]
_WITNESS = Path(__file__).with_name("witness")
_IMPORTS = "imports.log"
_TIMEOUT_S = 900.0


class CaseError(Exception):
    """A case cannot be run to its end: a command failed, or a process took its code from another tree."""


@dataclass(frozen=True)
class Tree:
    """A checkout of the product."""

    name: str
    root: Path

    @cached_property
    def command(self) -> list[str]:
        """The command line of the product, from the console script in this tree's pyproject.toml."""
        project = tomllib.loads((self.root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
        module, _, function = project["scripts"]["spallwatch"].partition(":")
        return [sys.executable, "-c", f"from {module} import {function}; {function}()"]

    def environment(self, folder: Path) -> dict[str, str]:
        """Return the environment of a case: this tree first, and caches of its own, empty at first but for kernels."""
        return {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(_WITNESS), str(self.root)]),
            "XDG_CACHE_HOME": str(folder / "cache"),
            "NUMBA_CACHE_DIR": str(user_cache_path("spallwatch-regression") / "kernels"),
            "REGRESSION_IMPORTS": str(folder / _IMPORTS),
            "TZ": "UTC",
        }

    def call(self, folder: Path, *arguments: str | Path) -> dict[str, Any]:
        """Run a command with ``--json`` and return the object that it prints.

        Raises:
            CaseError: it failed, or took too long.
        """
        command = [*self.command, *map(str, arguments), "--json", "--quiet"]
        environment = self.environment(folder)
        try:
            done = subprocess.run(
                command, cwd=self.root, env=environment, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise CaseError(f"{arguments[0]} took more than {_TIMEOUT_S:g} s") from None
        if done.returncode != 0:
            raise CaseError(f"{arguments[0]} ended with {done.returncode}: {done.stderr.strip()[-500:]}")
        return json.loads(done.stdout)

    def check_imports(self, folder: Path) -> None:
        """Check that every process of a case, children included, took the product from this tree.

        Raises:
            CaseError: one did not, or no process imported the product.
        """
        log = folder / _IMPORTS
        lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
        wrong = sorted({line for line in lines if not line.partition(" ")[2].startswith(f"{self.root}{os.sep}")})
        if wrong or not lines:
            raise CaseError(f"imported from another tree than {self.root}: {wrong or 'nothing was imported'}")


def full_hash(commit: str) -> str:
    """Return the full hash of a commit of this repository."""
    return _git("rev-parse", "--verify", f"{commit}^{{commit}}")


@contextmanager
def baseline_tree(commit: str, folder: Path) -> Iterator[Tree]:
    """Check out a commit into a worktree below a folder; remove the worktree at the end."""
    root = folder / "baseline"
    _git("worktree", "add", "--detach", "--force", str(root), commit)
    try:
        yield Tree("baseline", root.resolve())
    finally:
        _git("worktree", "remove", "--force", str(root))


def _git(*arguments: str) -> str:
    done = subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"git {' '.join(arguments)}: {done.stderr.strip()}")
    return done.stdout.strip()
