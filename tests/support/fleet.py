"""Several machines in a folder."""

from __future__ import annotations

from pathlib import Path

from tests.support.daemons import machine_text


def add_machine(folder: Path, name: str, web: str | None = "enabled = false") -> Path:
    """Write the configuration of a machine with one source, its folders beside it; return the configuration."""
    home = folder / name
    (home / "in0").mkdir(parents=True)
    text = machine_text(home / "in0").replace(
        '[machine]\nname = "m"\n',
        f'[machine]\nname = "{name}"\nstate_dir = "{name}/state"\nrecords_dir = "{name}/records"\n',
    )
    section = "" if web is None else f"[web]\n{web}\n"
    path = folder / f"{name}.toml"
    path.write_text(text.replace("[web]\nenabled = false\n", section))
    return path
