"""What the configuration has to state of a recording because its files do not."""

from __future__ import annotations

from streams.files.datasets import DataSet, FileFacts
from streams.types.samples import Samples
from streams.types.spec import SourceError, SourceSpec


def check_stated(spec: SourceSpec, data_set: DataSet, facts: FileFacts, samples: Samples | None) -> None:
    """Check that rate and units are stated, and only once.

    Args:
        spec: of the source.
        data_set: of its files.
        facts: stated by the path of the first file.
        samples: of the first file, where it was read.

    Raises:
        SourceError: rate or unit are missing, or the unit is another one.
    """
    where = f"[[source]] {spec.name}"
    states_rate = data_set.states_rate and (samples is None or samples.rate is not None)
    if facts.rate is None and not states_rate and spec.rate is None:
        raise SourceError(f"{where}: rate_hz is missing: neither the files nor {data_set.name} state a rate")
    states_unit = data_set.states_unit and (samples is None or any(unit is not None for unit in samples.units))
    if data_set.unit is None and not states_unit and not spec.channels:
        raise SourceError(f"{where}: a [[channel]] with its unit is missing: these files do not state one")
    for channel in spec.channels:
        stated = data_set.unit
        if stated is None and channel.unit is None and not states_unit:
            raise SourceError(f"[[channel]] {channel.name}: unit is missing: the files of {spec.name} state none")
        if channel.unit is not None and stated not in (None, "unknown", channel.unit):
            raise SourceError(
                f"[[channel]] {channel.name}: unit is {channel.unit!r}, but {data_set.name} is in {stated}"
            )
