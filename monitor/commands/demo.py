"""``spallwatch demo``: the pipeline over a simulated life, with its truth beside."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.machine.rig import Rig
from models.solve.registry import IGNORES_DEPTH, RIGS
from models.work.choose import local_runner
from monitor.commands import option
from monitor.commands.common import InputError, counter, finite, progress_bar, say
from monitor.commands.demo_prior import forecast_quadratic, quadratic_library
from monitor.commands.replay import summary_lines, write_report
from monitor.commands.shared_folders import hold_output
from monitor.config.load import Config, validate
from monitor.config.source import ChannelSection
from monitor.words.numbers import duration, interval
from streams.rig.bench import machine_of

if TYPE_CHECKING:
    from models.lives.population import Population
    from models.maps.data import RmsMap

_RMS_BAND = (0.0, 9500.0)
"""The low-pass of the thesis (section 2.3.1)."""
_EXTENTS_DEG = 50.0
_DEPTHS_UM = 32.0
LIVES = 200
"""Simulated lives in the library; the default of ``spallwatch library build`` is 1000."""
_AROUND = 0.02
"""Relative range of load and speed, either way, of the lives of the library."""
_LIBRARY_SEED = 20
_WINDOW_HOURS = 4.0
"""Time to the next maintenance, h."""
_MACHINE = "demo"
_TESTED = "test_bearing"
_ONE = "This is one life of many. "
SHIPPED = Path(__file__).with_name("demo_library.npz")
"""The library of the demo (``benchmarks.forecast.demo_libraries`` makes it)."""
_OURS = ("state.db", "state.db-*", "state.db.lock", "days.lock", "report.html", ".report.html.tmp", "records")
"""What a demo leaves in its folder, be it that it was killed."""
_RECORDS = ("demo-*.nc", "demo-state.json", ".demo-*.tmp")
"""The same in the folder of records."""
_NOTES = {
    "library": (
        "V_eq and TT come from a library of simulated lives: the interval is valid for bearings like those of the "
        "library. The growth and rig parameters of this bearing are drawn from other ranges.",
        _ONE
        + "An interval of 80 % misses one value in five, and then for hours, because errors of neighbouring blocks "
        "are correlated (docs/evidence/forecasting.md).",
    ),
    "filter": (
        "V_eq comes from the physical tracker, which weights candidate defects by a map of nominal rig parameters; TT "
        "comes from a library of simulated lives. The rig's parameters are 2 to 5 % away from nominal.",
        _ONE + "An interval of 80 % misses one value in five (docs/evidence/forecasting.md).",
    ),
    "thesis": (
        "The rig's parameters are 2 to 5 % away from the map's, and its floor is rough where the map's is smooth.",
        _ONE + "On others the error of the tracked V_eq is a factor of several (docs/evidence/tracking.md).",
    ),
}


_OTHER_NOTES = (
    "Rig and map are of one model, whose sensor is not on a casing; the rig's parameters are 2 to 5 % away from the "
    "map's. TT is that of the thesis, and there is no end of life by peak.",
    _ONE + "On the map of another model V_eq is another (docs/evidence/maps.md).",
)
MODELS = [name for name, kind in RIGS.items() if name not in IGNORES_DEPTH and not kind.slow]


def demo_config(method: str = "library", model: str = Rig.model) -> Config:
    """Return the configuration of the demo: the test bench of the thesis, without tuning.

    ``method`` ("library", "thesis" or "filter") gives V_eq; TT comes from the library unless it is "thesis", or the
    model is another than that of the casing, of which the demo builds no library.
    """
    channel = {"source": "rig", "unit": "m/s2", "rms_band_hz": _RMS_BAND}
    own = model == Rig.model
    designation = machine_of(model).bearing.designation
    return validate(
        {
            "machine": {"name": _MACHINE},
            "bearing": [
                {"name": "test", "designation": designation},
                {"name": "support_drive", "designation": "22207"},
                {"name": "support_free", "designation": "22207"},
            ],
            # The simulated rig is made of these numbers, up to 2 to 5 %.
            "rig": {"calibrated": "declared"},
            "shaft": {"calibrated": "declared"},
            "operating": {"speed_hz": 40.0, "speed_exact": True, "load_newton": 4000.0},
            "source": [{"name": "rig", "url": "rig:ferrara", "rate_hz": 25600.0, "range_g": 50.0 if own else 5000.0}],
            "channel": [
                {**channel, "name": _TESTED, "bearing": "test", "band_hz": [[7000, 9000]], "track": True},
                {**channel, "name": "support_drive", "bearing": "support_drive"},
                {**channel, "name": "support_free", "bearing": "support_free"},
            ],
            # A sensor without a casing before it is louder than the level that ends a life.
            "detect": {"learn_blocks": 100} | ({} if own else {"end_of_life_peak_g": 1000.0}),
            "track": {"method": method},
            "forecast": {
                "method": "thesis" if method == "thesis" or not own else "library",
                "window_hours": _WINDOW_HOURS,
            },
        },
        Path("demo"),
    )


@click.command("demo")
@click.option(
    "--out",
    type=option.FOLDER,
    default="demo-out",
    help="Folder for records and report; an earlier demo in it is replaced.",
)
@click.option("--seed", type=option.WHOLE, default=1, help="Number of the simulated life.")
@click.option(
    "--method",
    type=click.Choice(["library", "filter", "thesis"]),
    help="Method for V_eq; TT comes from the library unless it is thesis. Default: library; filter of other models.",
)
@click.option("--model", type=click.Choice(MODELS), default=Rig.model, help="Of rig and map.")
@option.output
def command(out: Path, seed: int, method: str | None, model: str, quiet: bool) -> option.Result:
    """Simulate a bearing that wears out, monitor its blocks, and write records and a report.

    The rig simulates each block directly, on a rough floor and with parameters 2 to 5 % away from the nominal ones.
    V_eq and TT come from a library of other simulated lives of such rigs; with --method thesis or filter, V_eq comes
    from a map of a smooth floor and nominal parameters. Of another model than that of the casing no library is built,
    the floor is smooth, and the accelerometer shows the model's own sensor.
    """
    from monitor.records.library_file import load_library
    from monitor.service.replay import replay

    began, own = time.perf_counter(), model == Rig.model
    if method is None:
        method = "library" if own else "filter"
    if method == "library" and not own:
        raise InputError(
            f"--method library: the demo has a library of {Rig.model} only, since lives of {model} take long; "
            f"take filter, or make one with: spallwatch library build --model {model}"
        )
    config = demo_config(method, model)
    hold_output(out)
    _clear(out)
    maps = {_TESTED: _demo_map(config, model, quiet=quiet)}
    libraries = {_TESTED: load_library(SHIPPED)} if method != "thesis" and own else {}
    say(f"simulating and monitoring the life of bearing {seed}", quiet=quiet)
    result = replay(
        config,
        f"rig:ferrara?seed={seed}" + ("" if own else f"&model={model}"),
        out,
        maps=maps,
        libraries=libraries,
        progress=progress_bar("demo", quiet=quiet),
    )
    title = f"Demo: simulated bearing {seed}" + ("" if own else f" by the model {model}")
    notes = _NOTES[method] if own else _OTHER_NOTES
    comparison = _compare(result.store_path)
    priors: dict[str, str] = {}
    if libraries:
        priors = {"prior": libraries[_TESTED].prior, "prior_quadratic": quadratic_library().prior}
        _add_quadratic(comparison, result.store_path)
        notes = (*notes, _prior_note(comparison))
    page = write_report(result, out / "report.html", title, notes)
    summary = {
        **result.summary,
        "seed": seed,
        "method": method,
        "model": model,
        "truth": comparison,
        **priors,
        "report": str(page),
        "seconds_in_all": time.perf_counter() - began,
    }
    return summary, _demo_lines(summary)


def _demo_map(config: Config, model: str, *, quiet: bool) -> RmsMap:
    """Return the RMS map of the demo, built on first use; coarser of a model that takes longer."""
    from models.maps.file import cached_map, default_map_path
    from models.maps.plan import MapPlan

    entry = config.entry_of(_tested(config))
    depths, extents = (32, 100) if model == Rig.model else (16, 50)
    plan = MapPlan(
        bearing=entry.bearing,
        rig=config.parameters_of(RIGS[model], entry),
        model=model,
        load=(4000.0,),
        speed=(40.0,),
        h_d=tuple(_DEPTHS_UM * 1e-6 * i / depths for i in range(depths + 1)),
        dphi_d=tuple(math.radians(_EXTENTS_DEG * i / extents) for i in range(extents + 1)),
        rms_band=_RMS_BAND,
    )
    kept = default_map_path(plan).exists()
    say("reading the RMS map" if kept else "building the RMS map (kept for later runs)", quiet=quiet)
    with local_runner(0) as runner:
        return cached_map(plan, runner=runner, progress=counter("map", quiet=quiet))


def demo_population(config: Config) -> Population:
    """Return the lives of the library that ships: at the load and speed of a demo."""
    from models.lives.population import Population

    tested = _tested(config)

    def around(value: float | None) -> tuple[float, float]:
        return (1.0 - _AROUND) * (value or 0.0), (1.0 + _AROUND) * (value or 0.0)

    return Population(
        bearing=config.bearing_of(tested),
        rig=config.rig_of(config.entry_of(tested)),
        load=around(config.operating.load_newton),
        speed=around(config.operating.speed_hz),
        rms_band=_RMS_BAND,
        seed=_LIBRARY_SEED,
    )


def _tested(config: Config) -> ChannelSection:
    """Return the channel on the bearing that wears out."""
    return next(channel for channel in config.channel if channel.name == _TESTED)


def _clear(out: Path) -> None:
    """Remove the files of an earlier demo.

    Raises:
        InputError: the folder holds other files.
    """
    if not out.exists():
        return
    foreign = sorted(item.name for item in out.iterdir() if not any(map(item.match, _OURS)))
    if foreign:
        raise InputError(f"--out {out}: holds {foreign[0]!r}, which is not from a demo; give another folder")
    if (out / "state.db").exists():
        _refuse_other_machine(out)
    for item in out.iterdir():
        if item.is_dir():
            for file in chain.from_iterable(map(item.glob, _RECORDS)):
                file.unlink()
        else:
            item.unlink()


def _refuse_other_machine(out: Path) -> None:
    """Refuse the store of a machine that is watched: its folder may hold no other file."""
    from monitor.records.database import StoreError
    from monitor.records.store import Store

    try:
        with Store.open(out / "state.db", read_only=True) as store:
            machine = store.machine
    except StoreError as error:
        raise InputError(f"--out {out}: {error}; give another folder") from None
    if machine != _MACHINE:
        raise InputError(f"--out {out}: holds the state of machine {machine!r}; give another folder")


def _compare(store_path: Path) -> list[dict[str, Any]]:
    """Return found and true V_eq and TT at a quarter, half, three quarters and the end of the final stage."""
    from monitor.records.store import Store

    with Store.open(store_path, read_only=True) as store:
        rows = [
            (record.sequence, record.channels[_TESTED])
            for record in store.records()
            if record.channels.get(_TESTED, {}).get("v_eq_true")
        ]
    ahead = [row for row in rows if _first(row[1].get("tt_true"))]
    if not ahead:
        return []
    places = {share: ahead[min(len(ahead) - 1, int(share * len(ahead)))] for share in (0.25, 0.5, 0.75)}
    compared = []
    for share, (block, values) in [*places.items(), (1.0, rows[-1])]:
        in_mm2 = {
            f"{name}_mm2": None if values.get(name) is None else values[name] * 1e6
            for name in ("v_eq", "v_eq_lower", "v_eq_upper", "v_eq_true")
        }
        in_s = {f"{name}_s": _first(values.get(name)) for name in ("tt", "tt_lower", "tt_upper", "tt_true")}
        statuses = {
            name: _first(values.get(name)) for name in ("edv_status", "tt_status", "p_threshold", "p_no_growth")
        }
        compared.append({"share_of_life": share, "block": block, **in_mm2, **in_s, **statuses})
    return compared


def _add_quadratic(compared: list[dict[str, Any]], store_path: Path) -> None:
    """Add to each moment the forecast of its V_eq as tracked by a library of quadratic growth alone."""
    from monitor.records.store import Store

    with Store.open(store_path, read_only=True) as store:
        history = [
            (record.sequence, float(record.elapsed), float(record.channels[_TESTED]["v_eq"]))
            for record in store.records()
            if record.elapsed is not None and record.channels.get(_TESTED, {}).get("v_eq") is not None
        ]
    found = forecast_quadratic(history)
    for row in compared:
        one = found.get(row["block"])
        for end in ("", "_lower", "_upper"):
            row[f"tt_quadratic{end}_s"] = None if one is None else finite(getattr(one, f"tt{end}"))


def _prior_note(compared: list[dict[str, Any]]) -> str:
    """Return in a sentence what TT leans on, and what it would be at half of the life were the growth law known."""
    half = next((row for row in compared if row["share_of_life"] == 0.5), None)
    known = None if half is None else half["tt_quadratic_s"]
    said = "The library expects any growth; this bearing grows by a quadratic."
    if half is None or known is None or half["tt_true_s"] is None:
        return said
    issued = "none" if half["tt_s"] is None else duration(half["tt_s"])
    return (
        f"{said} Were that known, TT at half of the life would be {duration(known)} from the same V_eq, issued is "
        f"{issued}, true {duration(half['tt_true_s'])}."
    )


def _first(value: Any) -> Any:
    return value[0] if isinstance(value, tuple) else value


def _demo_lines(summary: dict[str, Any]) -> Iterator[str]:
    yield from summary_lines(summary)
    yield ""
    level = "" if summary["method"] == "thesis" else ", intervals of 80 %"
    yield f"truth and estimates (test bearing, threshold 0.05 mm3/mm{level})"
    volume, forecast = f"{'V_eq true':>10} {'found':>24}", f"{'TT true':>11} {'found':>38}"
    yield f"{'life':>6} {'block':>6}   {volume}   {forecast}  status"
    for row in summary["truth"]:
        v_eq = _with_interval(row, "v_eq", "mm2", lambda value: f"{value:.3f}")
        tt = _with_interval(row, "tt", "s", duration)
        tt_true = "-" if row["tt_true_s"] is None else duration(row["tt_true_s"])
        status = " / ".join(dict.fromkeys(row[name] or "-" for name in ("edv_status", "tt_status")))
        yield (
            f"{row['share_of_life']:>6.0%} {row['block']:>6}   {row['v_eq_true_mm2']:>10.4f} {v_eq:>24}   "
            f"{tt_true:>11} {tt:>38}  {status}"
        )
    if "prior" in summary:
        yield f"prior of TT: {summary['prior']}"
        yield "this bearing grows by a quadratic; TT from the same V_eq, were that known (the right prior):"
        for row in summary["truth"]:
            found = _with_interval(row, "tt_quadratic", "s", duration)
            yield f"{row['share_of_life']:>6.0%} {row['block']:>6}   {'':>35}   {'':>11} {found:>38}"
    yield from _NOTES[summary["method"]] if summary["model"] == Rig.model else _OTHER_NOTES
    yield ""
    yield f"report: {summary['report']} ({summary['seconds_in_all']:.0f} s in all)"


def _with_interval(row: dict[str, Any], name: str, unit: str, words: Callable[[float], str]) -> str:
    """Return a value with its interval, "-" where there is none."""
    middle, low, high = (row[f"{key}_{unit}"] for key in (name, f"{name}_lower", f"{name}_upper"))
    if middle is None:
        return "-"
    return words(middle) if low is None else f"{words(middle)} ({interval(low, high or math.nan, words)})"
