"""Least squares of base parameters is exact where the robot is a rigid arm with other masses and plain friction."""

from dataclasses import replace

import numpy as np
import pytest
from loops import ARM

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.diagnosis.evidence.base_parameters import base_parameters, columns
from vispeg.diagnosis.evidence.signatures import Probe, signatures
from vispeg.identify.inverse import TorqueEvidence
from vispeg.recordings.recording import Control, Recording
from vispeg.worlds.world import World

REAL = World().add(
    EffectInstance.of("link_mass", "lower", mass=0.4),
    EffectInstance.of("link_com", "upper", x=0.02, z=-0.03),
    EffectInstance.of("payload", "flange", mass=0.3),
    EffectInstance.of("coulomb_friction", "elbow", torque=0.3),
    EffectInstance.of("viscous_friction", "shoulder", damping=0.5),
    EffectInstance.of("joint_bias", "elbow", torque=-0.2),
)


@pytest.fixture(scope="module")
def evidence(tmp_path_factory):
    """Two recordings whose torque is what the real arm needs, and nothing else."""
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    out = []
    for i in range(2):
        t = np.arange(1200) * 5e-3
        q = np.stack([0.5 * np.sin((3 + i) * t) + 0.2 * np.sin(7 * t), 0.6 * np.sin((5 - i) * t + 1)], axis=1)
        control = Control("unknown", 200.0)
        rec = Recording(path, str(path), ("shoulder", "elbow"), 200.0, control, t, q, tau=np.zeros_like(q))
        rec = replace(rec, torque_sensor="motor", noise={"tau": 1e-3})
        ideal = TorqueEvidence([rec])
        rng, tau = stream(i, "tau"), np.zeros_like(q)
        rows = ideal.items[0].segment.rows
        tau[rows] = ideal.simulated([REAL])[0][0]
        out.append(replace(rec, tau=tau + 1e-3 * rng.standard_normal(q.shape)))
    return TorqueEvidence(out[:1]), TorqueEvidence(out[1:])


def test_nothing_but_noise_is_left_on_recordings_that_were_not_fitted(evidence):
    fitted, held_out = evidence
    before = held_out.items[0].measured - held_out.simulated([World()])[0][0]
    (left,) = base_parameters(fitted, held_out, World())
    valid = held_out.items[0].valid
    assert np.sqrt(np.mean(before[valid] ** 2)) > 0.3
    assert np.sqrt(np.mean(left[valid] ** 2)) == pytest.approx(1e-3, rel=0.2)
    assert np.all(left[~valid] == 0)


def test_the_columns_are_derivatives_of_the_needed_torque(evidence):
    """The torque of a heavier, shifted link lies in the space that the columns span: to first order and beyond."""
    item = evidence[0].items[0]
    x = columns(item)
    nominal, moved = evidence[0].simulated([World(), REAL])[0]
    gap = (moved - nominal).ravel()
    solution = np.linalg.lstsq(x, gap, rcond=1e-10)[0]
    np.testing.assert_allclose(x @ solution, gap, atol=1e-6 * np.abs(gap).max())


def test_a_model_must_come_near_what_least_squares_leaves():
    """However bad the nominal model was: 97 % of its excess explained is not enough."""
    assert decide(1000.0, 20.0, 3, [], []).verdict == "identified"
    assert decide(1000.0, 20.0, 3, [], [], mark=10.0).verdict == "unexplained"
    assert decide(1000.0, 10.0 * RULES.inertial, 3, [], [], mark=10.0).verdict == "identified"
    assert "leaves 3.2 ×" in decide(1000.0, 20.0, 3, [], [], mark=10.0).reason


def test_signatures_of_torques_are_the_differences_of_worlds_since_nothing_is_integrated(evidence):
    fitted, _ = evidence
    (before,) = fitted.residuals([World()])
    alone = [Probe(e, tuple(effect(e.effect).magnitudes[:1]), ()) for e in REAL.effects]
    for probe, signature in zip(alone, signatures(fitted, World(), before, alone), strict=True):
        (after,) = fitted.residuals([World().add(probe.variants[0])])
        np.testing.assert_allclose(signature.columns[:, 0], (before - after).astype(np.float32))
