"""Every seed is one episode; rows without one are somebody else, so that a control has another's images to show."""

import numpy as np
import pytest
from toy import Reach

from vispeg.evaluation.controls import Controlled
from vispeg.learn.evaluation import run_episodes


class Watcher:
    """Stands still, and notes the images that it is shown."""

    modality, meta = "depth", {}

    def __init__(self):
        self.shown = []

    def reset(self, n, rows=None):
        self.n = n

    def act(self, obs):
        self.shown.append(obs["depth_wrist"].copy())
        return np.zeros((self.n, 3), np.float32)


class Seen(Reach):
    """Notes the images that it gives and the seeds that it is given."""

    def __init__(self, rows):
        super().__init__(rows, "depth")
        self.given, self.images = [], []

    def reset(self, *, seed=None, options=None):
        self.given.append(list(seed))
        return super().reset(seed=seed, options=options)

    def observe(self):
        obs = super().observe()
        self.images.append(obs["depth_wrist"].copy())
        return obs


def test_a_row_that_is_done_plays_no_seed_again_that_counts():
    """Row 0 ends at once; the other one plays on. What row 0 plays meanwhile is nobody's episode."""

    class Uneven(Seen):
        def step(self, actions):
            obs, reward, terminated, truncated, info = super().step(actions)
            return obs, reward, terminated | np.array([True, False]), truncated, info

    env = Uneven(2)
    outcomes = run_episodes(Watcher(), env, [7, 8])
    assert [(o.seed, o.steps) for o in outcomes] == [(7, 1), (8, 12)]
    begun = [seeds[0] for seeds in env.given]
    assert len(begun) == 12 and len(set(begun)) == 12 and not {7, 8} & set(begun[1:])


@pytest.mark.parametrize(("rows", "seeds"), [(2, [7]), (4, [7, 8]), (3, [7, 8, 9, 10, 11])])
def test_who_is_shown_anothers_images_is_never_shown_its_own(rows, seeds):
    watcher, env = Watcher(), Seen(rows)
    outcomes = run_episodes(Controlled(watcher, "shuffled", rows), env, seeds)
    assert [o.seed for o in outcomes] == seeds
    begun = env.given[0]
    assert len(set(begun)) == rows and set(begun[: len(seeds)]) <= set(seeds)
    for own, shown in zip(env.images, watcher.shown, strict=False):
        assert not any(np.array_equal(own[row], shown[row]) for row in range(rows))
