import sys
from typing import Any

import pytest

from models.fe import extra


def test_what_is_missing_is_said_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "skfem"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "skfem", None)
    assert not extra.has_extra()
    with pytest.raises(extra.MissingExtraError, match=r'pip install "spallwatch\[fe\]"$') as raised:
        extra.require_skfem()
    assert raised.value.exit_code == 2


def test_a_package_that_the_extra_itself_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(name: str) -> Any:
        raise ModuleNotFoundError("No module named 'meshio'", name="meshio")

    monkeypatch.setattr(extra.importlib, "import_module", fails)
    with pytest.raises(extra.MissingExtraError, match=r"scikit-fem: pip install .* \(meshio is missing\)"):
        extra.require_skfem()
