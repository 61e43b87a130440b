"""The verdict and the decrease of the error in words, derived from the record's numbers."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from vispeg.core.effect import REGISTRY
from vispeg.diagnosis.scale import times
from vispeg.report.record import label, rows
from vispeg.report.text import effect_words, joint_errors
from vispeg.report.text.effect_words import named as named_effect
from vispeg.report.text.effect_words import sized
from vispeg.report.text.quantities import fold, number, plain, quantity, scaled

NEAR_FLOOR = 1.2  # a held-out error up to this many noise floors is called "at the noise floor"
MOST_NAMED = 5  # with more effects, a sentence gives only their number
BEST = "best of what is known"  # for a model that ends above the noise floor, or began at it
PARTIAL = "partial: each effect lowers the held-out error, but a residual is left; model.yaml contains them"
TENTATIVE = "tentative: they lower the error, but each may stand in for another effect"
MOST_PRICED = 3  # most joints in the command that measures the effect of the residual on a policy
MOST_RIVALS = 3  # most rivals that a sentence lists
SAME = 0.05  # a relative change below this is called none
BELOW = 0.8  # noise floors; an error below this shows that the noise floor is too high for these recordings


def join(parts: Iterable[str], word: str = "and") -> str:
    """Join parts to a phrase: `a`, `a and b`, `a, b and c`."""
    items = list(parts)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} {word} {items[-1]}" if items else ""


def named(labels: list[str]) -> str:
    """Return the joined labels, or `7 effects` if there are too many for a sentence."""
    return join(labels) if len(labels) <= MOST_NAMED else f"{len(labels)} effects"


def change(first: Any, last: Any) -> str:
    """Return an error's change in words: `falls 37-fold`, `falls by 32 %`, `hardly changes`; empty if unknown."""
    a, b = number(first), number(last)
    if a is None or b is None or a < 0 or b < 0 or a == 0 == b:
        return ""
    if a == 0:
        return "rises from zero"
    if b == 0:
        return "falls to zero"
    if abs(b - a) <= SAME * a:
        return "hardly changes"
    if b < a:
        return f"falls {fold(a / b)}-fold" if a / b >= 2 else f"falls by {100 * (1 - b / a):.0f} %"
    return f"rises {fold(b / a)}-fold" if b / a >= 2 else f"rises by {100 * (b / a - 1):.0f} %"


def against_floor(error: Any, floor: Any) -> str:
    """Return an error as `1.1 × the noise floor`; empty if either is unknown or the floor is not positive."""
    e, f = number(error), number(floor)
    return f"{times(e / f)} × the noise floor" if e is not None and f is not None and f > 0 else ""


def ladder_ends(values: Mapping[str, Any]) -> tuple[float | None, float | None, str]:
    """Return the held-out errors of the ladder's first and last model, None if unknown, and their unit."""
    ladder = rows(values, "ladder")
    if not ladder:
        return None, None, ""
    first, last = (number(ladder[i].get("heldout_error")) for i in (0, -1))
    return first, last, str(ladder[0].get("unit") or "")


def error_name(values: Mapping[str, Any]) -> str:
    """Return the name of the ladder's errors, such as `Held-out error`; a comparison fits nothing: `Model error`."""
    if values.get("judged") == "fitted":
        return "Error on the fitted recordings"
    of = f" of {values['of']}" if values.get("of") else ""
    return "Model error" if values.get("format") == "vispeg-compare/1" else f"Held-out error{of}"


def fall(values: Mapping[str, Any]) -> str:
    """Return a sentence on the ladder: first and last held-out error, and the last relative to the noise floor."""
    first, last, unit = ladder_ends(values)
    if last is None:
        return f"The {error_name(values).lower()} is not known."
    if len(rows(values, "ladder")) == 1 or first is None:
        return f"{error_name(values)} is {quantity(last, unit)}{_against(', ', last, _floor(values), unit)}."
    moved, against = change(first, last) or "stays", _against(", which is ", last, _floor(values), unit)
    return f"{error_name(values)} {moved}, from {quantity(first, unit)} to {quantity(last, unit)}{against}."


def _against(lead: str, error: float, floor: float | None, unit: str) -> str:
    """Return `lead` and an error relative to the noise floor; if well below it, with an explanation."""
    if floor is not None and 0 < error < BELOW * floor:
        return f"{lead}below the noise floor: {quantity(floor, unit)} includes errors that these recordings lack"
    times = against_floor(error, floor)
    return f"{lead}{times}" if times else ""


def drifted(drift: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return sentences on whether the robot has changed since its effects were identified; empty without data."""
    if not drift:
        return []
    outside = [row for row in drift if row["since"]]
    recordings = len(drift[0]["now"])
    where = f"{recordings} recordings" if recordings > 1 else "this recording"
    if not outside:
        count = "its one value agrees" if len(drift) == 1 else f"all {len(drift)} values agree"
        return [f"has the robot changed? no: {count} in {where} with the identified model"]
    said = []
    for row in outside:
        then, now = (spread(row["parameter"], part, row["unit"]) for part in (row["then"], row["now"][-1]))
        said.append(f"has the robot changed? {label(row)} {then} then, {now} now: outside since {row['since']}")
    return said


def spread(name: str, ends: Mapping[str, Any], unit: str) -> str:
    """Return a value with its name, unit and interval."""
    value, around, shown = scaled(ends["value"], ends["low"], ends["high"], unit)
    return " ".join(part for part in (name, value, effect_words.unit(shown), f"({around})") if part)


def diverged(values: Mapping[str, Any]) -> list[str]:
    """Return a sentence on each recording in which the model diverged."""
    return [
        f"The model diverged in {row['recording']}, {plain(row['time_s'])} s after its start: its loop is unstable. No "
        "error below counts that recording."
        for row in rows(values, "diverged")
    ]


def verdict(values: Mapping[str, Any]) -> str:
    """Return the verdict in one or two plain sentences."""
    kind = values.get("verdict")
    names = _names(values)
    last, floor = ladder_ends(values)[1], _floor(values)
    at_floor = last is not None and floor is not None and last <= NEAR_FLOOR * floor
    from_the_start = _from_the_start(values)
    if kind == "adequate":
        if at_floor or last is None or floor is None or not values.get("reason"):
            return "The model is adequate: no known effect improves its prediction of the held-out recordings."
        return f"The model is adequate: {reason(values)}."
    if kind == "identified":
        verb = "explain" if len(names) > 1 else "explains"
        times = against_floor(last, floor) if last is not None else ""
        above = f"down to {times}" if times else BEST
        reach = from_the_start or (_to_the_floor(values) if at_floor else above)
        what = named(names) if names else "The model"
        return f"{what} {verb} the held-out recordings {reach}, and no rival does as well."
    if kind == "ambiguous":
        return _ambiguous(values, from_the_start or (_to_the_floor(values) if at_floor else BEST))
    if kind == "unexplained":
        count = len(_tentative(values))
        parts = [named(names)] if names else []
        parts += [f"{count} tentative effect{'s' if count > 1 else ''}"] if count else []
        helped = f"{join(parts)} {'help' if len(names) + count > 1 else 'helps'}, but " if parts else ""
        if only := _shows_in(values):
            left = "what is left" if helped else "The model's error"
            return f"{helped}{left} shows only in {only}, so no other recording can test an explanation."
        if what := _left_over(values):
            return f"{helped}not all is explained: {what}." if helped else f"What is left: {what}."
        rest = f"{helped}a structured residual remains that no known effect explains."
        return f"{rest[0].upper()}{rest[1:]}{_depends(values)}"
    return f"The record gives no known verdict ({kind})." if kind else ""


def tentative(values: Mapping[str, Any]) -> str:
    """Return a sentence that lists the tentative effects; empty if there are none."""
    labels = [named_effect(effect) for effect in _tentative(values)]
    return f"{TENTATIVE}: {join(labels)}" if labels else ""


def one_of(effect: Mapping[str, Any]) -> str:
    """Return an effect's name; for a partial effect with rivals `One of:` and the names of all."""
    others = [named_effect(other) for other in rows(effect, "indistinguishable_from")]
    alone = not others or not effect.get("partial") or effect.get("tentative")
    return named_effect(effect) if alone else f"One of: {', '.join([named_effect(effect), *others])}"


def baseline(values: Mapping[str, Any]) -> str:
    """Return sentences on the arm before and on what changed, if two states of a robot were compared; else empty."""
    before = values.get("baseline")
    if not isinstance(before, dict):
        return ""
    names = [sized(effect) for effect in rows(before, "effects")]
    had = named(names) if names else "no effect"
    changed = [
        f"{named_effect(e)} (from {effect_words.size(effect_words.before(e))} to {effect_words.size(e)})"
        for e in rows(values, "effects")
        if e.get("was")
    ]
    new = [sized(e) for e in rows(values, "effects") if not e.get("was")]
    out = [f"Before: {had} ({before.get('verdict')})"]
    out += [f"Changed: {named(changed)}"] if changed else []
    out += [f"New: {named(new)}"] if new else []
    return ". ".join(out if changed or new else [*out, "No change was found"]) + "."


def paid(values: Mapping[str, Any]) -> list[str]:
    """Return the cost of the remainder for each policy that was evaluated; empty if none was."""
    cost = values.get("cost")
    if not isinstance(cost, Mapping):
        return []
    world, lines = (cost.get("world") or {}).get("name"), []
    for row in rows(cost, "policies"):
        lost, low, high = (100 * (number(row["cost"].get(key)) or 0.0) for key in ("value", "low", "high"))
        before, after = (f"{100 * (number(row[key].get('value')) or 0.0):.0f} %" for key in ("identified", "left"))
        text = f"what is left costs {row['policy']} {lost:.0f} points of success [{low:.0f}, {high:.0f}]"
        lines.append(f"{text}: {before} with the identified model, {after} with the rest, in {world}")
    return lines


def price(values: Mapping[str, Any]) -> str:
    """Return the command that measures what the residual costs a policy; empty if there is none, or if that is known.

    It names the joints with the largest missing torque relative to the torque that they need.
    """
    if values.get("cost"):
        return ""
    missing = []
    for row in rows(values, "remainder"):
        rms, needed = number(row.get("rms")) or 0.0, number(row.get("needed")) or 0.0
        if rms > 0:
            missing.append((rms / max(needed, 1e-9), rms, row.get("joint")))
    worst = sorted(missing, key=lambda entry: -entry[0])[:MOST_PRICED]
    sweeps = " ".join(f'--sweep "torque_noise@{joint}.rms=0,{rms:.2g}"' for _, rms, joint in worst)
    return f"vispeg sensitivity POLICY {sweeps} --out price" if sweeps else ""


def rivals(values: Mapping[str, Any]) -> list[list[str]]:
    """Return in words the classes of effects that the recordings cannot distinguish, the one in the model first."""
    classes = []
    for effect in rows(values, "effects"):
        others = [o for o in _others(effect) if not _mutual(values, effect, o)]
        if others and not effect.get("tentative"):
            classes.append([sized(effect), *map(named_effect, others)])
    return classes


def combinations(values: Mapping[str, Any]) -> list[list[str]]:
    """Return in words the sets of named effects that are all rivals of each other.

    The recordings determine only a combination of such effects.
    """
    sets: list[list[str]] = []
    for effect in rows(values, "effects"):
        if effect.get("tentative"):
            continue
        found = [e for e in rows(values, "effects") if e is effect or _mutual(values, effect, e)]
        members = [sized(e) for e in found]
        if len(members) > 1 and members not in sets:
            sets.append(members)
    return sets


def reason(values: Mapping[str, Any]) -> str:
    """Return the reason for the verdict; empty if the record gives none."""
    return in_words(values.get("reason"))


def in_words(text: Any) -> str:
    """Replace labels `name(place)` in a record's text by the effects' names in words; empty without text."""

    def effect_of(label: re.Match[str]) -> str:
        return named_effect({"effect": label[1], "where": label[2]}) if label[1] in REGISTRY else label[0]

    return re.sub(r"(\w+)\(([^()]+)\)", effect_of, str(text or "")).rstrip(".")


def _others(effect: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return rows(effect, "indistinguishable_from")


def _mutual(values: Mapping[str, Any], effect: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Return whether two effects are named and each is among the rivals of the other."""

    def is_at(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
        return (a.get("effect"), a.get("where")) == (b.get("effect"), b.get("where"))

    named_too = [e for e in rows(values, "effects") if is_at(e, other) and not e.get("tentative")]
    other_is_rival = any(is_at(o, other) for o in _others(effect))
    return other_is_rival and any(is_at(o, effect) for e in named_too for o in _others(e))


def depends_on(row: Mapping[str, Any]) -> str:
    """Return an input that the residual depends on, such as `position at joint3`."""
    joint = row.get("joint")
    return f"{row.get('input', '?')} at {joint}" if joint else str(row.get("input", "?"))


def onward(values: Mapping[str, Any]) -> str:
    """Return the recommended next recording and its reason, in one sentence."""
    following = values.get("next_experiment")
    if not isinstance(following, dict) or not (following.get("motion") or following.get("why")):
        if values.get("verdict") == "unexplained":
            return "No known effect explains the residual, so no motion can be proposed that would show its cause."
        if values.get("verdict") == "ambiguous":
            return "These recordings cannot tell which, and no motion is proposed that would: record another one."
        return (
            "No rivals are left to distinguish. A recording of another motion would show whether the model holds there "
            "too."
        )
    motion, why = str(following.get("motion") or ""), str(following.get("why") or "").rstrip(".")
    sigma = number(following.get("expected_separation_sigma"))
    expected = f", by an expected {plain(sigma, 2)} sigma" if sigma and motion else ""  # zero means not predicted
    return f"Record {motion}: it {why}{expected}." if motion and why else f"{motion or why[0].upper() + why[1:]}."


def _names(values: Mapping[str, Any]) -> list[str]:
    """Return the named effects with sizes, not tentative ones; a class of competing partial effects is one entry."""
    listed = rows(values, "effects") or rows(values, "partial")
    names: dict[frozenset[str], str] = {}
    for effect in (e for e in listed if not e.get("tentative")):
        several = one_of(effect) != named_effect(effect)
        members = [named_effect(e) for e in (effect, *(_others(effect) if several else ()))]
        names.setdefault(frozenset(members), f"one of {_among(members)}" if several else sized(effect))
    return [*names.values()]


def _among(names: Sequence[str]) -> str:
    return join(names, "or") if len(names) <= MOST_RIVALS else f"{', '.join(names[:2])} and {len(names) - 2} more"


def _tentative(values: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [effect for effect in rows(values, "effects") if effect.get("tentative")]


def _to_the_floor(values: Mapping[str, Any]) -> str:
    """Return `down to the noise floor`, and the joint that is far above its own noise floor, if there is one."""
    far = joint_errors.farthest(values)
    return f"down to the noise floor of all joints together ({far})" if far else "down to the noise floor"


def _from_the_start(values: Mapping[str, Any]) -> str:
    """Return a clause for an error that was at the noise floor from the start; empty if it was not."""
    first, floor = ladder_ends(values)[0], _floor(values)
    at = first is not None and floor is not None and first <= NEAR_FLOOR * floor
    return f"{BEST}, though the error was at the noise floor from the start" if at else ""


def _ambiguous(values: Mapping[str, Any], reach: str) -> str:
    classes, sets = rivals(values), combinations(values)
    if not classes and not sets:
        names, why = _names(values), reason(values) or "these recordings cannot tell its members"
        who = named(names) if names else "A class of effects"
        verb = "explain" if len(names) > 1 else "explains"
        return f"{who} {verb} the held-out recordings {reach}; {why}."
    effects = rows(values, "effects")
    sure = [e for e in effects if not e.get("tentative")]
    clear = [sized(e) for e in sure if not _others(e)]
    if len(effects) > MOST_NAMED:
        tentative = len(effects) - len(sure)
        counts = [
            (len(clear), "named"),
            (len(sure) - len(clear), "that these recordings cannot tell from others"),
            (tentative, "tentative"),
        ]
        kinds = join([f"{n} {kind}" for n, kind in counts if n])
        return f"{len(effects)} effects explain the held-out recordings {reach}: {kinds}."
    with_clear = f", beside {join(clear)}" if clear else ""
    either = [f"a combination of {join(members)}" for members in sets]
    either += [f"{'either ' if len(c) == 2 else 'one of '}{join(c, 'or')}" for c in classes]
    who = "; and ".join(either)
    not_told = ["tell the members of a combination from each other"] if sets else []
    not_told += ["tell which"] if classes else []
    text = f"{who[0].upper()}{who[1:]} explains the held-out recordings {reach}{with_clear}"
    return f"{text}; these recordings cannot {' or '.join(not_told)}."


def _depends(values: Mapping[str, Any]) -> str:
    rest = values.get("unexplained")
    if not isinstance(rest, dict):
        return ""
    on = [depends_on(row) for row in rows(rest, "depends_on")]
    return f" It depends on {join(on)}." if on else ""


def _left_over(values: Mapping[str, Any]) -> str:
    """Return a record's text on the residual; empty if the record gives only its share and what it depends on."""
    rest = values.get("unexplained")
    if not isinstance(rest, dict) or "explained_share" in rest or rows(rest, "depends_on"):
        return ""
    return in_words(rest.get("text"))


def _shows_in(values: Mapping[str, Any]) -> str:
    rest = values.get("unexplained")
    return str(rest.get("shows_in", "")) if isinstance(rest, dict) else ""


def _floor(values: Mapping[str, Any]) -> float | None:
    floor = values.get("noise_floor")
    return number(floor.get("value")) if isinstance(floor, dict) else None
