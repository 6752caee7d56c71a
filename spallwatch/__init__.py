"""spallwatch for people who program: recordings, features, names of damaged parts, models, maps and records.

    import spallwatch as sw

    signal = sw.read("press.csv", unit="g")
    sw.name_fault(signal, bearing="6205", speed_hz=24.9).fault

Signals are arrays of xarray in m/s2, records and maps are datasets with units. Parameters have the names of the
configuration and the command line, units at their end; what the models return is SI. What cannot be used raises a
``SpallwatchError`` that names it.

The packages ``models``, ``streams`` and ``monitor`` of the program are imported from where it is installed, whatever
folders of these names are beside a script.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, cast


def _import_own_floors() -> None:
    """Import the packages from beside this one, before a folder of the same name on ``sys.path`` is taken for them.

    Raises:
        ImportError: a module of one of these names that is not of this program has been imported before.
    """
    root = Path(__file__).resolve().parent.parent
    for name in ("models", "streams", "monitor"):
        loaded = sys.modules.get(name)
        if loaded is not None:
            place = Path(getattr(loaded, "__file__", None) or "unknown")
            if place.resolve().parent != root / name:
                raise ImportError(
                    f"spallwatch has a package {name!r} of its own, and {str(place)!r} is imported under that name; "
                    "import spallwatch first, or rename the other one"
                )
            continue
        spec = PathFinder.find_spec(name, [str(root)])
        if spec is None or spec.loader is None:
            raise ImportError(f"the package {name!r} of spallwatch is not in {str(root)!r}; install spallwatch again")
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise


_import_own_floors()

if TYPE_CHECKING:
    from models.machine.bearing import Bearing as Bearing
    from models.machine.bearing import Kinematics as Kinematics
    from models.machine.scene import Scene as Scene
    from models.maps.data import RmsMap as RmsMap
    from models.solve.response import Response as Response
    from models.solve.simulate import simulate as simulate
    from models.solve.six_dof.sweep import Sweep as Sweep
    from models.solve.six_dof.sweep import sweep as sweep
    from models.words.errors import SpallwatchError as SpallwatchError
    from monitor import __version__ as __version__
    from monitor.desk.desk import DeskError as DeskError
    from monitor.desk.recording import RecordingDescription as RecordingDescription
    from monitor.health.name.naming import Naming as Naming
    from spallwatch.analysis import SignalError as SignalError
    from spallwatch.analysis import envelope_spectrum as envelope_spectrum
    from spallwatch.analysis import features as features
    from spallwatch.analysis import name_fault as name_fault
    from spallwatch.analysis import spectrum as spectrum
    from spallwatch.archives import open_archive as open_archive
    from spallwatch.bearings import bearing as bearing
    from spallwatch.bearings import fault_frequencies as fault_frequencies
    from spallwatch.bearings import fe_stiffness as fe_stiffness
    from spallwatch.descriptions import describe as describe
    from spallwatch.figures import plot_cyclic as plot_cyclic
    from spallwatch.figures import plot_map as plot_map
    from spallwatch.figures import plot_records as plot_records
    from spallwatch.figures import plot_scene as plot_scene
    from spallwatch.figures import plot_signal as plot_signal
    from spallwatch.figures import plot_spectrum as plot_spectrum
    from spallwatch.gears import gear_motion as gear_motion
    from spallwatch.gears import mesh_frequencies as mesh_frequencies
    from spallwatch.orders import cyclic_coherence as cyclic_coherence
    from spallwatch.orders import ias_spectrum as ias_spectrum
    from spallwatch.orders import order_spectrum as order_spectrum
    from spallwatch.recordings import DoubtedTimeWarning as DoubtedTimeWarning
    from spallwatch.recordings import LostSamplesWarning as LostSamplesWarning
    from spallwatch.recordings import blocks as blocks
    from spallwatch.recordings import read as read
    from spallwatch.recordings import to_signal as to_signal
    from spallwatch.records import NothingAcceptedWarning as NothingAcceptedWarning
    from spallwatch.records import open_records as open_records
    from spallwatch.records import replay as replay
    from spallwatch.scenes import acceleration as acceleration
    from spallwatch.scenes import build_map as build_map
    from spallwatch.scenes import map_dataset as map_dataset
    from spallwatch.scenes import open_map as open_map
    from spallwatch.scenes import save_map as save_map
    from spallwatch.scenes import scene as scene

# Imported when they are first used: a script that reads a file does not wait for the models, nor the command line for
# any of it.
_NAMES = {
    "models.machine.bearing": "Bearing Kinematics",
    "models.machine.scene": "Scene",
    "models.maps.data": "RmsMap",
    "models.solve.response": "Response",
    "models.solve.simulate": "simulate",
    "models.solve.six_dof.sweep": "Sweep sweep",
    "models.words.errors": "SpallwatchError",
    "monitor": "__version__",
    "monitor.desk.desk": "DeskError",
    "monitor.desk.recording": "RecordingDescription",
    "monitor.health.name.naming": "Naming",
    "spallwatch.analysis": "SignalError envelope_spectrum features name_fault spectrum",
    "spallwatch.archives": "open_archive",
    "spallwatch.bearings": "bearing fault_frequencies fe_stiffness",
    "spallwatch.descriptions": "describe",
    "spallwatch.figures": "plot_cyclic plot_map plot_records plot_scene plot_signal plot_spectrum",
    "spallwatch.gears": "gear_motion mesh_frequencies",
    "spallwatch.orders": "cyclic_coherence ias_spectrum order_spectrum",
    "spallwatch.recordings": "DoubtedTimeWarning LostSamplesWarning blocks read to_signal",
    "spallwatch.records": "NothingAcceptedWarning open_records replay",
    "spallwatch.scenes": "acceleration build_map map_dataset open_map save_map scene",
}
_HOMES = {name: home for home, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


class _AfterXarray:
    """Registers the accessors (:mod:`spallwatch.accessors`) when xarray is imported; nothing is imported before."""

    @staticmethod
    def find_spec(name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return the module of xarray, which then registers them; None for all others."""
        if name != "xarray":
            return None
        sys.meta_path.remove(_after_xarray)
        spec = importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        run = spec.loader.exec_module

        def exec_module(module: ModuleType) -> None:
            run(module)
            importlib.import_module("spallwatch.accessors")

        spec.loader.exec_module = exec_module
        return spec


_after_xarray = cast("Any", _AfterXarray)
if "xarray" in sys.modules:
    importlib.import_module("spallwatch.accessors")
else:
    sys.meta_path.insert(0, _after_xarray)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    value = globals()[name] = getattr(importlib.import_module(_HOMES[name]), name)
    return value


def __dir__() -> list[str]:
    return __all__
