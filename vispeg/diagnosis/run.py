"""`diagnose`: from recordings to a verdict, a model with the missing effects, and the evidence for both."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import EffectInstance
from vispeg.core.rules import RULES
from vispeg.diagnosis.beginning import Beginning, of_joints
from vispeg.diagnosis.conclusion.farthest import farthest
from vispeg.diagnosis.conclusion.intervals import of_form, widened
from vispeg.diagnosis.conclusion.next_experiment import next_experiment, repeated
from vispeg.diagnosis.conclusion.shares import shares
from vispeg.diagnosis.conclusion.shows_from import joints_show_from
from vispeg.diagnosis.conclusion.subsets import subsets
from vispeg.diagnosis.conclusion.verdict import decide, undecided, without_tentative
from vispeg.diagnosis.evidence.base_parameters import base_parameters
from vispeg.diagnosis.evidence.localise import maps, missing_torque, peaks, where_it_fails
from vispeg.diagnosis.evidence.motionless import refuse_motionless
from vispeg.diagnosis.evidence.remainder import dependences, sizes
from vispeg.diagnosis.evidence.roles import Sides, sides
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.proposal import Proposal, placed, propose
from vispeg.diagnosis.record import (
    candidates,
    channels,
    coarse_encoders,
    correlations,
    effects,
    ladder,
    moved,
    screening,
    with_origin,
)
from vispeg.diagnosis.schema import DiagnosisRecord, ProposalRecord
from vispeg.diagnosis.selection.judge import Judge
from vispeg.diagnosis.selection.names import never_named, tentative
from vispeg.diagnosis.selection.search import Search
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.evidence import Evidence
from vispeg.identify.inverse import TorqueEvidence
from vispeg.identify.loops.noise_motion import noise_motion
from vispeg.recordings.checks import missing
from vispeg.recordings.recording import Recording
from vispeg.recordings.windows import records
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Diagnosis:
    """Result of `vispeg diagnose`: the record, the model, and the arrays behind the pictures."""

    record: DiagnosisRecord
    world: World
    arrays: dict[str, np.ndarray]

    @property
    def added(self) -> tuple[EffectInstance, ...]:
        """The effects that the record lists, which are the last ones of the model; partial ones of the user's too."""
        return self.world.effects[len(self.world.effects) - len(self.record["effects"]) :]


def diagnose(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    likely: Callable[[ProposalRecord], None] = lambda _: None,
    plan_next: bool = True,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects that `world` lacks; errors are on `held_out`, unless `evidence.roles` changes it.

    `likely` is called within seconds with the effects that torques suggest, before the search confirms or corrects
    them (`proposal`).
    `progress` stores results, so that a killed diagnosis with the same arguments can resume.

    Raises:
        UserError: recordings that cannot be compared with the world, or in which nothing moves.
    """
    still = refuse_motionless(fitted, held_out)
    parts = sides(world, fitted, held_out, nthread)
    progress = progress or Progress()
    if parts.roles is not None:
        say(parts.roles.note)
    found = _search(world, parts, say, likely, progress)
    if parts.whole is not None and parts.outdone(found.state.world) is None:
        say("the model explains the recording that was left out; it is fitted too")
        parts = parts.whole
        found = _search(world, parts, say, likely, progress)
    if parts.roles is not None:
        still += [parts.roles.note, *parts.roles.converted]
    fitted, held_out, evidence, judged = parts.fitted, parts.held_out, parts.evidence, parts.judged
    proposal, search, begin, state = found.proposal, found.search, found.begin, found.state
    judge, world, n_given, n_fixed = search.judge, begin.world, begin.n_given, begin.n_fixed
    rung = (begin.label, begin.first) if begin.read else None
    before_held = judged.residuals([world])[0]
    rivals = state.rivals
    after_held = judged.residuals([state.world])[0]
    before, after = judge.mean(judge.loss(before_held)), judge.mean(state.loss)
    before_missing, after_missing = search.missing(world), search.missing(state.world)
    predicted = judged.simulated([world, state.world])
    held = [[missing_torque(i, y[w]) for i, y in zip(judged.items, predicted, strict=True)] for w in (0, 1)]
    joints = judged.items[0].robot.joints
    depends = dependences(after_missing, held[1], joints)
    fed_back = noise_motion(judged, state.world)
    floor = judge.floor(state.world) + fed_back
    least = None
    if isinstance(evidence, TorqueEvidence) and isinstance(judged, TorqueEvidence):
        say("least squares of base parameters, to compare with")
        least = base_parameters(evidence, judged, world)
    mark = None if least is None else _mean_square(judged, least)
    worst = farthest(judged, after_held, floor)
    n_added = len(state.world.effects) - n_given
    errors = judged.errors([world, state.world])
    seen = (errors[0] / judged.floor, errors[1] / judged.floor)
    verdict = decide(before, after, n_added, rivals, depends, floor, mark, worst, len(begin.read), seen)
    unjudged = parts.outdone(state.world) if verdict.verdict != "unexplained" or not n_added else None
    verdict = verdict if unjudged is None else undecided(unjudged, before, after, floor)
    changing = search.changes(state)
    unsure = never_named(state)
    if verdict.partial and state.fit is not None:
        say("asking which names are certain")
        unsure = tentative(state, search.exchanges(state), rivals, far=worst > RULES.far)
    unsure |= {c.label for c in changing}
    verdict = without_tentative(verdict, rivals, unsure)
    explained = shares(judge, state.world, n_given, before, after, floor)
    bare = judge.mean(judge.losses([begin.bare])[0])
    wrong = of_form(evidence, state.fit, bare, after, floor)
    final = with_origin(
        widened(state.world, range(n_fixed, len(state.world.effects)), wrong),
        n_given,
        fitted,
        held_out,
        errors[0],
        errors[1],
        verdict.partial,
        unsure,
    )
    equals = [(f"{t.score.label} in place of {r.label}", t.fit.world) for r in rivals for t in r.equals]
    drawing = arrays(traces(judged.items, predicted), joints) | subsets(judged, state.world, n_given, equals)
    drawn, final_maps = maps(held[0]), maps(held[1], over=held[0])
    for axis, (edges, grid) in drawn.items():
        drawing[f"map/{axis}/edges"], drawing[f"map/{axis}/before"] = edges, grid
        drawing[f"map/{axis}/after"] = final_maps[axis][1]
    say("working out what could not have been seen")
    hidden = joints_show_from(search, state)
    upcoming, more = (None, {})
    if plan_next:
        say("choosing what to record next")
        if unjudged is not None:
            upcoming = repeated(unjudged.alone)
        else:
            named = [r for r in rivals if r.equals and r.label not in unsure]  # tentative ones come after them
            recorded = {r.motion for r in (*fitted, *held_out)}
            upcoming, more = next_experiment(search, state, named or rivals, verdict.verdict, seed, recorded)
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": effects(final, n_given, rivals, state.world, explained),
        "ladder": ladder(evidence, judged, state, world, rung),
        "noise_floor": {
            "value": judged.floor,
            "unit": f"{judged.unit} RMS",
            "from": judged.floor_from,
        },
        "where_it_fails": where_it_fails(before_missing, joints),
        "residual_peaks": peaks(drawn, joints, final_maps),
        "unexplained": verdict.unexplained,
        "remainder": sizes(held[1], joints) if verdict.partial else [],
        "proposal": None if proposal is None else proposal.record,
        "channels": channels(judged, predicted, least),
        "next_experiment": upcoming,
        "shows_from": hidden,
        "candidates": candidates(state, rivals),
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "correlations": correlations(state),
        "parameters_moved": moved(state),
        "windows": records([*fitted, *held_out]),
        "missing": [line for rec in (*fitted, *held_out) for line in missing.said(rec)],
        "notes": [
            *still,
            *evidence.notes,
            *(note for note in judged.notes if note not in evidence.notes),
            *coarse_encoders(fitted[0], judged, final),
            *_noise_note(fed_back),
            *_odd_note(evidence, state.world),
            *(c.said() for c in changing),
        ],
    }
    return Diagnosis(record, final, drawing | more)


@dataclass(frozen=True)
class _Found:
    """A search that ended at `state`, with the model at which it began and what torques had proposed."""

    proposal: Proposal | None
    search: Search
    begin: Beginning
    state: State


def _search(
    world: World,
    parts: Sides,
    say: Callable[[str], None],
    likely: Callable[[ProposalRecord], None],
    progress: Progress,
) -> _Found:
    """Search for the effects that `world` lacks; arguments are as in `diagnose`."""
    say("asking the torques what is missing")
    proposal = propose(world, parts.fitted, parts.held_out)
    if proposal is not None:
        likely(proposal.record)
    search = Search(parts.evidence, Judge(parts.judged), say, parts.part(progress), lambda: placed(proposal))
    begin = of_joints(world, [*parts.fitted, *parts.held_out], parts.evidence.unit)
    return _Found(proposal, search, begin, search.run(begin.first, begin.n_fixed))


def _mean_square(judged: Evidence, residuals: list[np.ndarray]) -> float:
    """Return the mean squared whitened residual; 1 at the noise floor."""
    total = sum(float(np.sum((r / i.sigma) ** 2)) for i, r in zip(judged.items, residuals, strict=True))
    return total / max(judged.count, 1)


def _noise_note(fed_back: float) -> list[str]:
    if fed_back < 0.05:
        return []
    moved = f"move the arm by {np.sqrt(fed_back):.2g} times the encoders' noise"
    text = f"noise that is fed back, and where in a coarse encoder's step the arm began, {moved}"
    return [text + ": the right model too is that far off"]


def _odd_note(evidence: Evidence, world: World) -> list[str]:
    """Return a note on the fitted pieces that the model describes far worse than most (`Evidence.weigh`)."""
    squares = evidence.squares(evidence.residuals([world])[0])
    errors = [s.sum() / i.valid.sum() for s, i in zip(squares, evidence.items, strict=True)]
    usual = max(1.0, float(np.median(errors)))
    odd = [
        f"{i.name} (error {(e / usual) ** 0.5:.2g} times the median)"
        for i, e in zip(evidence.items, errors, strict=True)
        if e > RULES.loud * usual
    ]
    return [f"described far worse than the others, so counted like them: {', '.join(odd)}"] if odd else []
