"""The last judge of a contact model: a whole insertion run again under the controller that ran, in closed loop.

The search compares wrenches along a measured path; nothing there says what a tool would have done by itself. Here arm,
controller and cell of a model run the commanded poses of a held-out insertion from its first sample on, and peak force,
time in contact and outcome are set beside the measured ones. Paths part where contacts come and go, so that it judges
what was accepted and fits nothing.
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

MOST = 1  # episodes that are run again: a second of one takes about a third of a processor second a model


def closed_loop(
    recordings: Sequence[Recording], models: Mapping[str, World], nthread: int = 1
) -> tuple[list[Replayed], list[str]]:
    """Held-out insertions against models that ran them.

    Args:
        recordings: those under mode osc whose `outcomes` say how they ended are run again, `MOST` at most.
        models: by name.
        nthread: of the simulation.

    Returns:
        An entry an episode, `measured` first among its trials, and notes on those that cannot be run.
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
    """Give the first episode alone."""
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
    above = before & (measured.tip[:n, 2] > 0)  # of the goal: inside, a tip is pushed by less than counts as a touch
    off = np.linalg.norm(run.tip[:n][above] - measured.tip[:n][above], axis=1)
    out: Trial = {
        "peak_force": float(np.nanmax(run.force)),
        "contact_s": float(np.sum(run.touching)) / rate,
        "outcome": outcome.category or ("success" if outcome.success else "failure"),
    }
    if np.isfinite(off).any():
        out["free_off"] = float(np.sqrt(np.nanmean(off**2)))
    return out
