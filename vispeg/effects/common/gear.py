"""The motor side of a gear: one implicit step of a rotor coupled to the link by a spring and damper.

The effects `joint_elasticity` and `backlash` use it. MuJoCo's own mechanism is a second coaxial hinge, which changes
the structure of the model and needs a step far below 1 ms on a light wrist. This step is stable there, because it
contains the link's response to the gear torque.
"""

from __future__ import annotations

# weight of the step's end in the spring's mean stretch: 0.5 would be of second order, a little more damps oscillations
# that the step does not resolve
WEIGHT = 0.55


def coasting(x, before):
    """Predict the link's mean velocity over the coming step if the gear transmits nothing in it, (nsim, nj) rad/s.

    `Plant` is a leapfrog: the velocity in the middle of a step is that in the middle of the last one, plus the mean of
    the two steps' torques over the inertia. So `x.ddq` contains the gear's last two torques, and of those without which
    the link would coast, the last still acts for half a step and cancels; the one before it remains. With the last in
    its place the step lags its own torque, and light links under stiff teeth become unstable (1 ms, iiwa14's wrist).

    Args:
        x: the state of the batch.
        before: (nsim, nj) N m, this gear's torque in the last step but one.
    """
    return x.dq + 0.5 * x.h * (x.ddq - before / x.inertia)


def motor_step(theta, omega, tau, x, link, offset, compliance, relaxation, inertia):
    """Advance the rotor by a step: `J d(omega)/dt = tau - s`, `s = (delta + relaxation d(delta)/dt) / compliance`.

    `delta = theta - q - offset` is the stretch. All arrays are (nsim, nj).

    Args:
        theta, omega: motor angle and velocity divided by the gear ratio, rad and rad/s.
        tau: motor torque, N m.
        x: the state of the batch.
        link: the link's mean velocity over the step without this gear's torque, see `coasting`, rad/s.
        offset: stretch at which the spring is slack, rad (half of a free play, with the side's sign).
        compliance: rad/(N m), above 0.
        relaxation: time constant of the gear's damping, s.
        inertia: of the motor, reflected to the link, kg m^2, above 0; the results at 0 are finite and mean nothing.

    Returns:
        the new angle and velocity, and the gear torque s on the link, N m.
    """
    ratio = inertia / x.inertia
    lag = WEIGHT * x.h + relaxation
    delta = theta - x.q - offset
    momentum = 2.0 * inertia * compliance / x.h
    # mean rate of the stretch, from the rotor's equation over the step: 2 J (mean - omega) / h = tau - gear
    rate = (compliance * tau - (1.0 + ratio) * delta - momentum * (link - omega)) / (momentum + lag * (1.0 + ratio))
    gear = (delta + lag * rate) / compliance
    mean = rate + link + 0.5 * x.h * gear / x.inertia  # mean motor velocity over the step
    return theta + x.h * mean, 2.0 * mean - omega, gear


def free_step(theta, omega, tau, x, inertia):
    """Advance by one step inside the backlash gap, where the motor turns only its own inertia (> 0).

    Arguments are as in `motor_step`. Return the new angle and velocity.
    """
    new = omega + x.h * tau / inertia
    return theta + 0.5 * x.h * (omega + new), new
