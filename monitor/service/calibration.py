"""Whether V_eq of a channel is that of its machine, and what is said where it is not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from models.machine.rig import Calibration, Rig, RigParameters
from models.maps.data import RmsMap
from models.solve.registry import RIGS
from monitor.config.load import Config
from monitor.config.source import ChannelSection
from monitor.health.size.library.model import Library
from monitor.health.state import ChannelSettings
from monitor.words.calibration import uncalibrated_sentence
from monitor.words.statuses import suspended_words


def weakest_calibration(*found: Calibration) -> Calibration:
    """Return the weakest of several claims: false, then "declared", then true; true for none."""
    return False if False in found else "declared" if "declared" in found else True


def rig_of_library(library: Library) -> RigParameters | None:
    """Return the rig whose lives a library was made of, None for a library without simulated lives."""
    if "population" not in library.made_of:
        return None
    population = library.made_of["population"]
    return RIGS[population.get("model", Rig.model)](**population["rig"])


def is_calibrated(library: Library) -> bool:
    """Return whether the rig that a library is of is calibrated; one that does not name its rig is not."""
    rig = rig_of_library(library)
    return rig is not None and rig.calibrated is not False


def calibration_of(
    config: Config, channel: ChannelSection, maps: Iterable[RmsMap], library: Library | None
) -> Calibration:
    """Return the weakest claim of the configuration, maps and library: a map that was built uncalibrated stays so.

    The configuration claims in ``[rig]`` for the model of the casing, in ``[shaft]`` for the others.
    """
    rigs: list[RigParameters] = [rms_map.plan.rig for rms_map in maps]
    of_library = None if library is None else rig_of_library(library)
    if of_library is not None:
        rigs.append(of_library)
    claims: list[Calibration] = [rig.calibrated for rig in rigs]
    if not rigs or any(isinstance(rig, Rig) for rig in rigs):
        claims.append(config.calibration_of(channel))
    if not all(isinstance(rig, Rig) for rig in rigs):
        claims.append(config.shaft.calibrated)
    return weakest_calibration(*claims)


def uncalibrated_lines(config: Config, channels: Mapping[str, ChannelSettings]) -> Iterator[str]:
    """Yield a line for each channel of an uncalibrated rig that is tracked, and for each level that is suspended."""
    for section in config.channel:
        settings = channels.get(section.name)
        if settings is not None and settings.calibration is False:
            yield from channel_lines(config, section, settings.alarms.suspended, other_models(settings))


def other_models(settings: ChannelSettings) -> list[str]:
    """Return the models of the maps and the library of a channel, but that of the casing."""
    if settings.damage is None:
        return []
    models = {part_map.model for part_map in settings.damage.maps.values()}
    of_library = None if settings.damage.library is None else rig_of_library(settings.damage.library)
    if of_library is not None:
        models.add(of_library.model)
    return sorted(models - {Rig.model})


def channel_lines(
    config: Config, section: ChannelSection, suspended: Sequence[str] = (), models: Sequence[str] = ()
) -> Iterator[str]:
    """Yield the lines of one tracked channel of an uncalibrated rig, and of its ``suspended`` levels.

    ``models`` are those of its maps and its library, but that of the casing.
    """
    issued = config.forecast.uncalibrated_threshold
    yield f"channel {section.name!r}: {_reason(config, section, models, issued=issued)}"
    if suspended:
        yield f"channel {section.name!r}: {suspended_words(suspended)}; give a level on v_eq_relative"


def _reason(config: Config, section: ChannelSection, models: Sequence[str], *, issued: bool) -> str:
    if models and config.shaft.calibrated is False:
        return uncalibrated_sentence(f"[shaft] does not declare the parameters of {', '.join(models)}", issued=issued)
    if models:
        return uncalibrated_sentence("its map or library was built before [shaft] was declared", issued=issued)
    if config.calibration_of(section) is not False:
        return uncalibrated_sentence("its map or library was built before [rig] was calibrated", issued=issued)
    try:
        rig = config.rig_of(config.entry_of(section))
    except ValueError as error:
        return uncalibrated_sentence(str(error), issued=issued)
    if config.rig.claim is not False:
        return uncalibrated_sentence("[rig] is that of another bearing; see bearing in [rig]", issued=issued)
    return uncalibrated_sentence(rig, issued=issued)
