"""Places that an archive does not take: with recordings in them, and below one."""

from __future__ import annotations

import pytest

from monitor.fleet.index import Index
from monitor.fleet.manifest import ManifestError
from monitor.fleet.place import Overlap
from tests.monitor.fleet.fleet_files import EACH, make_archive, write_files


@pytest.mark.parametrize(
    ("out", "recording", "words"),
    [
        ("/srv", "/srv/m/a", "/srv/m/a is in m of --out /srv, where records will be written"),
        ("/srv", "folder:/srv/m", "in m of --out /srv"),
        ("/srv", "dataset:ims:/srv/m/a", "in m of --out /srv"),
        ("/srv", "file:///srv/m/a%20b", "in m of --out /srv"),
        ("/srv", "/srv/archive-work/a", "in archive-work of --out /srv"),
        ("/srv", "/srv", "/srv holds --out /srv"),
        ("/srv/a/out", "/", "/ holds --out /srv/a/out"),
        ("/srv/a/out", "/srv/a", "/srv/a holds --out /srv/a/out"),
        ("s3://plant/fleet", "s3://plant/fleet/m/2025/", "in m of --out s3://plant/fleet"),
        ("s3://plant/fleet", "s3a://plant/", "holds --out s3://plant/fleet"),
        ("/srv", "/srv/n/a", None),
        ("/srv", "/srv/m-2", None),
        ("/srv/out", "/srv/o", None),
        ("/srv", "rig:ferrara?seed=1", None),
        ("s3://plant/fleet", "s3://plant/fleet-2/m/a", None),
        ("s3://plant/fleet", "/plant/fleet/m/a", None),
    ],
)
def test_recordings_where_an_archive_would_be_written(out, recording, words):
    def look(*, machines):
        found = Overlap(out, machines=machines)
        found.add("f.toml:1", recording)
        found.check(["k", "m"])

    if words is None:
        look(machines=True)
        return
    with pytest.raises(ManifestError) as refused:
        look(machines=True)
    assert str(refused.value).startswith("f.toml:1: recordings: ")
    assert words in str(refused.value)
    if " in m of " in words:
        # One Zarr store has no folders of machines.
        look(machines=False)


def test_an_archive_is_not_written_among_its_recordings(tmp_path):
    write_files(tmp_path / "out/m/a", 1)
    before = sorted((tmp_path / "out").rglob("*"))
    manifest = EACH.format('"out/*/a"')
    with pytest.raises(ManifestError, match="out/m/a is in m of --out"):
        make_archive(tmp_path, manifest)
    with Index(tmp_path / "out/index.db") as index:
        assert not index.planned
    (tmp_path / "out/index.db").unlink()
    assert sorted((tmp_path / "out").rglob("*")) == before
    # Also where a link leads there, and where it is extended.
    (tmp_path / "link").symlink_to(tmp_path / "out")
    write_files(tmp_path / "b", 1)
    make_archive(tmp_path, EACH.format('"b"'), "link")
    with pytest.raises(ManifestError, match="out/m/a is in m of --out"):
        make_archive(tmp_path, EACH.format('["b", "out/m/a"]'), "link", extend=True)
