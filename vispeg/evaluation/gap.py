"""Compute the transfer gap: every policy's success in every world, its losses, their factors, and what is undecided.

`gap` first collects all tests (`_Asked`), then decides them together (`vispeg.evaluation.statistics.decide`), and then
makes the rows.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.evaluation import statistics
from vispeg.evaluation.categories import Parting, part
from vispeg.evaluation.entrants import EXPERT
from vispeg.evaluation.jobs import FIRST_SEED
from vispeg.evaluation.measures import Measured
from vispeg.evaluation.measures import compare as compare_measures
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
    Worth,
)
from vispeg.evaluation.statistics import CANNOT_TELL, FEWEST_NETWORKS, Decision, Difference, Hypothesis, Rows
from vispeg.evaluation.table import BLIND, Cell, Table, rows

FORMAT = "vispeg-gap/2"
NO_BLIND = f"no blind control: add a {BLIND} policy"
SHARED = "Three questions share the 5 % equally: what policies lose, how they compare, and how they fail."
RULE = f"{statistics.RULE} {SHARED}"
Key = tuple[str, ...]  # of a test: its kind, then policies, worlds, categories, see `_Asked.tests`


def gap(
    episodes: Iterable[Episode],
    reference: str = "S",
    worlds: Sequence[str] = (),
    seed: int = 0,
    notes: Sequence[str] = (),
    scripted: Collection[str] = (EXPERT,),
    homes: Mapping[str, Collection[str]] | None = None,
) -> GapRecord:
    """Return everything that a gap report shows, as JSON data.

    Args:
        episodes: records of policies in worlds, with controls.
        reference: the world against which losses are measured.
        worlds: the order of worlds in tables; empty for the order of the episodes.
        seed: seed of the random tables in the tests of kinds of failure.
        notes: further notes about the episodes.
        scripted: names of policies that were not trained and have no training seeds.
        homes: policy -> hashes of the worlds that it was trained in, for policies of which these are known.

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
    home = {p: [w for w in order if table.hashes[w] and table.hashes[w] in own] for p, own in (homes or {}).items()}
    asked = _Asked.of(table, order, [joint, *factors] if joint else [], scripted, seed)
    decided = statistics.decide(weighed(asked.tests))
    measures = _measures(asked, decided)
    measure_notes = [f"{row['policy']} in {row['world']}: {row['words']}" for row in measures]
    return {
        "format": FORMAT,
        "reference": reference,
        "worlds": [{"name": w, "hash": table.hashes[w]} for w in order],
        "joint": joint,
        "factors": factors,
        "policies": [_policy(table, p, p in scripted, home.get(p)) for p in policies],
        "success": [
            row for c in ("", *table.controls) for p in policies for w in order for row in _success(table, p, w, c)
        ],
        "gaps": [_gap(table, d, key, reference, home) for key, d in decided.items() if key[0] == "gap"],
        "attribution": [
            _attribution(table, decided, p, reference, factors, str(joint))
            for p in policies
            if ("beyond", p) in decided
        ],
        "comparisons": [_comparison(key, d) for key, d in decided.items() if key[0] == "pair"],
        "prediction": [row for w in targets for row in _prediction(table, decided, reference, w)],
        "categories": _partings(asked, decided),
        "measures": measures,
        "notes": [*_notes(table, decided, order, scripted), *notes, *measure_notes],
        "rule": RULE,
    }


def joint_of(worlds: Sequence[str], reference: str) -> tuple[str | None, list[str]]:
    """Find the world whose name joins the names of most other worlds.

    Returns:
        Its name and those of its factors, such as `VNP` and V, N, P; None and none without such a world.
    """
    others = [w for w in worlds if w != reference]
    best: tuple[str | None, list[str]] = (None, [])
    for joint in others:
        factors, rest = [], joint
        while rest:
            parts = sorted((w for w in others if w != joint and rest.startswith(w)), key=len)
            if not parts:
                break
            factors.append(parts[-1])
            rest = rest[len(parts[-1]) :]
        if not rest and len(factors) == len(set(factors)) and len(factors) > max(1, len(best[1])):
            best = (joint, factors)
    return best


@dataclass(frozen=True)
class _Asked:
    """All the tests of a page: one family.

    Attributes:
        tests: by ("gap", policy, world), ("pair", world, first, second), ("beyond", policy), ("failures", policy,
            world, category or "") and ("measure", policy, world, measure).
        partings: (policy, world) -> the comparison of failures behind the "failures" tests, and the number of episodes
            on each side.
        measured: (policy, world) -> the comparisons behind the "measure" tests.
    """

    tests: dict[Key, Hypothesis | Difference] = field(default_factory=dict)
    partings: dict[tuple[str, str], tuple[Parting, list[int]]] = field(default_factory=dict)
    measured: dict[tuple[str, str], list[Measured]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, table: Table, worlds: Sequence[str], joint: Sequence[str], scripted: Collection[str], seed: int
    ) -> _Asked:
        """Collect the tests.

        Args:
            table: the episodes.
            worlds: names of the worlds, the reference first.
            joint: the combined world, then its factors; empty without one.
            scripted, seed: as for `gap`.
        """
        asked, reference, policies = cls(), worlds[0], table.policies
        for policy in policies:
            for world in worlds[1:]:
                asked._ask_loss(table, policy, reference, world, seed)
            if joint and (y := table.aligned(policy, [reference, *joint])) is not None:
                asked.tests["beyond", policy] = statistics.contrast(_beyond(y, reference, joint[0], joint[1:]))
        for world in worlds:
            for i, a in enumerate(policies):
                for b in policies[i + 1 :]:
                    sides = [table.rows(Cell(p, world)) for p in (a, b)]
                    if all(sides):
                        trained = (a not in scripted, b not in scripted)
                        asked.tests["pair", world, a, b] = statistics.difference(sides[0], sides[1], False, trained)
        return asked

    def _ask_loss(self, table: Table, policy: str, reference: str, world: str, seed: int) -> None:
        """Add the tests of a policy's loss of success, of its kinds of failure and, on a robot, of time and force."""
        cells = [Cell(policy, reference), Cell(policy, world)]
        networks = table.networks(cells)
        if not networks:
            return
        self.tests["gap", policy, world] = statistics.difference(table.rows(cells[0]), table.rows(cells[1]), True)
        first, second = ([e for e in table.all(cell) if e.train_seed in networks] for cell in cells)
        ends = [rows(side, lambda e: (e.seed, e.configuration), lambda e: e.category) for side in (first, second)]
        kinds = part(ends[0], ends[1], stream(seed, "categories", policy, world))
        self.partings[policy, world] = kinds, [len(first), len(second)]
        self.tests.update({("failures", policy, world, name): test for name, test in kinds.tests.items()})
        if not table.hashes[world]:  # a robot; for simulations the tables of success show time and force
            self.measured[policy, world] = compare_measures(first, second)
            for m in self.measured[policy, world]:
                self.tests["measure", policy, world, m.name] = Hypothesis(m.p)


def weighed(tests: Mapping[Key, Hypothesis | Difference]) -> dict[Key, Hypothesis | Difference]:
    """Split the page's 5 % error rate among its questions: losses of policies, comparisons of them, kinds of failure.

    Each question gets an equal share, because the number of comparisons grows with the square of the number of
    policies.
    """
    question = {"beyond": "gap", "measure": "failures"}  # other kinds of test are a question of their own
    total: defaultdict[str, float] = defaultdict(float)
    for key, test in tests.items():
        total[question.get(key[0], key[0])] += test.weight * (test.p is not None)
    return {
        key: replace(test, weight=test.weight / total[question.get(key[0], key[0])] if test.p is not None else 1.0)
        for key, test in tests.items()
    }


def _beyond(y: Mapping[str, np.ndarray], reference: str, joint: str, factors: Sequence[str]) -> np.ndarray:
    """Return the cost of the joint world beyond the sum of the factors', one value per episode and network."""
    return y[reference] - y[joint] - np.sum([y[reference] - y[f] for f in factors], axis=0)


def _policy(table: Table, policy: str, scripted: bool, home: list[str] | None) -> PolicyRow:
    seeds = sorted({t for cell, rows in table.cells.items() if cell.policy == policy for t in rows})
    modality = table.modality[policy]
    return {
        "name": policy,
        "modality": modality,
        "train_seeds": [] if scripted else seeds,
        "blind": modality == BLIND,
        "scripted": scripted,
        "home": [] if scripted else home,
    }


def _success(table: Table, policy: str, world: str, control: str) -> list[SuccessRow]:
    """Return the row of a policy in a world under a control; none where nothing was played."""
    cell = Cell(policy, world, control)
    rows = table.rows(cell)
    if not rows:
        return []
    episodes, estimate = table.all(cell), statistics.rate(rows)
    one = len(rows) == 1  # with several networks, more episodes would not help
    return [
        {
            "policy": policy,
            "modality": table.modality[policy],
            "world": world,
            "control": control,
            "success": estimate.to_json(),
            "words": statistics.rate_words(estimate, sum(e.success for e in episodes)),
            "needed": statistics.episodes_needed(estimate) if one else None,
            "categories": dict(Counter(e.category for e in episodes)),
            "time": _mean(e.time for e in episodes if e.success),
            "peak_force": _mean(e.peak_force for e in episodes),
        }
    ]


def _mean(values: Iterable[float]) -> float | None:
    """Return the mean of the finite values."""
    finite = [v for v in values if np.isfinite(v)]
    return float(np.mean(finite)) if finite else None


def _gap(table: Table, decision: Decision, key: Key, reference: str, home: Mapping[str, Sequence[str]]) -> GapRow:
    _, policy, world = key
    return {
        "policy": policy,
        "modality": table.modality[policy],
        "world": world,
        "home": world in home.get(policy, ()),
        "paired": decision.paired,
        "train_seeds": table.networks([Cell(policy, reference), Cell(policy, world)]),
        "gap": decision.estimate.to_json(),
        "p": decision.test.p,
        "p_holm": decision.p_holm,
        "verdict": decision.verdict,
        "words": statistics.gap_words(decision),
        "worth": None if table.hashes[world] else _worth(table, policy, reference, world),
    }


def _worth(table: Table, policy: str, reference: str, world: str) -> Worth | None:
    """Return the value of simulation for one network's robot trials; None if these do not share its starts.

    A trial with the number of a simulated episode's seed (FIRST_SEED or more) had that episode's start set up.
    """
    cells = [Cell(policy, reference), Cell(policy, world)]
    networks = table.networks(cells)
    simulated, tried = (
        {(e.seed, e.configuration): float(e.success) for e in table.all(cell) if e.train_seed in networks}
        for cell in cells
    )
    if len(networks) != 1 or not all(e in simulated and e[0] >= FIRST_SEED for e in tried):
        return None
    return worth_row(np.array(list(tried.values())), np.array([simulated[e] for e in tried]))


def worth_row(y: np.ndarray, f: np.ndarray) -> Worth:
    """Return the value of simulated outcomes f (n,) for real outcomes y (n,), ready for JSON."""
    w = statistics.worth(y, f)
    return {"rho": w.rho.to_json(), "trials": w.trials.to_json(), "buys": w.buys, "words": w.words}


def _comparison(key: Key, decision: Decision) -> ComparisonRow:
    _, world, first, second = key
    return {
        "world": world,
        "first": first,
        "second": second,
        "paired": decision.paired,
        "difference": decision.estimate.to_json(),
        "p": decision.test.p,
        "p_holm": decision.p_holm,
        "verdict": decision.verdict,
        "refused": decision.refused,
        "needed": decision.needed,
    }


def _attribution(
    table: Table, decided: Mapping[Key, Decision], policy: str, reference: str, factors: Sequence[str], joint: str
) -> AttributionRow:
    parts = {"total": decided["gap", policy, joint], **{f: decided["gap", policy, f] for f in factors}}
    parts["remainder"] = decided["beyond", policy]
    y = table.aligned(policy, [reference, *factors, joint])
    shares: dict[str, statistics.Estimate | None] = dict.fromkeys(factors)
    if y is not None and parts["total"].certain:
        shares = {f: statistics.share(y[reference] - y[f], y[reference] - y[joint]) for f in factors}
    return {
        "policy": policy,
        "modality": table.modality[policy],
        "parts": {name: d.estimate.to_json() for name, d in parts.items()},
        "verdict": {name: d.verdict for name, d in parts.items()},
        "share": {f: None if e is None else e.to_json() for f, e in shares.items()},
    }


def _prediction(table: Table, decided: Mapping[Key, Decision], reference: str, world: str) -> list[PredictionRow]:
    """Return the row on how success in the reference predicts success in a world; none with fewer than two policies.

    Each policy is one point, the mean over its networks.
    """
    points: list[Point] = []
    means: dict[str, np.ndarray] = {}
    networks: dict[str, list[tuple[float, float]]] = {}
    episodes: dict[str, list[Rows]] = {}
    for policy in table.policies:
        cells = [Cell(policy, reference), Cell(policy, world)]
        shared, sides = table.networks(cells), [table.rows(cell) for cell in cells]
        for t in shared:
            here, there = (float(np.mean(list(side[t].values()))) for side in sides)
            points.append({"policy": policy, "train_seed": t, "reference": here, "target": there})
            networks.setdefault(policy, []).append((here, there))
        if shared:
            means[policy] = np.mean(networks[policy], axis=0)
            episodes[policy] = [{t: side[t] for t in shared} for side in sides]
    if len(means) < 2:
        return []
    x, y = np.array(list(means.values())).T
    noise = _noise(networks, episodes)
    pearson = statistics.correlation(x, y, noise)
    measured, ceiling = (
        v if np.isfinite(v) else None for v in (statistics.measured_correlation(x, y), statistics.ceiling(x, y, noise))
    )
    names = list(means)
    orders = [_order(decided, w, names) for w in (reference, world)]
    return [
        {
            "world": world,
            "n": len(means),
            "pearson": pearson.to_json(),
            "measured": measured,
            "ceiling": ceiling,
            "mmrv": statistics.mmrv(y, *orders),
            "ordered": int(np.sum(orders[0] * orders[1] != 0)) // 2,
            "mean_difference": statistics.mean_interval(x - y).to_json(),
            "words": _prediction_words(pearson, measured, ceiling),
            "points": points,
        }
    ]


def _noise(
    networks: Mapping[str, Sequence[tuple[float, float]]], episodes: Mapping[str, Sequence[Rows]]
) -> list[np.ndarray]:
    """Return the covariance (2, 2) of each policy's two measured rates.

    If a policy has several networks, it comes from the spread of networks within policies, pooled over policies; else
    from the episodes.
    """
    df = sum(len(each) - 1 for each in networks.values())
    if df:
        deviations = [np.array(each) - np.mean(each, axis=0) for each in networks.values()]
        pooled = np.sum([d.T @ d for d in deviations], axis=0) / df + 1e-9 * np.eye(2)  # never singular
        return [pooled / len(each) for each in networks.values()]
    return [statistics.noise(*sides) for sides in episodes.values()]


def _order(decided: Mapping[Key, Decision], world: str, policies: Sequence[str]) -> np.ndarray:
    """Return (n, n): 1 where policy i is found to succeed more than policy j, -1 where less, 0 where undecided."""
    order = np.zeros((len(policies), len(policies)))
    for i, a in enumerate(policies):
        for j, b in enumerate(policies):
            decision = decided.get(("pair", world, a, b))
            if decision is not None and decision.certain:
                order[i, j] = np.sign(decision.estimate.value)
                order[j, i] = -order[i, j]
    return order


def _prediction_words(r: statistics.Estimate, measured: float | None, ceiling: float | None) -> str:
    if r.n < statistics.FEWEST_POLICIES:
        return f"{CANNOT_TELL}: {r.n} policies, at least {statistics.FEWEST_POLICIES} are needed"
    words = f"r = {r.value:.2f} ({r.low:.2f} to {r.high:.2f}) over {r.n} policies"
    if measured is not None and ceiling is not None:
        words += f"; of the rates as measured {measured:.2f}, of at most {ceiling:.2f} with so many episodes"
    return words if r.excludes(0.0) else f"{CANNOT_TELL}: {words}"


def _partings(asked: _Asked, decided: Mapping[Key, Decision]) -> list[PartingRow]:
    rows: list[PartingRow] = []
    for (policy, world), (kinds, n) in asked.partings.items():
        decisions = {name: decided["failures", policy, world, name] for name in kinds.tests}
        rows.append({"policy": policy, "world": world, **kinds.decided(decisions), "n": n})
    return rows


def _measures(asked: _Asked, decided: Mapping[Key, Decision]) -> list[MeasureRow]:
    return [
        {"policy": policy, "world": world, **m.decided(decided["measure", policy, world, m.name])}
        for (policy, world), measures in asked.measured.items()
        for m in measures
    ]


def _notes(table: Table, decided: Mapping[Key, Decision], order: Sequence[str], scripted: Collection[str]) -> list[str]:
    notes = [] if BLIND in table.modality.values() else [NO_BLIND]
    for policy in table.policies:
        played = [w for w in order if table.has(Cell(policy, w))]
        if missing := [w for w in order if w not in played]:
            notes.append(f"{policy} has no episodes in {', '.join(missing)}")
        cells = [Cell(policy, w) for w in played if table.hashes[w]]
        counts = {len(row) for cell in cells for row in table.cells[cell].values()}
        if len(counts) > 1:
            notes.append(
                f"{policy} has {min(counts)} to {max(counts)} episodes a world; comparisons use the shared seeds"
            )
        own = [row for cell, by_network in table.cells.items() if cell.policy == policy for row in by_network.values()]
        clipped = [e.clipped for row in own for e in row.values() if e.clipped >= 0]  # without NaN, where not counted
        if any(clipped):
            notes.append(
                f"{policy} asked for more than the controller takes in {np.mean(clipped):.1%} of an episode's steps"
            )
        if policy not in scripted:
            notes += _of_networks(policy, len(_policy(table, policy, False, None)["train_seeds"]))
        if order[0] in played:
            notes += [line for w in played[1:] for line in _of_pairing(table, decided, policy, order[0], w)]
    for key, decision in decided.items():
        if key[0] == "pair" and table.hashes[key[1]] and not decision.paired:
            _, world, a, b = key
            notes.append(f"{a} and {b} did not play the same seeds in {world}: compared as independent samples")
    return notes


def _of_networks(policy: str, networks: int) -> list[str]:
    if networks >= FEWEST_NETWORKS:
        return []
    if networks == 1:
        words = "has one training seed: seeds were not varied, so the figures are of this network, not of the recipe"
    else:
        words = f"has {networks} training seeds: a statement on the recipe needs {FEWEST_NETWORKS} or more"
    return [f"{policy} {words}"]


def _of_pairing(table: Table, decided: Mapping[Key, Decision], policy: str, reference: str, world: str) -> list[str]:
    """Return notes on the networks and episodes behind a gap, where these are not all."""
    here, there = (list(table.rows(Cell(policy, w))) for w in (reference, world))
    decision = decided.get(("gap", policy, world))
    if decision is None:
        tried = ", ".join(map(str, there))
        return [f"{policy}: none of training seeds {tried}, played in {world}, was played in {reference}"]
    lines, shared = [], [str(t) for t in here if t in there]
    if here != there:
        words = "is compared over the networks played on both sides only: training seed "
        lines.append(f"{policy} in {world} {words}" + ", ".join(shared))
    if table.hashes[world] and not decision.paired:
        words = "did not play the same seeds, so they are compared as independent samples"
        lines.append(f"{policy}: {reference} and {world} {words}")
    return lines
