"""Decide whether a gap can be bridged here: the unexplained torque, its cost in success, the verdict's conditions.

Intervals here are not in the page's family of tests: each condition is tested by itself, at 95 %.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from vispeg.core.counts import count
from vispeg.evaluation import statistics
from vispeg.evaluation.outlook import Sign
from vispeg.evaluation.records import Episode
from vispeg.evaluation.remainder import Remainder
from vispeg.evaluation.schema.estimate import Interval
from vispeg.evaluation.schema.explain import Bridge, Condition, RemainderRecord
from vispeg.evaluation.statistics import CANNOT_TELL, MARGIN, Estimate
from vispeg.evaluation.table import rows

UNBRIDGEABLE = "unbridgeable here (for this policy, with this library)"
HARMLESS = "not explained, and it does not matter for this task"
NOT_SHOWN = "not shown to be unbridgeable"
RECORDINGS = 2  # fewest recordings of a regime (free air, contact)
ASK = "not played: --remainder 200"


def cost(without: Sequence[Episode], with_it: Sequence[Episode]) -> Estimate:
    """Return the paired loss of success on the same seeds, with Tango's 95 % interval."""
    d = statistics.difference(rows(without), rows(with_it), same_networks=True)
    return Estimate(d.value, *d.interval(statistics.ALPHA), d.n)


def matters(e: Estimate | Interval | None) -> bool | None:
    """Return True if the whole interval of a loss lies above 5 points, False if it lies below, else None."""
    if e is None:
        return None
    low, high = (e.low, e.high) if isinstance(e, Estimate) else (e["low"], e["high"])
    if low is None or high is None:
        return None
    return True if low > MARGIN else False if high < MARGIN else None


def replayed(
    remainder: Remainder,
    without: Sequence[Episode],
    with_it: Sequence[Episode],
    home: tuple[Sequence[Episode], Sequence[Episode]] | None,
    home_world: str,
) -> RemainderRecord:
    """Return the loss of success due to the remainder.

    Args:
        remainder: the torque that was resampled.
        without, with_it: episodes without and with it, on the same seeds in the identified world.
        home: episodes without and with as much random torque, on the same seeds in the policy's training world; None
            if not played.
        home_world: name of the training world.
    """
    lost = cost(without, with_it)
    sizes, regimes = remainder.sizes(), remainder.regimes()
    where = max(regimes, key=lambda name: regimes[name]["share"])
    size = f"{sizes[0]['rms']:.2g} N m RMS in {sizes[0]['joint']}"
    size += f", {100 * regimes[where]['share']:.0f} % of its power in {where}"
    ends = f"{100 * lost.value:.0f} points ({100 * lost.low:.0f} to {100 * lost.high:.0f})"
    costly = matters(lost)
    if costly is None:
        words = f"{CANNOT_TELL} whether the unexplained torque matters: {size}, costs {ends}"
    elif costly:
        words = f"the unexplained torque costs {ends}: {size}"
    else:
        words = f"{HARMLESS}: {size}, costs {ends}"
    return {
        "recordings": list(remainder.names),
        "block_s": remainder.block,
        "joints": sizes,
        "regimes": regimes,
        "without": statistics.rate(rows(without)).to_json(),
        "with_it": statistics.rate(rows(with_it)).to_json(),
        "cost": lost.to_json(),
        "home": None if home is None else cost(*home).to_json(),
        "home_world": home_world,
        "matters": costly,
        "words": words,
    }


def bridge(
    remainder: RemainderRecord | None, diagnosis: Mapping[str, Any] | None, signs: Sequence[Sign] = ()
) -> Bridge:
    """Return the verdict with its conditions.

    Args:
        remainder: the cost of the unexplained torque; None if not played.
        diagnosis: content of the model's diagnosis.json; None if there is none.
        signs: the article's signs of a gap that cannot be bridged, with their numbers here.
    """
    conditions = [
        _recorded(remainder),
        _searched(diagnosis),
        _costly(remainder),
        _not_randomized_away(remainder),
    ]
    missing = [c for c in conditions if not c["met"]]
    if not missing and remainder is not None:
        worst = max(remainder["regimes"].items(), key=lambda item: item[1]["share"])
        e = remainder["cost"]
        points = f"{100 * (e['low'] or 0):.0f} to {100 * (e['high'] or 0):.0f} points"
        verdict = UNBRIDGEABLE
        share = f"{100 * worst[1]['share']:.0f} % of the unexplained torque's power is in {worst[0]}"
        words = f"{share}, it costs {points}, and no known effect explains it"
    elif remainder is not None and remainder["matters"] is False:
        verdict, words = HARMLESS, remainder["words"]
    else:
        first = missing[0]
        state = "not known" if first["met"] is None else "not met"
        verdict, words = NOT_SHOWN, f"{first['condition']}: {state} ({first['here']})"
    return {"verdict": verdict, "words": words, "conditions": conditions, "signs": list(signs)}


def _recorded(remainder: RemainderRecord | None) -> Condition:
    condition = f"{RECORDINGS} recordings or more of each regime"
    if remainder is None:
        return {"condition": condition, "here": ASK, "met": None}
    counts = {name: r["recordings"] for name, r in remainder["regimes"].items()}
    here = ", ".join(f"{n} in {name}" for name, n in counts.items())
    return {"condition": condition, "here": here, "met": min(counts.values()) >= RECORDINGS}


def _searched(diagnosis: Mapping[str, Any] | None) -> Condition:
    condition = "no further known effect passes the test of a diagnosis"
    if diagnosis is None:
        return {"condition": condition, "here": "no diagnosis.json beside --model", "met": None}
    refused = [c for c in diagnosis.get("candidates") or () if isinstance(c.get("heldout_gain"), int | float)]
    best = max(refused, key=lambda c: c["heldout_gain"], default=None)
    here = f"{diagnosis.get('verdict')}, {count(len(refused), 'effect')} refused"
    if best is not None:
        here += f", the best would remove {100 * best['heldout_gain']:.1f} % of the held-out error"
        here += f" ({best['effect']} at {best['where']})"
    return {"condition": condition, "here": here, "met": diagnosis.get("verdict") != "ambiguous"}


def _costly(remainder: RemainderRecord | None) -> Condition:
    condition = "the unexplained torque costs this policy more than 5 points"
    here = ASK if remainder is None else _ends(remainder["cost"])
    return {"condition": condition, "here": here, "met": matters(None if remainder is None else remainder["cost"])}


def _not_randomized_away(remainder: RemainderRecord | None) -> Condition:
    condition = "as much random torque in its training world costs this policy more than 5 points"
    lost = None if remainder is None else remainder["home"]
    here = ASK if remainder is None else "its training world is not known"
    if lost is not None and remainder is not None:
        here = f"{_ends(lost)} in {remainder['home_world']}, as it is, not trained anew"
    return {"condition": condition, "here": here, "met": matters(lost)}


def _ends(e: Interval) -> str:
    low, value, high = (100 * (e[k] or 0.0) for k in ("low", "value", "high"))
    return f"{value:.0f} points ({low:.0f} to {high:.0f}) of {e['n']} pairs"
