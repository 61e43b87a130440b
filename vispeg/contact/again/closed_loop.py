"""Final check of a contact model: simulate a whole insertion again in closed loop with the recorded controller.

The search compares wrenches along a measured path, which does not show how the tool would have moved by itself. Here
arm, controller and cell of a model follow the commanded poses of a held-out insertion from its first sample on, and
peak force, time in contact and outcome are compared with the measured ones. Trajectories diverge where contacts begin
and end, so this checks the final model and is not used in a fit: if its outcome differs, an effect is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.inputs import touching
from vispeg.contact.selection.repeats import repeats
from vispeg.contact.torques import calm
from vispeg.core.errors import UserError
from vispeg.core.rules import RULES
from vispeg.diagnosis.findings import Verdict, left_unexplained
from vispeg.diagnosis.schema import Replayed, Trial
from vispeg.recordings.cell import Outcome, WrenchSensor
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import Thresholds
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


def contradicted(
    verdict: Verdict,
    replayed: Sequence[Replayed],
    held_out: Sequence[Recording],
    world: World,
    n_fixed: int,
    threads: int,
) -> Verdict:
    """Change a verdict to `unexplained` if no simulation of the corrected model comes near the measured insertion.

    It is simulated at its values, and with each value in turn at either end of its interval. It counts only if the arm
    alone follows its measured path, since an error of the arm is no evidence on contact. Even the correct model's peak
    force is slightly off, and uncertain parameters may change it more.

    Args:
        verdict: the verdict by the wrench along the measured path.
        replayed: result of `closed_loop`, with the corrected model as its last trial.
        held_out: the recordings that it simulated.
        world: the corrected model.
        n_fixed: number of effects given by the user.
        threads: threads of the simulation.
    """
    if verdict.verdict == "unexplained":
        return verdict
    for row in replayed:
        measured, (name, last) = row["trials"]["measured"], list(row["trials"].items())[-1]
        if last.get("free_off", np.inf) > repeats()["m"] or ended_alike(measured, [last]):
            continue
        source = [r for r in held_out if r.name == row["recording"]]
        ends, _ = closed_loop(source, {str(k): w for k, w in enumerate(at_ends(world, n_fixed))}, threads)
        others = [trial for end in ends for key, trial in end["trials"].items() if key != "measured"]
        if ended_alike(measured, [last, *others]):
            continue
        text = (
            f"{row['recording']} in closed loop: peak {last['peak_force']:.1f} N and {last['outcome']} in the {name} "
            f"model, {measured['peak_force']:.1f} N and {measured['outcome']} measured, which no known effect explains"
        )
        return left_unexplained(text)
    return verdict


def ended_alike(measured: Trial, runs: Sequence[Trial]) -> bool:
    """Return whether a run ends as the measured one did, and the measured peak force lies within those of the runs."""
    peaks = [run["peak_force"] for run in runs]
    off = max(RULES.peak_share * measured["peak_force"], 0.5 * Thresholds().touch)  # N: less is no contact
    ended = any((run["outcome"] == "success") == (measured["outcome"] == "success") for run in runs)
    return ended and min(peaks) - off <= measured["peak_force"] <= max(peaks) + off


def at_ends(world: World, n_fixed: int) -> Iterator[World]:
    """Yield worlds with one value at one end of its interval."""
    for k, placed in enumerate(world.effects[n_fixed:], n_fixed):
        for name, value in placed.params.items():
            for end in {value.low, value.high} - {value.value}:
                if end is not None:
                    moved = placed.with_values(**{name: end})
                    yield replace(world, effects=(*world.effects[:k], moved, *world.effects[k + 1 :]))
