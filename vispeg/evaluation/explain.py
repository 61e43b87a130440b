"""Explain why trials fail: replay their starts in simulation, apply rules of thumb, price each named effect.

Each trial's start is replayed several times over the model's uncertainty, and the trial is compared with the mean over
its replays. The trial is the unit of every comparison of success: replays of one start are not independent. The rules
of thumb are those of "the article", the practitioners' guide in docs/sources.md.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.seeds import stream
from vispeg.evaluation import senses, statistics
from vispeg.evaluation.bridge import bridge
from vispeg.evaluation.categories import part as compare_failures
from vispeg.evaluation.gap import worth_row
from vispeg.evaluation.jobs import seeds_of as evaluation_seeds
from vispeg.evaluation.measures import APART
from vispeg.evaluation.measures import compare as compare_measures
from vispeg.evaluation.records import Episode
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.explain import Cause, ExplainRecord, Rule, Sense, TrialRow
from vispeg.evaluation.schema.gap import Measure
from vispeg.evaluation.senses import before_contact
from vispeg.evaluation.statistics import CANNOT_TELL, Decision, Difference, Estimate, Hypothesis, Rows, wilson
from vispeg.trials.trial import Trial

FORMAT = "vispeg-explain/1"
CLOSED, OPEN, TOGETHER = "closed loop", "open loop", "all together"
FEWEST = 10  # trials; with fewer, even if none fails, the failure rate may be 30 %
TRACKING = 2.0  # deg, limit of a joint's RMS distance; the article's rule is 2 to 3 on any joint
LATE = 0.02  # s, limit of the delay; the article's delays are 0 to 20 ms
LIGHT = 1.0  # N, smallest divisor in the relative difference of peak forces
DELAYS = np.arange(0, 41)  # delays to try, in samples


def seeds_of(trial: int, trials: int, replays: int, seed: int = 0) -> list[int]:
    """Return the seeds of one trial's replays.

    They are the same for every kind of replay, so that replays pair, and the first are the same for any number of
    replays, so that a resumed run can use them.

    Raises:
        UserError: as `vispeg.evaluation.jobs.seeds_of`.
    """
    return evaluation_seeds(replays * trials, seed)[trial::trials]


def summarise(
    policy: str,
    trials: Sequence[Trial],
    played: Mapping[str, Sequence[Episode]],
    replayed: Sequence[Trial],
    causes: Mapping[str, Sequence[EffectInstance]],
    notes: Sequence[str] = (),
    parted: Sequence[senses.Parting] = (),
    repeats: float = senses.ASSUMED,
) -> ExplainRecord:
    """Return the content of explain.json.

    Args:
        policy: the policy's name.
        trials: the robot's trials.
        played: kind of replay (`CLOSED`, `OPEN`, a cause's label) -> episodes, trial by trial, as many for each trial.
        replayed: one replay of each trial's actions, kept as a trial.
        causes: label -> effects that were added in the replays of that kind.
        notes: further notes for the record.
        parted: for each trial, how far its actions move if one sense at a time is simulated; empty if not asked for.
        repeats: the arm's pose repeatability, mm.
    """
    y = np.array([t.said.outcome.success for t in trials], float)
    # kind -> (trials, replays)
    won = {kind: np.array([e.success for e in ends]).reshape(len(y), -1) for kind, ends in played.items()}
    mean = {kind: replays.mean(axis=1) for kind, replays in won.items()}
    tried = [_episode(policy, t, i) for i, t in enumerate(trials)]
    # the first replay of each trial, as the same network 0 that `_episode` gives the trials
    once = [replace(e, train_seed=0) for e in played[CLOSED][:: won[CLOSED].shape[1]]]
    kinds = compare_failures(_ends(once, "simulation"), _ends(tried, "robot"), stream(0, "categories", policy))
    measures = compare_measures(once, tried)
    tests: dict[tuple[str, str], Hypothesis | Difference] = {("gap", ""): _difference(mean[CLOSED], y)}
    tests |= {("failures", name): test for name, test in kinds.tests.items()}
    tests |= {("measure", m.name): Hypothesis(m.p) for m in measures}
    tests |= {("cause", name): _difference(mean[CLOSED], mean[name]) for name in causes}
    if parted:
        tests |= {("sense", name): test for name, test in senses.tests(parted).items()}
    if len(y) < FEWEST:
        tests = {key: replace(test, p=None) for key, test in tests.items()}
    decided = statistics.decide(tests)
    compared = [m.decided(decided["measure", m.name]) for m in measures]
    rules = _rules(trials, replayed, compared)
    rows = [_cause(name, effects, mean, y, decided["cause", name]) for name, effects in causes.items()]
    rows.sort(key=lambda c: (c["effect"] == TOGETHER, -(c["cost"]["value"] or 0.0)))
    exchanged = senses.ranked(parted, {name: decided[kind, name] for kind, name in tests if kind == "sense"}, repeats)
    for cause in rows:
        cause["points_to_it"] = _signs(causes[cause["effect"]], rules, exchanged)
    gap, failed = decided["gap", ""], y == 0
    verdict, words = _verdict(gap, mean, failed, rows)
    return {
        "format": FORMAT,
        "policy": policy,
        "verdict": verdict,
        "words": words,
        "robot": wilson(int(y.sum()), len(y)).to_json(),
        "closed": _rate(mean[CLOSED]),
        "open": _rate(mean[OPEN]),
        "gap": gap.estimate.to_json(),
        "failed": _rate(mean[CLOSED][failed]) if failed.any() else None,
        "trials": [_row(t, won[CLOSED][i], won[OPEN][i]) for i, t in enumerate(trials)],
        "categories": kinds.decided({name: decided["failures", name] for name in kinds.tests}),
        "measures": compared,
        "rules": rules,
        "causes": rows,
        "senses": exchanged,
        "moment": senses.moment(trials, parted, _shown(exchanged)) if parted else None,
        "worth": worth_row(y, mean[CLOSED]),
        "left": _alone(mean[everything(causes)], y),
        "remainder": None,  # the caller fills in this, `bridge`, `steps` and `next`
        "bridge": bridge(None, None),
        "steps": [],
        "next": None,
        "notes": list(notes),
        "rule": statistics.RULE,
    }


def _shown(exchanged: Sequence[Sense]) -> str:
    """Return the sense whose moment of largest effect is shown: pictures if any, which people can see, or the first."""
    names = [row["sense"] for row in exchanged]
    return senses.PICTURES if senses.PICTURES in names else names[0]


def _episode(policy: str, trial: Trial, number: int) -> Episode:
    """Return a robot's trial in the form of an evaluated episode, with its number as the seed."""
    o = trial.said.outcome
    force = np.nan if o.peak_force_n is None else o.peak_force_n
    return Episode(policy, "", 0, "robot", "", number, o.success, o.category, time=o.time_s, peak_force=force)


def _ends(episodes: Sequence[Episode], side: str) -> dict[int, dict[Hashable, str]]:
    """Return how one network's episodes end, as `categories.Ends`.

    A trial and its replay get different keys and so do not pair, because the draws of the world differ.
    """
    return {0: {(side, i): e.category for i, e in enumerate(episodes)}}


def _difference(first: np.ndarray, second: np.ndarray) -> Difference:
    """Compare success per trial (n,) on two sides; the trial is the unit, so no pairs of episodes are counted."""
    sides: list[Rows] = [{0: {i: float(x) for i, x in enumerate(side)}} for side in (first, second)]
    return replace(statistics.difference(sides[0], sides[1], same_networks=True), discordant=None)


def everything(causes: Collection[str]) -> str:
    """Return the kind of replay that has all causes; closed loop if there are none."""
    return TOGETHER if TOGETHER in causes else next(iter(causes), CLOSED)


def _alone(first: np.ndarray, second: np.ndarray) -> Interval:
    """Return a difference of success with its own 95 % interval, outside the page's family of tests."""
    d = _difference(first, second)
    return Estimate(d.value, *d.interval(statistics.ALPHA), d.n).to_json()


def _signs(effects: Sequence[EffectInstance], rules: Sequence[Rule], exchanged: Sequence[Sense]) -> list[str]:
    """Return, in words, the rules that speak and senses that point to something, if these effects change it."""
    changed = {sign for e in effects for sign in _shows(e.effect)}
    return [
        *(f"{r['rule']} {r['value']:.3g} {r['unit']}" for r in rules if r["speaks"] and r["points_to"] in changed),
        *(
            f"{s['sense']}: the action moves by {s['moved_mm']:.1f} mm"
            for s in exchanged
            if s["points_to"] and s["sense"] in changed
        ),
    ]


def _shows(name: str) -> set[str]:
    """Return the names, as used by rules (`points_to`) and senses, of what an effect changes."""
    family = effect(name).family
    if family in ("camera", "appearance"):
        return {senses.PICTURES}
    if family in ("contact", "task"):
        return {"contact", senses.CONTACT}
    if family == "sensor" and name.startswith("wrench"):
        return {senses.WRENCH}
    return {senses.ARM, "latency" if "delay" in name else "actuator"}


def _rate(each: np.ndarray) -> Interval:
    """Return the mean success over trials (n,), with Wilson's interval of n episodes: replays of a start add none."""
    found = wilson(round(float(each.sum())), len(each)).to_json()
    return {**found, "value": float(each.mean())}


def _row(trial: Trial, closed: np.ndarray, opened: np.ndarray) -> TrialRow:
    """Return a trial's row: its outcome, and the success of its replays (n,) in closed and open loop."""
    return {
        "trial": "" if trial.path is None else trial.path.name,
        "success": trial.said.outcome.success,
        "category": trial.said.outcome.category,
        "closed": wilson(int(closed.sum()), len(closed)).to_json(),
        "open": wilson(int(opened.sum()), len(opened)).to_json(),
    }


def _verdict(
    gap: Decision, mean: Mapping[str, np.ndarray], failed: np.ndarray, causes: Sequence[Cause]
) -> tuple[str, str]:
    """Return the verdict (`gap`, `policy`, `none` or CANNOT_TELL) and a sentence.

    Args:
        gap: success in closed-loop replays minus that of the trials.
        mean: kind of replay -> success of each trial's replays (n,).
        failed: (n,) bool, trials that failed.
        causes: the largest cost first, all together last.
    """
    n, count = len(failed), int(failed.sum())
    if n < FEWEST:
        return CANNOT_TELL, f"these trials cannot tell: there are {n}, at least {FEWEST} are needed"
    if not count:
        return "none", f"none of {n} trials failed"
    closed, opened = _rate(mean[CLOSED][failed]), float(mean[OPEN][failed].mean())
    value, low, high = (100 * (closed[key] or 0) for key in ("value", "low", "high"))
    rate = f"{value:.0f} % ({low:.0f} to {high:.0f})"
    words = f"from the starts of the {count} failures {rate} succeed in simulation"
    if (closed["high"] or 0) < 0.5:
        return "policy", f"{words}: it is the policy"
    if not gap.certain or gap.estimate.value < 0:
        return CANNOT_TELL, f"these trials cannot tell: {words}"
    words += ": the gap is in physics or looks"
    if opened > 0.5:
        words += f"; so do {100 * opened:.0f} % with the trials' own actions, which points to physics"
    first = next((c for c in causes if c["verdict"] == "different" and (c["cost"]["value"] or 0) > 0), None)
    return "gap", words if first is None else f"{words}; first cause: {first['effect']}"


def _cause(
    name: str,
    effects: Sequence[EffectInstance],
    mean: Mapping[str, np.ndarray],
    y: np.ndarray,
    decision: Decision,
) -> Cause:
    """Return the row of a cause; `decision` is on success without it minus success with it; `y` (n,) is the trials'."""
    with_it = mean[name]
    share = statistics.share(mean[CLOSED] - with_it, mean[CLOSED] - y) if len(y) >= FEWEST else None
    cost = decision.estimate
    if decision.certain and cost.value < 0:
        words = f"gains {-100 * cost.value:.0f} points ({-100 * cost.high:.0f} to {-100 * cost.low:.0f})"
    elif decision.certain:
        words = f"costs {100 * cost.value:.0f} points ({100 * cost.low:.0f} to {100 * cost.high:.0f})"
    elif decision.verdict == "equal":
        words = "costs this policy nothing, to within 5 points"
    else:
        words = f"{CANNOT_TELL}: {100 * cost.low:.0f} to {100 * cost.high:.0f} points"
    return {
        "effect": name,
        "params": {} if name == TOGETHER else {k: v.value for k, v in effects[0].params.items()},
        "without": _rate(mean[CLOSED]),
        "with_it": _rate(with_it),
        "cost": cost.to_json(),
        "p_holm": decision.p_holm,
        "verdict": decision.verdict,
        "share": None if share is None else share.to_json(),
        "points_to_it": [],
        "cure": "",  # the caller fills in this and `hours`
        "hours": None,
        "words": words,
    }


def _rules(trials: Sequence[Trial], replayed: Sequence[Trial], measures: Sequence[Measure]) -> list[Rule]:
    """Return the article's rules of thumb, each with its value in these trials and their replays."""
    followed = [f for f in map(_followed, trials, replayed) if f is not None]
    rules: list[Rule] = []
    if followed:
        distance = np.median([distance for distance, _ in followed], axis=0)  # (nj,) deg
        worst = int(np.argmax(distance))
        joint, delay = trials[0].recording.joints[worst], float(np.median([delay for _, delay in followed]))
        rules.append(
            _rule(
                f"distance of {joint} from where the same actions bring it in simulation",
                float(distance[worst]),
                TRACKING,
                "deg",
                "actuator",
            )
        )
        rules.append(_rule("the arm moves later than in simulation", delay, LATE, "s", "latency"))
    for m in measures:
        if m["measure"] == "peak_force":
            off = abs(m["second"] - m["first"]) / max(m["first"], LIGHT)
            rules.append(
                {**_rule("peak force differs from the simulated", off, APART, "of it", "contact"), "speaks": m["apart"]}
            )
    return rules


def _rule(rule: str, value: float, limit: float, unit: str, points_to: str) -> Rule:
    return {"rule": rule, "value": value, "limit": limit, "unit": unit, "points_to": points_to, "speaks": value > limit}


def _followed(trial: Trial, replay: Trial) -> tuple[np.ndarray, float] | None:
    """Return the joints' RMS distance (nj,) deg between trial and replay, and the delay of the robot that fits best, s.

    Both are read at the replay's rate, as a robot's readings may be fewer, from the first step until either of them
    makes contact. None where this is too short.
    """
    sides, rate = [(t.recording, t.steps.time[0]) for t in (trial, replay)], replay.recording.rate_hz
    n = 1 + int(rate * min(rec.time[max(before_contact(rec), 1) - 1] - begun for rec, begun in sides) + 1e-6)
    if n < 2 * DELAYS[-1]:
        return None
    real, simulated = (
        np.stack([np.interp(begun + np.arange(n) / rate, rec.time, q) for q in rec.q.T], axis=1) for rec, begun in sides
    )
    speed = [np.diff(q, axis=0) for q in (real, simulated)]
    residual = [float(np.nanmean((speed[0][k:] - speed[1][: n - 1 - k]) ** 2)) for k in DELAYS]
    delay = float(DELAYS[int(np.argmin(residual))]) / rate
    return np.rad2deg(np.sqrt(np.nanmean((real - simulated) ** 2, axis=0))), delay
