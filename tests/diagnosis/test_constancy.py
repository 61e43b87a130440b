"""Effects that a fit takes for constant and that are not: they stand in for something that changes."""

from dataclasses import replace
from pathlib import Path

import fits
import numpy as np
import pytest
from loops import arm

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.constancy import _magnitudes, _times, changes
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Fit
from vispeg.identify.space import Space
from vispeg.recordings.recording import Control, Recording
from vispeg.worlds.world import World

ROWS, JOINTS = 800, ("shoulder", "elbow")
FRICTION = EffectInstance.of("coulomb_friction", "shoulder", torque=2.0)
BIAS = EffectInstance.of("joint_bias", "elbow", torque=0.5)


@pytest.fixture(scope="module")
def items() -> list:
    """Two recordings of two joints, 8 s each; the second one in two windows."""
    out, rng, time = [], stream(3, "moves"), np.arange(ROWS) * 0.01
    control = Control("position", 100.0, "none", np.full(2, 60.0), np.full(2, 4.0))
    for pieces in (1, 2):
        q = np.sin(np.outer(time, rng.uniform(1.0, 3.0, 2)) + rng.uniform(0, 6, 2))
        episode = np.repeat(np.arange(pieces), ROWS // pieces)
        rec = Recording(Path("moves"), arm().source, JOINTS, 100.0, control, time, q, q_cmd=q, episode=episode)
        out += Evidence([rec]).items
    assert len(out) == 3
    return out


def columns(items) -> np.ndarray:
    """Whitened derivative (n, 2) of the residual to friction and to bias: 100 times the noise a unit."""
    direction = np.concatenate([np.sign(np.gradient(i.posture[:, 0])) for i in items])
    out = np.zeros((len(direction), 2, 2))
    out[:, 0, 0], out[:, 1, 1] = -100.0 * direction, -100.0
    return out.reshape(-1, 2)


def ages(items) -> np.ndarray:
    return np.concatenate([i.recording.time[i.segment.rows] for i in items])


def fitted(items, share: np.ndarray) -> Fit:
    """The fit of an arm whose friction is `share` (m,) of 2 N m, with noise; the bias is what it is taken for."""
    jac, rng = columns(items), stream(4, "noise")
    space = Space(World().add(FRICTION, BIAS), range(2))
    truth = np.repeat(share, 2)[:, None] * jac[:, :1] * (0.0 - space.start[0])  # what friction adds to the residual
    measured = truth[:, 0] - jac[:, 1] * space.start[1] + rng.standard_normal(len(jac))
    u = np.linalg.lstsq(-jac, measured, rcond=None)[0]
    return fits.fit(space.world, residual=measured + jac @ u, jacobian=jac, u=u)


def left(fit) -> dict[str, float]:
    squares = (fit.residual**2).reshape(-1, 2).sum(axis=0) - len(fit.residual) / 2
    return {joint: float(max(s, 10.0)) for joint, s in zip(JOINTS, squares, strict=True)}


def test_a_constant_effect_is_constant_whatever_else_is_left(items):
    fit = fitted(items, np.ones(2 * ROWS))
    assert changes(items, fit, 0, left(fit)) == []
    rough = 3.0 * np.repeat(stream(5, "rough").standard_normal(2 * ROWS // 20), 20)  # missing, in no relation to either
    fit = replace(fit, residual=fit.residual + np.repeat(rough, 2))
    assert changes(items, fit, 0, left(fit)) == []
    slight = fitted(items, 1.0 - 0.02 * ages(items))
    assert changes(items, slight, 0, left(slight)) == [], "it hardly changes"


def test_friction_that_falls_with_time_is_not_constant_and_its_parts_are_those_of_least_squares(items):
    fit = fitted(items, np.exp(-ages(items) / 2.0))
    (change,) = changes(items, fit, 0, left(fit))
    assert (change.label, change.over) == ("coulomb_friction(shoulder)", "time") and change.share > 0.8
    assert list(change.parts) == sorted(change.parts, reverse=True)
    quarter = np.repeat(np.minimum(ages(items) // 2.0, RULES.folds - 1), 2)
    apart = np.column_stack([fit.jacobian[:, 0] * (quarter == s) for s in range(RULES.folds)] + [fit.jacobian[:, 1]])
    moved = np.linalg.lstsq(apart, -fit.residual, rcond=None)[0]
    assert change.parts == pytest.approx(1.0 + moved[: RULES.folds] / fit.u[0], rel=1e-4)
    here = slice(None, None, 2)  # what it removes in the other joint does not count
    drop = np.sum(fit.residual[here] ** 2) - np.sum((fit.residual + apart @ moved)[here] ** 2)
    assert change.share == pytest.approx(drop / left(fit)["shoulder"], rel=1e-4)
    assert "as the recordings go on" in change.said()
    assert changes(items, fit, 1, left(fit)) == [], "what was given is not asked"


def test_the_parts_of_episodes_are_those_of_any_clock(items):
    """Four episodes of 2 s are a quarter each, whether the clock restarts with each or runs on."""
    number = np.repeat(np.arange(RULES.folds), ROWS // RULES.folds)
    first = items[0].recording
    running = replace(first, episode=number)
    restarted = replace(running, time=first.time - 2.0 * number)
    for rec in (running, restarted):
        np.testing.assert_array_equal(_times(Evidence([rec]).items), number)


def test_the_residual_of_another_joint_does_not_count(items):
    """A friction that moves both joints explains what changes in the other one by its parts: it is constant itself."""
    jac = columns(items)
    jac[1::2, 0] = -100.0
    fit = fitted(items, np.ones(2 * ROWS))
    noise = stream(4, "noise").standard_normal(len(jac))
    drift = 60.0 * np.exp(-ages(items) / 2.0)
    measured = noise.copy()
    measured[1::2] += drift - drift.mean()
    fit = replace(fit, columns=(jac,), residual=measured)
    total = 30.0 * fit.u[0]
    assert np.sum(measured[1::2] ** 2) > 10 * total and changes(items, fit, 0, left(fit)) == []


def test_friction_at_one_angle_alone_is_none(items):
    angle = np.concatenate([i.posture[:, 0] for i in items])
    fit = fitted(items, 3.0 * np.exp(-(((angle - 0.8) / 0.2) ** 2)))
    (change,) = changes(items, fit, 0, left(fit))
    assert (change.label, change.over) == ("coulomb_friction(shoulder)", "position")
    assert change.parts[-1] > 1.5 > 0.5 > change.parts[0]


def test_a_missing_reading_is_no_angle(items):
    angle = np.concatenate([i.posture[:, 0] for i in items])
    fit = fitted(items, 3.0 * np.exp(-(((angle - 0.8) / 0.2) ** 2)))
    q = items[0].recording.q.copy()
    q[ROWS // 2, 0] = np.nan
    holed = [replace(items[0], recording=replace(items[0].recording, q=q)), *items[1:]]
    (whole,), (change,) = (changes(some, fit, 0, left(fit)) for some in (items, holed))
    assert change.over == "position" and change.parts == pytest.approx(whole.parts, abs=0.05)


def test_a_servo_is_not_judged_by_a_gain_that_may_be_null():
    """Its bandwidth tells it, and that vanishes on no straight line; friction is judged by its torque."""
    fit = fits.fit(World().add(EffectInstance.of("servo", "shoulder"), FRICTION))
    assert _magnitudes(fit, 0) == [] and len(_magnitudes(fit, 1)) == 1
