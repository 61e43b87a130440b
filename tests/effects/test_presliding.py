"""Elements that yield one after the other: the stretch along a whole path is that of one step after the other."""

import numpy as np

from vispeg.core.seeds import stream
from vispeg.effects.common.presliding import pull, slack, yielding


def test_a_path_at_once_is_the_path_step_by_step():
    path = np.cumsum(stream(7, 1).normal(0.0, 2e-3, 800))
    path[100:140] = path[100]  # it stands
    level, stiffness = np.array([[0.6]]), np.array([[90.0]])
    anchors = slack(path[:1, None])
    stepped = [pull(anchors, np.array([[q]]), stiffness, level)[0, 0] for q in path]
    np.testing.assert_allclose(-stiffness[0, 0] * yielding(path, 0.6 / 90.0), stepped, atol=1e-12)


def test_after_a_reversal_the_spring_is_as_stiff_again_and_yields_over_twice_the_way():
    path = np.concatenate([np.linspace(0.0, 1.0, 2001), np.linspace(1.0, 0.0, 2001)])
    stretch = yielding(path, 0.05)
    np.testing.assert_allclose([stretch[2000], stretch[-1]], [0.05, -0.05])
    np.testing.assert_allclose(stretch[2001] - stretch[2002], stretch[1] - stretch[0])  # nothing slips yet
    slipping = 0.05 * 1.75 * np.array([1.0, 2.0])  # the way after which the last element slips, at first and back
    ways = [np.flatnonzero(np.isclose(stretch[:2001], 0.05))[0], np.flatnonzero(np.isclose(stretch[2001:], -0.05))[0]]
    np.testing.assert_allclose(np.array(ways) * 5e-4, slipping, atol=6e-4)
    np.testing.assert_allclose(yielding(-path, 0.05), -stretch)
