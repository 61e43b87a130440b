"""Comparison and diagnosis for any evidence, used by channels without a search of their own.

An evidence holds recordings and predicts them under a world; a diagnosis has two, a fitted one and a held-out one,
called `judged`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vispeg.diagnosis.beginning import opened
from vispeg.diagnosis.compare import Comparison
from vispeg.diagnosis.conclusion.shares import shares
from vispeg.diagnosis.conclusion.verdict import decide
from vispeg.diagnosis.record import (
    candidates,
    channels,
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
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.traces import arrays, traces
from vispeg.identify.evidence import Evidence
from vispeg.recordings.recording import Recording
from vispeg.worlds.world import World


def compare_plain(evidence: Evidence, world: World, label: str) -> Comparison:
    """Return the errors of a world on an evidence, joint by joint; nothing is fitted.

    Args:
        evidence: of the recordings to compare.
        world: the part of a model that the evidence shows.
        label: the model's name in the record.
    """
    predicted, joints = evidence.simulated([world]), evidence.items[0].robot.joints
    (error,), (residual,) = evidence.errors([world]), evidence.residuals([world])
    unit, rows = f"{evidence.unit} RMS", channels(evidence, predicted, None)
    record: ComparisonRecord = {
        "format": "vispeg-compare/1",
        "ladder": [{"model": label, "fit_error": None, "heldout_error": error, "unit": unit}],
        "noise_floor": {"value": evidence.floor, "unit": unit, "from": evidence.floor_from},
        "chi2": evidence.chi2(residual),
        "joints": joint_errors(rows),
        "where_it_fails": [],
        "recordings": {"fit": [], "validate": [r.name for r in evidence.recordings]},
        "notes": list(evidence.notes),
    }  # fmt: skip
    return Comparison(record, arrays(traces(evidence.items, predicted), joints))


def diagnose_plain(
    search: PlainSearch, world: World, recordings: tuple[Sequence[Recording], Sequence[Recording]]
) -> Diagnosis:
    """Find the effects that a world lacks in signals with a column per joint; arguments as for `concluded`."""
    diagnosis, state = concluded(search, world, recordings)
    judged, record = search.judged, diagnosis.record
    predicted = judged.simulated([world, state.world])
    record["where_it_fails"], record["residual_peaks"] = [], []
    record["channels"], record["correlations"] = channels(judged, predicted, None), correlations(state)
    return replace(diagnosis, arrays=arrays(traces(judged.items, predicted), judged.items[0].robot.joints))


def concluded(
    search: PlainSearch, world: World, recordings: tuple[Sequence[Any], Sequence[Any]]
) -> tuple[Diagnosis, State]:
    """Find the effects that a world lacks; every error in the record is on the held-out evidence.

    Args:
        search: over the fitted and the held-out evidence.
        world: the part of a model that the evidence shows.
        recordings: fitted and held-out recordings.

    Returns:
        the diagnosis with the record's entries that every evidence has, and the last state of the search.
    """
    evidence, judged, begin = search.evidence, search.judged, opened(world)
    world, n_fixed = begin.world, begin.n_given
    state = search.run(world, n_fixed)
    final = search.finish(state)
    search.say("what else would do as well")
    rivals = search.rivals(state)
    errors = judged.errors([world, state.world])
    over_floor = (errors[0] / judged.floor, errors[1] / judged.floor)
    n_added = len(final.effects) - n_fixed
    after, floor = search.judge.mean(state.loss), search.judge.floor(state.world)
    explained = shares(search.judge, state.world, n_fixed, state.first, after, floor)
    verdict = decide(state.first, after, n_added, rivals, [], floor, errors=over_floor)
    final = with_origin(final, n_fixed, *recordings, errors[0], errors[1], verdict.partial)
    search.say("working out what could not have been seen")
    record: DiagnosisRecord = {
        "format": "vispeg-diagnosis/1",
        "verdict": verdict.verdict,
        "reason": verdict.reason,
        "effects": effects(final, n_fixed, rivals, state.world, explained),
        "ladder": ladder(evidence, judged, state, world),
        "noise_floor": {"value": judged.floor, "unit": f"{judged.unit} RMS", "from": judged.floor_from},
        "unexplained": verdict.unexplained,
        "next_experiment": None,
        "shows_from": search.shows_from(state),
        "candidates": candidates(state, rivals),
        "recordings": {"fit": [r.name for r in recordings[0]], "validate": [r.name for r in recordings[1]]},
        "screening": [{"effect": s.key[0], "where": s.key[1], "score": round(s.gain, 2)} for s in screening(state)],
        "parameters_moved": moved(state),
        "notes": list(dict.fromkeys([*evidence.notes, *judged.notes])),
    }
    return Diagnosis(record, final, {}), state
