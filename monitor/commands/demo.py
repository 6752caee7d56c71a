"""``spallwatch demo``: the main job on embedded defaults, with the truth beside what was found."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from monitor.commands.common import (
    InputError,
    counter,
    duration_words,
    emit,
    output_options,
    progress_bar,
    say,
)
from monitor.commands.replay import summary_lines
from monitor.config import Config, validate

_RMS_BAND = (0.0, 9500.0)
"""The low-pass of the thesis (section 2.3.1)."""
_EXTENTS_DEG = 50.0
_DEPTHS_UM = 32.0


def demo_config() -> Config:
    """Return the configuration of the demo: the bench of the thesis, nothing tuned for."""
    channel = {"source": "rig", "unit": "m/s2", "rms_band_hz": _RMS_BAND}
    return validate(
        {
            "machine": {"name": "demo"},
            "bearing": [{"name": "test", "designation": "1205 ETN9"}, {"name": "support", "designation": "22207"}],
            "operating": {"speed_hz": 40.0, "load_newton": 4000.0},
            "source": [{"name": "rig", "url": "rig:ferrara", "rate_hz": 25600.0, "range_g": 50.0}],
            "channel": [
                {**channel, "name": "test_bearing", "bearing": "test", "band_hz": [[7000, 9000]], "track": True},
                {**channel, "name": "support_drive", "bearing": "support"},
                {**channel, "name": "support_free", "bearing": "support"},
            ],
            "detect": {"learn_blocks": 100},
        },
        Path("demo"),
    )


@click.command("demo")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("demo-out"),
    show_default=True,
    help="Folder for records and report; an earlier demo in it is replaced.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, help="Which bearing life.")
@output_options
def command(out: Path, seed: int, as_json: bool, quiet: bool) -> None:
    """Simulate a bearing that wears out, monitor its blocks, and write records and a report.

    The rig simulates each block directly, on a rough floor and with parameters 2 to 5 % away from those of the map that
    the tracker uses, so that the tracker meets a bearing that its map does not describe exactly.
    """
    from models.map_data import MapPlan
    from models.rms_map import cached_map, default_map_path
    from monitor.commands.report import write_report
    from monitor.service.replay import replay

    began = time.perf_counter()
    config = demo_config()
    _clear(out)
    plan = MapPlan(
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(_DEPTHS_UM * 1e-6 * i / 32 for i in range(33)),
        dphi_d=tuple(math.radians(_EXTENTS_DEG * i / 100) for i in range(101)),
        rms_band=_RMS_BAND,
    )
    kept = default_map_path(plan).exists()
    say("reading the RMS map" if kept else "building the RMS map (kept for the next time)", quiet=quiet)
    rms_map = cached_map(plan, workers=0, progress=counter("map", quiet=quiet))
    say(f"simulating and monitoring the life of bearing {seed}", quiet=quiet)
    result = replay(
        config,
        f"rig:ferrara?seed={seed}",
        out,
        maps={"test_bearing": rms_map},
        progress=progress_bar("demo", quiet=quiet),
    )
    note = "The rig's parameters are 2 to 5 % away from the map's, and its floor is rough where the map's is smooth."
    other = "This is one life of many: on others the tracked V_eq is several times off (docs/how-the-thesis-tracks.md)."
    page = write_report(result, out / "report.html", f"Demo: simulated bearing {seed}", (note, other))
    comparison = compare(result.store_path)
    summary = {
        **result.summary,
        "seed": seed,
        "truth": comparison,
        "report": str(page),
        "seconds_in_all": time.perf_counter() - began,
    }
    emit(summary, _lines(summary), as_json=as_json)


def _clear(out: Path) -> None:
    """Remove what an earlier demo left, and nothing else.

    Raises:
        InputError: the folder holds files that no demo makes.
    """
    if not out.exists():
        return
    ours = ("state.db", "state.db-wal", "state.db-shm", "state.db.lock", "report.html", "records")
    foreign = sorted(item.name for item in out.iterdir() if item.name not in ours)
    if foreign:
        raise InputError(f"--out {out}: holds {foreign[0]!r}, which no demo made; give a folder of its own")
    for item in out.iterdir():
        if item.is_dir():
            for file in item.glob("demo-*.nc"):
                file.unlink()
        else:
            item.unlink()


def compare(store_path: Path) -> list[dict[str, Any]]:
    """Return found and true V_eq and TT at a quarter, half, three quarters and the end of the final stage."""
    from monitor.records.store import Store

    with Store.open(store_path, read_only=True) as store:
        rows = [
            (record.sequence, record.channels["test_bearing"])
            for record in store.records()
            if record.channels.get("test_bearing", {}).get("v_eq_true")
        ]
    ahead = [row for row in rows if _first(row[1].get("tt_true"))]
    if not ahead:
        return []
    places = {share: ahead[min(len(ahead) - 1, int(share * len(ahead)))] for share in (0.25, 0.5, 0.75)}
    compared = []
    for share, (block, values) in [*places.items(), (1.0, rows[-1])]:
        v_eq, tt = values.get("v_eq"), _first(values.get("tt"))
        compared.append(
            {
                "share_of_life": share,
                "block": block,
                "v_eq_mm2": None if v_eq is None else v_eq * 1e6,
                "v_eq_true_mm2": values["v_eq_true"] * 1e6,
                "edv_status": values.get("edv_status"),
                "tt_s": tt,
                "tt_true_s": _first(values.get("tt_true")),
                "tt_status": _first(values.get("tt_status")),
            }
        )
    return compared


def _first(value: Any) -> Any:
    return value[0] if isinstance(value, tuple) else value


def _lines(summary: dict[str, Any]) -> Iterator[str]:
    yield from summary_lines(summary)
    yield ""
    yield "truth and what was found (test bearing, threshold 0.05 mm3/mm)"
    volume, forecast = f"{'V_eq true':>10} {'found':>8}  {'status':<16}", f"{'TT true':>9} {'found':>9}  status"
    yield f"{'life':>6} {'block':>6}   {volume} {forecast}"
    for row in summary["truth"]:
        found = "-" if row["v_eq_mm2"] is None else f"{row['v_eq_mm2']:.4f}"
        tt_true = "-" if row["tt_true_s"] is None else duration_words(row["tt_true_s"])
        tt = "-" if row["tt_s"] is None else duration_words(row["tt_s"])
        yield (
            f"{row['share_of_life']:>6.0%} {row['block']:>6}   {row['v_eq_true_mm2']:>10.4f} {found:>8}  "
            f"{row['edv_status'] or '-':<16} {tt_true:>9} {tt:>9}  {row['tt_status'] or '-'}"
        )
    yield "One life of many: on others V_eq is several times off. docs/how-the-thesis-tracks.md measures how often."
    yield ""
    yield f"report: {summary['report']} ({summary['seconds_in_all']:.0f} s in all)"
