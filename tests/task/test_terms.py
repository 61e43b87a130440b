"""Observation terms of the package's own task: their noise, and the drawn parameters that they show."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.task.environments.vector import TaskVec
from vispeg.task.terms import Observation
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld


def test_noise_of_a_term_is_white_with_its_standard_deviation_and_follows_the_seed():
    env = TaskVec(64, "nominal", "state", autoreset_mode="Disabled", privileged=True)
    env.reset(seed=0)
    table = Observation(env.sim.task.terms, env.config)
    quiet = table.term("force")
    loud = replace(quiet, noise=2.0)
    drawn = table.read(env.sim, [loud]) - table.read(env.sim, [quiet])
    assert np.std(drawn) * quiet.scale == pytest.approx(2.0, rel=4 / np.sqrt(2 * drawn.size))
    np.testing.assert_array_equal(drawn, table.read(env.sim, [loud]) - table.read(env.sim, [quiet]))
    env.sim.count += 1
    assert not np.allclose(drawn, table.read(env.sim, [loud]) - table.read(env.sim, [quiet]))


@pytest.mark.parametrize("where", ["peg", "each"])
def test_what_was_drawn_is_shown_as_it_was_drawn(where):
    """Whatever place the world draws at: surfaces, the held part and joints that it does not name do not count."""

    drawn = {"friction": ("contact_friction", "scale", where), "latency": ("command_delay", "delay", "joint1")}
    world = RandomizedWorld(tuple(RandomizedEffect(e, at, {k: Uniform(0.005, 0.02)}) for e, k, at in drawn.values()))
    env = TaskVec(3, world, privileged=True)
    truth = env.reset(seed=0)[0]["privileged"]
    for term, (name, key, _) in drawn.items():
        for row in range(3):
            values = [v[key] for label, v in env.drawn(row).values.items() if label.startswith(f"{name}(")]
            shown = truth[row, env.observed[term]] * env.observed.term(term).scale
            assert shown == pytest.approx(np.mean(values), rel=1e-5), term
    assert (truth[:, env.observed["mass"]] == 0).all(), "the world draws none"
    env.close()
