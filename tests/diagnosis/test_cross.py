"""Cross-fitting and deletion without rollouts are what refitting gives where the model is linear."""

from types import SimpleNamespace

import numpy as np
import pytest

from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.selection.accept import threshold
from vispeg.diagnosis.selection.cross import Cross, reduced
from vispeg.diagnosis.selection.judge import Judge

ROWS, JOINTS, PARAMETERS = 120, 2, 3


class Linear:
    """Evidence of recordings whose residual is `y - X u`, one item each."""

    def __init__(self, count: int, seed: int = 0):
        rng = stream(seed, "linear")
        shape = (ROWS, JOINTS)
        self.items = [
            SimpleNamespace(measured=np.zeros(shape), nj=JOINTS, valid=np.ones(shape, bool)) for _ in range(count)
        ]
        self.x = rng.standard_normal((count * ROWS * JOINTS, PARAMETERS))
        self.y = self.x @ np.array([0.7, 0.0, -0.4]) + rng.standard_normal(len(self.x))

    def blocks(self, seconds: float) -> np.ndarray:
        rows = np.arange(len(self.items) * ROWS) // 10
        return np.repeat(rows[:, None], JOINTS, axis=1).ravel()

    def tells(self, difference: np.ndarray) -> np.ndarray:
        return np.ones(len(difference), bool)

    def stretches(self, blocks: np.ndarray) -> np.ndarray:
        return np.arange(int(blocks.max()) + 1)

    def fit(self, columns=slice(None)):
        u = np.linalg.lstsq(self.x[:, columns], self.y, rcond=None)[0]
        space = SimpleNamespace(bounds=(np.full(len(u), -9.0), np.full(len(u), 9.0)))
        return SimpleNamespace(u=u, residual=self.y - self.x[:, columns] @ u, jacobian=-self.x[:, columns], space=space)


@pytest.mark.parametrize("count", [1, 3])
def test_a_fold_is_judged_by_the_fit_of_the_others(count):
    """The slow oracle: leave the rows of a fold out, fit the rest, and predict them."""
    evidence = Linear(count)
    cross, fit = Cross(Judge(evidence)), evidence.fit()
    assert len(cross.folds) == (4 if count == 1 else count)
    expected = np.empty(len(evidence.y))
    for fold in cross.folds:
        rest = np.ones(len(evidence.y), bool)
        rest[fold] = False
        u = np.linalg.lstsq(evidence.x[rest], evidence.y[rest], rcond=None)[0]
        expected[fold] = evidence.y[fold] - evidence.x[fold] @ u
    found = cross.loss(fit.residual, fit.jacobian)
    np.testing.assert_allclose(found, cross.judge.loss(expected), rtol=1e-5)
    assert found.sum() > np.sum(fit.residual**2), "what was fitted to itself looks better than it is"
    np.testing.assert_array_equal(cross.loss(evidence.y), cross.judge.loss(evidence.y))


def test_a_parameter_is_taken_out_as_by_a_fit_without_it():
    evidence = Linear(2)
    u, residual, rest = reduced(evidence.fit(), [1], np.zeros(PARAMETERS))
    without = evidence.fit([0, 2])
    np.testing.assert_allclose(u, [without.u[0], 0.0, without.u[1]], atol=1e-6)
    np.testing.assert_allclose(residual, without.residual, atol=1e-5)
    np.testing.assert_array_equal(rest, without.jacobian)


def test_a_useless_parameter_does_not_lower_the_cross_fitted_loss():
    evidence = Linear(3)
    cross, full = Cross(Judge(evidence)), evidence.fit()
    best = cross.loss(full.residual, full.jacobian)
    gains = []
    for k in range(PARAMETERS):
        _, residual, rest = reduced(full, [k], np.zeros(PARAMETERS))
        gains.append(cross.judge.gain(cross.loss(residual, rest), best).z)
    assert gains[0] > 3 and gains[2] > 3 and gains[1] < 2


def test_the_loss_by_joints_adds_up():
    evidence = Linear(2)
    judge = Judge(evidence)
    r = evidence.y.reshape(-1, JOINTS)
    loss = judge.loss(evidence.y)
    np.testing.assert_allclose(loss.sum(axis=0), np.sum(r**2, axis=0))
    halved = evidence.y.copy().reshape(-1, JOINTS)
    halved[:, 1] *= 0.5
    gain = judge.gain(loss, judge.loss(halved.ravel()))
    np.testing.assert_allclose(gain.joints, [0.0, 0.75], atol=1e-12)
    assert gain.mean == pytest.approx(0.75 * np.sum(r[:, 1] ** 2) / r.size)


def test_false_discoveries_keep_their_rate():
    """Against the definition, and against Holm's first level where one candidate stands alone."""
    from scipy import stats

    one = threshold([6.0, 0.1], 60)
    assert one == pytest.approx(stats.norm.isf(RULES.discoveries / 60))
    many = threshold([4.0, 4.0, 4.0, 0.0], 60)
    assert many == pytest.approx(stats.norm.isf(3 * RULES.discoveries / 60)) and many < one
    rng, false = stream(7, "null"), 0
    for _ in range(400):  # 60 places without anything: any discovery is false
        z = rng.standard_normal(60)
        false += bool(np.any(z >= threshold(list(z), 60)))
    assert false / 400 < 3 * RULES.discoveries
