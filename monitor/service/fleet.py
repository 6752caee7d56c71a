"""Many machines: one configuration a machine in one folder, and what must hold between them."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from monitor.config.load import Config, ConfigError, load_config
from monitor.config.web import WebSection


@dataclass(frozen=True)
class Machine:
    """One machine of several.

    Attributes:
        path: its configuration file.
        config: what the file says.
    """

    path: Path
    config: Config

    @property
    def name(self) -> str:
        """Its name, which no other machine of the folder has."""
        return self.config.machine.name

    @property
    def state_dir(self) -> Path:
        """Where its state is kept, which no other machine of the folder uses."""
        return self.config.machine.state_dir


@dataclass(frozen=True)
class Fleet:
    """The machines of a folder, by the name of their files, and the page that they share.

    Attributes:
        machines: at least one.
        web: the ``[web]`` section of those that have one, or its defaults.
    """

    machines: tuple[Machine, ...]
    web: WebSection

    @property
    def page_dir(self) -> Path:
        """Where the common page keeps what is its own: the state folder of the first machine."""
        return self.machines[0].state_dir


def load_fleet(folder: Path) -> Fleet:
    """Read every ``*.toml`` of a folder; each is a machine.

    Raises:
        ConfigError: with all problems: files that are not valid, machines of one name or with a common folder, and
            ``[web]`` sections that differ.
    """
    paths = sorted(path for path in folder.glob("*.toml") if not path.name.startswith("."))
    if not paths:
        raise ConfigError(f"{folder}: expected a configuration file or a folder of them; it holds no *.toml")
    machines, problems = [], []
    for path in paths:
        try:
            machines.append(Machine(path, load_config(path)))
        except ConfigError as error:
            problems.append(str(error))
    problems += _same_names(machines)
    problems += _same_folders(machines)
    sections = {machine.path: machine.config.web for machine in machines if _says_web(machine.path)}
    problems += _different_pages(sections)
    if problems:
        raise ConfigError("\n".join(problems))
    web = next(iter(sections.values()), machines[0].config.web)
    return Fleet(tuple(machines), web)


def _same_names(machines: Sequence[Machine]) -> Iterator[str]:
    first: dict[str, Path] = {}
    for machine in machines:
        other = first.setdefault(machine.name, machine.path)
        if other != machine.path:
            yield f"{machine.path}: machine.name: {machine.name!r} is the name of the machine of {other.name}, too"


def _same_folders(machines: Sequence[Machine]) -> Iterator[str]:
    """Yield what two machines would both write into: each has one state, one lock, and files of its own."""
    first: dict[Path, tuple[Path, str]] = {}
    for machine in machines:
        for key in ("state_dir", "records_dir"):
            folder = getattr(machine.config.machine, key).resolve()
            path, other = first.setdefault(folder, (machine.path, key))
            if path != machine.path:
                yield (
                    f"{machine.path}: machine.{key}: {folder} is {other} of {path.name}, too; "
                    "each machine needs folders of its own"
                )


def _says_web(path: Path) -> bool:
    """Tell whether a configuration, which is known to be valid, has a section of its own on the page."""
    return "web" in tomllib.loads(path.read_text(encoding="utf-8"))


def _different_pages(sections: Mapping[Path, WebSection]) -> Iterator[str]:
    if not sections:
        return
    (first, expected), *others = sections.items()
    for path, section in others:
        if section != expected:
            keys = [key for key in type(section).model_fields if getattr(section, key) != getattr(expected, key)]
            yield (
                f"{path}: web: {', '.join(keys)} differ from those of {first.name}; all machines of a folder share "
                "one page: say it in one file, or the same in each"
            )
