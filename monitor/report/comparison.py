"""Several runs: those side by side, and tables over runs of final stages, fitted laws and scores."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import tzinfo

from monitor.report.figures.drawing import Picture
from monitor.report.figures.side_by_side import other_conditions, side_by_side
from monitor.report.options import Options
from monitor.report.score.scoring import mean_of_runs
from monitor.report.summary import RunSummary
from monitor.report.tables import Cell, Column, Table
from monitor.report.verdict import GRADES
from monitor.words.numbers import Clock, duration

_PER_HOUR = 3600.0
_SCORES = (
    Column("cra", "CRA", "1"),
    Column("crps", "CRPS", "s", "s", words=duration),
    Column("prognostic_horizon", "horizon", "s", "s", words=duration),
    Column("coverage", "coverage", "1", words=lambda value: f"{value:.0%}"),
    Column("width", "width of the interval", "s", "s", words=duration),
    Column("answered", "answered", "1", words=lambda value: f"{value:.0%}"),
)
"""Their keys are those of :func:`monitor.report.score.scoring.score_run`."""
_CHANNEL = (Column("run", "run"), Column("channel", "channel"))
"""The first columns of tables with a row for each channel of each run."""
_END_WORDS = {"given": "given", "truth": "true", "tracked": "tracked V_eq crossed", "none": "not known"}
_BASELINES = ("doubling", "linear", "thesis")


@dataclass(frozen=True)
class Comparison:
    """Several runs together, the worst first.

    Attributes:
        grades: grade and number of the runs whose worst channel has it, the worst first.
        shown: tables on the page.
        overview: table for files only.
    """

    runs: tuple[RunSummary, ...]
    grades: tuple[tuple[str, int], ...]
    pictures: tuple[Picture, ...]
    shown: tuple[Table, ...]
    overview: Table

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables, for files."""
        return (self.overview, *self.shown)


def compare(runs: Sequence[RunSummary], options: Options, numbers: itertools.count[int]) -> Comparison:
    """Compare runs; ``numbers`` are those of figures."""
    ordered = sorted(runs, key=lambda run: GRADES.index(grade_of(run)))
    grades = [(grade, sum(grade_of(run) == grade for run in runs)) for grade in GRADES]
    pictures = [
        side_by_side(ordered, "rms_g", "RMS (g)", "Final stages side by side: RMS", numbers),
        side_by_side(ordered, "v_eq_mm2", "V_eq (mm³/mm)", "Final stages side by side: damaged volume", numbers),
    ]
    other = other_conditions(ordered, options, numbers)
    found = [milestones(ordered, options.zone), laws(ordered), speeds(ordered)]
    if other is not None:
        pictures.append(other[0])
        found.append(other[1])
    if options.holds("score"):
        found += [scores(ordered), mean_scores(ordered)]
    return Comparison(
        runs=tuple(ordered),
        grades=tuple((grade, number) for grade, number in grades if number),
        pictures=tuple(picture for picture in pictures if picture is not None),
        shown=tuple(table for table in found if table is not None and table.rows),
        overview=overview(ordered),
    )


def grade_of(run: RunSummary) -> str:
    """Return the grade of the worst channel of a run, "open" where none has a value."""
    return min((channel.grade for channel in run.channels), key=GRADES.index, default="open")


def milestones(runs: Sequence[RunSummary], zone: tzinfo) -> Table:
    """Return t_fs, t_EOL and length of every final stage (thesis, Table 20); dates are in ``zone``."""
    rows: list[Sequence[Cell]] = []
    for run in runs:
        clock = Clock(run.dated, zone)
        for channel in run.channels:
            if channel.t_fs is None or channel.last is None:
                continue
            ended = channel.last if channel.t_eol is None else channel.t_eol
            words = ["" if moment is None else clock.moment(moment) for moment in (channel.t_fs, channel.t_eol)]
            until = "last block" if channel.t_eol is None else "end of life"
            seconds = (channel.t_fs, channel.t_eol, ended - channel.t_fs)
            rows.append((run.label, channel.name, *words, *seconds, until))
    columns = (
        *_CHANNEL,
        Column("t_fs_words", "t_fs"),
        Column("t_eol_words", "t_EOL"),
        Column("t_fs", "t_fs", "s", "s", on_page=False),
        Column("t_eol", "t_EOL", "s", "s", on_page=False),
        Column("length", "final stage lasts", "s", "s", words=duration),
        Column("until", "until"),
    )
    note = "As Table 20 of the thesis. Where no end of life was seen, the final stage is counted to the last block."
    return Table("final_stages", "Start, end and length of the final stages", columns, rows, note)


def speeds(runs: Sequence[RunSummary]) -> Table | None:
    """Return speeds and domains of the channels for whose blocks an angle was sought, or None without any."""
    keys = ("least", "highest", "orders", "refused")
    rows = [
        (run.label, channel.name, *(channel.speeds[key] for key in keys))
        for run in runs
        for channel in run.channels
        if channel.speeds
    ]
    if not rows:
        return None
    columns = (
        *_CHANNEL,
        Column("speed_min", "least speed (Hz)", "Hz", "hz"),
        Column("speed_max", "highest speed (Hz)", "Hz", "hz"),
        Column("orders", "blocks in orders", "1", words=lambda value: f"{value:.0%}"),
        Column("refused", "blocks without an angle", "1", words=lambda value: f"{value:,}"),
    )
    return Table("speeds", "Speed of the shaft", columns, rows)


def laws(runs: Sequence[RunSummary]) -> Table | None:
    """Return the coefficients of the last fitted law of each channel (thesis, Table 22), or None without any."""
    rows = []
    for run in runs:
        for channel in run.channels:
            if len(channel.law) == 4:
                a, b, c, r_squared = channel.law
                # mm3/mm and hours read better than m2 and seconds.
                in_hours = (a * 1e6 * _PER_HOUR**2, b * 1e6 * _PER_HOUR, c * 1e6)
                rows.append((run.label, channel.name, *in_hours, a, b, c, r_squared))
    if not rows:
        return None
    columns = (
        *_CHANNEL,
        *(
            Column(f"{name}_per_hour", f"{name} (mm³/mm{unit})", "1", words=lambda value: f"{value:.3e}")
            for name, unit in (("a", "/h²"), ("b", "/h"), ("c", ""))
        ),
        Column("a", "a", "m2 s-2", "mm2_per_s2", 1e6, on_page=False),
        Column("b", "b", "m2 s-1", "mm2_per_s", 1e6, on_page=False),
        Column("c", "c", "m2", "mm2", 1e6, on_page=False),
        Column("r_squared", "R²", "1", words=lambda value: f"{value:.3f}"),
    )
    note = "V_eq = a τ² + b τ + c, τ the damage time since t_fs; the last fit before the threshold (thesis, Table 22)."
    return Table("laws", "Fitted laws", columns, rows, note)


def scores(runs: Sequence[RunSummary]) -> Table | None:
    """Return the scores of forecasts as issued, beside naive ones; None where no end is known."""
    rows: list[Sequence[Cell]] = []
    for run in runs:
        for scored in run.scores:
            end = _END_WORDS.get(str(scored["end_source"]), "")
            methods = {scored["method"] or "as issued": scored}
            methods |= {f"naive: {name}": scored["baselines"].get(name) for name in _BASELINES}
            for method, figures in methods.items():
                if figures is not None:
                    values = (figures.get(column.key) for column in _SCORES)
                    rows.append((run.label, scored["channel"], method, end, *values))
    if not rows:
        return None
    columns = (*(Column(name, name) for name in ("run", "channel", "method", "end")), *_SCORES)
    note = (
        "Each run by itself, at all moments between t_fs becoming known and the end. CRA: 1 is perfect. CRPS: mean "
        "error of the whole distribution. Where the end is that of the tracked V_eq, it is judged by its own values."
    )
    return Table("scores", "Forecasts as issued, scored", columns, rows, note)


def mean_scores(runs: Sequence[RunSummary]) -> Table | None:
    """Return means over runs with their standard errors, or None where fewer than two runs are scored."""
    scored = [dict(item) for run in runs for item in run.scores]
    if len({(item["records"], item["machine"]) for item in scored}) < 2:
        return None
    means = mean_of_runs(scored)
    rows = []
    for column in _SCORES:
        if column.key in means:
            values = means[column.key]
            shown = [column.shown(values[name]) for name in ("mean", "standard_error")]
            rows.append((column.key, values["mean"], values["standard_error"], *shown, values["runs"]))
    columns = (
        Column("figure", "figure"),
        Column("mean", "mean", "1", on_page=False),
        Column("standard_error", "standard error", "1", on_page=False),
        Column("mean_words", "mean over runs"),
        Column("error_words", "standard error"),
        Column("runs", "runs", "1"),
    )
    return Table("mean_scores", "Scores, mean over runs", columns, rows)


def overview(runs: Sequence[RunSummary]) -> Table:
    """Return one row per channel for files: state, part, since when, how large, how long left."""
    rows = [
        (
            *(run.label, channel.name, channel.grade, channel.headline, channel.where, channel.since),
            *(channel.level, channel.large, channel.left, channel.t_fs, channel.t_eol),
        )
        for run in runs
        for channel in run.channels
    ]
    texts = ("run", "channel", "state", "headline", "part", "since", "rms", "v_eq", "left")
    columns = (
        *(Column(name, name) for name in texts),
        Column("t_fs", "t_fs", "s", "s"),
        Column("t_eol", "t_EOL", "s", "s"),
    )
    return Table("overview", "All runs", columns, rows)
