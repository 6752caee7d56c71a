"""Forecasts as issued, read for scoring from records or from the archive in the store."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from monitor.health.schema import REJECTIONS
from monitor.records.archive import Archived, of_channel
from monitor.records.database import StoreError
from monitor.records.histories import damage_time
from monitor.records.store import Store
from monitor.report.runs import Channel, ReportError, Run, read_runs

Floats = NDArray[np.float64]

_SILENT = ("", "not_final_stage")
_OUT_OF_TIME = {"late", "out_of_order", "clock"}
_SAME_THRESHOLD = 1e-6
_MIN_LOWER_S = 1.0


class ScoreError(ReportError):
    """Records cannot be scored; the message names the file, the option, what was expected and what came."""


@dataclass(frozen=True, eq=False)
class Issued:
    """The forecasts of one channel for one threshold at n blocks of the final stage, with what scoring needs.

    Damage time is time without standstill, s.

    Attributes:
        records: path or name of the records.
        dated: whether ``time`` is UTC seconds since 1970 rather than seconds from the first block.
        threshold: V_th, m2.
        method: "" if not recorded.
        interval: probability of the interval, None for single numbers.
        source: "archive" or "records".
        time, clock: s and damage time, shape (n,).
        status: as in ``TT_STATUSES``, shape (n,).
        levels: of the quantiles, shape (q,).
        quantiles: time to threshold in damage time, shape (n, q), NaN for no answer.
        v_eq, v_eq_lower, v_eq_upper: as tracked with its interval, m2, shape (n,).
        v_eq_true: of a simulated rig, m2, shape (n,), else NaN.
        onset: damage time of t_fs.
        alarms: times at which a final stage was detected, on the axis of ``time``.
        judged: times of the blocks that the detector judged.
        damaged: first time of true damage on a simulated rig that was recorded without damage too, else NaN.
        end_true: damage time of the true end of a simulated rig, else NaN.
        all_time, all_clock: time and damage time of every block of the channel.
    """

    records: str
    machine: str
    channel: str
    dated: bool
    threshold: float
    method: str
    interval: float | None
    source: str
    time: Floats
    clock: Floats
    status: NDArray[np.str_]
    levels: Floats
    quantiles: Floats
    v_eq: Floats
    v_eq_lower: Floats
    v_eq_upper: Floats
    v_eq_true: Floats
    onset: float
    alarms: Floats
    judged: Floats
    damaged: float
    end_true: float
    all_time: Floats
    all_clock: Floats

    def to_clock(self, time: float) -> float:
        """Return the damage time at a time; after the last block the machine is assumed to run."""
        if time > self.all_time[-1]:
            return float(self.all_clock[-1] + time - self.all_time[-1])
        return float(np.interp(time, self.all_time, self.all_clock))

    def to_time(self, clock: float) -> float:
        """Return the first time at which a damage time was reached."""
        if clock > self.all_clock[-1]:
            return float(self.all_time[-1] + clock - self.all_clock[-1])
        place = int(np.searchsorted(self.all_clock, clock))
        if place == 0:
            return float(self.all_time[0])
        return float(self.all_time[place] - (self.all_clock[place] - clock))


def read_issued(path: Path, threshold: float | None = None) -> list[Issued]:
    """Read the forecasts of all channels that have any for a threshold (m2), None where the records have only one.

    ``path`` is a ``.nc`` file, a ``state.db``, which has more quantiles than records, or a folder.

    Raises:
        ScoreError: nothing to score, or the threshold is not among those that were forecast.
        ReportError: the file cannot be read.
    """
    archive = _archive(path)
    found = [
        _issued(path, run, channel, _threshold_place(path, channel, threshold), archive)
        for run in read_runs(path)
        for channel in _forecast_channels(run)
    ]
    if not found:
        raise ScoreError(f"{path}: no channel has a forecast, so there is nothing to score")
    return found


def issued_of(run: Run, label: str) -> list[Issued]:
    """Return the forecasts in the records of a run for the first threshold of each channel.

    Raises:
        ScoreError: the records do not name the level of their intervals.
    """
    known = [channel for channel in _forecast_channels(run) if channel.last_row("v_th") is not None]
    return [_issued(Path(label), run, channel, 0, {}) for channel in known]


def _forecast_channels(run: Run) -> list[Channel]:
    """Return the channels with a forecast or its refusal after the onset."""
    return [channel for channel in run.channels.values() if not _is_silent(channel).all()]


def _is_silent(channel: Channel) -> NDArray[np.bool_]:
    """Return which forecasts were not due, shape (block, threshold), or withheld as the rig is not calibrated."""
    status = channel.words["tt_status"].astype(str)
    withheld = (status == "uncalibrated") & ~np.isfinite(channel.numbers["tt"][:, : status.shape[1]])
    return np.isin(status, _SILENT) | withheld


def _archive(path: Path) -> dict[tuple[str, int, str], list[Archived]]:
    """Return the archived forecasts by source, block and channel; empty without a store."""
    database = path / "state.db" if path.is_dir() else path
    if database.suffix == ".nc" or not database.exists():
        return {}
    rows: dict[tuple[str, int, str], list[Archived]] = {}
    try:
        with Store.open(database, read_only=True) as store:
            for row in store.forecasts():
                rows.setdefault((row.source, row.block, row.channel or ""), []).append(row)
    except StoreError as error:
        raise ScoreError(str(error)) from None
    return rows


def _threshold_place(path: Path, channel: Channel, threshold: float | None) -> int:
    known = [
        float(column[np.isfinite(column)][-1]) for column in channel.numbers["v_th"].T if np.isfinite(column).any()
    ]
    if threshold is None and len(known) == 1:
        return 0
    for place, value in enumerate(known):
        if threshold is not None and math.isclose(value, threshold, rel_tol=_SAME_THRESHOLD):
            return place
    forecast = f"channel {channel.name!r} was forecast for {', '.join(f'{value * 1e6:g}' for value in known)} mm3/mm"
    if threshold is None:
        raise ScoreError(f"{path}: {forecast}; say which: --threshold-mm2")
    raise ScoreError(f"{path}: --threshold-mm2 {threshold * 1e6:g}: {forecast}")


def _issued(
    path: Path, run: Run, channel: Channel, place: int, archive: Mapping[tuple[str, int, str], list[Archived]]
) -> Issued:
    status = channel.words["tt_status"][:, place]
    v_th = channel.column("v_th", place)
    threshold = float(v_th[np.isfinite(v_th)][-1])
    # Without forecasts for a threshold that was configured earlier.
    rows = np.flatnonzero(~_is_silent(channel)[:, place] & np.isclose(v_th, threshold, rtol=_SAME_THRESHOLD, atol=0))
    rows = rows[_of_last_stage(channel, rows)]
    archived = _matching(archive, run, channel, rows, threshold)
    if archived is None:
        interval, levels, quantiles = _from_records(path, run, channel, place, rows)
        method, source = of_channel(run.attributes.get("forecast_method"), channel.name) or "", "records"
    else:
        interval, levels, quantiles = _from_archive(archived)
        method, source = "; ".join(dict.fromkeys(row.method for row in archived if row.method)), "archive"
    clock = running_time(channel)
    truth, left = channel.column("v_eq_true"), channel.numbers["tt_true"]
    left = left[:, min(place, left.shape[1] - 1)]
    ahead = np.flatnonzero(left > 0)
    sound = np.flatnonzero(truth == 0)
    damaged = np.flatnonzero(truth > 0) if sound.size else sound
    onset = channel.column("t_fs")[rows]
    begun = onset[np.isfinite(onset)]
    known = channel.column("t_fs_known")
    return Issued(
        records=str(path),
        machine=run.machine,
        channel=channel.name,
        dated=run.dated,
        threshold=threshold,
        method=method,
        interval=interval,
        source=source,
        time=channel.time[rows],
        clock=clock[rows],
        status=status[rows].astype(np.str_),
        levels=levels,
        quantiles=quantiles,
        v_eq=channel.column("v_eq")[rows],
        v_eq_lower=channel.column("v_eq_lower")[rows],
        v_eq_upper=channel.column("v_eq_upper")[rows],
        v_eq_true=truth[rows],
        onset=float(np.interp(begun[0], channel.time, clock)) if begun.size else float(clock[rows[0]]),
        alarms=np.unique(known[np.isfinite(known)]),
        judged=channel.time[np.isfinite(channel.column("detect_score"))],
        damaged=float(channel.time[damaged[0]]) if damaged.size else math.nan,
        end_true=float(clock[ahead[0]] + left[ahead[0]]) if ahead.size else math.nan,
        all_time=channel.time,
        all_clock=clock,
    )


def _of_last_stage(channel: Channel, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which rows are of the latest final stage: forecasts of one that closed again are void."""
    for name in ("t_fs", "t_fs_block"):
        begun = channel.column(name)[rows]
        known = begun[np.isfinite(begun)]
        if known.size:
            return begun == known[-1]
    return np.ones(rows.size, dtype=bool)


def running_time(channel: Channel) -> Floats:
    """Return the damage time of each block, s from the first: the time between blocks without standstill."""
    flags = [set(str(text).split("|")) for text in channel.word("quality_flags")]
    judged = channel.word("quality_status").astype(str)
    counted = (judged != "") & ~np.isin(judged, REJECTIONS) & np.array([not f & _OUT_OF_TIME for f in flags])
    stopped = np.array(["stopped" in f for f in flags], dtype=bool)
    return damage_time(channel.time, stopped, counted)


def _matching(
    archive: Mapping[tuple[str, int, str], list[Archived]],
    run: Run,
    channel: Channel,
    rows: NDArray[np.intp],
    threshold: float,
) -> list[Archived] | None:
    """Return the archived forecast of each row, None if one is missing."""
    sources = dict.fromkeys(str(source) for source in run.ledger["source"])
    found: list[Archived] = []
    for row in rows:
        block = int(channel.sequence[row])
        issued = (item for source in sources for item in archive.get((source, block, channel.name), ()))
        same = [
            item for item in issued if math.isclose(item.threshold_mm2 or 0.0, threshold * 1e6, rel_tol=_SAME_THRESHOLD)
        ]
        if not same:
            return None
        found.append(same[0])
    return found


def _from_archive(archived: Sequence[Archived]) -> tuple[float | None, Floats, Floats]:
    """Return the level of the interval, the levels, and the quantiles at them."""
    levels = sorted({level for row in archived for level in row.quantiles} or {0.5})
    rows = [_at_levels(row.quantiles, levels) for row in archived]
    intervals = [row.interval_level for row in archived if row.interval_level is not None]
    return (intervals[-1] if intervals else None), np.array(levels), np.array(rows).reshape(-1, len(levels))


def _at_levels(quantiles: Mapping[float, float], levels: Iterable[float]) -> list[float]:
    """Return quantiles at all levels, by linear interpolation where a forecast has fewer."""
    known = sorted(quantiles)
    if not known:
        return [math.nan for _ in levels]
    return np.interp(list(levels), known, [quantiles[level] for level in known]).tolist()


def _from_records(
    path: Path, run: Run, channel: Channel, place: int, rows: NDArray[np.intp]
) -> tuple[float | None, Floats, Floats]:
    """Return the level of the interval, the levels, and the quantiles at them."""
    middle, lower, upper = (channel.column(name, place)[rows] for name in ("tt", "tt_lower", "tt_upper"))
    if not np.isfinite(lower).any():
        return None, np.array([0.5]), middle[:, np.newaxis]
    found = of_channel(run.attributes.get("interval_level"), channel.name) or ""
    try:
        interval = float(found)
    except ValueError:
        interval = math.nan
    if not 0.0 < interval < 1.0:
        raise ScoreError(
            f"{path}: attribute interval_level must be the probability of the intervals, such as 0.8, found {found!r}"
        )
    points = np.isfinite(middle) & ~np.isfinite(lower)
    lower, upper = np.where(points, middle, lower), np.where(points, middle, upper)
    # An open upper end is taken as far above the median as the lower end is below, in ratio.
    open_ended = np.isfinite(lower) & ~np.isfinite(upper)
    upper = np.where(open_ended, middle**2 / np.maximum(lower, _MIN_LOWER_S), upper)
    tail = round((1.0 - interval) / 2.0, 12)
    return interval, np.array([tail, 0.5, 1.0 - tail]), np.stack([lower, middle, upper], axis=1)
