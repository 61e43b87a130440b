"""A distillation's further looks are other pictures of the same states, and change nothing else of it."""

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.demonstrations.looks import looking, side_by_side
from vispeg.learn.methods.distill import DistillSettings, collect
from vispeg.learn.methods.rounds import keep_ring, kept_ring
from vispeg.learn.sb3_env import Sb3Env
from vispeg.learn.teacher import teacher_of
from vispeg.task.peg.task import PegInHoleVec

ROWS, LOOKS = 2, 2
IMAGES = ("depth_wrist_wide", "rgb_wrist_wide")


@pytest.fixture(scope="module")
def env():
    task = {"cameras": ("wrist_wide",), "image_size": 24, "steps": 3, "dwell": 1}
    out = Sb3Env(PegInHoleVec(ROWS, "S", "rgbd", autoreset_mode="Disabled", privileged=True, **task))
    yield out
    out.close()


@pytest.mark.slow
def test_looks_differ_in_pictures_alone_and_the_first_is_the_one_that_was_played(env, tmp_path):
    teacher = teacher_of("expert", env.env.config)  # episodes of three steps: some end while this is played
    one, many = (collect(env, teacher, None, 1.0, 5 * ROWS, 0.0, 7, looks=looks) for looks in (1, LOOKS))
    written = slice(0, int(one.head.min()))
    assert int(one.head.min()) == 6 and len(many) == LOOKS * len(one)
    assert many.refused == 0 and set(many.obs) == set(one.obs)
    for k in range(LOOKS):
        rows = slice(k * ROWS, (k + 1) * ROWS)
        for name in ("action", "reward", "done", "starts"):
            assert np.array_equal(getattr(many, name)[written, rows], getattr(one, name)[written]), name
        for key, kept in many.obs.items():
            same = [np.array_equal(a, b) for a, b in zip(kept[written, rows], one.obs[key][written], strict=True)]
            assert all(same) if k == 0 or key not in IMAGES else not any(same), (k, key)
    first, second = (many.obs["depth_wrist_wide"][written, k * ROWS].astype(float) for k in (0, 1))
    seen = (first > 0) & (second > 0)  # in units of 0.05 mm
    assert seen.mean() > 0.5 and np.median(np.abs(first - second)[seen]) * 0.05 < 5, "of the same scene"
    keep_ring(many, tmp_path / "ring")
    assert len(kept_ring(tmp_path / "ring", one)) == len(many), "a killed run finds them all"


@pytest.mark.slow
def test_afterwards_the_environment_is_seen_as_before(env):
    eyes = env.env.eyes
    with looking(env.env, 2):
        obs = env.env.reset(seed=3)[0]
    assert env.env.eyes is eyes and set(obs) == set(env.observation_space.spaces) | {f"{key}@1" for key in IMAGES}
    assert set(env.env.reset(seed=3)[0]) == set(env.observation_space.spaces)
    assert side_by_side(obs, 2)["policy"].shape == (2 * ROWS, *obs["policy"].shape[1:])


def test_looks_that_would_all_be_the_same_are_refused(env):
    blind = PegInHoleVec(1, "S", "proprio")
    plain = PegInHoleVec(1, "unknown_hole", "depth", cameras=("wrist_wide",), image_size=24)
    for one in (blind, plain):
        with pytest.raises(UserError, match="nothing that is seen varies"), looking(one, 2):
            pass
        one.close()
    with pytest.raises(UserError, match="at least 1"):
        DistillSettings(looks=0)
