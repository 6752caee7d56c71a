"""Replays of several recordings, each into a folder of its own, shared between workers."""

from __future__ import annotations

import json
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from models.work.redact import redact
from models.work.runner import SERIAL, Runner
from models.work.task import Failure, Work
from monitor import __version__
from monitor.commands.common import InputError
from monitor.commands.shared_folders import (
    Seen,
    SharedFolderError,
    check_config,
    check_mark,
    check_seen,
    config_digest,
    files_below,
    folder_names,
    input_digest,
    marked,
    raise_if_unseen,
    remove_leftovers,
    replaced,
    seen,
)
from monitor.config.load import ConfigError, load_config
from streams.files.groups import FilesBeside
from streams.files.remote import bare, expand, is_remote, local_source
from streams.types.spec import SourceError

MARKER = "replay.json"
"""File beside the store of a recording whose replay is complete: of what, and its summary."""
MEMORY = 400_000_000
"""Bytes that a replay with its page needs at most beside the program, measured."""
_KIND = re.compile(r"(dataset:[^:]*:|folder:)(.*)", re.DOTALL)


@dataclass(frozen=True)
class ReplayRecording:
    """One recording: the name of its folder, its URL as workers open it, and as it is shown, without credentials."""

    name: str
    url: str
    shown: str

    @property
    def path(self) -> Path | None:
        """File or folder of this machine, None for another source."""
        found = _KIND.fullmatch(self.url)
        path = Path(self.url if found is None else found[2])
        return path if path.is_absolute() and path.exists() else None


@dataclass(frozen=True)
class Replays:
    """What all replays share; paths are absolute.

    Attributes:
        limit: greatest number of blocks of each.
        report: whether each gets a page.
        resume: whether what stands under ``out`` is kept or continued.
        mark: of the caller in ``out``, for workers of other machines; "" without.
        configured: digest of the configuration with the files that it names.
        run: identity of the command: what it has put in place stands there, and is not replayed again.
    """

    config_path: Path
    out: Path
    limit: int | None = None
    report: bool = True
    resume: bool = False
    mark: str = ""
    configured: str = ""
    run: str = ""


@dataclass(frozen=True)
class ReplayTask:
    """A recording; ``expected``: what the caller sees of it, for workers of other machines."""

    recording: ReplayRecording
    expected: Seen | None = None


@dataclass(frozen=True)
class Replayed:
    """What a worker leaves in the store: the summary of a replay or why there is none, and no URL with a signature."""

    summary: Mapping[str, Any] | None
    error: str = ""


@dataclass(frozen=True)
class ReplayOutcome:
    """The summary of a replay, or why there is none; ``kept``: it was complete before."""

    recording: ReplayRecording
    summary: Mapping[str, Any] | None
    error: str = ""
    kept: bool = False


def find_recordings(paths: Sequence[str]) -> list[ReplayRecording]:
    """Return the recordings that paths, URLs and patterns of remote URLs name, with unique names, in their order.

    Raises:
        SourceError, RemoteError: a pattern fits nothing, or the storage cannot be listed.
    """
    urls = [url for path in paths for url in (expand(path) if is_remote(path) else [path])]
    names = folder_names(map(_last_part, urls), "recording")
    return [ReplayRecording(name, _absolute(url), bare(url)) for name, url in zip(names, urls, strict=True)]


def _last_part(url: str) -> str:
    if is_remote(url):
        return PurePosixPath(bare(url)).name
    if url.startswith("rig:"):
        return url
    path = Path(url)
    return path.name if path.is_dir() else path.name.partition(".")[0]


def _absolute(url: str) -> str:
    """Return the URL of a source without a path relative to the working directory of this process."""
    found = _KIND.fullmatch(url)
    kind, path = ("", url) if found is None else (found[1], found[2])
    return url if is_remote(url) or not Path(path).exists() else kind + str(Path(path).absolute())


def replay_many(
    recordings: Sequence[ReplayRecording], replays: Replays, runner: Runner = SERIAL, *, elsewhere: bool = False
) -> list[ReplayOutcome]:
    """Replay recordings, each into its folder under ``replays.out``; one that fails does not stop the others.

    ``elsewhere``: workers are on other machines, so they check that they see the same folders.

    Raises:
        InputError: a folder is in use, and they are not resumed.
        ConfigError: the configuration or the output folder cannot be used.
        SharedFolderError: a worker sees other folders.
    """
    config = load_config(replays.config_path)
    replays = replace(replays, configured=config_digest(replays.config_path, config), run=secrets.token_hex(8))
    out = replays.out
    remove_leftovers(out, [recording.name for recording in recordings])
    if not replays.resume:
        _refuse_used(recordings, out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {out}: {error.strerror or error}") from None
    found = {each.name: kept for each in recordings if (kept := _kept(replays, each)) is not None}
    left = [
        ReplayTask(each, None if not elsewhere or each.path is None else seen(files_below(each.path)))
        for each in recordings
        if each.name not in found
    ]
    with marked(out, checked=elsewhere) as mark:
        for i, outcome in runner.outcomes(REPLAYS, replace(replays, mark=mark), left):
            recording = left[i].recording
            if isinstance(outcome, Failure):
                raise_if_unseen(outcome)
                found[recording.name] = ReplayOutcome(recording, None, outcome.message)
            else:
                found[recording.name] = ReplayOutcome(recording, outcome.summary, outcome.error)
    remove_leftovers(out, [recording.name for recording in recordings])
    return [found[recording.name] for recording in recordings]


def _refuse_used(recordings: Iterable[ReplayRecording], out: Path) -> None:
    for recording in recordings:
        if (out / recording.name).exists():
            raise InputError(f"--out {out}: has a folder {recording.name}; use --resume to go on, or another folder")


def replay_one(replays: Replays, task: ReplayTask) -> Replayed:
    """Replay one recording; an error of it or of its configuration becomes its outcome.

    Raises:
        SharedFolderError: this worker sees other folders, or another configuration, than the caller.
    """
    check_mark(replays.out, replays.mark)
    recording = task.recording
    if task.expected is not None:
        path = Path(_KIND.sub(r"\2", recording.url))
        check_seen(path, files_below(path), task.expected)
    try:
        return Replayed(_replay(replays, recording))
    except SharedFolderError:
        raise
    except (ConfigError, SourceError, InputError) as error:
        return Replayed(None, redact(" ".join(str(error).split())))


REPLAYS = Work("recordings", replay_one, memory=MEMORY)


def _replay(replays: Replays, recording: ReplayRecording) -> dict[str, Any]:
    """Replay into a folder of this machine that then takes its place under ``out``."""
    from monitor.commands.replay import write_report
    from monitor.service.replay import replay

    config = load_config(replays.config_path)
    check_config(replays.config_path, config, replays.configured)
    place = replays.out / recording.name
    if (before := _marker(place)).get("run") == replays.run:
        # The worker was lost after the folder was in its place.
        return before["summary"]
    digest = _digest(replays, recording)
    with replaced(place) as folder:
        resume = place.exists()
        if resume and not replays.resume:
            raise InputError(f"{place}: another command has made it meanwhile; use another --out")
        if resume:
            _check_same(place, recording, replays)
            shutil.copytree(place, folder, dirs_exist_ok=True)
        beside = FilesBeside(config.source[0].pulses, config.source[0].files)
        with local_source(recording.url, folder / "fetched", beside) as source:
            result = replay(config, source, folder, limit=replays.limit, resume=resume)
        if replays.report:
            write_report(result, folder / "report.html", f"{config.machine.name}: {recording.name}")
        files = [str(place / Path(file).relative_to(folder)) for file in result.summary["records"]]
        text = json.dumps(
            {
                "recording": recording.shown,
                "configured": replays.configured,
                "run": replays.run,
                "digest": digest,
                "summary": {**result.summary, "records": files},
            },
            allow_nan=False,
        )
        (folder / MARKER).write_text(text, encoding="utf-8")
    return json.loads(text)["summary"]


def _check_same(place: Path, recording: ReplayRecording, replays: Replays) -> None:
    """Refuse to continue the store of another recording, or one of another configuration."""
    before = _marker(place)
    found = before.get("recording", recording.shown)
    if found != recording.shown:
        raise InputError(f"{place}: holds the replay of {found}, expected {recording.shown}; use another --out")
    if before.get("configured", replays.configured) != replays.configured:
        raise InputError(
            f"{place}: was replayed with another configuration, or other maps or libraries; use another --out"
        )


def _marker(place: Path) -> dict[str, Any]:
    try:
        found = json.loads((place / MARKER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def _kept(replays: Replays, recording: ReplayRecording) -> ReplayOutcome | None:
    """Return the outcome of a replay that is complete and whose inputs are unchanged, else None."""
    place = replays.out / recording.name
    found = _marker(place) if replays.resume and (place / "state.db").is_file() else {}
    if not found or found.get("digest") is None or found.get("digest") != _digest(replays, recording):
        return None
    return ReplayOutcome(recording, found["summary"], kept=True)


def _digest(replays: Replays, recording: ReplayRecording) -> str | None:
    """Return a digest of the inputs of a replay; None where they may change without a trace, as what is fetched."""
    path = recording.path
    if path is None and not recording.url.startswith("rig:"):
        return None
    chosen = (__version__, replays.limit, replays.report, recording.shown, replays.configured)
    return input_digest(chosen, [], [] if path is None else files_below(path))


def values(outcomes: Sequence[ReplayOutcome], out: Path) -> dict[str, Any]:
    """Return what ``--json`` says of several recordings."""
    from monitor.service.replay import is_all_rejected

    rejected = [outcome.summary is not None and is_all_rejected(outcome.summary) for outcome in outcomes]
    return {
        "runs": [
            {
                "name": outcome.recording.name,
                "path": outcome.recording.shown,
                "out": str(out / outcome.recording.name),
                "kept": outcome.kept,
                "error": outcome.error or ("every block is rejected" if none else None),
                **(outcome.summary or {}),
            }
            for outcome, none in zip(outcomes, rejected, strict=True)
        ],
        "failed": sum(bool(outcome.error) or none for outcome, none in zip(outcomes, rejected, strict=True)),
        "kept": sum(outcome.kept for outcome in outcomes),
    }


def lines(answer: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines for people: one a recording."""
    for run in answer["runs"]:
        if "blocks" not in run:
            yield f"{run['name']}: failed: {run['error']}"
            continue
        grades = ", ".join(f"{name} {channel['stage']}" for name, channel in run["channels"].items())
        kept = ", kept" if run["kept"] else ""
        error = "" if run["error"] is None else f", {run['error']}"
        yield f"{run['name']}: {run['blocks']} blocks, {run['accepted']} accepted ({grades}){error}{kept}"
    yield f"{len(answer['runs']) - answer['failed']} of {len(answer['runs'])} recordings replayed"
