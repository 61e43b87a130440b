"""Warnings that are held back, and a profiler that stands still; an interrupt in the middle is an ordinary one."""

import signal
import subprocess
import sys
import time

import mujoco

from vispeg.sim.quiet import quiet

DIVERGING = """
import signal
import mujoco
from mujoco.batch import Batch
from vispeg.sim.quiet import quiet

signal.signal(signal.SIGINT, signal.default_int_handler)  # whoever began the tests in the background ignores it
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
batch = Batch(mujoco.MjModel.from_xml_string(BALL), nsim=2000, nthread=1)
times = 0
while times < 5:
    try:
        with quiet():
            print("runs", flush=True)
            while True:
                batch.reset(stage=0)
                batch.qvel[:] = 1e11  # every simulation warns in this step
                batch.step()
                assert (batch.warning[..., 1] > 0).any(axis=1).all()
    except KeyboardInterrupt:
        times += 1
print("ends")
"""


def test_an_interrupt_while_simulations_diverge_is_raised_in_python():
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    child = subprocess.Popen([sys.executable, "-c", DIVERGING], **pipe)
    for k in range(5):
        assert child.stdout.readline() == "runs\n", child.stderr.read()
        time.sleep(0.05 + 0.007 * k)  # into a step, where it is nine tenths of its time
        child.send_signal(signal.SIGINT)
    said, error = child.communicate(timeout=60)
    assert (child.returncode, said, error) == (0, "ends\n", "")


def test_mujocos_profiler_stands_still_while_quiet_and_runs_on_afterwards():
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    data, step = mujoco.MjData(model), mujoco.mjtTimer.mjTIMER_STEP.value
    mujoco.mj_step(model, data, 10)
    spent = data.timer[step].duration
    with quiet():
        mujoco.mj_step(model, data, 10)
    assert data.timer[step].duration == spent > 0
    mujoco.mj_step(model, data, 10)
    assert data.timer[step].duration > spent
