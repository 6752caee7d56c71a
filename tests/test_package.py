"""The distribution: what the wheel holds, where the packages come from, and what the daemon's modules import."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from monitor import cli
from monitor.commands import installation

pytestmark = pytest.mark.process

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    out = tmp_path_factory.mktemp("wheel")
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(ROOT)],
        check=True,
        capture_output=True,
    )
    return zipfile.ZipFile(next(out.glob("spallwatch-*.whl")))


def test_two_builds_of_a_wheel_are_equal(wheel, tmp_path):
    """Of another clone: another folder and umask, files of other times and permissions."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in filter(None, listed.stdout.split("\0")):
        if (ROOT / name).is_file() and not name.startswith(("tests/", "docs/", "benchmarks/", "reference/")):
            place = tmp_path / "clone" / name
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, place)
            place.chmod(0o640)
            os.utime(place, (1.2e9, 1.2e9))
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000", "TZ": "Asia/Tokyo"}
    built = []
    for source, mask in ((ROOT, 0o022), (tmp_path / "clone", 0o077)):
        out = tmp_path / f"{mask:o}"
        command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
        subprocess.run(command, check=True, capture_output=True, env=environment, umask=mask)
        built.append(next(out.glob("*.whl")).read_bytes())
    assert built[0] == built[1]
    # Without a given time it is always the same one, too.
    assert wheel.filename is not None
    dates = {info.date_time for info in wheel.infolist()}
    assert dates == {(2020, 2, 2, 0, 0, 0)}


def test_the_wheel_holds_exactly_our_packages(wheel):
    names = [name for name in wheel.namelist() if ".dist-info/" not in name and ".data/" not in name]
    assert {name.split("/")[0] for name in names} == {"models", "monitor", "spallwatch", "streams"}
    parts = [part for name in names for part in name.lower().split("/")]
    assert not [part for part in parts if part.startswith("test") or part.endswith((".pyc", ".nbi", ".nbc"))]


def test_the_wheel_holds_the_catalogue_and_every_module(wheel):
    inside = set(wheel.namelist())
    tracked = subprocess.run(
        ["git", "ls-files", "models", "monitor", "spallwatch", "streams"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.split()
    assert "models/bearings.toml" in tracked
    assert set(tracked) <= inside


def test_the_wheel_brings_the_examples(wheel, tmp_path, monkeypatch):
    listed = ["git", "ls-files", "examples"]
    tracked = subprocess.run(listed, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    inside = {name.partition("/share/spallwatch/")[2]: name for name in wheel.namelist() if ".data/data/" in name}
    assert set(tracked) <= set(inside)
    # As pip unpacks them.
    for name in tracked:
        place = tmp_path / "share" / "spallwatch" / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(wheel.read(inside[name]))
    site = tmp_path / "lib" / "site-packages"
    files = [site / "../../share/spallwatch" / name for name in tracked]
    installed = [_Installed(f"../../share/spallwatch/{name}", path) for name, path in zip(tracked, files, strict=True)]
    # pip compiles what is a module.
    installed.append(_Installed("../../share/spallwatch/examples/__pycache__/sender.cpython-311.pyc", files[0]))
    monkeypatch.setattr(installation.importlib.metadata, "files", lambda _: installed)
    site.mkdir(parents=True)
    found = installation.example_files(site)
    assert list(found) == sorted(name.removeprefix("examples/") for name in tracked)
    assert all(path.read_bytes() == (ROOT / "examples" / name).read_bytes() for name, path in found.items())


class _Installed:
    """A file of an installed distribution, as importlib.metadata has it."""

    def __init__(self, name, path):
        self._name, self._path = name, path

    def as_posix(self):
        return self._name

    def locate(self):
        return self._path


def test_the_installation_is_whole():
    assert cli.check_installation() is None


def test_a_foreign_package_of_the_same_name_is_noticed(tmp_path):
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "__init__.py").touch()
    run = subprocess.run(
        [
            sys.executable,
            "-c",
            f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from monitor.cli import main; main()",
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 2
    assert str(tmp_path) in run.stderr
    assert "Traceback" not in run.stderr


HEAVY = ("numba", "pymoo", "matplotlib", "xarray", "netCDF4", "pandas", "scipy.signal", "skfem", "gmsh")
HEAVY += ("dask", "distributed", "fsspec", "zarr")


def modules_after(code: str) -> set[str]:
    run = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print('\\n'.join(sys.modules))"],
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
    )
    return set(run.stdout.split())


def test_help_imports_nothing_heavy():
    code = "from monitor.cli import spallwatch\nspallwatch.main(['--help'], standalone_mode=False)"
    assert not modules_after(code) & {*HEAVY, "scipy", "numpy"}


@pytest.mark.parametrize("module", ["monitor.service.publisher", "monitor.config.load"])
def test_what_computes_no_spectrum_loads_no_transforms(module: str) -> None:
    assert not modules_after(f"import {module}") & {"pyfftw", "scipy.special"}


def test_a_committed_block_needs_no_compiler_and_no_plotting():
    """The stages and the store as the daemon uses them, with what it must not load made unimportable."""
    code = """
import sys
for name in ("numba", "dask", "distributed", "fsspec", "zarr", "pymoo", "matplotlib", "skfem", "gmsh"):
    sys.modules[name] = None
import tempfile
from pathlib import Path
import numpy as np
from monitor.config.load import validate
from monitor.records.store import Store
from monitor.health.state import SourceState
from monitor.health.step import step
from monitor.service.setup import source_settings
from streams.types.block import Block
config = validate({
    "bearing": [{"name": "b", "designation": "6205"}], "operating": {"speed_hz": 30.0},
    "source": [{"name": "s"}],
    "channel": [{"name": "c", "source": "s", "unit": "g", "bearing": "b", "band_hz": [[2000, 8000]]}],
    "gear": {"wheel": [{"name": "p", "teeth": 23}, {"name": "q", "teeth": 71}], "pair": [{"wheels": ["p", "q"]}]},
}, Path("x.toml"))
settings = source_settings(config, config.source[0])
samples = np.random.default_rng(0).standard_normal((1, 25600)).astype("float32")
block = Block(samples, 25600.0, ("c",), ("g",), "s", 1, "x", content_hash="0")
state, output = step(SourceState.begin(settings), block, settings)
with tempfile.TemporaryDirectory() as folder, Store.open(Path(folder) / "state.db", machine="m") as store:
    assert store.commit(output.record, state.to_stored()) == "committed"
# Without the extra fe its modules load all the same, so that they can say what is missing.
import importlib, pkgutil
import models.fe
for found in pkgutil.walk_packages(models.fe.__path__, "models.fe."):
    importlib.import_module(found.name)
"""
    loaded = modules_after(code)
    assert "monitor.records.store" in loaded
    assert {"monitor.health.step", "models.fe.extra"} <= loaded
