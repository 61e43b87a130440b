"""An episode that begins as a trial began: the same joints, goal, belief and effects give the same episode."""

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.task.environments.vector import TaskVec
from vispeg.task.start import Start


def episode(env: TaskVec, **reset) -> tuple[np.ndarray, list]:
    obs, info = env.reset(**reset)
    seen, rng = [obs["policy"]], np.random.default_rng(0)
    for _ in range(8):
        obs = env.step(np.clip(rng.uniform(-1, 1, (1, 3)) - [0, 0, 0.5], -1, 1))[0]
        seen.append(obs["policy"])
    return np.concatenate(seen), info["world"]


def test_the_start_of_an_episode_gives_it_back_in_another_world():
    drawn = TaskVec(1, "P", autoreset_mode="Disabled")
    seen, (world,) = episode(drawn, seed=[1_000_004])
    sim = drawn.sim
    drawn.reset(seed=[1_000_004])
    start = Start(
        q=sim.seen.measured[0][0],
        goal=sim.cell.site_position("goal")[0].copy(),
        believed=sim.seen.believed[0].copy(),
        effects=sim.drawn[0].effects,
    )
    other = TaskVec(1, "nominal", autoreset_mode="Disabled", **{k: getattr(drawn.config, k) for k in ("stiffness",)})
    again, (same,) = episode(other, seed=[7], options={"start": start})
    assert {k: v for k, v in same.items() if "offset" not in k} == {k: v for k, v in world.items() if "offset" not in k}
    np.testing.assert_allclose(again, seen, atol=1e-4)


def test_a_start_that_is_open_follows_the_seed_and_the_next_episode_is_its_seeds_own():
    env = TaskVec(1, "searching", autoreset_mode="Disabled")
    plain, _ = episode(env, seed=[5])
    moved, _ = episode(env, seed=[5], options={"start": Start(believed=np.array([0.6, 0.0, 0.1]))})
    assert not np.allclose(moved[0], plain[0])
    np.testing.assert_array_equal(episode(env, seed=[5], options={"start": Start()})[0], plain)
    np.testing.assert_array_equal(episode(env, seed=[5])[0], plain)


@pytest.mark.parametrize(
    ("start", "named"),
    [
        (Start(q=np.full(7, 9.0)), "q"),
        (Start(q=np.zeros(3)), "q"),
        (Start(goal=np.array([2.0, 0.0, 0.0])), "goal"),
        ("here", "start"),
    ],
)
def test_a_start_that_cannot_be_is_refused(start, named):
    env = TaskVec(1, "nominal", autoreset_mode="Disabled")
    with pytest.raises(UserError, match=named):
        env.reset(options={"start": start})


def test_effects_that_no_row_could_have_do_not_break_into_running_episodes():
    env = TaskVec(2, "nominal", autoreset_mode="Disabled")
    env.reset(seed=0)
    late = Start(effects=(EffectInstance.of("command_delay", "all", delay=0.01),))
    with pytest.raises(UserError, match="command_delay"):
        env.reset(seed=1, options={"start": late, "reset_mask": np.array([True, False])})
    env.reset(seed=1, options={"start": late})
    assert all("command_delay(all)" in env.drawn(row).values for row in range(2))


def test_looks_of_a_start_move_nothing():
    """A recorded trial's effects may hold what only its cameras saw."""
    env, felt = TaskVec(1, "nominal", autoreset_mode="Disabled"), EffectInstance.of("joint_bias", "joint4", torque=2.0)
    looks = EffectInstance.of("camera_offset", "external", x=0.01)
    (plain, _), (seen, _) = (
        episode(env, seed=[5], options={"start": Start(effects=e)}) for e in ((felt,), (felt, looks))
    )
    np.testing.assert_array_equal(seen, plain)
