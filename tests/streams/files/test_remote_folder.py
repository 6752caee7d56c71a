"""Files below a prefix are fetched as they are read, from where a pass begins, and removed behind it."""

from __future__ import annotations

import datetime
import gzip
import itertools
import uuid
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.fleet.object_store import ObjectStore
from streams.files import remote, remote_folder
from streams.files.groups import FilesBeside
from streams.files.remote import local_source
from streams.files.remote_folder import OpenedRemote, opened_remote
from streams.open import open_source
from streams.recording.source import Recording
from streams.recording.state import ReadingState
from streams.types.block import Block, Rejected
from streams.types.spec import ChannelSpec, SourceError, SourceSpec
from tests.monitor.fleet.fleet_files import assert_same_records, make_archive, write_files

pytest.importorskip("fsspec", reason="needs the extra cluster")

COUNT = 12
CHANNELS = (ChannelSpec("a", column=1),)
PULSES = "{stem}.pulses.csv"


@pytest.fixture
def gets(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The names of the objects that are fetched, in order."""
    fetched: list[str] = []
    get = remote._get

    def noted(files: object, file: remote.RemoteFile, target: Path) -> None:
        fetched.append(target.name)
        get(files, file, target)

    monkeypatch.setattr(remote, "_get", noted)
    return fetched


@pytest.fixture
def prefix(tmp_path: Path) -> tuple[str, Path]:
    """The URL of a prefix, and a folder with the same files: recordings of 1.5 blocks each, and a side-car."""
    rng = np.random.default_rng(1)
    files = {f"run-{number}.npy": rng.standard_normal(150) for number in range(COUNT)}
    folder = written(tmp_path / "local" / "press", files)
    (folder / "spallwatch.json").write_text('{"rate_hz": 100, "unit": "g"}')
    (folder / "run-3.npy.json").write_text('{"rate_hz": 100, "unit": "g", "scale": 2.0}')
    return stored(folder), folder


def written(folder: Path, files: Mapping[str, np.ndarray]) -> Path:
    """Write recordings below a folder."""
    for name, values in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        np.save(folder / name, values.astype(np.float32))
    return folder


def stored(folder: Path) -> str:
    """Return the URL of a prefix of the name and with the files of a folder."""
    store = ObjectStore(f"memory://{uuid.uuid4()}/plant")
    for path in folder.rglob("*"):
        if path.is_file():
            store.write(f"{folder.name}/{path.relative_to(folder).as_posix()}", path.read_bytes())
    return f"{store.url}/{folder.name}"


def opened(found: OpenedRemote, begin: ReadingState | None = None) -> Recording:
    source = open_source(spec_of(found.url), begin=begin, files=found.files)
    assert isinstance(source, Recording)
    return source


def spec_of(url: str, pulses: str | None = None) -> SourceSpec:
    return SourceSpec("s", url, block_s=1.0, channels=CHANNELS, start=0.0, pulses=pulses)


def seen(items: list[Block | Rejected]) -> list[object]:
    return [(i.name, i.start, i.samples.tobytes()) if isinstance(i, Block) else replace(i) for i in items]


@pytest.mark.parametrize("files", [1, 4, 16])
def test_blocks_are_those_of_a_folder(
    files: int, prefix: tuple[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", files)
    url, folder = prefix
    local = open_source(spec_of(str(folder)))
    most = 0
    with opened_remote(url, tmp_path / "scratch") as found:
        items: list[Block | Rejected] = []
        for item in opened(found):
            items.append(item)
            most = max(most, len(list((tmp_path / "scratch").rglob("*.npy"))))
    assert seen(items) == seen(list(local))
    assert len(items) > COUNT
    assert most <= files
    assert not list((tmp_path / "scratch").iterdir())


@pytest.mark.parametrize("several", [False, True])
def test_side_cars_of_folders_stay_until_the_end(
    several: bool, tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", 3)
    rng = np.random.default_rng(1)
    names = [f"{'one/' if several and letter == 'a' else ''}{letter}{n}.npy" for letter in "az" for n in range(8)]
    folder = written(tmp_path / "local" / "press", {name: rng.standard_normal(100) for name in names})
    for place in {(folder / name).parent for name in names}:
        (place / "spallwatch.json").write_text('{"rate_hz": 100, "unit": "g", "scale": 4.0}')
    with opened_remote(stored(folder), tmp_path / "scratch") as found:
        source = opened(found)
        assert len(source) == len(names)
        items = [*iter(source)]
    assert seen(items) == seen(list(open_source(spec_of(str(folder)))))
    assert all(isinstance(item, Block) for item in items)
    assert gets.count("spallwatch.json") == 1 + several


def test_files_that_are_read_by_date_are_fetched_once(
    tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", 4)
    rng = np.random.default_rng(1)
    days = [datetime.date(2024, 1, 1) + datetime.timedelta(days=3 * number) for number in range(30)]
    names = [f"vib_{day:%d-%m-%Y}_12-00-00.npy" for day in days]
    folder = written(tmp_path / "local" / "press", {name: rng.standard_normal(100) for name in names})
    (folder / "spallwatch.json").write_text('{"rate_hz": 100, "unit": "g"}')
    for name in names[::3]:
        (folder / f"{name}.json").write_text('{"rate_hz": 100, "unit": "g", "scale": 2.0}')
    with opened_remote(stored(folder), tmp_path / "scratch") as found:
        source = open_source(replace(spec_of(found.url), start=None), files=found.files)
        gets.clear()
        items = list(iter(source))
    local = open_source(replace(spec_of(str(folder)), start=None))
    assert seen(items) == seen(list(iter(local)))
    assert len(gets) == len(set(gets))
    # The first one was fetched to open the recording.
    assert set(names[1:]) <= set(gets)


def test_a_part_fetches_from_the_file_on_in_which_the_one_before_ended(
    prefix: tuple[str, Path], tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", 2)
    url, folder = prefix
    with opened_remote(url, tmp_path / "scratch") as found:
        source = opened(found)
        first = [item for _, item in zip(range(7), source, strict=False)]
        state = source.state()
    gets.clear()
    with opened_remote(url, tmp_path / "scratch") as found:
        # list() would ask for the length first, which takes a pass of its own.
        rest = [*iter(opened(found, state))]
    assert seen([*first, *rest]) == seen(list(open_source(spec_of(str(folder)))))
    assert [name for name in gets if name.endswith(".npy")] == [f"run-{number}.npy" for number in range(3, COUNT)]
    assert found.size == sum((folder / name).stat().st_size for name in gets)


def test_a_batch_has_a_limit_of_bytes(
    prefix: tuple[str, Path], tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    url, folder = prefix
    monkeypatch.setattr(remote_folder, "MAX_BATCH_BYTES", 2 * (folder / "run-0.npy").stat().st_size + 10)
    with opened_remote(url, tmp_path) as found:
        assert found.files is not None
        items = {item.path: item for item in found.files}
        gets.clear()
        for name in ("run-5.npy", "run-6.npy", "run-2.npy"):
            items[name].read()
        assert gets == ["run-5.npy", "run-6.npy", "run-2.npy", "run-3.npy", "run-3.npy.json"][: len(gets)]
        assert len(gets) == 3


def test_a_file_that_changed_meanwhile_ends_the_pass(prefix: tuple[str, Path], tmp_path: Path) -> None:
    url, folder = prefix
    store = ObjectStore(url.removesuffix("/press"))
    with opened_remote(url, tmp_path / "scratch") as found:
        store.write("press/run-0.npy", (folder / "run-0.npy").read_bytes() + b"more")
        with pytest.raises(remote.RemoteError, match=r"run-0\.npy: changed while it was fetched"):
            opened(found)
        store.delete("press/run-0.npy")
        with pytest.raises(SourceError, match=r"cannot be fetched"):
            opened(found)


@pytest.mark.parametrize("name", ["run-0.npy/run-1.npy", f"{'x' * 300}.npy", f"{'x' * 300}/run-1.npy"])
def test_an_object_whose_name_no_folder_can_hold_is_said(name: str, tmp_path: Path) -> None:
    store = ObjectStore(f"memory://{uuid.uuid4()}/plant")
    store.write("press/run-0.npy", b"0" * 200)
    objects, place = store._files.store, store.url.removeprefix("memory:/")
    # A memory, unlike S3, does not write below an object.
    objects[f"{place}/press/{name}"] = objects[f"{place}/press/run-0.npy"]
    with opened_remote(f"{store.url}/press", tmp_path / "scratch") as found:
        assert found.files is not None
        items = list(found.files)
        assert len(items) == 2
        with pytest.raises(remote.RemoteError, match=r"plant/press cannot be fetched: \w+: "):
            items[0].read()
    assert not list((tmp_path / "scratch").iterdir())
    store.write(f"{'x' * 300}/run-2.npy", b"0")
    with (
        pytest.raises(remote.RemoteError, match=r" cannot be fetched: OSError: File name too long"),
        opened_remote(f"{store.url}/{'x' * 300}", tmp_path / "scratch"),
    ):
        pass


def test_an_object_is_fetched_at_once(prefix: tuple[str, Path], tmp_path: Path) -> None:
    url, folder = prefix
    with opened_remote(f"{url}/run-1.npy", tmp_path / "scratch") as found:
        assert found.files is None
        assert Path(found.url).read_bytes() == (folder / "run-1.npy").read_bytes()
        assert found.size == sum((folder / name).stat().st_size for name in ("run-1.npy", "spallwatch.json"))


@pytest.mark.parametrize("beside", ["run-1.npy.json", "spallwatch.json", "spallwatch.toml"])
def test_an_object_is_read_with_the_files_beside_it(beside: str, tmp_path: Path, gets: list[str]) -> None:
    rng = np.random.default_rng(1)
    folder = written(tmp_path / "local" / "press", {f"run-{n}.npy": rng.standard_normal(100) for n in range(12)})
    own = 'rate_hz = 100\nunit = "g"\nscale = 3.0' if beside.endswith("toml") else '{"rate_hz": 100, "unit": "g"}'
    (folder / beside).write_text(own)
    (folder / "run-1.pulses.csv").write_text("0.1\n0.5\n")
    (folder / "run-2.npy.json").write_text('{"rate_hz": 50}')
    with opened_remote(f"{stored(folder)}/run-1.npy", tmp_path / "scratch", FilesBeside(PULSES)) as found:
        assert found.files is None
        items = list(iter(open_source(spec_of(found.url, PULSES))))
    assert seen(items) == seen(list(open_source(spec_of(str(folder / "run-1.npy"), PULSES))))
    assert [pulses_of(item) for item in items] == [[0.1, 0.5]]
    assert sorted(gets) == sorted(["run-1.npy", beside, "run-1.pulses.csv"])
    with local_source(f"{stored(folder)}/run-1.npy", tmp_path / "scratch", FilesBeside(PULSES)) as url:
        assert seen(list(open_source(spec_of(url or "", PULSES)))) == seen(items)


def pulses_of(item: Block | Rejected) -> list[float] | None:
    return item.pulses.times.tolist() if isinstance(item, Block) and item.pulses is not None else None


def test_an_object_without_files_beside_it_is_fetched_alone(tmp_path: Path, gets: list[str]) -> None:
    folder = written(tmp_path / "local" / "press", {"run-1.npy": np.arange(100.0)})
    (folder / "run-2.npy.json").write_text('{"rate_hz": 50}')
    with opened_remote(f"{stored(folder)}/run-1.npy", tmp_path / "scratch", FilesBeside(PULSES)):
        assert gets == ["run-1.npy"]


def test_an_archive_of_prefixes_in_parts_has_the_records_of_folders(
    tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", 3)
    store = ObjectStore(f"memory://{uuid.uuid4()}/plant")
    for place, count in (("one", 5), ("two", 3)):
        for path in write_files(tmp_path / place, count, begin=0 if place == "one" else 5).iterdir():
            store.write(f"{place}/{path.name}", path.read_bytes())
    manifest = (
        '[[machine]]\nname = "m"\nconfig = "m.toml"\nrecordings = ["{0}/one", "{0}/two"]\nhistory = "continued"\n'
    )
    make_archive(tmp_path, manifest.format(store.url), part_blocks=3)
    fetched = [name for name in gets if name.endswith(".npy")]
    make_archive(tmp_path, manifest.format(tmp_path), "local", part_blocks=100)
    for folder in sorted((tmp_path / "local" / "m").iterdir()):
        assert_same_records(tmp_path / "out" / "m" / folder.name, folder)
    # Bands are chosen of so few blocks by a pass of its own, and a part fetches the last file of the one before again.
    assert len(fetched) <= 3 * 8


GROUPS = ("*_ch1.csv.gz", "*_ch2.csv.gz")


def of_channels(folder: Path, count: int) -> Path:
    """Write recordings of one file a channel; of the second one the unit is in a side-car."""
    rng = np.random.default_rng(3)
    folder.mkdir(parents=True)
    for number, channel in itertools.product(range(count), (1, 2)):
        rows = "\n".join(f"{value:.6f}" for value in rng.standard_normal(100))
        head = "Sample rate: 100 Hz\n" + ("Unit: g\n" if channel == 1 else "")
        name = f"2024-01-01T00-{number:02d}-00_ch{channel}.csv.gz"
        (folder / name).write_bytes(gzip.compress(f"{head}acc\n{rows}\n".encode()))
        if channel == 2:
            (folder / f"{name}.json").write_text('{"unit": "g"}')
    return folder


def of_groups(url: str) -> SourceSpec:
    channels = tuple(ChannelSpec(name, column=name) for name in ("ch1", "ch2"))
    return SourceSpec("s", url, block_s="file", channels=channels, files=GROUPS)


@pytest.mark.parametrize("files", [1, 3, 16])
def test_files_of_one_channel_each_are_read_together(
    files: int, tmp_path: Path, gets: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_folder, "MAX_FILES", files)
    folder = of_channels(tmp_path / "local" / "press", 5)
    expected = seen(list(open_source(of_groups(str(folder)))))
    assert len(expected) == 5
    with opened_remote(stored(folder), tmp_path / "scratch", FilesBeside(files=GROUPS)) as found:
        source = open_source(of_groups(found.url), files=found.files)
        gets.clear()
        items = [*iter(source)]
    assert seen(items) == expected
    assert all(isinstance(item, Block) and len(item.channels) == 2 for item in items)
    assert len(gets) == len(set(gets))
    with (
        opened_remote(stored(folder), tmp_path / "scratch") as found,
        pytest.raises(SourceError, match=r'files = \["\*_ch1.csv.gz", "\*_ch2.csv.gz"\]'),
    ):
        open_source(replace(of_groups(found.url), files=()), files=found.files)


def test_a_channel_that_is_not_in_the_storage_is_said(tmp_path: Path) -> None:
    folder = of_channels(tmp_path / "local" / "press", 2)
    (folder / "2024-01-01T00-01-00_ch2.csv.gz").unlink()
    with opened_remote(stored(folder), tmp_path / "scratch", FilesBeside(files=GROUPS)) as found:
        first, second = open_source(of_groups(found.url), files=found.files)
    assert isinstance(first, Block)
    assert isinstance(second, Rejected)
    assert (second.status, "00-01-00_ch2.csv.gz" in second.reason) == ("incomplete", True)


def test_with_an_object_come_those_of_other_channels_and_notes(tmp_path: Path) -> None:
    folder = of_channels(tmp_path / "local" / "press", 1)
    name = "2024-01-01T00-00-00_ch1.csv.gz"
    with local_source(f"{stored(folder)}/{name}", tmp_path / "scratch", FilesBeside(files=GROUPS)) as url:
        assert url is not None
        (block,) = open_source(of_groups(url))
        assert seen([block]) == seen(list(open_source(of_groups(str(folder / name)))))


@pytest.mark.parametrize("alone", [False, True])
def test_a_text_beside_a_recording_is_fetched_with_it(alone: bool, tmp_path: Path) -> None:
    folder = written(tmp_path / "local" / "press", {"run-1.npy": np.random.default_rng(1).standard_normal(150)})
    (folder / "run-1.txt").write_text("Sample rate: 100 Hz\nUnit: m/s2\n")
    with opened_remote(f"{stored(folder)}{'/run-1.npy' if alone else ''}", tmp_path / "scratch") as found:
        (block, *_) = open_source(spec_of(found.url), files=found.files)
    assert isinstance(block, Block)
    assert (block.rate, block.units) == (100.0, ("m/s2",))
