"""A seven-joint fit of dry friction and armature: `mujoco.sysid` and vispeg on the same recordings, in one run.

    python scripts/bench/sysid.py [--seconds 5] [--steps 2 1 0.5]

The truth is plain MuJoCo at 0.1 ms steps under a 500 Hz joint servo with nominal gravity: neither side's own loop. Both
fit 14 parameters from the same start values and bounds to two recordings, in one thread, comparing angles in units of
their noise from 0.4 s on. `mujoco.sysid` simulates the servo as MuJoCo actuators with gravity compensated, each of its
rows at another physics step; its optimizer is its default one. Both results are judged on a third recording, by one
judge (vispeg's rollout at 0.5 ms) and by their own simulator.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.calibrate import calibrate
from vispeg.identify.evidence import Evidence
from vispeg.identify.excitation import motion
from vispeg.identify.fit import fit_job
from vispeg.identify.pool import run_together
from vispeg.identify.record import centre_of, controller
from vispeg.recordings.recording import Control, Recording
from vispeg.robots.model import RobotModel, load
from vispeg.sim.compiled import compiled, nominal_of
from vispeg.sim.segments.segment import segments
from vispeg.worlds.world import World

FRICTION = np.array([1.5, 2.0, 0.8, 1.2, 0.5, 0.4, 0.25])  # N m
ARMATURE = np.array([0.4, 0.5, 0.3, 0.3, 0.1, 0.08, 0.04])  # kg m^2
START = {"coulomb_friction": ("torque", 0.2), "rotor_inertia": ("inertia", 0.05)}
NOISE = 2e-5  # rad
TICK, FINE = 2e-3, 1e-4  # s


def gains(control: Control) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness N m/rad and damping N m s/rad (nj,) of a joint servo."""
    if control.kp is None or control.kd is None:
        raise ValueError("not a servo")
    return control.kp, control.kd


def truth(robot: RobotModel, control: Control, seconds: float, seed: int) -> Recording:
    """Return a recording of plain MuJoCo with friction and armature, read with noise that is not fed back."""
    kp, kd = gains(control)
    m = motion("fourier", robot, 1 / TICK, seconds, stream(seed, "sysid", "motion"))
    model = robot.spec().compile()
    model.opt.timestep, model.opt.integrator = FINE, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_frictionloss[:], model.dof_armature[:] = FRICTION, ARMATURE
    model.dof_solref[:], model.dof_solimp[:] = (2 * FINE, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
    data, nominal = mujoco.MjData(model), nominal_of(robot, 1)
    data.qpos[:], data.qvel[:] = m.q_cmd[0], m.dq_cmd[0]
    q = np.empty_like(m.q_cmd)
    for k in range(len(q)):
        q[k] = data.qpos
        servo = kp * (m.q_cmd[k] - q[k]) + kd * (m.dq_cmd[k] - data.qvel)
        data.ctrl[:] = servo + nominal.gravity(q[k][None])[0]
        mujoco.mj_step(model, data, nstep=round(TICK / FINE))
    q += stream(seed, "sysid", "noise").normal(scale=NOISE, size=q.shape)
    return Recording(
        Path(f"rec-{seed}"), "iiwa14", robot.joints, 1 / TICK, control, m.time, q, q_cmd=m.q_cmd, dq_cmd=m.dq_cmd,
        noise={"q": NOISE},
    )  # fmt: skip


def world(robot: RobotModel, values: dict[str, np.ndarray]) -> World:
    """Return the nominal arm with both effects in every joint."""
    return World().add(
        *(EffectInstance.of(name, j, **{START[name][0]: float(x)}) for name, v in values.items()
          for j, x in zip(robot.joints, v, strict=True))
    )  # fmt: skip


class Sysid:
    """The same arm and servo for `mujoco.sysid`, at one physics step.

    One actuator a joint: `kp u - kp q - kd dq` with `u = q_cmd + kd / kp dq_cmd`, and bodies with `gravcomp` 1.
    """

    def __init__(self, robot: RobotModel, control: Control, h: float):
        self.robot, self.h = robot, h
        self.kp, self.kd = gains(control)
        self.spec = robot.spec()
        self.spec.option.timestep = h
        self.spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        for body in self.spec.bodies[1:]:
            body.gravcomp = 1.0
        for j, name in enumerate(robot.joints):
            a = self.spec.actuator(name)
            a.gaintype, a.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
            a.gainprm[0] = self.kp[j]
            a.biasprm[:3] = [0.0, -self.kp[j], -self.kd[j]]
            joint = self.spec.joint(name)
            joint.solref_friction, joint.solimp_friction = (2 * h, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
            self.spec.add_sensor(
                name=name, type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
            )

    def parameters(self) -> sysid.ParameterDict:
        """Return the 14 parameters, with vispeg's start values and bounds."""
        out = sysid.ParameterDict()
        for name, field in (("coulomb_friction", "frictionloss"), ("rotor_inertia", "armature")):
            param, start = START[name]
            p = effect(name).params[param]
            for joint in self.robot.joints:

                def write(spec, value, joint=joint, field=field):
                    setattr(spec.joint(joint), field, float(value.value[0]))

                out.add(sysid.Parameter(f"{field}.{joint}", start, p.low, p.high, modifier=write))
        return out

    def residual(self, recs: list[Recording]):
        """Return the residual function over recordings; angles in units of noise."""
        model = self.spec.compile()
        sequences = []
        for rec in recs:
            s = segments(rec)[0]
            u = s.command
            u = u["q_cmd"] + self.kd / self.kp * u["dq_cmd"]
            held = np.repeat(u, round(TICK / self.h), axis=0)
            control = sysid.TimeSeries.from_control_names(np.arange(len(held)) * self.h, held, model)
            sensors = sysid.TimeSeries.from_names(rec.time, rec.q, model)
            sequences.append(
                sysid.ModelSequences(
                    rec.path.name, self.spec, rec.path.name,
                    sysid.create_initial_state(model, s.q[0], s.dq[0]), control, sensors,
                )
            )  # fmt: skip
        every = round(TICK / self.h)

        def whiten(params, predicted, measured, model, return_pred_all, state):
            q = state[every - 1 :: every, 1 : 1 + model.nq]  # the state after k ticks, k = 1, 2, ...
            n = min(len(q), len(measured.times) - 1)
            keep = measured.times[1 : n + 1] >= RULES.settle
            r = (q[:n] - measured.data[1 : n + 1])[keep] / NOISE
            return r, predicted, predicted

        return sysid.build_residual_fn(
            models_sequences=sequences, modify_residual=whiten, n_threads=1, resample_true=False
        )


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--steps", type=float, nargs="+", default=[2.0, 1.0, 0.5], help="of mujoco.sysid, ms")
    args = parser.parse_args()
    robot = load("iiwa14")
    control = controller(robot, "position", 1 / TICK, centre_of(robot))
    recs = [truth(robot, control, args.seconds, seed) for seed in range(3)]
    compiled(robot)
    judge = Evidence(recs[2:], h_max=5e-4)

    def judged(found: World) -> float:
        return judge.rms_error(judge.residuals([found])[0]) * 1e6

    def row(name: str, seconds: float, cpu: float, found: World, own: float) -> None:
        values = [np.array([v.value for e in found.effects if e.effect == n for v in e.params.values()]) for n in START]
        off = [np.abs(v / t - 1).max() * 100 for v, t in zip(values, (FRICTION, ARMATURE), strict=True)]
        print(
            f"| {name} | {seconds:.1f} | {cpu:.1f} | {judged(found):.1f} | {own:.1f} | {off[0]:.2g} | {off[1]:.2g} |",
            flush=True,
        )

    print("| fit | wall, s | processor, s | held out, urad | own simulator, urad | friction off by at most, % | "
          "armature, % |\n|---|---|---|---|---|---|---|")  # fmt: skip
    start = world(robot, {name: np.full(7, v) for name, (_, v) in START.items()})
    true = judged(world(robot, dict(zip(START, (FRICTION, ARMATURE), strict=True))))
    print(f"| start values | | | {judged(start):.0f} | | | |\n| truth | | | {true:.1f} | | | |", flush=True)
    for h, steps in ((2e-3, 4), (2e-3, None), (1e-3, None)):
        begin, cpu = time.perf_counter(), time.process_time()
        evidence = Evidence(recs[:2], h_max=h)
        if steps is None:  # as `vispeg fit` does it
            found = calibrate(evidence, start, range(14), seed=0, method="least-squares").fit.world
        else:  # as a diagnosis does it
            found = run_together([fit_job(evidence, start, range(14), iterations=steps)], evidence.residuals)[0].world
        spent = time.perf_counter() - begin, time.process_time() - cpu
        own = Evidence(recs[2:], h_max=h)
        name = f"vispeg, {h * 1e3:g} ms" + (f", {steps} steps" if steps else "")
        row(name, *spent, found, own.rms_error(own.residuals([found])[0]) * 1e6)
    for h in np.array(args.steps) * 1e-3:
        side = Sysid(robot, control, h)
        begin, cpu = time.perf_counter(), time.process_time()
        with contextlib.redirect_stdout(sys.stderr):  # its optimizer prints its iterations
            params, _ = sysid.optimize(side.parameters(), side.residual(recs[:2]), verbose=False)
        spent = time.perf_counter() - begin, time.process_time() - cpu
        x = params.as_vector()
        r = np.concatenate(side.residual(recs[2:])(x, params)[0])
        found = world(robot, dict(zip(START, (x[:7], x[7:]), strict=True)))
        row(f"mujoco.sysid, {h * 1e3:g} ms", *spent, found, float(np.sqrt(np.mean(r**2))) * NOISE * 1e6)


if __name__ == "__main__":
    main()
