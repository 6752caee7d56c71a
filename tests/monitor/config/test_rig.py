"""``[rig] calibrated``: by an identification, by a person, or not at all."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from models.machine.rig import Rig
from monitor.config.bearing import RIG_KEYS, STIFFNESS_KEYS, RigSection, sealed
from monitor.config.load import Config, ConfigError, validate
from monitor.desk.judge.problems import find_problems

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
    assert any("without identification" in doubt.came for doubt in find_problems(found))
    identified = config(calibrated=True, identification=HASH)
    assert not any("identification" in doubt.came for doubt in find_problems(identified))


@pytest.mark.parametrize(
    ("rig", "messages"),
    [
        ({"identification": HASH}, ("identification is the hash of calibrated = true",)),
        ({"identification": HASH, "calibrated": "declared"}, ("identification is the hash of calibrated = true",)),
        (
            {"calibrated": True, "identification": "by hand"},
            ("rig.identification = 'by hand': expected the hash that identify writes",),
        ),
        ({"calibrated": "yes"}, ("rig.calibrated = 'yes': expected true, false or 'declared'",)),
        ({"calibrated": 1}, ("rig.calibrated = 1: expected true, false or 'declared'",)),
    ],
)
def test_a_claim_that_nothing_vouches_for_is_refused(rig: dict[str, Any], messages: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as refused:
        config(**rig)
    assert all(message in str(refused.value) for message in messages)


NUMBERS = {"m_i_kg": 1.2, "k_r_newton_per_m": 1.6123456789012e9, "c_i_newton_s_per_m": Rig.c_i}


def test_check_digits_hold_for_the_numbers_that_were_found() -> None:
    identification = sealed(HASH, NUMBERS)
    found = config(calibrated=True, identification=identification, **NUMBERS)
    assert rigs(found)[0].identification == HASH
    # Written with 12 digits, without a key that has its default, or with another one that has it.
    rounded = {key: float(f"{value:.12g}") for key, value in NUMBERS.items() if key != "c_i_newton_s_per_m"}
    config(calibrated=True, identification=identification, m_o_kg=Rig.m_o, **rounded)


@pytest.mark.parametrize("changed", [{"m_i_kg": 1.21}, {"m_i_kg": Rig.m_i}, {"beta_c_s": 1e-5}])
def test_numbers_that_were_changed_after_the_identification_are_refused(changed: dict[str, float]) -> None:
    rig = {**NUMBERS, **changed, "calibrated": True, "identification": sealed(HASH, NUMBERS)}
    with pytest.raises(
        ConfigError, match=r"m\.toml: rig: the numbers are not those of identification abababababababab"
    ):
        config(**rig)
    assert config(**rig | {"identification": HASH}).rig.claim is True


def test_check_names_the_numbers_that_a_calibrated_rig_leaves_to_the_default_bench(tmp_path: Path) -> None:
    (doubt,) = (one for one in find_problems(config(calibrated="declared", **NUMBERS)) if one.rule == "rig")
    assert (doubt.severity, doubt.key) == ("warning", "rig.calibrated")
    assert doubt.came.startswith('"declared", but m_o_kg, m_r_kg, m_b_kg, k_i_newton_per_m, k_c_newton_per_m15, c_r')
    assert not any(doubt.rule == "rig" for doubt in find_problems(config(**NUMBERS)))
    whole = config(calibrated="declared", **RigSection().numbers)
    assert not any(doubt.rule == "rig" for doubt in find_problems(whole))


def test_only_keys_of_the_file_count_as_given(tmp_path: Path) -> None:
    assert config(**NUMBERS).rig.model_fields_set == set(NUMBERS)
    # The mass of a roller follows from its geometry unless it is given.
    values: dict[str, Any] = {
        "bearing": [{"name": "a", "designation": "22207"}],
        "source": [{"name": "s"}],
        "channel": [{"name": "c", "source": "s", "unit": "g", "bearing": "a"}],
    }
    assert 5e-3 < rigs(validate(values, tmp_path / "m.toml"))[0].m_b < 20e-3
    assert rigs(validate({**values, "rig": {"m_b_kg": 0.01}}, tmp_path / "m.toml"))[0].m_b == 0.01


def test_every_parameter_of_the_model_has_a_key() -> None:
    parameters = {name for name, value in Rig().as_dict().items() if isinstance(value, float)}
    assert {*RIG_KEYS, "k_c"} == parameters
    assert {*RIG_KEYS.values(), *STIFFNESS_KEYS.values()} < set(RigSection.model_fields)
