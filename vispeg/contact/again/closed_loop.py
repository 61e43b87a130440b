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

MOST = 1  # largest number of episodes; 1 s of one takes about a third of a CPU second per model


def closed_loop(
    recordings: Sequence[Recording], models: Mapping[str, World], nthread: int = 1
) -> tuple[list[Replayed], list[str]]:
    """Simulate held-out insertions with models, and compare the outcomes.

    Args:
        recordings: those in mode osc with stated `outcomes` are simulated, at most `MOST`.
        models: the models by name.
        nthread: threads of the simulation.

    Returns:
        One entry per episode, with `measured` as its first trial, and messages on episodes that cannot be simulated.
    """
    out: list[Replayed] = []
    said: list[str] = []
    for rec in recordings:
        if len(out) == MOST or not rec.outcomes or rec.control.mode != "osc" or rec.ee_cmd is None:
            continue
        episode, cell = _first(rec), recorded_cell(rec)
        try:
            runs = {name: task_of(cell.config).again(episode, world, nthread) for name, world in models.items()}
        except UserError as error:
            said.append(f"not run again in closed loop: {error}")
            continue
        played = {name: ran for name, ran in runs.items() if ran is not None}
        if len(played) < len(runs):
            said.append(f"{rec.name}: not run again in closed loop: its task cannot play a recording again")
            continue
        felt = touching(episode)
        read = felt.recording if felt.torques is None else calm(felt.recording, felt.torques)
        way = _felt(read, cell.scene)
        trials = {"measured": _trial(way, way, read.rate_hz, rec.outcomes[0])}
        for name, ran in played.items():
            same = replace(read, q=ran[0], ft=ran[1], wrench=WrenchSensor())
            trials[name] = _trial(_felt(same, cell.scene), way, read.rate_hz, ran[2])
        out.append({"recording": rec.name, "trials": trials})
    return out, said


def _first(rec: Recording) -> Recording:
    """Return a recording of the first episode alone."""
    if rec.episode is None:
        return rec
    rows = np.flatnonzero(rec.episode == rec.outcomes[0].episode)
    columns = ("time", "q", "dq", "tau", "tau_cmd", "ee", "ee_cmd", "ft", "episode", "q_cmd", "dq_cmd", "load")
    cut = {name: getattr(rec, name)[rows] for name in columns if getattr(rec, name) is not None}
    return replace(rec, **cut, outcomes=rec.outcomes[:1])


def _felt(rec: Recording, scene: Scene) -> Touch:
    felt = touch(rec, scene)
    assert felt is not None
    return felt


def _trial(run: Touch, measured: Touch, rate: float, outcome: Outcome) -> Trial:
    """Summarise one run: peak wrist force, time in contact, distance of the tip from the measured one, outcome."""
    n = min(len(run.tip), len(measured.tip))
    before = ~np.logical_or.accumulate(run.touching[:n] | measured.touching[:n])
    above = before & (measured.tip[:n, 2] > 0)  # relative to the goal's mouth; inside, contact may be undetectable
    off = np.linalg.norm(run.tip[:n][above] - measured.tip[:n][above], axis=1)
    out: Trial = {
        "peak_force": float(np.nanmax(run.force)),
        "contact_s": float(np.sum(run.touching)) / rate,
        "outcome": outcome.category or ("success" if outcome.success else "failure"),
    }
    if np.isfinite(off).any():
        out["free_off"] = float(np.sqrt(np.nanmean(off**2)))
    return out
