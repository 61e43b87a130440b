"""The record of a fit, and its tables for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NotRequired, TypedDict

import numpy as np

from vispeg.core.provenance import Provenance
from vispeg.diagnosis.conclusion.intervals import of_form, widened
from vispeg.diagnosis.schema import Correlations, Rung
from vispeg.identify.calibrate import Calibration, labels, strong_pairs
from vispeg.identify.evidence import Evidence
from vispeg.identify.loops.noise_motion import noise_motion, reading_floor
from vispeg.recordings.windows import records
from vispeg.report.text import words
from vispeg.report.text.summary import Block, Line
from vispeg.report.text.terminal import effects_table, ladder_table
from vispeg.worlds.model_file import PlacedRecord, without_origin
from vispeg.worlds.world import World

HOPELESS = 5e5  # chi2, in noise variances; above it, most residuals have the value that is set for diverged rollouts


class FitRecord(TypedDict):
    """Content of fit.json.

    Attributes:
        format: `vispeg-fit/1`.
        method: the optimizer.
        converged: whether it came to its end.
        effects: fitted effects, as in a model file.
        ladder: errors before and after.
        noise_floor: the error that noise alone makes.
        chi2: mean squared whitened residual of the fitted recordings.
        starts: that residual for each start of the optimizer.
        correlations: of the parameters.
        hardly_told_apart: pairs of parameters that are hard to separate.
        at_bound: parameters at a bound.
        unidentifiable: parameters that the recordings do not determine.
        windows: which parts of long recordings were used.
        notes: remarks.
        channel: the channel whose evidence was fitted.
        provenance: command, seed and versions.
    """

    format: str
    method: str
    converged: bool
    effects: list[PlacedRecord]
    ladder: list[Rung]
    noise_floor: Mapping[str, object]
    chi2: float
    starts: list[Mapping[str, float]]
    correlations: Correlations
    hardly_told_apart: list[Mapping[str, object]]
    at_bound: list[str]
    unidentifiable: list[str]
    windows: list[Mapping[str, object]]
    notes: list[str]
    channel: NotRequired[str]
    provenance: NotRequired[Provenance]


def fit_record(
    nominal: World, calibration: Calibration, free: Sequence[int], evidence: Evidence, judged: Evidence | None
) -> tuple[FitRecord, World]:
    """Return the content of fit.json, and the fitted world with the origin of its values.

    Args:
        nominal: the given model.
        calibration: the fit.
        free: indices of the fitted effects in the fitted world.
        evidence: evidence of the fitted recordings.
        judged: evidence of the held-out recordings, or None.
    """
    fit = calibration.fit
    worlds, judge = [nominal, fit.world], judged or evidence
    fitted = evidence.errors(worlds)
    held = [None, None] if judged is None else judged.errors(worlds)
    bare = replace(fit.world, effects=tuple(e for i, e in enumerate(fit.world.effects) if i not in free))
    before, after = map(judge.chi2, judge.residuals([bare, fit.world]))
    unit, floor = f"{evidence.unit} RMS", judge.floor
    floor_chi2 = reading_floor(judge, fit.world) + noise_motion(judge, fit.world)
    effects = list(widened(fit.world, free, of_form(evidence, fit, before, after, floor_chi2)).effects)
    given = {e.label: e for e in nominal.effects}
    for i in free:
        origin: dict[str, object] = {"fitted_on": [r.name for r in evidence.recordings]}
        if judged is not None:
            origin |= {"validated_on": [r.name for r in judged.recordings]}
            origin |= {"heldout_error_before": held[0], "heldout_error_after": held[1]}
        was = given.get(effects[i].label, effects[i])  # a fit does not decide `partial` and `tentative`
        effects[i] = replace(effects[i], origin=origin, partial=was.partial, tentative=was.tentative)
    final = replace(fit.world, effects=tuple(effects))
    names = labels(fit)
    record: FitRecord = {
        "format": "vispeg-fit/1",
        "method": calibration.method,
        "converged": bool(fit.converged),
        "effects": [without_origin(final.effects[i]) for i in free],
        "ladder": [
            {"model": label, "fit_error": f, "heldout_error": h, "unit": unit}
            for label, f, h in zip(("initial", "fitted"), fitted, held, strict=True)
        ],
        "noise_floor": {"value": floor, "unit": unit},
        "chi2": fit.cost,
        "starts": [{"chi2": c} for c in calibration.costs],
        "correlations": {"labels": names, "matrix": np.round(fit.correlation, 4).tolist()},
        "hardly_told_apart": [{"a": a, "b": b, "correlation": round(c, 4)} for a, b, c in strong_pairs(fit)],
        "at_bound": list(fit.at_bound),
        "unidentifiable": list(fit.weak),
        "windows": records([*evidence.recordings, *(judged.recordings if judged else ())]),
        "notes": [*evidence.notes, *(n for n in (judged.notes if judged else ()) if n not in evidence.notes)],
    }
    return record, final


def fit_summary(record: Mapping[str, Any]) -> list[Block]:
    """Return blocks with errors before and after, values with intervals, and reasons to doubt them."""
    held = record["ladder"][-1]["heldout_error"] is not None
    said = words.fall(record) if held else "Errors are on the fitted recordings; use --validate for errors on others."
    return [ladder_table(record), Line(said), effects_table(record), *map(Line, doubts(record))]


def doubts(record: Mapping[str, Any]) -> list[str]:
    """Return one line per reason to doubt the values, and the notes."""
    lines = []
    if record["chi2"] >= HOPELESS:
        lines.append(
            "every rollout diverged from the measured motion, so the values mean nothing; "
            "start nearer or fit fewer effects"
        )
    if not record["converged"]:
        lines.append("the optimizer stopped before it converged: fit again from OUT/model.yaml")
    lines += [f"at its bound: {name}" for name in record["at_bound"]]
    lines += [f"not determined by these recordings: {name}" for name in record["unidentifiable"]]
    pairs = record["hardly_told_apart"]
    lines += [f"hard to distinguish: {p['a']} and {p['b']} (correlation {p['correlation']:.2f})" for p in pairs]
    costs = [row["chi2"] for row in record["starts"]]
    if len(costs) > 1:
        same = sum(c <= 1.05 * min(costs) + 0.05 for c in costs)
        lines.append(f"{same} of {len(costs)} starts ended at the best fit")
    return lines + [f"note: {note}" for note in record["notes"]]
