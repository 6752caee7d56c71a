"""``[rig] calibrated``: by an identification, by a person, or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from models.rigs.six_dof import Rig
from monitor.commands.check import find_problems
from monitor.config.load import Config, ConfigError, validate

HASH = "ab" * 32


def config(**rig: Any) -> Config:
    values: dict[str, Any] = {
        "bearing": [{"name": "a", "designation": "1205 ETN9"}, {"name": "b", "designation": "6205"}],
        "source": [{"name": "s"}],
        "channel": [{"name": name, "source": "s", "unit": "g", "bearing": name} for name in "ab"],
    }
    return validate(values | ({"rig": rig} if rig else {}), Path("m.toml"))


def rigs(found: Config) -> list[Rig]:
    return [found.rig_of(found.entry_of(channel)) for channel in found.channel]


def test_a_rig_is_not_calibrated_unless_it_is_said() -> None:
    for found in (config(), config(m_i_kg=2.0), config(m_i_kg=Rig.m_i, k_r_newton_per_m=Rig.k_r)):
        assert [rig.calibrated for rig in rigs(found)] == [False, False]
        assert [found.calibration_of(channel) for channel in found.channel] == [False, False]


@pytest.mark.parametrize("hash_", [HASH, f"sha256:{HASH}", HASH[:16]])
def test_an_identified_rig_carries_the_hash_of_its_identification(hash_: str) -> None:
    found = config(calibrated=True, identification=hash_)
    first, _ = rigs(found)
    assert (first.calibrated, first.identification) == (True, hash_)


@pytest.mark.parametrize("rig", [{"calibrated": "declared"}, {"calibrated": True, "identification": HASH}])
def test_the_contact_stiffness_of_another_bearing_is_an_estimate(rig: dict[str, Any]) -> None:
    found = config(**rig)
    assert [one.calibrated for one in rigs(found)] == [rig["calibrated"], False]
    assert [one.identification for one in rigs(found)] == [rig.get("identification", ""), ""]
    assert [found.calibration_of(channel) for channel in found.channel] == [rig["calibrated"], False]


def test_true_without_the_hash_of_an_identification_is_a_declaration() -> None:
    found = config(calibrated=True)
    assert rigs(found)[0].calibrated == "declared"
    assert found.calibration_of(found.channel[0]) == "declared"
    assert any("without identification" in problem for problem in find_problems(found))
    identified = config(calibrated=True, identification=HASH)
    assert not any("identification" in problem for problem in find_problems(identified))


@pytest.mark.parametrize(
    ("rig", "messages"),
    [
        ({"identification": HASH}, ("identification is the hash of calibrated = true",)),
        ({"identification": HASH, "calibrated": "declared"}, ("identification is the hash of calibrated = true",)),
        ({"calibrated": True, "identification": "by hand"}, ("rig.identification = 'by hand'",)),
        ({"calibrated": "yes"}, ("rig.calibrated = 'yes'", "'declared'")),
        ({"calibrated": 1}, ("rig.calibrated = 1", "'declared'")),
    ],
)
def test_a_claim_that_nothing_vouches_for_is_refused(rig: dict[str, Any], messages: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as refused:
        config(**rig)
    assert all(message in str(refused.value) for message in messages)
