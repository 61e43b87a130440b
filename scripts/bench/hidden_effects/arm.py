"""The rigid nominal arm of the hidden plant, written out from its published table, SI units.

Source of the numbers: MuJoCo Menagerie `kuka_iiwa_14` (BSD-3-Clause). It is a second, independent transcription: the
project's own nominal model is not imported, so a slip in either shows up as a residual of the effect-free cases.
"""

from __future__ import annotations

import mujoco
import numpy as np

JOINTS = tuple(f"joint{i}" for i in range(1, 8))
#         pos in parent        quat in parent mass  centre of mass           diagonal inertia         range
LINKS = (
    ((0, 0, 0.1575), (1, 0, 0, 0), 5.76, (0, -0.03, 0.12), (0.0333, 0.033, 0.0123), 2.96706),
    ((0, 0, 0.2025), (0, 0, 1, 1), 6.35, (0.0003, 0.059, 0.042), (0.0305, 0.0304, 0.011), 2.0944),
    ((0, 0.2045, 0), (0, 0, 1, 1), 3.5, (0, 0.03, 0.13), (0.025, 0.0238, 0.0076), 2.96706),
    ((0, 0, 0.2155), (1, 1, 0, 0), 3.5, (0, 0.067, 0.034), (0.017, 0.0164, 0.006), 2.0944),
    ((0, 0.1845, 0), (0, 0, 1, 1), 3.5, (0.0001, 0.021, 0.076), (0.01, 0.0087, 0.00449), 2.96706),
    ((0, 0, 0.2155), (1, 1, 0, 0), 1.8, (0, 0.0006, 0.0004), (0.0049, 0.0047, 0.0036), 2.0944),
    ((0, 0.081, 0), (0, 0, 1, 1), 1.2, (0, 0, 0.02), (0.001, 0.001, 0.001), 3.05433),
)
FLANGE = np.array([0.0, 0.0, 0.045])  # m, in link7
VELOCITY_LIMIT = np.array([1.4835, 1.4835, 1.7453, 1.3090, 2.2689, 2.3562, 2.3562])  # rad/s
RANGE = np.array([[-link[5], link[5]] for link in LINKS])  # rad


class Arm:
    """What a motion generator asks of a robot: joints, range (7, 2) rad, velocity_limit (7,) rad/s."""

    joints = JOINTS
    range = RANGE
    velocity_limit = VELOCITY_LIMIT


def rigid(
    mass: dict[str, float] | None = None,
    com: dict[str, np.ndarray] | None = None,
    payload: tuple[float, np.ndarray] | None = None,
    tilt: tuple[float, float] = (0.0, 0.0),
) -> mujoco.MjModel:
    """Return the bare arm without limits, contacts, actuators or passive forces.

    Args:
        mass: kg added to a link; its inertia about its centre of mass grows in proportion.
        com: m added to a link's centre of mass, in the link frame.
        payload: kg and centre (3,) m in the flange frame, a steel ball.
        tilt: roll and pitch of the base, rad: gravity is (Rx(roll) Ry(pitch))' (0, 0, -9.81).
    """
    mass, com = mass or {}, com or {}
    spec = mujoco.MjSpec()
    (sr, sp), (cr, cp) = np.sin(tilt), np.cos(tilt)
    spec.option.gravity = -9.81 * np.array([-sp * cr, sr, cp * cr])  # third row of Rx Ry
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    body = spec.worldbody
    for i, (pos, quat, m, c, inertia, _) in enumerate(LINKS):
        name = f"link{i + 1}"
        body = body.add_body(name=name, pos=pos, quat=np.array(quat) / np.linalg.norm(quat))
        body.add_joint(name=JOINTS[i], type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        grown = m + mass.get(name, 0.0)
        centre = np.array(c, float) + com.get(name, 0.0)
        tensor = np.diag(inertia) * grown / m
        if payload is not None and i == 6:
            grown, centre, tensor = _joined(grown, centre, tensor, payload[0], FLANGE + payload[1])
        body.explicitinertial = True
        body.mass, body.ipos = grown, centre
        body.fullinertia = [tensor[0, 0], tensor[1, 1], tensor[2, 2], tensor[0, 1], tensor[0, 2], tensor[1, 2]]
    body.add_site(name="flange", pos=FLANGE)
    return spec.compile()


def _joined(m: float, c: np.ndarray, tensor: np.ndarray, add: float, at: np.ndarray) -> tuple:
    """Return mass, centre and inertia about it after a steel ball of `add` kg is fixed at `at` (3,) m (Steiner)."""
    radius = (3.0 * add / (4.0 * np.pi * 7850.0)) ** (1.0 / 3.0)
    total = m + add
    centre = (m * c + add * at) / total
    out = tensor + 0.4 * add * radius**2 * np.eye(3)
    for part, place in ((m, c), (add, at)):
        d = place - centre
        out = out + part * (d @ d * np.eye(3) - np.outer(d, d))
    return total, centre, out
