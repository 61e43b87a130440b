"""Signatures are simulated with longer steps than worlds: they must be what worlds at the evidence's own step show."""

import numpy as np
import pytest
from loops import ARM, drive, iiwa_segment, recorded

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.diagnosis.evidence.localise import joint_data, missing_torque
from vispeg.diagnosis.evidence.screen import candidates, screen
from vispeg.diagnosis.evidence.signatures import probes, signatures
from vispeg.identify.evidence import Evidence
from vispeg.robots.model import load
from vispeg.worlds.world import World

HIDDEN = EffectInstance.of("coulomb_friction", "shoulder", torque=0.5)


@pytest.fixture(scope="module", params=["position", "torque"])
def evidence(request, tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    robot, t = load(path), np.arange(2000) * 2e-3
    swing = np.outer(1 - np.cos(2 * np.pi * 0.7 * t), [0.4, 0.3])
    options = {"command": swing, "kp": 60.0, "kd": 2.0} if request.param == "position" else {"command": 4.0 * swing}
    s = drive(robot, request.param, 0.0, seconds=4.0, rate=500.0, **options)
    return Evidence([recorded(robot, robot.source, World().add(HIDDEN), s, stream(8, 1))])


def test_a_signature_is_the_difference_of_worlds_at_the_evidence_s_own_step(evidence):
    world = World().add(HIDDEN)
    joints, (residual,) = evidence.items[0].robot.joints, evidence.residuals([world])
    missing = [missing_torque(i, y[0]) for i, y in zip(evidence.items, evidence.simulated([world]), strict=True)]
    asked = probes(candidates(evidence, world, list(joints)), evidence.items[0], joint_data(missing, evidence.items))
    taken = signatures(evidence, world, residual, asked)
    shorter = {p.placed.effect for p in asked if evidence.steps(world.add(p.placed)) != evidence.coarser().steps(world)}
    assert len(asked) > 30 and shorter
    for probe, signature in zip(asked, taken, strict=True):
        alone = [world.add(v) for v in probe.variants[: len(probe.names)]]
        for k, after in enumerate(evidence.residuals(alone)):
            if np.abs(after).max() > 1e3:  # an unstable loop: its path says nothing at any step
                continue
            fine, coarse = residual - after, signature.columns[:, k]
            error, size = np.linalg.norm(coarse - fine), np.linalg.norm(fine)
            assert error < 0.3 * max(np.sqrt(len(residual)), size), (probe.placed.label, probe.names[k])
            if np.isfinite(effect(probe.placed.effect).stable_step(_values(probe))):
                assert error < 1e-4 * size, probe.placed.label


def _values(probe):
    return {name: value.value for name, value in probe.placed.params.items()}


@pytest.mark.parametrize(
    "hidden",
    [
        EffectInstance.of("joint_elasticity", "joint5", compliance=7e-4, motor_inertia=0.014),
        EffectInstance.of("backlash", "joint5", gap=2e-3, motor_inertia=0.014),
    ],
    ids=lambda e: e.effect,
)
def test_a_rotor_behind_a_gear_is_guessed_from_the_missing_torque_and_its_signature_explains_the_error(hidden):
    """A rotor of 0.2 kg m^2 in a wrist of 0.03 would move the arm so far that its signature is not linear."""
    robot, segment = load("iiwa14"), iiwa_segment(seconds=2.0)
    evidence = Evidence([recorded(robot, "iiwa14", World().add(hidden), segment, stream(8, 2))])
    (residual,) = evidence.residuals([World()])
    missing = [missing_torque(i, y[0]) for i, y in zip(evidence.items, evidence.simulated([World()]), strict=True)]
    asked = probes([(hidden.effect, hidden.where)], evidence.items[0], joint_data(missing, evidence.items))
    guessed = [p.placed.params["motor_inertia"].value for p in asked]
    assert min(abs(g / 0.014 - 1.0) for g in guessed) < 0.25, guessed
    taken = signatures(evidence, World(), residual, asked)
    best = screen(taken, residual, None, [(hidden.effect, hidden.where)])[0]
    assert best.gain > 0.95 * (residual @ residual)
