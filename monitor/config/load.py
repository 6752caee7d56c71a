"""Load and validate config.toml."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pydantic import Field, ValidationError, model_validator

from models.machine.bearing import Bearing, CatalogueEntry
from models.machine.contact_estimates import estimate_stiffness
from models.machine.rig import Calibration, PosteriorError, Rig, RigDraws, RigParameters, read_posterior
from models.solve.nominal_rigs import nominal_rig
from models.solve.rotor.rig import RotorRig
from models.words.errors import WrongInputError
from models.words.extras import load
from monitor.config.alarms import AdviceSection, AlarmsSection
from monitor.config.bearing import RING_KEYS, STIFFNESS_KEYS, BearingSection, RigSection
from monitor.config.explain import explain_problems, find_loose_ends, further_problems, place_words
from monitor.config.fields import ConfigSection, LocatedError
from monitor.config.hints import syntax_problems
from monitor.config.interference import InterferenceSection
from monitor.config.machine import MachineSection, OperatingSection, RetentionSection
from monitor.config.outputs import NotifySection, PublishSection, WebSection
from monitor.config.positions import Place, find_lines, line_of
from monitor.config.shaft import SCENE_KEYS, ShaftSection
from monitor.config.source import ChannelSection, SourceSection
from monitor.config.stages import DetectSection, ForecastSection, TrackSection


def files_of(config: Config) -> list[Path]:
    """Return maps and libraries of tracked channels and the library of the forecast, each once."""
    found: dict[Path, None] = {}
    for channel in config.channel:
        if channel.track:
            found |= dict.fromkeys((*channel.maps, *([] if channel.library is None else [channel.library])))
    if config.forecast.library is not None:
        found[config.forecast.library] = None
    return [*found]


_CONNECTED: Any = {
    "bearing": {"__all__": {"name"}},
    "source": {"__all__": {"name"}},
    "channel": {"__all__": {"name", "source", "bearing"}},
    "rig": {"bearing"},
    "shaft": {"second_bearing"},
}
"""The names by which sections refer to each other."""


class ConfigError(WrongInputError):
    """The configuration cannot be used; the message names the file, the key, what was found and what is allowed."""


_VELOCITY = {"alert_mm_s", "danger_mm_s"}


if TYPE_CHECKING:
    from monitor.config.interference import TrainSection as _Gear
else:
    _Gear = load("sections", "gear")


class Config(ConfigSection):
    """A whole configuration, one machine."""

    machine: MachineSection = MachineSection()
    bearing: tuple[BearingSection, ...] = Field(min_length=1)
    rig: RigSection = RigSection()
    shaft: ShaftSection = ShaftSection()
    operating: OperatingSection = OperatingSection()
    source: tuple[SourceSection, ...] = Field(min_length=1)
    channel: tuple[ChannelSection, ...] = Field(min_length=1)
    gear: _Gear | None = None
    interference: tuple[InterferenceSection, ...] = ()
    detect: DetectSection = DetectSection()
    track: TrackSection = TrackSection()
    forecast: ForecastSection = ForecastSection()
    publish: PublishSection = PublishSection()
    retention: RetentionSection = RetentionSection()
    alarms: AlarmsSection = AlarmsSection()
    advice: AdviceSection = AdviceSection()
    notify: NotifySection = NotifySection()
    web: WebSection = WebSection()

    @model_validator(mode="after")
    def _connected(self) -> Self:
        problems = list(find_loose_ends(self.model_dump(include=_CONNECTED)))
        if problems:
            raise LocatedError(problems)
        rates = {source.name: source.rate_hz for source in self.source}
        for index, channel in enumerate(self.channel):
            rate = rates[channel.source]
            reason = None if rate is None else channel.beyond_rate(rate)
            if reason is not None:
                problems.append((("channel", index, reason[0]), reason[1]))
        if problems:
            raise LocatedError(problems)
        self.alarms.check_channels(tuple(channel.name for channel in self.channel))
        return self

    def bearing_of(self, channel: ChannelSection) -> Bearing:
        """Return the geometry of the bearing of a channel."""
        return self.entry_of(channel).bearing

    def entry_of(self, channel: ChannelSection) -> CatalogueEntry:
        """Return the geometry of the bearing of a channel with the origins of its values."""
        return next(bearing.to_entry() for bearing in self.bearing if bearing.name == channel.bearing)

    def rig_of(self, entry: CatalogueEntry) -> Rig:
        """Return the parameters of the model for a bearing, configured or not.

        Raises:
            ValueError: the geometry of the bearing does not give its contact stiffness.
        """
        return self.rig.to_rig(entry, own=self.owns_rig(entry))

    @property
    def second_bearing(self) -> CatalogueEntry | None:
        """The bearing at the other support of ``[shaft]``, None where it is the same."""
        named = self.shaft.second_bearing
        return next((section.to_entry() for section in self.bearing if section.name == named), None)

    def parameters_of(self, kind: type[RigParameters], entry: CatalogueEntry) -> RigParameters:
        """Return the parameters of any model for a bearing: of ``[rig]`` or ``[shaft]``, else those of the model.

        Raises:
            ValueError: the geometry of the bearing does not give its contact stiffness, or a value is unusable.
        """
        if kind is Rig:
            return self.rig_of(entry)
        given = self.shaft.parameters_of(kind)
        if kind is RotorRig and self.second_bearing is not None:
            given["k_c_b"] = estimate_stiffness(self.second_bearing).value
        return nominal_rig(kind, entry, **given)

    def scene_values(self) -> dict[str, tuple[str, Any]]:
        """Return what ``[shaft]`` and ``[operating]`` add to a scene: by field of ``Scene``, key and SI value."""
        found: dict[str, tuple[str, Any]] = {
            name: (f"shaft.{SCENE_KEYS[name]}", value) for name, value in self.shaft.scene_values().items()
        }
        if self.operating.axial_load_newton:
            found["axial_load"] = ("operating.axial_load_newton", self.operating.axial_load_newton)
        if self.second_bearing is not None:
            found["second_bearing"] = ("shaft.second_bearing", self.second_bearing.bearing)
        return found

    def owns_rig(self, entry: CatalogueEntry) -> bool:
        """Return whether the contact stiffness of ``[rig]`` is that of a bearing."""
        return self.own_bearing.to_entry().bearing == entry.bearing

    def gives_contact_stiffness(self, entry: CatalogueEntry) -> bool:
        """Return whether ``[rig]`` states the contact stiffness of a bearing, and not only by its default."""
        return self.owns_rig(entry) and STIFFNESS_KEYS[entry.bearing.element] in self.rig.model_fields_set

    @property
    def own_bearing(self) -> BearingSection:
        """The bearing whose contact stiffness and mass of elements ``[rig]`` holds."""
        named = self.rig.bearing or self.bearing[0].name
        return next(section for section in self.bearing if section.name == named)

    def calibration_of(self, channel: ChannelSection) -> Calibration:
        """Return whether ``[rig]`` is calibrated for the bearing of a channel; an estimated stiffness is not."""
        return self.rig.claim if self.owns_rig(self.entry_of(channel)) else False

    def posterior_of(self, entry: CatalogueEntry) -> RigDraws | None:
        """Return the posterior of the identification of ``[rig]`` for a bearing, None where there is none.

        Raises:
            PosteriorError: its file cannot be used, was changed or is of another identification, or the numbers of
                ``[rig]`` are not those that were identified.
        """
        if self.rig.posterior is None or not self.owns_rig(entry):
            return None
        found = read_posterior(self.rig.posterior)
        rig = self.rig_of(entry)
        found.draws.check(rig)
        if different := found.differences(rig, self.own_bearing.clearance_um * 1e-6):
            raise PosteriorError(
                f"the numbers are not those of identification {found.identification[:16]}: {'; '.join(different)}. "
                "Take the identified ones, or remove calibrated, identification and posterior"
            )
        return found.draws

    @property
    def hash(self) -> str:
        """Digest of the settings on which records depend; it is stored with each record."""
        # The hash of the identification stands for the file of its posterior; a map names the shaft that it is of.
        left_out: dict[str, Any] = {
            "web": True,
            "notify": True,
            "advice": True,
            "publish": True,
            "retention": True,
            "shaft": True,
            "bearing": {"__all__": set(RING_KEYS)},
            "rig": {"posterior"},
            "operating": {"axial_load_newton", "opcua"},
        }
        if self.operating.opcua is not None:
            left_out["operating"] = {"axial_load_newton": True, "opcua": self.operating.opcua.ways}
        if not self.interference:
            left_out["interference"] = True
        left_out["gear"] = True if self.gear is None else self.gear.model_keys()
        if self.forecast.library is None:
            left_out["forecast"] = {"library"}
        # Keys that are newer than the hash, where they are not given: that of an older configuration stays.
        if self.machine.iso_class is None:
            left_out["machine"] = {"iso_class"}
        without = {
            at: _VELOCITY for at, level in enumerate(self.alarms.level) if not _VELOCITY & level.model_fields_set
        }
        if without:
            left_out["alarms"] = {"level": without}
        text = self.model_dump_json(exclude=left_out)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def load_config(path: Path) -> Config:
    """Read and validate a configuration file; relative paths in it are relative to it.

    Raises:
        ConfigError: with one line for each problem: the file, the line, the key, what was found and what is allowed.
    """
    text, values = read_toml(path)
    return validate(values, path, find_lines(text))


def read_toml(path: Path) -> tuple[str, dict[str, Any]]:
    """Return the text of a TOML file and its tables.

    Raises:
        ConfigError: it cannot be read or is not TOML, with one line for each problem.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise ConfigError(f"{path}:{line}: expected UTF-8, found byte 0x{error.object[error.start]:02x}") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError("\n".join(f"{path}:{line}" for line in syntax_problems(text, str(error)))) from None
    return text, values


def validate(values: dict[str, Any], path: Path, lines: Mapping[Place, int] | None = None) -> Config:
    """Validate the tables of a configuration read from ``path``.

    Args:
        lines: of the values in the file, as :func:`monitor.config.positions.find_lines` gives them.

    Raises:
        ConfigError: with one line for each problem.
    """
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        problems = [*explain_problems(error, Config), *further_problems(error, values, Config)]
        places = {place for place, _ in problems}
        loose = [(place, f"{place_words(place)}: {text}") for place, text in find_loose_ends(values)]
        problems += [problem for problem in loose if problem[0] not in places]
        raise ConfigError(sort_problems(problems, path, lines or {})) from None
    config = config.with_absolute_paths(path.resolve().parent)
    try:
        config.posterior_of(config.own_bearing.to_entry())
    except ValueError as error:
        raise ConfigError(
            sort_problems([(("rig", "posterior"), f"rig.posterior: {error}")], path, lines or {})
        ) from None
    return config


def sort_problems(problems: Sequence[tuple[Place, str]], path: Path, lines: Mapping[Place, int]) -> str:
    """Return one line for each problem, in the order of the file."""
    located = [(line_of(place, lines), text) for place, text in problems]
    located.sort(key=lambda pair: pair[0] or 0)
    return "\n".join(f"{path}: {text}" if line is None else f"{path}:{line}: {text}" for line, text in located)
