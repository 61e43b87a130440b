"""Simulate recordings of a cell again in closed loop: the recorded controller and commands, in other worlds.

This is the final check of a contact model. It is not used for fits: at the edge of the goal a small difference decides
which path the tip takes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.noise import noise_of
from vispeg.recordings.recording import Recording
from vispeg.sim.segments.segment import start_state
from vispeg.task.belief import recorded_cell
from vispeg.task.rig.run import STEP, Ran, run
from vispeg.worlds.world import World


def replay(rec: Recording, worlds: Sequence[World], *, h_max: float = STEP, nthread: int = 1) -> list[Ran]:
    """Simulate each episode again in the recording's believed cell.

    Args:
        rec: recorded under a controller of mode osc, with one sample per tick of the controller.
        worlds: their effects are added to those that the recording states for its cell.
        h_max: greatest physics step, s. A simulated recording without noise is reproduced bit for bit if its world is
            the only one and `h_max` is that of `record_cell`; beside other worlds, MuJoCo's solver takes a few more or
            fewer iterations.
        nthread: threads of the simulation.

    Returns:
        The sensors' readings in all worlds, one entry per episode.

    Raises:
        UserError: another controller, no commanded flange poses, or samples that are not the controller's ticks.
    """
    if rec.control.mode != "osc":
        file = rec.path / "recording.yaml"
        raise UserError("cannot be replayed", file=file, key="control.mode", expected="osc", got=rec.control.mode)
    if rec.ee_cmd is None:
        raise UserError("cannot be replayed without commanded flange poses", file=rec.path, expected="columns ee_cmd.*")
    belief = recorded_cell(rec)
    plants = [belief.world.add(*world.effects) for world in worlds]
    number = np.zeros(len(rec.time), int) if rec.episode is None else rec.episode
    out, clock = [], rec.elapsed
    for n in np.unique(number):
        rows = np.flatnonzero(number == n)
        _on_clock(rec, rows)
        q, dq = _start(rec, rows)
        options = {"begun": float(clock[rows[0]]), "h_max": h_max, "nthread": nthread}
        out.append(run(belief.scene, plants, rec.control, rec.ee_cmd[rows], q, dq, **options))
    return out


def _on_clock(rec: Recording, rows: np.ndarray) -> None:
    """Raise UserError if the time between two of these rows differs from the controller's period by more than 5 %."""
    step = np.diff(rec.time[rows]) * rec.control.rate_hz
    if len(step) and np.abs(step - 1).max() > 0.05:
        raise UserError("samples are not the controller's ticks", file=rec.path, expected=f"{rec.control.rate_hz:g} Hz")


def _start(rec: Recording, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the joint angles and velocities, (nj,) rad and rad/s, with which the episode in `rows` begins.

    If the recording states no noise of angles, they are those of its first row (velocities that were not recorded are
    taken as 0), else they are estimated from the first samples.
    """
    if "q" not in rec.noise:
        return rec.q[rows[0]], np.zeros(len(rec.joints)) if rec.dq is None else rec.dq[rows[0]]
    return start_state(rec.time[rows], rec.q[rows], noise_of(rec)["q"])
