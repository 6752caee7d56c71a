"""The fourth set of scenes is fixed, shares none with the others, and holds what it is said to hold."""

from __future__ import annotations

import hashlib
import json
import math
from itertools import pairwise

import pytest

from reference.periodic.fourth import ELEMENTS, KINDS, MAX_RESONANCE, SETS, fourth_scenes
from reference.periodic.judge import engine_scene
from reference.periodic.rig import OracleScene, from_dict
from reference.periodic.scenes import SEEDS, scenes

DRAWN = {name: fourth_scenes(seed, count) for name, (seed, count) in SETS.items()}
DIGESTS = {"development": "3519583be367e188", "held_out": "1d193fe2fe2cdbcd"}


def test_the_sets_are_fixed_and_disjoint() -> None:
    keys = {name: [scene.key() for scene in drawn] for name, drawn in DRAWN.items()}
    assert {name: hashlib.sha256("".join(those).encode()).hexdigest()[:16] for name, those in keys.items()} == DIGESTS
    others = {scene.key() for seed in SEEDS.values() for scene in scenes(seed, 60)}
    assert len({*keys["development"], *keys["held_out"], *others}) == 460 + 60 * len(SEEDS)
    assert not {seed for seed, _ in SETS.values()} & set(SEEDS.values())
    seed, _ = SETS["held_out"]
    assert [scene.key() for scene in fourth_scenes(seed, 12)] == keys["held_out"][:12]


def test_every_twelve_scenes_have_each_kind_with_balls_and_with_rollers() -> None:
    for drawn in DRAWN.values():
        for start in range(0, len(drawn) - 11, 12):
            found = {(scene.kind, scene.geometry.element) for scene in drawn[start : start + 12]}
            assert found == {(kind, element) for kind in KINDS for element in ELEMENTS}


@pytest.mark.parametrize("name", list(SETS))
def test_both_can_describe_them(name: str) -> None:
    for scene in DRAWN[name]:
        assert scene.highest_resonance() * scene.period <= MAX_RESONANCE
        assert from_dict(json.loads(json.dumps(scene.as_dict()))) == scene
        same = engine_scene(scene)
        assert same.repeats
        assert (len(same.defects), len(same.waviness)) == (len(scene.pits), len(scene.waves))


def reach(scene: OracleScene) -> float:
    """Return the angle that half a rolling element takes on the outer race, rad."""
    return math.asin(scene.geometry.element_radius / scene.geometry.outer_race_radius)


def test_a_kind_is_what_it_is_called() -> None:
    by_kind = {kind: [scene for scene in DRAWN["held_out"] if scene.kind == kind] for kind in KINDS}
    assert all(0.0 < scene.extent <= reach(scene) for scene in by_kind["pit"])
    for scene in by_kind["edge"]:
        edges = (scene.position - 0.5 * scene.extent, scene.position + 0.5 * scene.extent)
        assert min(abs(edge) for edge in edges) <= math.radians(15.0)
    assert all(scene.clearance >= 2e-6 and scene.load <= 300.0 for scene in by_kind["light"])
    for scene in by_kind["several"]:
        placed = sorted(scene.pits, key=lambda pit: pit.position)
        assert len(placed) > 1
        assert all(b.position - a.position > 0.5 * (a.extent + b.extent) for a, b in pairwise(placed))
    assert all(scene.waves for scene in by_kind["wavy"])
    assert {bool(scene.pits) for scene in by_kind["wavy"]} == {True, False}
    assert {scene.rough is None for scene in by_kind["edge"]} == {True, False}
