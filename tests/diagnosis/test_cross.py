"""Cross-fitting and deletion without rollouts are what refitting gives where the model is linear."""

from collections.abc import Sequence

import fits
import numpy as np
import pytest
from loops import arm

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.accept import threshold
from vispeg.diagnosis.selection.cross import Cross, reduced
from vispeg.diagnosis.selection.judge import Judge
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.worlds.world import World

JOINTS, PARAMETERS = 2, 3
BIASES = tuple(EffectInstance.of("joint_bias", f"joint{k + 1}") for k in range(PARAMETERS))


class Linear:
    """Recordings of two joints at rest, and residuals `y - X u` of them in three effects; 0 where nothing is read."""

    def __init__(self, count: int, seed: int = 0):
        rng = stream(seed, "linear")
        self.evidence = Evidence([fits.still(arm(), 1.2 + 0.1 * k, f"still-{k}") for k in range(count)])
        read = np.concatenate([i.valid.ravel() for i in self.evidence.items])[:, None]
        self.x = rng.standard_normal((self.evidence.length, PARAMETERS)) * read
        self.y = self.x @ np.array([0.7, 0.0, -0.4]) + rng.standard_normal(len(self.x)) * read[:, 0]

    def fit(self, columns: Sequence[int] = range(PARAMETERS)) -> Fit:
        x = self.x[:, list(columns)]
        u = np.linalg.lstsq(x, self.y, rcond=None)[0]
        return fits.fit(World().add(*(BIASES[k] for k in columns)), residual=self.y - x @ u, jacobian=-x, u=u)


@pytest.mark.parametrize("count", [1, 3])
def test_a_fold_is_judged_by_the_fit_of_the_others(count):
    """The slow oracle: leave the rows of a fold out, fit the rest, and predict them."""
    linear = Linear(count)
    cross, fit = Cross(Judge(linear.evidence)), linear.fit()
    assert len(cross.folds) == (4 if count == 1 else count)
    expected = np.empty(len(linear.y))
    for fold in cross.folds:
        rest = np.ones(len(linear.y), bool)
        rest[fold] = False
        u = np.linalg.lstsq(linear.x[rest], linear.y[rest], rcond=None)[0]
        expected[fold] = linear.y[fold] - linear.x[fold] @ u
    found = cross.loss(fit.residual, fit.jacobian)
    np.testing.assert_allclose(found, cross.judge.loss(expected), rtol=1e-5)
    assert found.sum() > cross.judge.loss(fit.residual).sum(), "what was fitted to itself looks better than it is"
    np.testing.assert_array_equal(cross.loss(linear.y), cross.judge.loss(linear.y))


def test_a_parameter_is_taken_out_as_by_a_fit_without_it():
    linear = Linear(2)
    u, residual, rest = reduced(linear.fit(), [1], np.zeros(PARAMETERS))
    without = linear.fit([0, 2])
    np.testing.assert_allclose(u, [without.u[0], 0.0, without.u[1]], atol=1e-6)
    np.testing.assert_allclose(residual, without.residual, atol=1e-5)
    np.testing.assert_array_equal(rest, without.jacobian)


def test_a_useless_parameter_does_not_lower_the_cross_fitted_loss():
    linear = Linear(3)
    cross, full = Cross(Judge(linear.evidence)), linear.fit()
    best = cross.loss(full.residual, full.jacobian)
    gains = []
    for k in range(PARAMETERS):
        _, residual, rest = reduced(full, [k], np.zeros(PARAMETERS))
        gains.append(cross.judge.gain(cross.loss(residual, rest), best).z)
    assert gains[0] > 3 and gains[2] > 3 and gains[1] < 2


def test_the_loss_by_joints_adds_up():
    linear = Linear(2)
    judge = Judge(linear.evidence)
    r = linear.y.reshape(-1, JOINTS)
    loss = judge.loss(linear.y)
    np.testing.assert_allclose(loss.sum(axis=0), np.sum(r**2, axis=0))
    halved = linear.y.copy().reshape(-1, JOINTS)
    halved[:, 1] *= 0.5
    gain = judge.gain(loss, judge.loss(halved.ravel()))
    np.testing.assert_allclose(gain.joints, [0.0, 0.75], atol=1e-12)
    assert gain.mean == pytest.approx(0.75 * np.sum(r[:, 1] ** 2) / linear.evidence.count)


def test_false_discoveries_keep_their_rate():
    """Against the definition, and against Holm's first level where one candidate stands alone."""
    from scipy import stats

    assert threshold([], 60) == np.inf, "nothing passes where nothing was tried"
    one = threshold([6.0, 0.1], 60)
    assert one == pytest.approx(stats.norm.isf(RULES.discoveries / 60))
    many = threshold([4.0, 4.0, 4.0, 0.0], 60)
    assert many == pytest.approx(stats.norm.isf(3 * RULES.discoveries / 60)) and many < one
    rng, false = stream(7, "null"), 0
    for _ in range(400):  # 60 places without anything: any discovery is false
        z = rng.standard_normal(60)
        false += bool(np.any(z >= threshold(list(z), 60)))
    assert false / 400 < 3 * RULES.discoveries
