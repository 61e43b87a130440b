"""Comparison and diagnosis for any evidence, used by channels without a search of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.conclusion.intervals import widened
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.record import (
    candidates,
    channels,
    correlations,
    effects,
    ladder,
    moved,
    screening,
    with_origin,
)
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import ComparisonRecord, DiagnosisRecord
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.evidence import Evidence
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World


def compare_plain(evidence: Evidence, world: World, label: str) -> Comparison:
    """Return the errors of a world in an evidence, joint by joint.

    Args:
        evidence: of held-out recordings.
        world: the part of a model that the evidence shows.
        label: of the model.
    """
    predicted, joints = evidence.simulated([world]), evidence.items[0].robot.joints
    (error,), (residual,) = evidence.errors([world]), evidence.residuals([world])
    unit, rows = f"{evidence.unit} RMS", channels(evidence, predicted, None)
    record: ComparisonRecord = {
        "format": "vispeg-compare/1",
        "ladder": [{"model": label, "fit_error": None, "heldout_error": error, "unit": unit}],
        "noise_floor": {"value": evidence.floor, "unit": unit, "from": evidence.floor_from},
        "chi2": float(residual @ residual / max(evidence.count, 1)),
        "joints": [
            {"joint": r["joint"], "error": r["before"], "floor": r["floor"], "unit": r["unit"],
             "times_floor": r["before"] / r["floor"]}
            for r in rows
        ],
        "where_it_fails": [],
        "recordings": {"fit": [], "validate": [r.name for r in evidence.recordings]},
        "notes": list(evidence.notes),
    }  # fmt: skip
    return Comparison(record, arrays(traces(evidence.items, predicted), joints))


def diagnose_plain(
    both: tuple[Evidence, Evidence],
    world: World,
    recordings: tuple[Sequence[Recording], Sequence[Recording]],
    say: Callable[[str], None] = lambda text: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the effects that a world lacks by the plain search; every error in the record is on the held-out evidence.

    Args:
        both: fitted and held-out evidence.
        world: the part of a model that the evidence shows.
        recordings: fitted and held-out recordings.
        say: called with progress messages.
        progress: stores results.
    """
    evidence, judged = both
    search, n_fixed = PlainSearch(evidence, judged, say, progress), len(world.effects)
    state = search.run(world)
    say("what else would do as well")
    rivals = search.rivals(state, n_fixed)
    before, after = search.judge.mean(search.judge.losses([world])[0]), search.judge.mean(state.loss)
    errors = judged.errors([world, state.world])
    seen = (errors[0] / judged.floor, errors[1] / judged.floor)
    verdict = decide(before, after, len(state.world.effects) - n_fixed, rivals, [], errors=seen)
    final = widened(state.world, n_fixed, before, after)
    final = with_origin(final, n_fixed, *recordings, errors[0], errors[1], verdict.partial)
    predicted = judged.simulated([world, state.world])
    say("working out what could not have been seen")
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": effects(final, n_fixed, rivals, state.world),
        "ladder": ladder(evidence, judged, state, world),
        "noise_floor": {"value": judged.floor, "unit": f"{judged.unit} RMS", "from": judged.floor_from},
        "where_it_fails": [],
        "residual_peaks": [],
        "unexplained": verdict.unexplained,
        "channels": channels(judged, predicted, None),
        "next_experiment": None,
        "shows_from": search.shows_from(state),
        "candidates": candidates(state, rivals, n_fixed),
        "recordings": {"fit": [r.name for r in recordings[0]], "validate": [r.name for r in recordings[1]]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "correlations": correlations(state),
        "parameters_moved": moved(state),
        "notes": list(dict.fromkeys([*evidence.notes, *judged.notes])),
    }
    return Diagnosis(record, final, arrays(traces(judged.items, predicted), judged.items[0].robot.joints))
