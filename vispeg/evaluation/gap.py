"""The transfer gap: success of every policy in every world, losses, their factors, and what is undecided."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation.categories import part
from vispeg.evaluation.entrants import EXPERT
from vispeg.evaluation.measures import compare as compare_measures
from vispeg.evaluation.modalities import Comparison, compare
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.gap import (
    AttributionRow,
    ComparisonRow,
    GapRecord,
    GapRow,
    MeasureRow,
    PartingRow,
    Point,
    PolicyRow,
    PredictionRow,
    SuccessRow,
)
from vispeg.evaluation.statistics import decide
from vispeg.evaluation.statistics.attribution import attribute, joint_of
from vispeg.evaluation.statistics.crossed import difference, rate
from vispeg.evaluation.statistics.intervals import unpaired_difference
from vispeg.evaluation.statistics.ranks import FEWEST, FEWEST_POINTS, TWO_POINTS, Prediction, predict
from vispeg.evaluation.table import BLIND, Cell, Table

FORMAT = "vispeg-gap/1"
NO_BLIND = f"no blind control: add a {BLIND} policy"


def gap(
    episodes: Iterable[Episode],
    reference: str = "S",
    worlds: Sequence[str] = (),
    seed: int = 0,
    notes: Sequence[str] = (),
    scripted: Collection[str] = (EXPERT,),
) -> GapRecord:
    """Everything that a gap report shows, ready for JSON.

    Args:
        episodes: records of policies in worlds, with controls.
        reference: the training world.
        worlds: the order of worlds in tables; empty: the order in which they come.
        seed: of the bootstrap and the permutation tests.
        notes: what else is to be known about the episodes.
        scripted: policies that were not trained, and so have no training seeds.

    Returns:
        {format, reference, worlds, joint, factors, policies, success, gaps, attribution, comparisons, prediction,
        categories, measures, notes, rule}; an estimate is {value, low, high, n}.

    Raises:
        UserError: no episode in the reference world, an unknown world.
    """
    table = Table(episodes)
    order = [reference, *(w for w in (worlds or table.worlds) if w != reference)]
    for world in order:
        if world not in table.worlds:
            raise UserError("no episodes in this world", got=world, choices=table.worlds)
    joint, factors = joint_of(order, reference)
    targets, policies = order[1:], table.policies
    measures = [row for p in policies for w in targets for row in _measures(table, p, reference, w)]
    said = [f"{row['policy']} in {row['world']}: {row['words']}" for row in measures]
    return {
        "format": FORMAT,
        "reference": reference,
        "worlds": [{"name": w, "hash": table.hashes[w]} for w in order],
        "joint": joint,
        "factors": factors,
        "policies": [_policy(table, p, p in scripted) for p in policies],
        "success": [
            row for c in ("", *table.controls) for p in policies for w in order for row in _success(table, p, w, c)
        ],
        "gaps": [row for p in policies for w in targets for row in _gap(table, p, reference, w)],
        "attribution": _attributions(table, policies, reference, factors, joint, seed),
        "comparisons": [_comparison(c) for w in order for c in compare(table, w, policies)],
        "prediction": [row for w in targets for row in _prediction(table, reference, w, seed)],
        "categories": [row for p in policies for w in targets for row in _parting(table, p, reference, w, seed)],
        "measures": measures,
        "notes": [*_notes(table, order, scripted), *notes, *said],
        "rule": decide.RULE,
    }


def _policy(table: Table, policy: str, scripted: bool) -> PolicyRow:
    seeds = sorted({t for cell, rows in table.cells.items() if cell.policy == policy for t in rows})
    modality = table.modality[policy]
    return {
        "name": policy,
        "modality": modality,
        "train_seeds": [] if scripted else seeds,
        "blind": modality == BLIND,
        "scripted": scripted,
    }


def _success(table: Table, policy: str, world: str, control: str) -> list[SuccessRow]:
    cell = Cell(policy, world, control)
    if not table.has(cell):
        return []
    episodes = table.all(cell)
    y = table.outcomes(cell)
    estimate = rate(y)
    more = (
        decide.episodes_needed(estimate) if len(y) == 1 else None
    )  # of several networks, more episodes are not the cure
    return [
        {
            "policy": policy,
            "modality": table.modality[policy],
            "world": world,
            "control": control,
            "success": estimate.to_json(),
            "words": decide.rate_words(estimate),
            "needed": more,
            "categories": dict(Counter(e.category for e in episodes)),
            "time": _mean(e.time for e in episodes if e.success),
            "peak_force": _mean(e.peak_force for e in episodes),
        }
    ]


def _mean(values: Iterable[float]) -> float | None:
    """Of what is finite."""
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else None


def _gap(table: Table, policy: str, reference: str, world: str) -> list[GapRow]:
    cells = [Cell(policy, reference), Cell(policy, world)]
    if not table.has(*cells):
        return []
    paired = bool(table.seeds(cells)) and bool(table.train_seeds(cells))
    if paired and table.hashes[world]:
        y = table.aligned(policy, [reference, world])
        estimate = difference(y[reference], y[world], same_networks=True)
    else:  # a measured target: other starts, so independent samples
        paired = False
        counts = [[e.success for e in table.all(cell)] for cell in cells]
        estimate = unpaired_difference((sum(counts[0]), sum(counts[1])), (len(counts[0]), len(counts[1])))
    return [
        {
            "policy": policy,
            "modality": table.modality[policy],
            "world": world,
            "paired": paired,
            "gap": estimate.to_json(),
            "verdict": decide.decide(estimate),
            "words": decide.gap_words(estimate),
        }
    ]


def _attributions(
    table: Table, policies: Sequence[str], reference: str, factors: Sequence[str], joint: str | None, seed: int
) -> list[AttributionRow]:
    rows: list[AttributionRow] = []
    for policy in policies if joint else ():
        if not table.has(*(Cell(policy, str(w)) for w in (reference, *factors, joint))):
            continue
        split = attribute(table, policy, reference, factors, str(joint), stream(seed, "attribution", policy))
        parts = {"total": split.total, **split.factors, "remainder": split.remainder}
        rows.append(
            {
                "policy": policy,
                "modality": table.modality[policy],
                "parts": {k: e.to_json() for k, e in parts.items()},
                "share": {f: split.share(f) for f in factors},
                "bootstrap": {k: e.to_json() for k, e in split.bootstrap.items()},
            }
        )
    return rows


def _prediction(table: Table, reference: str, world: str, seed: int) -> list[PredictionRow]:
    points: list[Point] = []
    for policy in table.policies:
        cells = [Cell(policy, reference), Cell(policy, world)]
        for t in table.train_seeds(cells) if table.has(*cells) else ():
            means = [float(np.mean([e.success for e in table.cells[cell][t].values()])) for cell in cells]
            points.append({"policy": policy, "train_seed": t, "reference": means[0], "target": means[1]})
    if len(points) < 2:
        return []
    x, y = (np.array([p[key] for p in points]) for key in ("reference", "target"))
    prediction = predict(x, y, stream(seed, "prediction", world))
    return [
        {
            "world": world,
            "n": prediction.n,
            "pearson": prediction.pearson.to_json(),
            "spearman": prediction.spearman.to_json(),
            "mmrv": prediction.mmrv.to_json(),
            "mean_difference": prediction.mean_difference.to_json(),
            "words": _prediction_words(prediction),
            "points": points,
        }
    ]


def _prediction_words(prediction: Prediction) -> str:
    if prediction.n < FEWEST_POINTS:
        return f"{decide.CANNOT_TELL}: {TWO_POINTS}"
    if not np.isfinite(prediction.pearson.value):
        return f"{decide.CANNOT_TELL}: success does not vary between these policies"
    if not prediction.enough:
        return f"{decide.CANNOT_TELL}: {prediction.n} policies, {FEWEST} are the fewest"
    r = prediction.pearson
    return f"r = {r.value:.2f} ({r.low:.2f} to {r.high:.2f}) over {prediction.n} policies"


def _parting(table: Table, policy: str, reference: str, world: str, seed: int) -> list[PartingRow]:
    cells = [Cell(policy, reference), Cell(policy, world)]
    if not table.has(*cells):
        return []
    first, second = ([e.category for e in table.all(cell)] for cell in cells)
    test = part(first, second, stream(seed, "categories", policy, world)).to_json()
    return [{"policy": policy, "world": world, **test, "n": [len(first), len(second)]}]


def _measures(table: Table, policy: str, reference: str, world: str) -> list[MeasureRow]:
    """Of a robot's trials alone: between simulations the tables of success show both."""
    cells = [Cell(policy, reference), Cell(policy, world)]
    if table.hashes[world] or not table.has(*cells):
        return []
    return [{"policy": policy, "world": world, **row} for row in compare_measures(*map(table.all, cells))]


def _notes(table: Table, order: Sequence[str], scripted: Collection[str]) -> list[str]:
    notes = [] if BLIND in table.modality.values() else [NO_BLIND]
    for policy in table.policies:
        missing = [w for w in order if not table.has(Cell(policy, w))]
        if missing:
            notes.append(f"{policy} has no episodes in {', '.join(missing)}")
        cells = [Cell(policy, w) for w in order if table.has(Cell(policy, w)) and table.hashes[w]]
        counts = {len(row) for cell in cells for row in table.cells[cell].values()}
        if len(counts) > 1:
            notes.append(
                f"{policy} has {min(counts)} to {max(counts)} episodes a world; comparisons use the shared seeds"
            )
        if policy not in scripted and len(_policy(table, policy, False)["train_seeds"]) < 3:
            notes.append(
                f"{policy} has fewer than three training seeds: intervals speak of these networks, not of the recipe"
            )
    return notes


def _comparison(c: Comparison) -> ComparisonRow:
    return {
        "world": c.world,
        "first": c.first,
        "second": c.second,
        "difference": c.difference.to_json(),
        "p": c.p,
        "p_holm": c.p_holm,
        "verdict": c.verdict,
        "needed": c.needed,
    }
