"""What a recording shows of contact: how long in which regime, how hard, how fast, and so which effects it excites.

What an effect needs is derived from the measured forces and speeds. The bounds follow a study of how well each
effect is known after five seconds of each motion: one is excited where that is far better than the sizes at which it
matters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import REGISTRY, effect
from vispeg.recordings.regimes import FREE, IMPACT, INSIDE, PRESS, REGIMES, SLIDE

AIR = 0.8  # s in free air that determine the sensor's zero
TILT = 0.4  # rad that the tool must be tilted in free air to tell its mass and centre from the sensor's zero
LONG = 0.5  # s in a regime that is enough to tell something
RATIO = 2.0  # of the largest press to the smallest, to tell a compliance from a height
TURN = 0.8  # rad that the flange must be turned about its axis in contact to tell grip from goal
HARD = 60.0  # N from which a grip may slip
SPEEDS = 1.6  # ratio of two impacts' speeds
SAID = ("in free air", "pressing", "sliding", "inserted", "hitting")
WORDS: dict[str, str] = dict(zip(REGIMES, SAID, strict=True))
FORCES = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # N
NEEDS = {  # what an effect needs (`Effect.needs`), in the order in which effects are listed
    "free air": "a while in free air",
    "tilt": "the tool tilted in free air",
    "weighing": "that, with and without the held part",
    "press": "a press",
    "two forces": "presses with two forces",
    "two directions": "a slide there and back",
    "two speeds": "impacts at two speeds",
    "insertion": "an insertion",
    "turned insertions": "insertions with the flange turned between them",
    "hard press": "a press that the grip may not hold",
}


@dataclass(frozen=True)
class ContactCheck:
    """What a recording shows of contact.

    Attributes:
        seconds: regime -> time in it, s.
        forces: regime -> s in each bin of contact force, whose edges are 0, `FORCES` and infinity.
        peak_force: N.
        slide_speed: median while sliding, m/s; 0 without a slide.
        directions: of 8 sectors, those in which the tip slid.
        hits: speeds of the impacts, m/s.
        begins_free: s in free air at the start, the least over episodes.
        yaw: least and greatest turn of the flange about the vertical in contact, rad; both 0 without contact.
        excited: effect -> "" where the recording can tell it, else why not.
    """

    seconds: Mapping[str, float]
    forces: Mapping[str, tuple[float, ...]]
    peak_force: float
    slide_speed: float
    directions: int
    hits: tuple[float, ...]
    begins_free: float
    yaw: tuple[float, float]
    excited: Mapping[str, str]


@dataclass(frozen=True)
class Touched:
    """The result of `vispeg.sim.touch` in plain arrays, each (n, ..) for the recording's samples.

    Attributes:
        time: s.
        episode: number.
        regime: of `REGIMES`.
        force: N.
        velocity: (n, 3) m/s of the tip.
        tilt: rad, of the tool's axis from the start's.
        yaw: rad, of the flange's x axis about the base's vertical.
        goal: whether a goal is believed in.
    """

    time: np.ndarray
    episode: np.ndarray
    regime: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    tilt: np.ndarray
    yaw: np.ndarray
    goal: bool


def examine(t: Touched) -> ContactCheck:
    """Histograms of forces and speeds by regime, and what they excite."""
    step = float(np.median(np.diff(t.time))) if len(t.time) > 1 else 0.0
    seconds = {name: float(np.sum(t.regime == k) * step) for k, name in enumerate(REGIMES)}
    edges = (0.0, *FORCES, np.inf)
    forces = {
        name: tuple(float(v) * step for v in np.histogram(t.force[t.regime == k], edges)[0])
        for k, name in enumerate(REGIMES)
        if k != FREE
    }
    sliding, speed = t.regime == SLIDE, np.linalg.norm(t.velocity, axis=1)
    flat = t.velocity[sliding][:, :2]
    sectors = np.unique(np.floor(np.arctan2(flat[:, 1], flat[:, 0]) / (np.pi / 4) + 0.5).astype(int) % 8)
    first = (t.regime == IMPACT) & np.concatenate([[True], t.regime[:-1] != IMPACT])
    hits = tuple(float(speed[max(0, i - 5) : i + 1].max()) for i in np.flatnonzero(first))
    touching = t.regime != FREE
    starts = [_free_start(t, number) for number in np.unique(t.episode)]
    summary = ContactCheck(
        seconds=seconds,
        forces=forces,
        peak_force=float(np.nanmax(t.force, initial=0.0)),
        slide_speed=float(np.median(speed[sliding])) if sliding.any() else 0.0,
        directions=len(sectors),
        hits=hits,
        begins_free=min(starts),
        yaw=(float(t.yaw[touching].min()), float(t.yaw[touching].max())) if touching.any() else (0.0, 0.0),
        excited={},
    )
    return ContactCheck(**{**vars(summary), "excited": _excited(t, summary, step)})


def _free_start(t: Touched, number: int) -> float:
    rows = np.flatnonzero(t.episode == number)
    touched = np.flatnonzero(t.regime[rows] != FREE)
    last = rows[touched[0]] if len(touched) else rows[-1]
    return float(t.time[last] - t.time[rows[0]])


def _excited(t: Touched, summary: ContactCheck, step: float) -> dict[str, str]:
    """Effect -> why it is not excited, "" where it is."""
    lacks = _lacking(t, summary, step)
    needing = sorted((list(NEEDS).index(e.needs), name) for name, e in REGISTRY.items() if e.needs)
    return {name: lacks[effect(name).needs].format(other=next(iter(effect(name).told_from), "")) for _, name in needing}


def _lacking(t: Touched, summary: ContactCheck, step: float) -> dict[str, str]:
    """Key of `NEEDS` -> what the recording lacks of it, "" for nothing; `{other}` stands for what looks the same."""
    s, free = summary.seconds, t.regime == FREE
    tilted = float(t.tilt[free].max(initial=0.0)) >= TILT
    pressed = s[REGIMES[PRESS]] + s[REGIMES[SLIDE]] >= LONG
    steady = t.force[(t.regime == PRESS) | (t.regime == INSIDE)]
    several = len(steady) > 10 and np.quantile(steady, 0.95) >= RATIO * max(np.quantile(steady, 0.1), 1e-9)
    speeds = [v for v in summary.hits if v > 0]
    hard = float(np.sum(t.force[t.regime == PRESS] >= HARD)) * step >= 0.2 * LONG
    air = "" if summary.begins_free >= AIR else f"only {summary.begins_free:.2g} s in free air at the start"
    lean = air or ("" if tilted else f"the tool was not tilted by {np.degrees(TILT):.0f} deg in free air")
    touched = "" if pressed or _inserted(summary) else "nothing was pressed"
    level = "" if several else touched or "pressed with one force only: press with 5 and with 20 N"
    slid = "" if s[REGIMES[SLIDE]] >= LONG else "nothing slid"
    inside = "never inserted and pressed" if t.goal else "no `cell` says where the goal is"
    inside = "" if _inserted(summary) else inside
    turned = summary.yaw[1] - summary.yaw[0] >= TURN
    return {
        "free air": air,
        "tilt": lean,
        "weighing": lean or "cannot be told from {other}: weigh with and without the held part",
        "press": touched,
        "two forces": level,
        "two directions": slid
        or ("" if summary.directions >= 2 else "slid in one direction only: slide there and back"),
        "two speeds": "nothing was hit"
        if not speeds
        else ("" if max(speeds) >= SPEEDS * min(speeds) else "hit at one speed only"),
        "insertion": inside,
        "turned insertions": inside
        or ("" if turned else "cannot be told from {other}: insert again with the flange turned by 90 deg"),
        "hard press": "" if hard else f"never pressed with {HARD:.0f} N",
    }


def _inserted(check: ContactCheck) -> bool:
    return check.seconds[REGIMES[INSIDE]] >= LONG


def together(checks: Sequence[ContactCheck]) -> dict[str, str]:
    """Effect -> why these recordings together cannot tell it, "" where they can.

    One that tells an effect is enough; a grip is told from the goal's place by insertions with the flange turned
    between them.
    """
    out = {}
    most = max(checks, key=lambda check: list(check.excited.values()).count(""))  # it says what is lacking
    for name in checks[0].excited:
        out[name] = "" if any(not check.excited[name] for check in checks) else most.excited[name]
    inside = [c for c in checks if _inserted(c)]
    if inside and max(c.yaw[1] for c in inside) - min(c.yaw[0] for c in inside) >= TURN:
        out |= {name: "" for name in out if effect(name).needs == "turned insertions"}
    return out


def said(check: ContactCheck, excited: Mapping[str, str] | None = None) -> list[str]:
    """Lines for a person: time and force in each regime, what is excited, and what is not and why."""
    lines = []
    if excited is None:
        parts = [f"{check.seconds[name]:.1f} s {WORDS[name]}" for name in REGIMES if check.seconds[name] > 0]
        lines.append(f"contact: {', '.join(parts)}; up to {check.peak_force:.0f} N")
    excited = check.excited if excited is None else excited
    able = [name for name, why in excited.items() if not why]
    lines.append(f"excites {', '.join(able)}" if able else "excites no effect of contact")
    reasons: dict[str, list[str]] = {}
    for name, why in excited.items():
        if why:
            reasons.setdefault(why, []).append(name)
    return [*lines, *(f"not {', '.join(names)}: {why}" for why, names in reasons.items())]
