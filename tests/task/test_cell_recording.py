"""What the task's own controller does in the task's cell is what a model with the same effects predicts."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.effect import EffectInstance
from vispeg.identify.evidence import Evidence
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control, Nullspace, Recording
from vispeg.recordings.write import write
from vispeg.robots.declared import declared
from vispeg.task.control import DAMPING, POSTURE
from vispeg.task.environments.simulation import TaskSimulation
from vispeg.task.peg.config import PegConfig
from vispeg.worlds.world import World

NOISE = 2e-5  # rad, the encoders'
FRICTION = EffectInstance.of("coulomb_friction", "joint4", torque=1.5)
PAYLOAD = EffectInstance.of("payload", "flange", mass=0.4, z=0.05)


def recorded(effects, steps=20):
    """An episode in free air above the fixture, as a recording of the arm under the task's controller."""
    config = PegConfig(start_height=(0.1, 0.1))
    sim = TaskSimulation(World(effects=effects), config, 1)
    sim.reset(np.arange(1), [3])
    angles, goals = [], []
    torque = sim.control.torque

    def spy(q, dq, pos, rot):
        angles.append(q[0].copy())
        goals.append(np.concatenate([pos[0], rot[0]]))
        return torque(q, dq, pos, rot)

    sim.control.torque = spy
    for k in range(steps):
        sim.step(np.array([[np.sin(0.9 * k), np.cos(0.7 * k), 0.6 * np.sin(0.5 * k)]]))
    assert not max(np.concatenate(t.forces).max() for t in sim.tracks), "nothing was touched"
    kp, kd = sim.control.kp[0], sim.control.kd[0]
    null = Nullspace(POSTURE, DAMPING, sim.control.home)
    control = Control("osc", 1 / config.control_period, "model", kp, kd, null, config.force_limit)
    q = np.array(angles)
    return Recording(
        path=Path("cell"),
        robot="iiwa14",
        joints=tuple(f"joint{i}" for i in range(1, 8)),
        rate_hz=control.rate_hz,
        control=control,
        time=np.arange(len(q)) * config.control_period,
        q=q + np.random.default_rng(0).normal(scale=NOISE, size=q.shape),
        ee_cmd=np.array(goals),
        tool=declared("iiwa14", f"meg50+peg{round(sim.scene.config.diameter * 1000)}"),
        noise={"q": NOISE},
        motion="task",
    )


def times_floor(rec, *effects):
    """Error of the nominal model with these effects over the noise, both RMS."""
    evidence = Evidence([rec], h_max=5e-4)
    return evidence.rms_error(evidence.residuals([World(effects=effects)])[0]) / evidence.floor


@pytest.mark.parametrize("effects", [(), (FRICTION,), (FRICTION, PAYLOAD)])
def test_the_model_with_the_same_effects_is_adequate(effects):
    rec = recorded(effects)
    assert times_floor(rec, *effects) < 1.5
    if effects:
        assert times_floor(rec) > 10


def test_the_force_limit_is_part_of_the_controller(tmp_path):
    """Without it the replayed controller is another one; the folder keeps it."""
    rec = recorded(())
    stiff = replace(rec, control=replace(rec.control, force_limit=None))
    assert times_floor(stiff) > 5 * times_floor(rec)
    write(rec, tmp_path / "cell")
    assert load(tmp_path / "cell").control.force_limit == rec.control.force_limit
