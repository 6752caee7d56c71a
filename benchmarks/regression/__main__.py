"""Judge whether the present tree still says what the baseline commit says, bit for bit.

Run as ``python -m benchmarks.regression [--case NAME ...] [--relative 1e-6] [--json FILE] [--quick]``. Both trees run
the same cases as black boxes through their command line: the baseline in a git worktree of its own, whose results are
kept in the user's cache folder, the present one as it stands. Compared are the ledger, the values of all records, the
events and forecasts in the stores, the published files and what is printed for programs. Not compared are times of
arrival, versions, hashes that cover them, paths, descriptive attributes and, without ``--texts``, sentences
(``EXCLUDED`` and ``TEXTS`` in ``observe.py``). Exit code 1 if anything differs or fails.
"""

from __future__ import annotations

import argparse
import hashlib
import inspect
import platform
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path

from platformdirs import user_cache_path

from benchmarks.common import Row, print_table, write_json
from benchmarks.regression import cases, live, machines, observe, store, trees
from benchmarks.regression.cases import Bench, Case, SkippedError
from benchmarks.regression.compare import Comparison, compare
from benchmarks.regression.observe import Observation
from benchmarks.regression.trees import ROOT, Tree, baseline_tree, full_hash

BASELINE = "3a5f02a1c74c209a5b5d9aecba89fdd661b2205d"
"""The commit that is compared with. A change of values on purpose moves it, in a commit that says why."""

CASES: tuple[Case, ...] = (
    cases.demo,
    cases.pronostia("1_1", "Bearing1_1.tar.bz2", "pronostia_1800rpm_4000n", 200),
    cases.pronostia("2_4", "Bearing2_4.tar.bz2", "pronostia_1650rpm_4200n", 200),
    cases.pronostia("3_1", "Bearing3_1.tar.xz", "pronostia_1500rpm_5000n", 515),
    cases.pronostia("2_7", "Bearing2_7.tar.xz", "pronostia_1650rpm_4200n", 230),
    cases.tdms,
    cases.csv_log,
    live.tcp,
    cases.alarms,
    live.acknowledge,
    live.folder_live,
    cases.named,
    cases.speed_estimated,
    cases.tracked,
    cases.histories,
    cases.models,
    cases.store_migration,
)
_BY_NAME = {case.__name__: case for case in CASES}
_LONG = ("demo",)
"""Cases that ``--quick`` leaves out."""
_COMPILED = ("demo", "tracked", "histories", "models", "store_migration")
"""Cases that run compiled kernels. A kernel that was compiled in the same process may differ in the last bits from the
one that is loaded from the cache, so both trees compile theirs beforehand."""
_SHOWN = 5
"""Differences of a case that are printed; the JSON has all of them."""


@dataclass
class Judged:
    """The result of one case."""

    name: str
    verdict: str = "equal"
    problem: str = ""
    comparison: Comparison = field(default_factory=Comparison)
    baseline_s: float = 0.0
    present_s: float = 0.0
    cached: bool = False

    @property
    def failed(self) -> bool:
        """Whether the trees differ or one of them could not be run."""
        return self.verdict not in ("equal", "skipped")

    def row(self) -> Row:
        """Return the row of the table."""
        counts = {key: getattr(self.comparison, key) for key in ("records", "values", "events", "forecasts")}
        times = {
            "baseline s": "cached" if self.cached else round(self.baseline_s, 1),
            "present s": round(self.present_s, 1),
        }
        return {"case": self.name, **counts, **times, "greatest change": self.comparison.greatest, "": self.verdict}


@dataclass(frozen=True)
class Judge:
    """Runs cases in both trees.

    Attributes:
        work: folder for what the cases write.
        cache: folder of the baseline's results.
        baseline: None where all its results are kept.
    """

    options: argparse.Namespace
    work: Path
    cache: Path
    baseline: Tree | None
    present: Tree

    def judge(self, case: Case) -> Judged:
        """Run one case in both trees, the baseline first, and compare."""
        judged = Judged(case.__name__)
        kept = self.cache / cache_key(case, self.options)
        try:
            judged.cached = (kept / "done").exists()
            if not judged.cached:
                assert self.baseline is not None
                shutil.rmtree(kept, ignore_errors=True)
                observed, judged.baseline_s = self._run(case, self.baseline, kept / "files")
                store.save(kept, observed)
            before = store.load(kept)
            now, judged.present_s = self._run(case, self.present, kept / "files")
        except SkippedError as reason:
            return Judged(case.__name__, "skipped", problem=str(reason))
        except Exception as error:  # Whatever a case raises is its result; the others go on.
            return Judged(case.__name__, "failed", problem=f"{type(error).__name__}: {error}")
        judged.comparison = compare(before, now, self.options.relative, texts=self.options.texts)
        if judged.comparison.differences:
            judged.verdict = f"{len(judged.comparison.differences)} of {len(before)} columns differ"
        return judged

    def _run(self, case: Case, tree: Tree, kept: Path) -> tuple[Observation, float]:
        # The same path for both trees, one after the other: some messages and hashes hold it.
        folder = self.work / case.__name__
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        began = time.monotonic()
        observed = case(Bench(tree, folder, self.options.quick, kept))
        seconds = time.monotonic() - began
        tree.check_imports(folder)
        return observed, seconds


def cache_key(case: Case, options: argparse.Namespace) -> str:
    """Return the name of a baseline's result: by commit, what makes the case, and what computes it."""
    digest = hashlib.sha256(inspect.getsource(inspect.getmodule(case) or cases).encode())
    for module in (cases, machines, observe, trees):
        digest.update(inspect.getsource(module).encode())
    for path in sorted((ROOT / "examples").glob("*.toml")):
        digest.update(path.read_bytes())
    versions = [f"{name} {version(name)}" for name in ("numpy", "scipy", "numba", "pyfftw", "netCDF4")]
    digest.update(f"{sys.version} {platform.platform()} {platform.processor()} {versions} {options.quick}".encode())
    return f"{options.baseline[:12]}-{case.__name__}-{digest.hexdigest()[:16]}"


def parse() -> argparse.Namespace:
    """Parse the options."""
    parser = argparse.ArgumentParser(description="compare the present tree with a baseline commit")
    parser.add_argument("--baseline", default=BASELINE, metavar="COMMIT", help="compare with this commit")
    parser.add_argument("--present", type=Path, default=ROOT, metavar="DIR", help="judge the tree of this folder")
    parser.add_argument("--case", nargs="+", choices=_BY_NAME, metavar="NAME", help=f"of {', '.join(_BY_NAME)}")
    parser.add_argument("--relative", type=float, default=0.0, metavar="SHARE", help="relative change allowed [0]")
    parser.add_argument("--texts", action="store_true", help="compare sentences for people, too")
    parser.add_argument("--jobs", type=int, default=2, help="cases run at a time [2]")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the same figures to this file")
    parser.add_argument("--quick", action="store_true", help="shorter and fewer cases: within a minute")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="keep all files here, also the baseline's results")
    options = parser.parse_args()
    options.baseline = full_hash(options.baseline)
    return options


def chosen(options: argparse.Namespace) -> list[Case]:
    """Return the cases that were asked for."""
    names = options.case or [name for name in _BY_NAME if not (options.quick and name in _LONG)]
    return [_BY_NAME[name] for name in names]


@contextmanager
def judge_of(options: argparse.Namespace, wanted: list[Case]) -> Iterator[Judge]:
    """Make the folders, and the worktree of the baseline where a result of it is missing; remove them at the end."""
    cache = (options.keep or user_cache_path("spallwatch-regression")) / "baseline"
    missing = [case for case in wanted if not (cache / cache_key(case, options) / "done").exists()]
    with tempfile.TemporaryDirectory(prefix="regression-") as temporary:
        work = options.keep.resolve() / "work" if options.keep else Path(temporary)
        with baseline_tree(options.baseline, Path(temporary)) if missing else nullcontext() as baseline:
            present = Tree("present", options.present.resolve())
            if any(case.__name__ in _COMPILED for case in wanted):
                for tree in filter(None, (baseline, present)):
                    tree.call(Path(temporary), "warmup")
            yield Judge(options, work, cache.resolve(), baseline, present)


def main() -> None:
    """Judge, print, and write what was asked for."""
    # The worktree of the baseline is removed then, too.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("terminated"))
    options = parse()
    wanted = chosen(options)
    with judge_of(options, wanted) as judge, ThreadPoolExecutor(options.jobs) as pool:
        judged = list(pool.map(judge.judge, wanted))
    print_table(f"present tree against {options.baseline[:12]}", [one.row() for one in judged])
    for one in judged:
        if one.problem:
            print(f"{one.name}: {one.verdict}: {one.problem}")
        for difference in one.comparison.differences[:_SHOWN]:
            print(f"{one.name}: {difference.name}: {difference.where}: {difference.baseline} -> {difference.present}")
    tables = {"cases": [one.row() for one in judged]}
    differences = [{"case": one.name, **asdict(item)} for one in judged for item in one.comparison.differences]
    write_json(options.json, {"baseline": options.baseline, **tables, "differences": differences})
    sys.exit(any(one.failed for one in judged))


if __name__ == "__main__":
    main()
