"""Demonstrations begin where they are asked to begin, one start after the other."""

import numpy as np

from vispeg.learn.methods.distill import demonstrations
from vispeg.learn.sb3_env import Sb3Env
from vispeg.task.environments.vector import TaskVec
from vispeg.task.scripted import Scripted
from vispeg.task.start import Start


def test_every_episode_begins_at_the_next_start_and_its_goal():
    drawn = TaskVec(5, world="nominal", seed=3, autoreset_mode="Disabled")
    drawn.reset()
    begin = [(q, np.array([0.6, 0.01 * i, 0.05])) for i, q in enumerate(drawn.sim.seen.measured[0].copy())]
    starts = [Start(*each) for each in begin]
    env = TaskVec(2, world="nominal", autoreset_mode="Disabled")
    begun: list[tuple[np.ndarray, np.ndarray]] = []
    reset = env.reset

    def heard(**how):
        result = reset(**how)
        rows = np.flatnonzero(how["options"]["reset_mask"])
        begun.extend((env.sim.cell.x.q[r].copy(), env.sim.cell.site_position("goal")[r].copy()) for r in rows)
        return result

    env.reset = heard
    ring, tried = demonstrations(Sb3Env(env, starts), Scripted(env.config), 6, seed=0)
    assert tried >= 6 and int(ring.done.sum()) >= 1 and len(begun) > len(starts)
    for k, (q, goal) in enumerate(begun):
        assert np.array_equal(q, begin[k % 5][0]) and np.allclose(goal, begin[k % 5][1], atol=1e-9)
