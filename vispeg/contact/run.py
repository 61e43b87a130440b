"""Comparison and diagnosis of contact: from recordings with a wrench to a verdict, a model and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from vispeg.contact.again.closed_loop import closed_loop, contradicted
from vispeg.contact.again.damping import Unsearched, struck
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
from vispeg.contact.remainder import of_phases, remainder
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
    """Return the start of the search in a model: its partial effects are refitted, except those found from impacts.

    The wrench along the measured path, which the search fits, does not show these.
    """
    return opened(world, {kind.name for kind in looked_for() if kind.stage != BLOWS})


def unsearched(
    world: World,
    found: World,
    evidence: ContactEvidence,
    judged: ContactEvidence,
    both: tuple[Sequence[Recording], Sequence[Recording]],
    nthread: int = 1,
) -> Unsearched:
    """Return noise of the wrench in excess of the stated one, and damping from impacts.

    Args:
        world: the model from which the search started.
        found: the model that it found, with which impacts are simulated.
        evidence, judged: the fitted and the held-out wrenches.
        both: the fitted and the held-out recordings.
        nthread: threads of the simulation.
    """
    damping = struck(found, *both, nthread)
    return replace(damping, effects=(*excess_noise(world, evidence.items, judged.items), *damping.effects))


def diagnose_contact(
    world: World,
    fitted: Sequence[Recording],
    held_out: Sequence[Recording],
    *,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects of contact that `world` lacks.

    Every error in the record is on `held_out`, except the ladder's `fit_error`. Partial effects in `world` are refitted
    as `begun` says.

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
    least_sizes = search.least
    imitated = confounded.imitated(search, state)
    rivals = rivals_of_each(search, state, say) if len(state.world.effects) > n_fixed else []
    errors = judged.errors([world, state.world])
    before, after = judge.mean(judge.loss(before_held)), judge.mean(state.loss)
    say("simulating impacts")
    direct = unsearched(world, state.world, evidence, judged, (fitted, held_out), nthread)
    fitted_world = state.world.add(*direct.effects)
    # intervals of fitted values count the error of the model's form too; what was found directly has its own
    form_error = of_form(evidence, state.fit, judge.mean(judge.losses([begin.bare])[0]), after)
    added = range(n_fixed, len(state.world.effects))
    corrected = widened(repeated(state.world, n_fixed), added, form_error).add(*direct.effects)
    changed = len(corrected.effects) > n_fixed
    models = {"given": world, "corrected": corrected} if changed else {"given": world}
    replayed, replay_notes = closed_loop(held_out, models, nthread)

    in_floors = (errors[0] / judged.floor, errors[1] / judged.floor)
    verdict = decide(before, after, len(fitted_world.effects) - n_fixed, rivals, depends=[], errors=in_floors)
    # what makes it `unexplained` comes first, as only `identified` may become `ambiguous`
    verdict = of_phases(verdict, [*remainder(evidence, state.world), *remainder(judged, state.world, held_out=True)])
    verdict = contradicted(verdict, replayed, held_out, corrected, n_fixed, nthread)
    # the first of these that holds states the reason
    combined = confounded.entangled(state.fit, n_fixed)
    verdict = confounded.of_layer(verdict, corrected, n_fixed)
    verdict = confounded.of_combinations(verdict, combined)
    verdict = confounded.of_imitated(verdict, imitated)
    # A clause is added to whichever reason stands. Along the measured path only the searched effects change the wrench.
    nuisances = allowed(judged, {"given": world, "corrected": state.world} if changed else {"given": world})
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
    explained = shares(judge, state.world, n_fixed, before, after, floor=1.0)  # the right model leaves noise alone, 1
    found = effects(final, n_fixed, rivals, fitted_world, explained)
    unseen = [*not_excited(least_sizes, recorded), *direct.unseen]
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "evidence": "contact",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": confounded.with_imitators(confounded.beside(found, combined), imitated),
        "ladder": ladder(evidence, judged, state, world),
        "noise_floor": {"value": judged.floor, "unit": "N RMS", "from": judged.floor_from},
        "where_it_fails": where_it_fails(judged, predicted),
        "phases": phase_errors(judged, predicted),
        "worst_left": worst_left(judged, predicted),
        "unexplained": verdict.unexplained,
        "channels": channels(judged, predicted),
        "not_excited": unseen,
        "shows_from": shows_from(least_sizes),
        "allowed": nuisances,
        "closed_loop": replayed,
        "next_experiment": separating(fitted_world, rivals, unseen, [*imitated, *combined], recorded),
        "candidates": candidates(state, rivals),
        "recordings": {"fit": [r.name for r in fitted], "validate": [r.name for r in held_out]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "correlations": correlations(state),
        "parameters_moved": moved(state),
        "notes": [*evidence.notes, *direct.notes, *replay_notes],
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
    }
    return Comparison(record, arrays(evidence, predicted))
