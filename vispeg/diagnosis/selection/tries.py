"""Start a search, fit candidates in batches and judge them: what the searches of joints and of contact share.

A search calls these functions; none of them moves a state on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from vispeg.diagnosis.findings import Score, Trial
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.selection.accept import ranked
from vispeg.diagnosis.selection.searching import Fitting
from vispeg.diagnosis.selection.state import State, without
from vispeg.identify.evidence import Evidence
from vispeg.identify.fit import Chase, Fit, Race, fit_job
from vispeg.identify.loops.noise_motion import within_noise
from vispeg.identify.pool import Submit, run_together
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

End = tuple[Sequence[float], bool]  # coordinates at which a fit ended, and whether it had converged


def begun(search: Fitting, world: World, n_fixed: int | None) -> State:
    """Return the state at which a search begins; effects of `world` after the first `n_fixed` are refitted.

    If `n_fixed` is None, none is refitted.
    """
    residual, loss = search.evidence.residuals([world])[0], search.judge.losses([world])[0]
    noise_alone = within_noise(search.judge.evidence, world)
    n_fixed = len(world.effects) if n_fixed is None else n_fixed
    state = State(world, loss, residual, n_fixed, first=search.judge.mean(loss), within_noise=noise_alone)
    if not state.added:
        state.cross = search.cross.loss(residual)
        return state
    search.say(f"fitting {len(state.added)} partial effects of the model anew")
    # one iteration evaluates the given values, which are kept if the held-out recordings prefer them
    fits = search.fits([world], n_fixed) + search.fits([world], n_fixed, iterations=1)
    losses = search.judge.losses([f.world for f in fits])
    fit, loss = min(zip(fits, losses, strict=True), key=lambda p: float(p[1].sum()))
    state.take(fit, loss)
    state.opened, state.cross = fit.world, search.cross.loss_of(fit, fit.residual)
    return state


def try_each(
    search: Fitting, tries: Sequence[tuple[State, Sequence[Score], int]], goal: float | None = None
) -> list[list[Trial]]:
    """Fit each score's effects jointly with the accepted ones, and judge all on the held-out recordings.

    Each of `tries` is a state, scores, and the number of places that share the level of the test; all states have the
    same fixed effects. Of each, the trials that pass come first. All are fitted in one batch, since a rollout of many
    rows costs little more than one of a few. Those of a state stop when another is far ahead. With a `goal`, a mean
    squared residual, each stops instead when it cannot reach it.
    """
    flat = [(state, s) for state, scores, _ in tries for s in scores]
    if not flat:
        return [[] for _ in tries]
    worlds = [without(state.world, s.out).add(*s.members) for state, s in flat]
    search.say(f"fitting {', '.join(dict.fromkeys(s.label for _, s in flat))}")
    races: list[Race] = []
    for _, scores, _ in tries:
        shared = Race()
        races += [shared if goal is None else Chase(goal) for _ in scores]
    columns = [state.derivatives(s.out) for state, s in flat]
    fits = search.fits(worlds, flat[0][0].n_fixed, races=races, columns=columns)
    trials = []
    for (state, s), f, loss in zip(flat, fits, search.judge.losses([f.world for f in fits]), strict=True):
        crossed = state.cross, search.cross.loss_of(f, f.residual)
        trials.append(Trial(s, f, loss, search.judge.gain(state.loss, loss, crossed)))
    out, at = [], 0
    for state, scores, tested in tries:
        ordered = ranked(search, state, trials[at : at + len(scores)], tested)
        out.append([t.bare if t.rejected else t for t in ordered])
        at += len(scores)
    return out


def fit_all(
    evidence: Evidence,
    progress: Progress,
    worlds: Sequence[World],
    n_fixed: int,
    *,
    races: Sequence[Race] | None = None,
    iterations: int = 8,
    columns: Sequence[np.ndarray | None] | None = None,
) -> list[Fit]:
    """Fit all but the first `n_fixed` effects of each world, in one batch; arguments are as in `Fitting.fits`."""
    constant = [None] * len(worlds) if columns is None else list(columns)
    raced = [None] * len(worlds) if races is None else list(races)

    def job(k: int, ended: End | None) -> Callable[[Submit], Fit]:
        free = range(n_fixed, len(worlds[k].effects))
        options = {"race": raced[k], "iterations": iterations, "ended": ended, "columns": constant[k]}
        return fit_job(evidence, worlds[k], free, **options)

    def turn() -> None:
        for race in raced:
            if race is not None:
                race.turn()

    widths = [None if c is None else c.shape[1] for c in constant]
    asked = [model_text(w) for w in worlds]
    question = ["fits", asked, n_fixed, races is not None, iterations, widths, evidence.weights]
    return recalled(evidence, progress, question, len(worlds), job, turn)


def recalled(
    evidence: Any,
    progress: Progress,
    question: list,
    count: int,
    job: Callable[[int, End | None], Callable[[Submit], Fit]],
    turn: Callable[[], None] = lambda: None,
) -> list[Fit]:
    """Return the fits of `count` jobs; their ends are stored, so that a resumed diagnosis only evaluates them there.

    Args:
        evidence: to which they are fitted.
        progress: stores the ends as the answer to the `question`.
        count: number of jobs.
        job: returns the job of a number, which is evaluated at the end of an earlier run if there was one.
        turn: as in `run_together`.
    """
    fresh: list[Fit] = []

    def work_out() -> list:
        jobs = [job(k, None) for k in range(count)]
        fresh.extend(run_together(jobs, evidence.residuals, turn=turn, length=evidence.length))
        return [[f.u.tolist(), f.converged] for f in fresh]

    ends = progress.recall(question, work_out)
    if fresh:
        return fresh
    again = [job(k, (u, bool(converged))) for k, (u, converged) in enumerate(ends)]
    return run_together(again, evidence.residuals, length=evidence.length)
