"""Points that neighbours read: type, quality and value follow the record and the state of the daemon."""

from __future__ import annotations

from pathlib import Path

from monitor.records.queries import StoredRecord
from monitor.service.neighbours.points import _WORDS, MachineSnapshot, Snapshots, channels_of, points_of
from tests.monitor.service.neighbours.machines import STATUS, Machine


def test_each_value_has_the_type_of_its_point(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    machine.add()
    types = {"float": float, "int": int, "text": str}
    words = dict.fromkeys(_WORDS, "words")
    record = StoredRecord("pump", "s", 1, "ok", "", "", 1.79e9, 0.5, {"x": words | {"rms": 1.0}})
    found = points_of(channels_of(machine.config), MachineSnapshot(STATUS, {"s": record}, 3))
    machine.close()
    numbers = {path[-1] for path, point in found.items() if isinstance(point.value, str) and point.kind != "text"}
    # The share, and the numbers of blocks, are the only numbers among them.
    assert numbers == {"p_no_growth", "t_fs_block", "t_fs_known_block", "t_eol_block", "pulses_missing", "pulses_extra"}
    for path, point in found.items():
        assert point.value is None or path[-1] in numbers or isinstance(point.value, types[point.kind]), path


def test_after_the_end_of_the_daemon_values_are_old(tmp_path: Path) -> None:
    machine = Machine(tmp_path)
    channels = channels_of(machine.config)
    snapshots = Snapshots("pump", ["s"], tmp_path)
    empty = points_of(channels, snapshots.read())
    machine.add()
    full = points_of(channels, snapshots.read())
    machine.add(status="nan", channels={}, reason="not finite")
    refused = points_of(channels, snapshots.read())
    machine.stop_daemon()
    ended = points_of(channels, snapshots.read())
    machine.close()
    assert empty.keys() == full.keys() == refused.keys() == ended.keys()
    assert {key: point.kind for key, point in empty.items()} == {key: point.kind for key, point in full.items()}
    level = ("de", "x", "rms_g")
    assert [found[level].quality for found in (empty, full, refused, ended)] == ["bad", "good", "bad", "bad"]
    assert (refused["de", "x", "status"].value, refused["de", "x", "block"].value) == ("nan", 2)
    assert (ended[("state",)].value, ended[("daemon",)].value) == ("no_data", "died")
    assert STATUS["status"] == "running"
    assert ended["de", "x", "device_health"].value == 1
