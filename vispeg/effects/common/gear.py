"""The motor side of a gear: one step of a rotor coupled to the link by a spring and damper.

The effects `joint_elasticity` and `backlash` use it. MuJoCo's own mechanism is a second coaxial hinge, which changes
the structure of the model and needs a step far below 1 ms on a light wrist or rotor. This step solves the equations of
both sides exactly, so that it is stable and accurate however fast the rotor swings against the link.
"""

from __future__ import annotations

import numpy as np

STEP = 1e-3  # s: at 2 ms a light link that swings, hardly damped, on a heavy rotor is unstable (iiwa14, joint 7)


def coasting(x, last, before):
    """Predict the link's motion over the coming step if the gear transmits nothing in it.

    `Plant` is a leapfrog: a step's acceleration is the mean of its torque's and the last one's. So `x.ddq` contains
    the gear's last two torques, and `x.dq` half of each over half a step, where the link has felt the last alone.

    Args:
        x: the state of the batch.
        last, before: (nsim, nj) N m, this gear's torque in the last step and in the one before.

    Returns:
        the velocity at the start of the step, rad/s, and the acceleration, rad/s^2, both (nsim, nj).
    """
    return x.dq + 0.25 * x.h * (last - before) / x.inertia, x.ddq - 0.5 * (last + before) / x.inertia


def coupled(x, compliance, relaxation, inertia):
    """Return what `motor_step` and `followed` need of a gear, for a state that they keep: its constants.

    Args:
        x: the state of the batch at the start; its `h` and `inertia` stay.
        compliance: rad/(N m), above 0.
        relaxation: time constant of the gear's damping, s.
        inertia: of the motor, reflected to the link, kg m^2, above 0.

    Returns:
        the motor's inertia; `_decay` of motor and link; and by what angle, and velocity (1/s), the motor alone follows
        a link that goes 1 rad farther in a step, under constant acceleration. All are (nsim, nj).
    """
    inertia = inertia + np.zeros_like(x.q)
    both = _decay(x.h, inertia * x.inertia / (inertia + x.inertia), compliance, relaxation)
    kept, moved, _, _, stiffness = _decay(x.h, inertia, compliance, relaxation)
    acceleration = 2.0 / x.h**2
    return inertia, both, (1.0 - acceleration * (1.0 - kept) / stiffness, acceleration * (x.h - moved))


def _decay(h, inertia, compliance, relaxation):
    """Return the free motion of `inertia u' + (delta + relaxation u) / compliance = 0`, `delta' = u`, after h seconds.

    Returns:
        the shares of `delta` and of `u` that become `delta`, those that become `u`, and 1 / (inertia compliance); all
        are (nsim, nj).
    """
    stiffness = 1.0 / (inertia * compliance)
    damping = 0.5 * relaxation * stiffness
    swing = np.sqrt(damping**2 - stiffness + 0j)
    swing = np.where(np.abs(swing) * h > 1e-6, swing, 1e-6 / h)  # at critical damping both roots are one
    slow, fast = -stiffness / (damping + swing), -damping - swing
    decayed = np.exp(slow * h)
    moved = decayed * -np.expm1(-2.0 * swing * h) / (2.0 * swing)
    return (
        (decayed - slow * moved).real,
        moved.real,
        (-stiffness * moved).real,
        (decayed + fast * moved).real,
        stiffness,
    )


def followed(theta, omega, link, x, gear):
    """Return the motor's angle and velocity after a step that the link ended at x.q, and not at `link` as expected.

    The difference is due to an acceleration that `coasting` did not know of. A light rotor follows it at once, a heavy
    one hardly. What the gear gives the rotor for it is not yet taken from the link: `motor_step` does.
    """
    off, (_, _, (angle, velocity)) = x.q - link, gear
    return theta + angle * off, omega + velocity * off


def motor_step(theta, omega, link, tau, x, coast, offset, gear):
    """Advance the rotor by a step: `J d(omega)/dt = tau - s`, `s = (delta + relaxation d(delta)/dt) / compliance`.

    `delta = theta - q - offset` is the stretch; the link moves by `I d(dq)/dt = I a + s`. Over the step tau and a are
    constant, so the difference of both equations is a linear oscillator, which is solved in closed form, and their sum
    is the momentum of both. All arrays are (nsim, nj).

    Args:
        theta, omega: motor angle and velocity divided by the gear ratio as the last step left them, rad and rad/s.
        link: the link's angle as the last step expected it, rad.
        tau: motor torque, N m.
        x: the state of the batch.
        coast: the link's velocity and acceleration without this gear's torque, see `coasting`.
        offset: stretch at which the spring is slack, rad (half of a free play, with the side's sign).
        gear: see `coupled`.

    Returns:
        the new angle and velocity, the link's expected angle, and the gear's mean torque on the link, N m.
    """
    velocity, acceleration = coast
    inertia, (kept, moved, pulled, slowed, stiffness), _ = gear
    both = inertia + x.inertia
    rest = (tau / inertia - acceleration) / stiffness
    theta, turning = followed(theta, omega, link, x, gear)
    stretch, rate = theta - x.q - offset - rest, turning - velocity
    wound = offset + rest + stretch * kept + rate * moved
    momentum = inertia * omega + x.inertia * velocity
    after = momentum + x.h * (tau + x.inertia * acceleration)
    new = (after + x.inertia * (stretch * pulled + rate * slowed)) / both
    middle = inertia * theta + x.inertia * x.q + 0.5 * x.h * (momentum + after)
    theta = (middle + x.inertia * wound) / both
    return theta, new, theta - wound, tau - inertia * (new - omega) / x.h


def free_step(theta, omega, tau, x, inertia):
    """Advance by one step inside the backlash gap, where the motor turns only its own inertia (> 0).

    Arguments are as in `motor_step`. Return the new angle and velocity.
    """
    new = omega + x.h * tau / inertia
    return theta + 0.5 * x.h * (omega + new), new
