"""Bodies and mounting: effects that write inertial fields against a model compiled with those numbers in it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from loops import KD, KP, iiwa_segment, one
from mujoco import batch as mjb
from scipy.spatial.transform import Rotation

from vispeg.core.effect import EffectInstance
from vispeg.core.seeds import stream
from vispeg.recordings.recording import Control
from vispeg.robots.model import RobotModel, load
from vispeg.sim.compiled import compiled
from vispeg.sim.nominal import dense
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

ROBOT = load("iiwa14")


def dynamics(robot: RobotModel, world: World, q, dq):
    """Inertia (7, 7), bias force (7,) and gravity torque (7,) of a world at one state, through the effects' fields."""
    batch = mjb.Batch(compiled(robot), 2, nthread=1)
    fields = Fields(batch, robot)
    for a in activate(robot, [world, world]):
        a.effect.write(fields, a.p)
    batch.set_const()
    mass, bias = batch.bind("M"), batch.bind("qfrc_bias")
    batch.bind("qpos")[:], batch.bind("qvel")[0] = q, dq
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    return dense(compiled(robot), mass)[0], bias[0].copy(), bias[1].copy()


def built(edit) -> RobotModel:
    """The iiwa with `edit(spec)` made before it is compiled."""

    def build() -> mujoco.MjSpec:
        spec = ROBOT.spec()
        edit(spec)
        return spec

    return replace(ROBOT, build=build)


def heavier(spec):
    body = spec.body("link5")
    scale = (body.mass + 0.8) / body.mass
    body.mass, body.inertia = body.mass * scale, np.array(body.inertia) * scale


def shifted(spec):
    spec.body("link4").ipos = np.array(spec.body("link4").ipos) + [0.03, -0.02, 0.05]


def loaded(spec):
    """A ball of 2 kg: two fifths m r^2 about each axis, welded on as a body of its own."""
    site = spec.site("flange")
    ball = 0.4 * 2.0 * 0.05**2
    site.parent.add_body(
        name="ball",
        pos=np.array(site.pos) + [0.05, -0.03, 0.12],
        mass=2.0,
        ipos=[0, 0, 0],
        inertia=[ball] * 3,
        explicitinertial=True,
    )


CASES = {
    "link_mass": (EffectInstance.of("link_mass", "link5", mass=0.8), built(heavier)),
    "link_com": (EffectInstance.of("link_com", "link4", x=0.03, y=-0.02, z=0.05), built(shifted)),
    "payload": (EffectInstance.of("payload", "flange", mass=2.0, x=0.05, y=-0.03, z=0.12, radius=0.05), built(loaded)),
    "gravity_tilt": (
        EffectInstance.of("gravity_tilt", "base", roll=0.2, pitch=-0.1),
        load("iiwa14", base_tilt=(0.2, -0.1)),
    ),
    "rotor_inertia": (
        EffectInstance.of("rotor_inertia", "joint3", inertia=0.3),
        built(lambda spec: setattr(spec.joint("joint3"), "armature", 0.3)),
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_dynamics_are_those_of_a_model_compiled_so(name):
    placed, other = CASES[name]
    rng = stream(1, name)
    for _ in range(5):
        q, dq = rng.uniform(-1.5, 1.5, (2, 7))
        got, expected = dynamics(ROBOT, World().add(placed), q, dq), dynamics(other, World(), q, dq)
        nominal = dynamics(ROBOT, World(), q, dq)
        for value, exact in zip(got, expected, strict=True):
            np.testing.assert_allclose(value, exact, atol=1e-10)
        assert any(np.abs(v - n).max() > 1e-3 for v, n in zip(got, nominal, strict=True))


@pytest.mark.parametrize("name", CASES)
def test_motion_is_that_of_a_model_compiled_so(name):
    """The same servo, without gravity compensation (which would know of what was compiled in)."""
    placed, other = CASES[name]
    s = iiwa_segment("position", 0.5)
    s = replace(s, control=Control("position", 500.0, "none", KP, KD))
    got, expected = one(ROBOT, World().add(placed), s).q[0], one(other, World(), s).q[0]
    signature = np.abs(got - one(ROBOT, World(), s).q[0]).max()
    assert signature > 1e-4
    np.testing.assert_allclose(got[25:], expected[25:], atol=0.02 * signature)  # they start in other balances


def test_gravity_tilt_is_a_rotated_base():
    """Gravity torque in the tilted base equals that of an upright world whose down is `(Rx Ry)' (0, 0, -9.81)`."""
    roll, pitch = 0.15, -0.25
    down = (Rotation.from_euler("x", roll) * Rotation.from_euler("y", pitch)).inv().apply([0, 0, -9.81])
    other = built(lambda spec: setattr(spec.option, "gravity", down))
    q = stream(2).uniform(-1.5, 1.5, 7)
    world = World().add(EffectInstance.of("gravity_tilt", "base", roll=roll, pitch=pitch))
    np.testing.assert_allclose(dynamics(ROBOT, world, q, 0)[2], dynamics(other, World(), q, 0)[2], atol=1e-10)


def test_payload_holds_the_torque_of_its_weight():
    """Gravity torque of the payload alone: `-J' m g` at its centre, J by finite differences of the kinematics."""
    mass, offset = 1.7, np.array([0.04, -0.06, 0.1])
    q = stream(3).uniform(-1.0, 1.0, 7)
    world = World().add(EffectInstance.of("payload", "flange", mass=mass, x=offset[0], y=offset[1], z=offset[2]))
    extra = dynamics(ROBOT, world, q, 0)[2] - dynamics(ROBOT, World(), q, 0)[2]
    model = ROBOT.compile()

    def height(q):
        data = mujoco.MjData(model)
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        site = data.site("flange")
        return (site.xpos + site.xmat.reshape(3, 3) @ offset)[2]

    slope = [(height(q + d) - height(q - d)) / 2e-6 for d in np.eye(7) * 1e-6]
    np.testing.assert_allclose(extra, mass * 9.81 * np.array(slope), atol=1e-6)
