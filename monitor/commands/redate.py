"""``spallwatch redate``: choose anew what dates the later blocks of a source; ``check --keep`` keeps a choice."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import click

from monitor.commands import option
from monitor.commands.common import InputError, find_source, publish_change, read_config
from monitor.config.load import Config
from monitor.desk.judge.dating import DatingPreview


@click.command("redate")
@click.argument("source")
@option.config
@option.output
def command(source: str, config_path: Path | None) -> option.Result:
    """Choose anew what dates the blocks of SOURCE, by the configuration and its next file.

    Committed blocks keep their dates. The daemon must be stopped.
    """
    from monitor.records.ledger import keep_dating, read_dating
    from monitor.records.store import Store
    from streams.dates.dating import Dating

    config = read_config(config_path)
    find_source(config, source)
    with Store.open(config.machine.state_dir / "state.db", create=False) as store:
        values = read_dating(store, source)
        before = None if values is None else Dating.from_dict(values)
        keep_dating(store, source, Dating().to_dict())
        publish_change(store, config.machine.records_dir)
    was = "not dated by a choice" if before is None else f"dated {before.describe()}"
    lines = [f"source {source}: was {was}", "its next file decides, by the configuration (spallwatch check shows how)"]
    return {"source": source, "before": values, "after": None}, lines


def keep_previews(config: Config, previews: Mapping[str, DatingPreview]) -> dict[str, DatingPreview]:
    """Keep the choices that were previewed and are not kept yet; return the previews as they are now.

    Raises:
        InputError: the store is lost, and the daemon makes it again at its start.
        StoreError: the daemon runs, or the store cannot be written.
    """
    from monitor.records.filing import published_files
    from monitor.records.ledger import keep_dating
    from monitor.records.store import Store

    machine = config.machine
    path = machine.state_dir / "state.db"
    todo = {name: found.choice for name, found in previews.items() if found.choice is not None and not found.kept}
    if not todo:
        return dict(previews)
    if not path.exists() and published_files(machine.records_dir, machine.name):
        raise InputError(f"{path}: is missing beside published records; start the daemon, which makes it again")
    machine.state_dir.mkdir(parents=True, exist_ok=True)
    with Store.open(path, machine=machine.name) as store:
        for name, choice in todo.items():
            keep_dating(store, name, choice.to_dict())
    return {name: replace(found, kept=found.kept or name in todo) for name, found in previews.items()}
