"""An episode follows from its seed, its world and the actions alone: not from the episodes before it, nor from its row.

Every channel and every picture is compared bit for bit with those of an environment that has played nothing before.
"""

from __future__ import annotations

import numpy as np
import pytest

from vispeg.core.effect import REGISTRY, Effect, EffectInstance
from vispeg.core.seeds import stream
from vispeg.effects.appearance.distractors import KEEP_OUT
from vispeg.render.backends.backend import Renderer
from vispeg.render.backends.filament import unusable
from vispeg.render.look import dress
from vispeg.robots.scene import build
from vispeg.task.environments.vector import TaskVec
from vispeg.task.world_file import built_in, load_world
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.places import EACH
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.world import World

# of these seeds, a distractor of 9 would lie elsewhere if it kept away from where the fixture stood in 2
STEPS, BEFORE, SEED, BESIDE = 2, 2, 9, 11
CAMERAS = ("wrist_wide", "external")
SCENE = build()


def drawn(kind: Effect) -> RandomizedEffect:
    """The effect at every place, each parameter between null and a typical value; a seed from all its values."""
    params: dict[str, float | Uniform] = {}
    for name, p in kind.params.items():
        low, high = (p.low, p.high) if name == "seed" else sorted((p.absent if p.shape else p.null, p.start))
        params[name] = Uniform(low, high) if low < high else float(low)
    return RandomizedEffect(kind.name, EACH, params)


def acts(kind: Effect) -> bool:
    """Whether a task's episode can have the effect: there is a place for it, and it is none of a servo's loop alone."""
    return bool(kind.targets(SCENE)) and kind.channels() != {"servo", "load"}


EFFECTS = sorted((e for _, e in REGISTRY.items() if acts(e)), key=lambda e: (e.family, e.name))
GROUPS = [EFFECTS[i::8] for i in range(8)]  # of all families, so that what one moves is there for another to read
# the fixture moves far from episode to episode: what is placed by where it stood before is then placed otherwise
MOVES = RandomizedEffect("hole_offset", "fixture", {"x": Uniform(-0.1, 0.1), "y": Uniform(-0.2, 0.2)})


def play(env: TaskVec, row: int, seeds: list[int]) -> list[dict[str, np.ndarray]]:
    """What a row sees from the reset with these seeds on, under actions that follow from the row's seed."""
    obs, info = env.reset(seed=seeds)
    seen = [{**obs, "drawn": np.array([repr(w) for w in info["world"]])}]
    rng = stream(SEED, "actions")
    for _ in range(STEPS):
        action = rng.uniform(-1, 1, env.single_action_space.shape)
        obs, reward, *_ = env.step(np.tile(action, (env.num_envs, 1)))
        seen.append({**obs, "reward": reward})
    return [{key: value[row].copy() for key, value in moment.items()} for moment in seen]


def differ(world, **settings) -> list[str]:
    """Channels in which a used environment, alone or beside another row, leaves what a fresh one sees of SEED."""
    made = {"obs_mode": "rgbd", "privileged": True, "cameras": CAMERAS, "image_size": 24, "seed": 0, **settings}
    fresh, used, two = TaskVec(1, world, **made), TaskVec(1, world, **made), TaskVec(2, world, **made)
    try:
        right = play(fresh, 0, [SEED])
        before = play(used, 0, [BEFORE])
        assert any(not np.array_equal(a[k], b[k]) for a, b in zip(before, right, strict=True) for k in a)
        play(two, 1, [BEFORE, BESIDE])
        sides = {"after another": play(used, 0, [SEED]), "beside another": play(two, 1, [BESIDE, SEED])}
    finally:
        for env in (fresh, used, two):
            env.close()
    return [
        f"{side}, step {t}: {key}"
        for side, seen in sides.items()
        for t, (a, b) in enumerate(zip(seen, right, strict=True))
        for key in b
        if not np.array_equal(a[key], b[key])
    ]


def with_moves(*kinds: Effect) -> RandomizedWorld:
    return RandomizedWorld((MOVES, *(drawn(e) for e in kinds if e.name != MOVES.effect)))


@pytest.mark.parametrize("group", range(len(GROUPS)))
def test_no_effect_remembers_the_episode_before(group):
    assert differ(with_moves(*GROUPS[group])) == []


def test_a_load_of_the_episode_before_is_gone():
    """Half of the episodes carry a load, and what MuJoCo derives from it goes with it."""
    load = RandomizedEffect("payload", "flange", {"mass": 5.0}, chance=0.5)
    assert load.draw(BEFORE, "flange") and not load.draw(SEED, "flange")
    assert differ(RandomizedWorld((load,))) == []


@pytest.mark.slow
@pytest.mark.parametrize("kind", EFFECTS, ids=lambda e: e.name)
def test_no_effect_alone_remembers_the_episode_before(kind):
    assert differ(with_moves(kind)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", built_in())
def test_an_episode_of_a_shipped_world_is_its_seeds(name):
    if load_world(name).renderer.get("backend") == "filament" and unusable():
        pytest.skip("no Vulkan here")
    assert differ(name) == []


def test_distractors_keep_away_from_the_fixture_where_it_stands():
    rng = stream(SEED, "fixtures")
    with Renderer(SCENE, [], "raycast") as renderer:
        home = renderer.model.body(SCENE.fixture).pos.copy()
        for seed in range(40):
            dress(
                renderer,
                SCENE,
                World().add(EffectInstance.of("distractors", "scene", count=5, seed=seed)),
                {SCENE.fixture: home + [*rng.uniform(-0.15, 0.15, 2), 0]},
            )
            renderer.render()
            hole = renderer.data.site(SCENE.goal).xpos[:2]
            things = [renderer.model.geom(name).id for name in SCENE.parts["distractors"]]
            seen = [g for g in things if renderer.model.geom_rgba[g, 3] == 1]
            assert len(seen) >= 4
            assert np.linalg.norm(renderer.data.geom_xpos[seen, :2] - hole, axis=1).min() > KEEP_OUT
