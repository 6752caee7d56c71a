import sys
from typing import Any

import pytest

from models.fe import extra


@pytest.fixture
def _without_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Hide scikit-fem and gmsh as if they were not installed."""
    for name in [name for name in sys.modules if name.partition(".")[0] in {"skfem", "gmsh"}]:
        monkeypatch.delitem(sys.modules, name)
    for name in ("skfem", "gmsh"):
        monkeypatch.setitem(sys.modules, name, None)


@pytest.mark.usefixtures("_without_packages")
def test_what_is_missing_is_said_with_the_command_that_installs_it() -> None:
    assert not extra.has_extra()
    for need in (extra.require_skfem, extra.require_gmsh):
        with pytest.raises(extra.MissingExtraError, match=r'pip install "spallwatch\[fe\]"$') as raised:
            need()
        assert raised.value.exit_code == 2


def test_a_missing_library_of_the_system_is_told_from_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(name: str) -> Any:
        raise OSError("libGLU.so.1: cannot open shared object file")

    monkeypatch.setattr(extra.importlib, "import_module", fails)
    with pytest.raises(extra.MissingExtraError, match=r"gmsh, which is installed.*libGLU\.so\.1.*apt-get install"):
        extra.require_gmsh()


def test_a_package_that_the_extra_itself_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(name: str) -> Any:
        raise ModuleNotFoundError("No module named 'meshio'", name="meshio")

    monkeypatch.setattr(extra.importlib, "import_module", fails)
    with pytest.raises(extra.MissingExtraError, match=r"scikit-fem: pip install .* \(meshio is missing\)"):
        extra.require_skfem()
