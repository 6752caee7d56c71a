"""What dates the blocks of a source of files, shown before its daemon starts."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from monitor.config.load import Config, ConfigError
from monitor.config.plausible.doubt import Doubt, Severity
from monitor.config.plausible.rules import NOTHING_STATED, JudgedConfig, SourceFacts, place_of
from monitor.config.source import SourceSection
from monitor.desk.judge.recordings import MAX_OPENED, look_at
from monitor.desk.judge.sections import TachoView, tacho_view

if TYPE_CHECKING:
    from streams.dates.dating import Dating
    from streams.files.container import Files
    from streams.types.block import Block
    from streams.types.spec import SourceSpec

_MAX_LAST = 20
"""Files at the end of the folder that it looks at besides."""


@dataclass(frozen=True)
class DatingPreview:
    """What would date the blocks of a watched folder: ``text`` in words, and the first block as an example.

    ``doubts`` are those of its files, ``facts`` what they state. ``levels`` says in words what states the level of each
    channel, ``ends`` what the first and the last file hold, ``choice`` is the choice as it would be kept, ``kept``
    whether it is; ``tacho`` is what the pulses of the first block show, ``ignored`` why which files are not read.
    """

    by: str | None
    text: str
    file: str | None = None
    time_utc: str | None = None
    elapsed_s: float | None = None
    doubts: tuple[Doubt, ...] = ()
    facts: SourceFacts = NOTHING_STATED
    levels: Mapping[str, str] = field(default_factory=dict)
    ends: tuple[str, ...] = ()
    choice: Dating | None = None
    kept: bool = False
    tacho: TachoView | None = None
    ignored: Mapping[str, str] = field(default_factory=dict)


def preview_dating(config: Config, section: SourceSection) -> DatingPreview | None:
    """Open waiting files of a folder, or those of a recording; None for other sources, and folders without files.

    Raises:
        ConfigError: the configuration contradicts the kept choice.
    """
    from monitor.service.setup import source_spec
    from streams.files.recognise import data_set_of
    from streams.recording.source import Recording
    from streams.types.spec import SourceError

    watched = section.url is not None and section.url.startswith("folder:")
    if section.url is None or not (watched or _is_path(section.url)):
        return None
    if watched and not Path(section.url.removeprefix("folder:")).exists():
        return None
    spec = source_spec(config, section)
    kept = _kept_dating(spec, config)
    said = partial(_doubt, config, section)
    try:
        paths, files, closed = _first_and_last_files(spec.name, section.url)
        locked = tuple(said("place", "warning", "folders that can be read", text) for text in closed)
        if not paths:
            return DatingPreview(None, "not known", doubts=locked) if closed else None
        recording = Recording(spec, files, data_set_of(spec, files, spec.format), kept)
        levels, view = recording.levels(), look_at(recording, config, section)
    except (SourceError, OSError) as error:
        if any(word in str(error) for word in ("date", "start_utc")):
            doubt = said("dating", "problem", "files that can be dated", f"nothing dates its blocks yet: {error}")
        else:
            doubt = said("file", "problem", "files that fit the configuration", f"no block comes of its files: {error}")
        return DatingPreview(None, "not known", doubts=(doubt,))
    choice = recording.dating
    by, text = (None, "by the data set") if choice is None else (choice.by, choice.describe())
    if choice is not None and len(paths) == 1 and choice.group is not None and choice.interval is None:
        # Its only file may still grow: the daemon sees its end, and with it the step.
        choice = replace(choice, step=None)
    remarks = tuple(said("dating", "warning", "one date for each block", remark) for remark in recording.remarks)
    named = any("do not fit those of the other files" in remark for remark in recording.remarks)
    found = DatingPreview(
        *(by, text),
        doubts=(*locked, *remarks, *(doubt for doubt in view.doubts if not (named and doubt.rule == "clock"))),
        facts=view.facts,
        levels=levels,
        ends=view.ends,
        choice=choice if watched else None,
        kept=kept is not None and kept.by is not None,
        ignored=recording.ignored(),
    )
    if view.first is not None:
        return _with_block(found, view.first, config, section)
    refused = view.refused
    if refused is None or any(refused.reason in doubt.came for doubt in found.doubts):
        return found
    came = f"no block comes of its first files: {refused.status}: {refused.reason}"
    return replace(found, doubts=(said("file", "problem", "files that fit the configuration", came), *found.doubts))


def _doubt(config: Config, section: SourceSection, rule: str, severity: Severity, expected: str, came: str) -> Doubt:
    """Return what is doubtful in the files of a source."""
    return JudgedConfig(config).doubt(rule, severity, place_of(config, "source", section.name, "url"), expected, came)


def _kept_dating(spec: SourceSpec, config: Config) -> Dating | None:
    from monitor.records.database import StoreError
    from streams.dates.dating import kept_dating
    from streams.types.spec import SourceError

    with ExitStack() as opened:
        ledger = _open_ledger(config.machine.state_dir / "state.db", opened)
        try:
            return None if ledger is None else kept_dating(spec, ledger)
        except SourceError as error:
            raise ConfigError(str(error)) from None
        except StoreError:
            # A damaged store, or one that no daemon has opened yet.
            return None


def _first_and_last_files(name: str, url: str) -> tuple[list[str], Files, tuple[str, ...]]:
    """Return names and files of a source, of a large folder the first and the last, and what is wrong with folders."""
    from streams.files.container import Folder, natural_key, open_files
    from streams.types.listing import CLOSED, list_files, shown

    root = Path(url.removeprefix("folder:"))
    if not (url.startswith("folder:") or root.is_dir()):
        return [root.name], open_files(name, str(root)), ()
    folders: list[str] = []
    paths = sorted(list_files(str(root), folders), key=natural_key)
    paths = paths[:MAX_OPENED] + paths[MAX_OPENED:][-_MAX_LAST:]
    closed = tuple(f"folder {shown(str(root / folder))} {CLOSED}" for folder in sorted(folders))
    return paths, Folder(root, paths), closed


def _with_block(found: DatingPreview, first: Block, config: Config, section: SourceSection) -> DatingPreview:
    """Return a preview with its first block as the example."""
    tacho = tacho_view(first, config, section)
    found_doubts = list(found.doubts)
    if first.start is None and not any(doubt.rule in ("dating", "file") for doubt in found.doubts):
        came = "nothing dates its blocks; give start_utc"
        found_doubts.append(_doubt(config, section, "dating", "warning", "a date", came))
    if tacho is not None and tacho.status != "ok":
        came = f"its tacho gives no angle in {tacho.file} ({tacho.pulses} pulses): rotation_status {tacho.status}"
        found_doubts.append(_doubt(config, section, "tacho", "problem", "pulses that give the angle", came))
    time = None if first.start is None else _utc_text(first.start)
    return replace(
        found, tacho=tacho, file=first.name, time_utc=time, elapsed_s=first.elapsed, doubts=tuple(found_doubts)
    )


def _is_path(url: str) -> bool:
    """Return whether a URL is the path of a recording that is there."""
    kind, colon, _ = url.partition(":")
    if "://" in url or (colon and kind in ("rig", "dataset", "tcp", "mqtt")):
        return False
    return Path(url).exists()


def _utc_text(seconds: float) -> str:
    from streams.types.stamps import utc_text

    return utc_text(seconds)


def _open_ledger(database: Path, opened: ExitStack) -> Any:
    """Return the ledger of a store, None where there is none yet."""
    from monitor.records.database import StoreError
    from monitor.records.ledger import StoreLedger
    from monitor.records.store import Store

    if not database.exists():
        return None
    try:
        return opened.enter_context(StoreLedger(opened.enter_context(Store.open(database, read_only=True))))
    except StoreError:
        return None
