"""Summaries of runs for comparison: small, and plain values for JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from monitor.report.figures.damage import thresholds_of
from monitor.report.figures.drawing import thin
from monitor.report.figures.map_path import hash_of
from monitor.report.readings import VolumeScale
from monitor.report.run_section import ChannelPart, RunPart
from monitor.report.runs import Channel, Run
from monitor.report.score import scoring
from monitor.report.score.forecasts import ScoreError, issued_of, running_time
from monitor.report.verdict import ChannelVerdict
from streams.types.block import STANDARD_GRAVITY

_BINS = 120
_SIZES = 200
VERSION = 3
"""Layout of a summary; another version is not read."""


@dataclass(frozen=True)
class ChannelSummary:
    """Summary of a channel; times are in seconds of its run, values SI, None for no value.

    Attributes:
        where, since, large, left: briefly, see :attr:`monitor.report.run_section.ChannelPart.briefly`.
        level, spark: as in :class:`monitor.report.run_section.ChannelPart`.
        last: time of the last block.
        rms_end: at the end of the final stage, None in an unknown unit.
        load, speed: last known.
        map_hash: of its maps, joined by "+"; "" for none.
        fault: the damaged part, "" for none named.
        law: a, b, c of the last fitted law and its R^2; empty for none.
        final: ``rms_g`` and ``v_eq_mm2`` (of an uncalibrated rig, ``v_eq_relative``) over the final stage, each
            {``time_s`` since t_fs, ``value``}.
        sizes: ``time_s`` since t_fs, ``dphi_d``, ``h_d`` of the tracker.
        thresholds: of V_eq.
        speeds: ``least``, ``highest`` (Hz), ``orders`` (share of the blocks with spectra in orders) and ``refused``
            (blocks without an angle); empty where no angle was sought.
    """

    name: str
    grade: str
    headline: str
    where: str
    since: str
    large: str
    left: str
    level: str
    spark: str
    t_fs: float | None
    t_eol: float | None
    last: float | None
    rms_end: float | None
    load: float | None
    speed: float | None
    map_hash: str
    fault: str
    law: tuple[float, ...]
    final: Mapping[str, Any]
    sizes: Mapping[str, Any]
    thresholds: tuple[float, ...]
    speeds: Mapping[str, Any]


@dataclass(frozen=True)
class RunSummary:
    """Summary of a run, its worst channel first; fields as in :class:`monitor.report.runs.Run`.

    Attributes:
        period: one sentence on its length.
        scores: see :func:`monitor.report.score.scoring.score_run`.
        link: of its page, relative to the index, or of its section.
    """

    label: str
    machine: str
    dated: bool
    period: str
    counts: Mapping[str, int]
    channels: tuple[ChannelSummary, ...]
    scores: tuple[Mapping[str, Any], ...]
    link: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"version": VERSION, **asdict(self)}

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> RunSummary:
        """Return the summary of :meth:`to_dict`.

        Raises:
            ValueError: another version.
        """
        if stored.get("version") != VERSION:
            raise ValueError(f"summary of a run: version {VERSION} expected, got {stored.get('version')!r}")
        values = {key: value for key, value in stored.items() if key != "version"}
        channels = tuple(
            ChannelSummary(**{**item, "law": tuple(item["law"]), "thresholds": tuple(item["thresholds"])})
            for item in values.pop("channels")
        )
        return cls(channels=channels, scores=tuple(values.pop("scores")), **values)


def summarise(run: Run, part: RunPart, link: str, *, scored: bool = True) -> RunSummary:
    """Return the summary of a run; ``scored``: with scores of forecasts whose end is known."""
    return RunSummary(
        label=run.label or run.machine,
        machine=run.machine,
        dated=run.dated,
        period=part.period,
        counts=dict(run.counts),
        channels=tuple(_channel(run, run.channels[item.verdict.channel], item) for item in part.channels),
        scores=tuple(_scores(run)) if scored else (),
        link=link,
    )


def _channel(run: Run, channel: Channel, part: ChannelPart) -> ChannelSummary:
    briefly, verdict = part.briefly, part.verdict
    start = math.nan if verdict.t_fs is None else verdict.t_fs.time
    return ChannelSummary(
        name=channel.name,
        grade=verdict.grade,
        headline=verdict.headline,
        where=briefly.get("Where?", ""),
        since=briefly.get("Since when?", ""),
        large=briefly.get("How large?", ""),
        left=briefly.get("How long left?", ""),
        level=part.level,
        spark=str(part.spark),
        t_fs=scoring.finite_or_none(start),
        t_eol=None if verdict.t_eol is None else scoring.finite_or_none(verdict.t_eol.time),
        last=scoring.finite_or_none(float(channel.time[-1])) if channel.time.size else None,
        rms_end=_rms_end(channel, verdict),
        load=_last(channel, "load"),
        speed=_last(channel, "speed"),
        map_hash=hash_of(run, channel.name),
        fault=verdict.fault,
        law=_law(channel),
        final=_final(run, channel, start),
        sizes=_sizes(channel, start),
        thresholds=tuple(thresholds_of(channel)),
        speeds=speeds_of(channel),
    )


def speeds_of(channel: Channel) -> dict[str, Any]:
    """Return the speeds of a channel and what its spectra are over, {} where no angle was sought."""
    sought = channel.word("rotation_status") != ""
    if not sought.any():
        return {}
    low, high = channel.column("speed_min"), channel.column("speed_max")
    known = bool(np.isfinite(low).any())
    return {
        "least": float(np.nanmin(low)) if known else None,
        "highest": float(np.nanmax(high)) if known else None,
        "orders": float(np.mean(channel.word("domain")[sought] == "order")),
        "refused": int(np.sum(channel.word("rotation_status")[sought] != "ok")),
    }


def _final(run: Run, channel: Channel, start: float) -> dict[str, Any]:
    """Return RMS and V_eq over damage time from t_fs, thinned for a figure."""
    if not math.isfinite(start) or channel.time.size < 2 or np.ptp(channel.time) == 0.0:
        return {}
    rows = channel.time >= start
    time = _since(channel, start)[rows]
    scale = VolumeScale.of(run, channel)
    columns = {"v_eq_mm2" if scale.absolute else "v_eq_relative": scale.scaled(channel.column("v_eq"))}
    if channel.has_level:
        columns = {"rms_g": channel.column("rms") * (1.0 / STANDARD_GRAVITY), **columns}
    found: dict[str, Any] = {}
    for name, values in columns.items():
        usable = np.isfinite(values[rows])
        if usable.sum() > 1:
            x, y = thin(time[usable], values[rows][usable], _BINS)
            found[name] = {"time_s": _rounded(x), "value": _rounded(y)}
    return found


def _since(channel: Channel, start: float) -> NDArray[np.float64]:
    """Return the damage time of each block from a moment on the axis of the run, s."""
    clock = running_time(channel)
    return clock - float(np.interp(start, channel.time, clock))


def _sizes(channel: Channel, start: float) -> dict[str, Any]:
    rows = np.flatnonzero(np.isfinite(channel.column("dphi_d")) & np.isfinite(channel.column("h_d")))
    if not rows.size or not math.isfinite(start):
        return {}
    rows = rows[np.unique(np.linspace(0, rows.size - 1, min(rows.size, _SIZES)).astype(int))]
    columns = {"time_s": _since(channel, start), **{name: channel.column(name) for name in ("dphi_d", "h_d")}}
    return {name: _rounded(values[rows]) for name, values in columns.items()}


def _law(channel: Channel) -> tuple[float, ...]:
    rows = channel.fitted_rows()
    if not rows.size:
        return ()
    r_squared = float(channel.column("r_squared")[rows[-1]])
    return (*channel.numbers["tt_coefficients"][rows[-1], :3].tolist(), r_squared if math.isfinite(r_squared) else 0.0)


def _rms_end(channel: Channel, verdict: ChannelVerdict) -> float | None:
    """Return the RMS at the end of life or at the last block; None without a final stage."""
    if verdict.t_fs is None or not channel.has_level:
        return None
    rms = channel.column("rms")
    until = verdict.t_eol.time if verdict.t_eol is not None else math.inf
    rows = np.flatnonzero(np.isfinite(rms) & (channel.time <= until))
    return float(rms[rows[-1]]) if rows.size else None


def _scores(run: Run) -> list[dict[str, Any]]:
    """Score the forecasts whose end is known: of a simulated rig, or where the tracked V_eq crossed."""
    try:
        issued = issued_of(run, run.label or run.machine)
    except ScoreError:
        return []
    found = []
    for one in issued:
        end = scoring.end_of(one, None, tracked=True)
        if end.source != "none":
            found.append(scoring.score_run(one, end))
    return found


def _last(channel: Channel, name: str) -> float | None:
    row = channel.last_row(name)
    return None if row is None else float(channel.column(name)[row])


def _rounded(values: NDArray[np.float64]) -> list[float]:
    return [float(f"{value:.6g}") for value in values.tolist()]
