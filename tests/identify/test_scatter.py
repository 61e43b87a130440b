"""Errors of the joints, frame by frame, and a field over the image are told apart by their likelihood."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from vispeg.identify.pictures.align import LOOSE as PRIOR
from vispeg.identify.pictures.scatter import CELLS, Columns, Scatter, likelihoods

FRAMES, EACH, JOINTS = 8, 80, 7


def columns(seed: int, robot: float = 0.0, field: float = 0.0) -> Columns:
    """Edges of some frames, at random places and facing anywhere, with what two causes of these sizes do to them."""
    rng = np.random.default_rng(seed)
    frame, n = np.repeat(np.arange(FRAMES), EACH), FRAMES * EACH
    place, facing = rng.uniform(0, 1, size=(n, 2)) * CELLS, rng.uniform(0, 2 * np.pi, n)
    middles = np.stack(np.meshgrid(*(np.arange(k) + 0.5 for k in CELLS)), axis=-1).reshape(-1, 2)
    bumps = np.exp(-0.5 * np.sum((place[:, None] - middles) ** 2, axis=2))
    bumps /= np.linalg.norm(bumps, axis=1, keepdims=True)
    shift = np.concatenate([bumps * np.cos(facing)[:, None], bumps * np.sin(facing)[:, None]], axis=1) / 0.1
    slopes = rng.normal(size=(n, JOINTS)) * 150 / 0.1  # px a rad, of 0.1 px of noise
    joints = np.zeros((n, FRAMES * JOINTS))
    for j in range(JOINTS):
        joints[np.arange(n), frame * JOINTS + j] = slopes[:, j]
    common, fixed = rng.normal(size=(n, 4)), rng.normal(size=(n, 5))
    unknown = rng.normal(size=joints.shape[1]), rng.normal(size=shift.shape[1])
    readings = rng.normal(size=n) + common @ rng.normal(size=4) + fixed @ rng.normal(size=5)
    return Columns(common, joints, shift, fixed, readings + robot * joints @ unknown[0] + field * shift @ unknown[1])


def test_the_likelihood_is_that_of_the_whole_covariance():
    """Restricted likelihood up to a constant: of all readings, fixed effects drawn from their wide prior."""
    parts, sizes = [columns(0, 2e-4, 0.2), columns(1, 2e-4, 0.2)], [(0.0, 0.0), (2e-4, 0.0), (0.0, 0.2), (3e-4, 0.1)]
    dense = []
    for robot, field in sizes:
        own = [c.common @ c.common.T + robot**2 * c.joints @ c.joints.T + field**2 * c.field @ c.field.T for c in parts]
        shared = np.concatenate([c.fixed for c in parts])
        covariance = PRIOR**2 * shared @ shared.T + np.eye(len(shared))
        covariance[: len(own[0]), : len(own[0])] += own[0]
        covariance[len(own[0]) :, len(own[0]) :] += own[1]
        readings = np.concatenate([c.readings for c in parts])
        dense.append(stats.multivariate_normal(cov=covariance).logpdf(readings))
    assert np.diff(likelihoods(parts, sizes)) == pytest.approx(np.diff(dense), rel=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_a_field_over_the_image_is_no_error_of_the_joints_and_theirs_no_field(seed):
    assert Scatter.of([columns(seed)]) == Scatter(0.0, 0.0)
    arm = Scatter.of([columns(seed, robot=5e-4)])
    assert arm.robot == pytest.approx(5e-4, rel=0.3) and arm.field == 0.0
    smear = Scatter.of([columns(seed, field=0.3)])
    assert smear.robot == 0.0 and smear.field == pytest.approx(0.3, rel=0.5)
    both = Scatter.of([columns(seed, robot=5e-4, field=0.3)])
    assert both.robot == pytest.approx(5e-4, rel=0.3) and both.field == pytest.approx(0.3, rel=0.5)
