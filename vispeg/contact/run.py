"""Comparison and diagnosis of contact: from recordings with a wrench to a verdict, a model and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from vispeg.contact.again.closed_loop import closed_loop, contradicted
from vispeg.contact.again.damping import Struck, struck
from vispeg.contact.errors.noise import excess_noise
from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.inputs import touching
from vispeg.contact.law import unsure
from vispeg.contact.next_motion import separating
from vispeg.contact.record import (
    allowed,
    arrays,
    channels,
    not_excited,
    phase_errors,
    shows_from,
    where_it_fails,
    with_nuisance,
    worst_left,
)
from vispeg.contact.remainder import judged as in_phases
from vispeg.contact.remainder import remainder
from vispeg.contact.selection import confounded
from vispeg.contact.selection.profile import BLOWS, looked_for
from vispeg.contact.selection.repeats import repeated
from vispeg.contact.selection.search import ContactSearch
from vispeg.diagnosis.beginning import Beginning, opened
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.conclusion.intervals import of_form, widened
from vispeg.diagnosis.conclusion.rivals import rivals_of_each
from vispeg.diagnosis.conclusion.shares import shares
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.record import (
    candidates,
    correlations,
    effects,
    joint_errors,
    ladder,
    moved,
    screening,
    with_origin,
)
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ComparisonRecord, DiagnosisRecord
from vispeg.diagnosis.selection.judge import Judge
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World


def evidence_of(recordings: Sequence[Recording], nthread: int = 1) -> ContactEvidence:
    """Return the evidence of contact recordings.

    Raises:
        UserError: a recording with neither wrench nor joint torques, or one that begins in contact.
    """
    return ContactEvidence([touching(r) for r in recordings], nthread=nthread)


def begun(world: World) -> Beginning:
    """Return the model from which the search starts; partial effects in it are refitted."""
    return opened(world, {kind.name for kind in looked_for() if kind.stage != BLOWS})


def unsearched(
    world: World,
    found: World,
    evidence: ContactEvidence,
    judged: ContactEvidence,
    both: tuple[Sequence[Recording], Sequence[Recording]],
    nthread: int = 1,
) -> Struck:
    """Return what is found without a search: noise of the wrench in excess of the stated one, damping from impacts.

    Args:
        world: the model from which the search started.
        found: the model that it found, with which impacts are simulated.
        evidence, judged: the fitted and the held-out wrenches.
        both: the fitted and the held-out recordings.
        nthread: threads of the simulation.
    """
    hit = struck(found, *both, nthread)
    return replace(hit, effects=(*excess_noise(world, evidence.items, judged.items), *hit.effects))


def diagnose_contact(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects of contact that `world` lacks; every error in the record is on `held_out`.

    Partial effects of contact in `world` are refitted.

    Raises:
        UserError: a recording with neither wrench nor joint torques, or one that begins in contact.
    """
    evidence, judged = evidence_of(fitted, nthread), evidence_of(held_out, nthread)
    judge = Judge(judged)
    search = ContactSearch(evidence, judge, say, progress)
    begin = begun(world)
    world, n_fixed = begin.world, begin.n_fixed
    before_held = judged.residuals([world])[0]
    state = search.run(world, n_fixed)
    shows = search.least
    imitated = confounded.imitated(search, state)
    rivals = rivals_of_each(search, state, say) if len(state.world.effects) > n_fixed else []
    errors = judged.errors([world, state.world])
    before, after = judge.mean(judge.loss(before_held)), judge.mean(state.loss)
    say("simulating impacts")
    hit = unsearched(world, state.world, evidence, judged, (fitted, held_out), nthread)
    fitted_world = state.world.add(*hit.effects)
    rests = [*remainder(evidence, state.world), *remainder(judged, state.world, held_out=True)]
    in_floors = (errors[0] / judged.floor, errors[1] / judged.floor)
    verdict = in_phases(
        decide(before, after, len(fitted_world.effects) - n_fixed, rivals, depends=[], errors=in_floors), rests
    )
    wrong = of_form(evidence, state.fit, judge.mean(judge.losses([begin.bare])[0]), after)
    corrected = widened(repeated(state.world, n_fixed), range(n_fixed, len(state.world.effects)), wrong).add(
        *hit.effects
    )
    models = {"given": world, "corrected": corrected} if len(corrected.effects) > n_fixed else {"given": world}
    replayed, replay_notes = closed_loop(held_out, models, nthread)
    verdict = contradicted(verdict, replayed, held_out, corrected, n_fixed, nthread)
    together = confounded.entangled(state.fit, n_fixed)
    verdict = confounded.of_layer(verdict, corrected, n_fixed)
    verdict = confounded.of_imitated(confounded.of_combinations(verdict, together), imitated)
    nuisances = allowed(judged, {"given": world, "corrected": state.world} if len(models) > 1 else {"given": world})
    verdict = with_nuisance(verdict, nuisances)
    final = with_origin(
        corrected,
        n_fixed,
        fitted,
        held_out,
        errors[0],
        errors[1],
        verdict.partial,
        unsure(corrected, n_fixed),
    )
    predicted = judged.simulated([world, state.world])
    recorded = {r.motion for r in (*fitted, *held_out)}
    explained = shares(judge, state.world, n_fixed, before, after, floor=1.0)  # not of what was found without a search
    found = effects(final, n_fixed, rivals, fitted_world, explained)
    unseen = [*not_excited(shows, recorded), *hit.unseen]
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "evidence": "contact",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": confounded.with_imitators(confounded.beside(found, together), imitated),
        "ladder": ladder(evidence, judged, state, world),
        "noise_floor": {"value": judged.floor, "unit": "N RMS", "from": judged.floor_from},
        "where_it_fails": where_it_fails(judged, predicted),
        "phases": phase_errors(judged, predicted),
        "worst_left": worst_left(judged, predicted),
        "unexplained": verdict.unexplained,
        "channels": channels(judged, predicted),
        "not_excited": unseen,
        "shows_from": shows_from(shows),
        "allowed": nuisances,
        "closed_loop": replayed,
        "next_experiment": separating(fitted_world, rivals, unseen, [*imitated, *together], recorded),
        "candidates": candidates(state, rivals),
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "correlations": correlations(state),
        "parameters_moved": moved(state),
        "notes": [*evidence.notes, *hit.notes, *replay_notes],
    }
    return Diagnosis(record, final, arrays(judged, predicted))


def compare_contact(
    world: World, recordings: Sequence[Recording], *, nthread: int = 1, label: str | None = None
) -> Comparison:
    """Return the errors of a model's wrench against the measured one, by axis and phase of contact."""
    evidence = evidence_of(recordings, nthread)
    residual, predicted = evidence.residuals([world])[0], evidence.simulated([world])
    (error,) = evidence.errors([world])
    rows = channels(evidence, predicted)
    record: ComparisonRecord = {
        "format": "vispeg-compare/1",
        "evidence": "contact",
        "ladder": [{"model": label or world.label, "fit_error": None, "heldout_error": error, "unit": "N RMS"}],
        "noise_floor": {"value": evidence.floor, "unit": "N RMS", "from": evidence.floor_from},
        "chi2": evidence.chi2(residual),
        "joints": joint_errors(rows),
        "where_it_fails": where_it_fails(evidence, predicted),
        "phases": phase_errors(evidence, predicted),
        "recordings": {"fit": [], "validate": [r.name for r in recordings]},
        "notes": list(evidence.notes),
    }  # fmt: skip
    return Comparison(record, arrays(evidence, predicted))
