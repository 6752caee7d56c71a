"""Load and validate config.toml."""

from __future__ import annotations

import difflib
import hashlib
import tomllib
from pathlib import Path
from typing import Any, Self, get_args

from pydantic import BaseModel, Field, ValidationError, model_validator

from models.bearing import Bearing, CatalogueEntry
from models.contact_estimates import estimate_stiffness
from models.errors import WrongInputError
from models.nominal_rigs import nominal_rig
from models.rigs import AnyRig
from models.rigs.draws import PosteriorError, RigDraws, read_posterior
from models.rigs.rotor import RotorRig
from models.rigs.six_dof import Calibration, Rig
from monitor.config.alarms import AlarmsSection
from monitor.config.bearing import BearingSection, RigSection
from monitor.config.fields import Section
from monitor.config.interference import InterferenceSection
from monitor.config.machine import MachineSection, OperatingSection, RetentionSection
from monitor.config.outputs import NotifySection, PublishSection, WebSection
from monitor.config.shaft import SCENE_KEYS, ShaftSection
from monitor.config.source import ChannelSection, SourceSection
from monitor.config.stages import DetectSection, ForecastSection, TrackSection


class ConfigError(WrongInputError):
    """The configuration cannot be used; the message names the file, the key, what was found and what is allowed."""


class Config(Section):
    """A whole configuration, one machine."""

    machine: MachineSection = MachineSection()
    bearing: tuple[BearingSection, ...] = Field(min_length=1)
    rig: RigSection = RigSection()
    shaft: ShaftSection = ShaftSection()
    operating: OperatingSection = OperatingSection()
    source: tuple[SourceSection, ...] = Field(min_length=1)
    channel: tuple[ChannelSection, ...] = Field(min_length=1)
    interference: tuple[InterferenceSection, ...] = ()
    detect: DetectSection = DetectSection()
    track: TrackSection = TrackSection()
    forecast: ForecastSection = ForecastSection()
    publish: PublishSection = PublishSection()
    retention: RetentionSection = RetentionSection()
    alarms: AlarmsSection = AlarmsSection()
    notify: NotifySection = NotifySection()
    web: WebSection = WebSection()

    @model_validator(mode="after")
    def _connected(self) -> Self:
        for key in ("bearing", "source", "channel"):
            names = [item.name for item in getattr(self, key)]
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"[[{key}]] name {twice[0]!r} is given twice")
        sources = {source.name: source for source in self.source}
        bearings = {bearing.name for bearing in self.bearing}
        for channel in self.channel:
            if channel.source not in sources:
                raise ValueError(
                    f"channel {channel.name!r}: source {channel.source!r} is not one of {', '.join(sorted(sources))}"
                )
            if channel.bearing not in bearings:
                raise ValueError(
                    f"channel {channel.name!r}: bearing {channel.bearing!r} is not one of {', '.join(sorted(bearings))}"
                )
            rate = sources[channel.source].rate_hz
            if rate is not None:
                channel.check_rate(rate)
        if self.rig.bearing is not None and self.rig.bearing not in bearings:
            raise ValueError(f"[rig] bearing {self.rig.bearing!r} is not one of {', '.join(sorted(bearings))}")
        if self.shaft.second_bearing is not None and self.shaft.second_bearing not in bearings:
            raise ValueError(
                f"[shaft] second_bearing {self.shaft.second_bearing!r} is not one of {', '.join(sorted(bearings))}"
            )
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

    def parameters_of(self, kind: type[AnyRig], entry: CatalogueEntry) -> AnyRig:
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
        left_out = {
            "web": True,
            "notify": True,
            "publish": True,
            "retention": True,
            "shaft": True,
            "rig": {"posterior"},
            "operating": {"axial_load_newton"},
        }
        if not self.interference:
            left_out["interference"] = True
        if self.forecast.library is None:
            left_out["forecast"] = {"library"}
        text = self.model_dump_json(exclude=left_out)
        return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def load_config(path: Path) -> Config:
    """Read and validate a configuration file; relative paths in it are relative to it.

    Raises:
        ConfigError: naming the file, the key, what was found and what is allowed.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: cannot be read: {error}") from None
    try:
        values = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from None
    return validate(values, path)


def validate(values: dict[str, Any], path: Path) -> Config:
    """Validate the tables of a configuration read from ``path``.

    Raises:
        ConfigError: with one line for each problem.
    """
    try:
        config = Config.model_validate(values)
    except ValidationError as error:
        raise ConfigError("\n".join(f"{path}: {line}" for line in _explain_all(error, Config))) from None
    config = config.with_absolute_paths(path.resolve().parent)
    try:
        config.posterior_of(config.own_bearing.to_entry())
    except ValueError as error:
        raise ConfigError(f"{path}: rig.posterior: {error}") from None
    return config


def _explain_all(error: ValidationError, root: type[BaseModel]) -> list[str]:
    """Return one line for each problem; "list too short" is left out if wrong entries of the list cause it."""
    problems = error.errors()
    return [
        _explain(problem, root)
        for problem in problems
        if problem["type"] != "too_short"
        or not any(other is not problem and other["loc"][: len(problem["loc"])] == problem["loc"] for other in problems)
    ]


def _explain(problem: Any, root: type[BaseModel]) -> str:
    """Return a line that names the key, the value found and the values allowed.

    ``problem`` is one of the errors of a pydantic ValidationError, ``root`` the model of the whole configuration.
    """
    location = ""
    for part in problem["loc"]:
        if isinstance(part, int):
            location += f"[{part}]"
        elif (
            "[" not in part and part not in {"bool", "float", "int", "str", "tuple"} and not part.startswith("literal")
        ):
            location += f".{part}" if location else part
    if problem["type"] == "extra_forbidden":
        known = _keys_at(problem["loc"][:-1], root)
        key = str(problem["loc"][-1])
        near = difflib.get_close_matches(key, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        return f"{location}: unknown key{hint} Allowed are {', '.join(sorted(known))}"
    message = problem["msg"].removeprefix("Value error, ")
    if problem["type"] == "missing":
        return f"{location}: is missing"
    if problem["type"] == "value_error" and isinstance(problem["input"], dict):
        name = problem["input"].get("name")
        who = f"{location} ({name})" if name and location else location or "configuration"
        return f"{who}: {message}"
    return f"{location} = {problem['input']!r}: {message}"


def _keys_at(location: tuple[int | str, ...], root: type[BaseModel]) -> list[str]:
    """Return the keys that the table at ``location`` may hold."""
    model = root
    for part in location:
        if isinstance(part, int) or part not in model.model_fields:
            continue
        annotation = model.model_fields[part].annotation
        candidates = [annotation, *get_args(annotation)]
        model = next((c for c in candidates if isinstance(c, type) and issubclass(c, BaseModel)), model)
    return list(model.model_fields)
