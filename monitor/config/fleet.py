"""The machines of one folder, one configuration file each, and the conflicts between them."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from monitor.config.load import Config, ConfigError, load_config
from monitor.config.outputs import WebSection


@dataclass(frozen=True)
class MachineFile:
    """A configuration file and its content."""

    path: Path
    config: Config


@dataclass(frozen=True)
class MachineFleet:
    """The machines of a folder (at least one, by file name), their common page, and the problems of left-out files."""

    machines: tuple[MachineFile, ...]
    web: WebSection
    problems: tuple[str, ...] = ()

    @property
    def page_dir(self) -> Path:
        """Folder of the page's own files: the state folder of the first machine."""
        return self.machines[0].config.machine.state_dir


def load_fleet(folder: Path, *, strict: bool = True) -> MachineFleet:
    """Read every ``*.toml`` of a folder; files that are not valid are refused, or left out if not ``strict``.

    Raises:
        ConfigError: with all problems: no (valid) file; two machines with the same name, folder or listening address;
            ``[web]`` sections that differ.
    """
    paths = sorted(path for path in folder.glob("*.toml") if not path.name.startswith("."))
    if not paths:
        raise ConfigError(f"{folder}: expected a folder of configuration files; it holds no *.toml")
    machines: list[MachineFile] = []
    invalid: list[str] = []
    for path in paths:
        try:
            machines.append(MachineFile(path, load_config(path)))
        except ConfigError as error:
            invalid.append(str(error))
    conflicts = [*_shared(machines, _names), *_shared(machines, _folders), *_shared(machines, _listening)]
    sections = {machine.path: machine.config.web for machine in machines if _has_web_section(machine.path)}
    conflicts += _different_pages(sections)
    if conflicts or not machines or (strict and invalid):
        raise ConfigError("\n".join([*invalid, *conflicts]))
    web = next(iter(sections.values()), machines[0].config.web)
    return MachineFleet(tuple(machines), web, tuple(invalid))


def _names(config: Config) -> Iterator[tuple[str, str]]:
    yield "machine.name", config.machine.name


def _folders(config: Config) -> Iterator[tuple[str, str]]:
    """Yield the folders that the daemon of a machine writes to."""
    yield "machine.state_dir", str(config.machine.state_dir.resolve())
    yield "machine.records_dir", str(config.machine.records_dir.resolve())


def _listening(config: Config) -> Iterator[tuple[str, str]]:
    """Yield the addresses at which the sources of a machine listen."""
    for source in config.source:
        if source.url is not None and source.url.startswith("tcp://"):
            yield f"source.{source.name}.url", source.url


def _shared(machines: Sequence[MachineFile], values: Callable[[Config], Iterator[tuple[str, str]]]) -> Iterator[str]:
    """Yield a sentence for each value that a machine has in common with an earlier one."""
    first: dict[str, tuple[Path, str]] = {}
    for machine in machines:
        for key, value in values(machine.config):
            path, other = first.setdefault(value, (machine.path, key))
            if path != machine.path:
                yield f"{machine.path}: {key}: {value} is also {other} of {path.name}; expected one of its own"


def _has_web_section(path: Path) -> bool:
    return "web" in tomllib.loads(path.read_text(encoding="utf-8"))


def _different_pages(sections: Mapping[Path, WebSection]) -> Iterator[str]:
    if not sections:
        return
    (first, expected), *others = sections.items()
    for path, section in others:
        if section != expected:
            keys = [key for key in type(section).model_fields if getattr(section, key) != getattr(expected, key)]
            yield (
                f"{path}: web: {', '.join(keys)} differ from those of {first.name}; the machines of a folder have one "
                "page: give the section in one file, or the same in each"
            )
