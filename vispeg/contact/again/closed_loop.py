"""Final check of a contact model: simulate a whole insertion again in closed loop with the recorded controller.

The search compares wrenches along a measured path, which does not show how the tool would have moved by itself. Here
arm, controller and cell of a model follow the commanded poses of a held-out insertion from its first sample on, and
peak force, time in contact and outcome are compared with the measured ones. Trajectories diverge where contacts begin
and end, so this checks the final model and is not used in a fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.inputs import touching
from vispeg.contact.torques import calm
from vispeg.core.errors import UserError
from vispeg.diagnosis.schema import Replayed, Trial
from vispeg.recordings.cell import Outcome, WrenchSensor
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.touch import Touch, touch
from vispeg.task.belief import recorded_cell
from vispeg.task.registry import task_of
from vispeg.worlds.world import World

MOST = 1  # largest number of simulated episodes; 1 s of an episode takes a third of a CPU second per model


def closed_loop(
    recordings: Sequence[Recording], models: Mapping[str, World], nthread: int = 1
) -> tuple[list[Replayed], list[str]]:
    """Simulate held-out insertions with models, and compare the outcomes.

    Args:
        recordings: held-out ones. The first episode of those under operational space control (`osc`) with commanded
            poses and stated `outcomes` is simulated, of at most `MOST` recordings.
        models: the models by name.
        nthread: threads of the simulation.

    Returns:
        One entry per episode, with `measured` as its first trial, and messages on episodes that cannot be simulated.
    """
    out: list[Replayed] = []
    notes: list[str] = []
    for rec in recordings:
        if len(out) == MOST or not rec.outcomes or rec.control.mode != "osc" or rec.ee_cmd is None:
            continue
        try:
            out.append({"recording": rec.name, "trials": _trials(first_episode(rec), models, nthread)})
        except UserError as error:
            notes.append(f"not run again in closed loop: {error}")
    return out, notes


def _trials(rec: Recording, models: Mapping[str, World], nthread: int) -> dict[str, Trial]:
    """Return the trials of an episode: the measured one, and those simulated with the models.

    Raises:
        UserError: the recorded cell or a model cannot be simulated, or a run has no finite contact force.
    """
    cell = recorded_cell(rec)
    runs = {name: task_of(cell.config).again(rec, world, nthread) for name, world in models.items()}
    simulated = {name: run for name, run in runs.items() if run is not None}
    if len(simulated) < len(runs):
        raise UserError("its task cannot simulate a recorded episode", key=rec.name)
    sensed = touching(rec)
    read = sensed.recording if sensed.torques is None else calm(sensed.recording, sensed.torques)
    measured = _contact(read, cell.scene)
    trials = {"measured": _trial(measured, measured, read.rate_hz, rec.outcomes[0])}
    for name, (q, ft, outcome) in simulated.items():
        run = _contact(replace(read, q=q, ft=ft, wrench=WrenchSensor()), cell.scene)
        trials[name] = _trial(run, measured, read.rate_hz, outcome)
    return trials


def first_episode(rec: Recording) -> Recording:
    """Return the part of a recording that is the episode of its first outcome, with that outcome alone."""
    if rec.episode is None:
        return rec
    return replace(rec.some(rec.episode == rec.outcomes[0].episode), outcomes=rec.outcomes[:1])


def _contact(rec: Recording, scene: Scene) -> Touch:
    """Return the contact along a recording that has a wrench."""
    contact = touch(rec, scene)
    assert contact is not None
    return contact


def _trial(run: Touch, measured: Touch, rate: float, outcome: Outcome) -> Trial:
    """Summarise one run: peak contact force N, time in contact s, outcome, and RMS distance m to the measured tip.

    The distance is taken in free air above the goal, before either run touches anything; it is left out if it is
    unknown. `rate` is that of the samples, Hz.

    Raises:
        UserError: no contact force of the run is finite.
    """
    if not np.isfinite(run.force).any():
        raise UserError("no contact force is finite")
    n = min(len(run.tip), len(measured.tip))
    untouched = ~np.logical_or.accumulate(run.touching[:n] | measured.touching[:n])
    free = untouched & (measured.tip[:n, 2] > 0)  # above the goal's mouth: inside, contact may be undetectable
    off = np.linalg.norm(run.tip[:n][free] - measured.tip[:n][free], axis=1)
    out: Trial = {
        "peak_force": float(np.nanmax(run.force)),
        "contact_s": float(np.sum(run.touching)) / rate,
        "outcome": outcome.category or ("success" if outcome.success else "failure"),
    }
    if np.isfinite(off).any():
        out["free_off"] = float(np.sqrt(np.nanmean(off**2)))
    return out
