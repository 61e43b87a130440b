"""Summarise contact in a recording: time, force and speed in each regime, and the effects that these excite.

Which excitation an effect needs is stated in `vispeg.recordings.checks.extent`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.core.effect import REGISTRY, effect
from vispeg.recordings.checks.extent import AIR, HARD, LONG, NEEDS, Extent, joined, lacking
from vispeg.recordings.differentiate import episodes
from vispeg.recordings.regimes import FREE, IMPACT, INSIDE, PRESS, REGIMES, SLIDE

WORDS: Mapping[str, str] = dict(
    zip(REGIMES, ("in free air", "pressing", "sliding", "inserted", "hitting"), strict=True)
)
FORCES = (2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # N, edges of the histogram of contact forces
BEFORE = 5  # samples before an impact, whose greatest speed is the impact's: the force is noticed late
STEADY = 10  # samples that the range of sustained forces must exceed


@dataclass(frozen=True)
class ContactCheck:
    """Contact in a recording.

    Attributes:
        seconds: regime -> time in it, s.
        forces: regime -> seconds in each bin of contact force, with edges 0, `FORCES` and infinity.
        peak_force: N.
        slide_speed: median speed while sliding, m/s; 0 without sliding.
        directions: number of direction sectors, of 8, in which the tip slid.
        hits: speeds of the impacts, m/s.
        begins_free: time in free air at the start of an episode, s, the least over episodes.
        extent: how much the recording contains of the excitation that effects need.
        excited: effect -> "" if the recording can identify it, else the reason why not.
    """

    seconds: Mapping[str, float]
    forces: Mapping[str, tuple[float, ...]]
    peak_force: float
    slide_speed: float
    directions: int
    hits: tuple[float, ...]
    begins_free: float
    extent: Extent
    excited: Mapping[str, str]


@dataclass(frozen=True)
class Touched:
    """The result of `vispeg.sim.touch` in plain arrays, (n,) for the recording's samples unless stated otherwise.

    Attributes:
        time: s.
        episode: episode number.
        regime: index into `REGIMES`.
        force: contact force, N.
        velocity: (n, 3) m/s of the tip, base axes.
        tilt: angle of the tool's axis to its direction at the start, rad.
        yaw: rotation of the flange's x axis about the base's vertical, rad.
        goal: whether the believed cell has a goal.
        blows: speeds of the impacts that a diagnosis can simulate, m/s; None if it can simulate none.
    """

    time: np.ndarray
    episode: np.ndarray
    regime: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    tilt: np.ndarray
    yaw: np.ndarray
    goal: bool
    blows: tuple[float, ...] | None = None


def examine(t: Touched) -> ContactCheck:
    """Compute times, forces and speeds by regime, and the effects that they excite."""
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
    episode_start = np.concatenate([np.full(len(rows), rows[0]) for rows in episodes(t.time, t.episode)])
    hits = tuple(float(speed[max(episode_start[i], i - BEFORE) : i + 1].max()) for i in np.flatnonzero(first))
    free = min(_free_start(t, number) for number in np.unique(t.episode))
    extent = _extent(t, seconds, sectors, free, step)
    return ContactCheck(
        seconds=seconds,
        forces=forces,
        peak_force=float(np.nanmax(t.force, initial=0.0)),
        slide_speed=float(np.median(speed[sliding])) if sliding.any() else 0.0,
        directions=len(sectors),
        hits=hits,
        begins_free=free,
        extent=extent,
        excited=_excited(extent),
    )


def _free_start(t: Touched, number: int) -> float:
    """Return the time, s, that an episode spends in free air before its first touch."""
    rows = np.flatnonzero(t.episode == number)
    touched = np.flatnonzero(t.regime[rows] != FREE)
    last = rows[touched[0]] if len(touched) else rows[-1]
    return float(t.time[last] - t.time[rows[0]])


def _extent(
    t: Touched,
    seconds: Mapping[str, float],
    sectors: np.ndarray,
    free: float,
    step: float,
) -> Extent:
    """Return the excitation of contact; `free` is `begins_free`, `step` the sample time in s, the rest as in `examine`.

    Sustained forces are from the 10 % to the 95 % quantile, so that a short peak is none of them.
    """
    steady = t.force[(t.regime == PRESS) | (t.regime == INSIDE)]
    forces = (float(np.quantile(steady, 0.1)), float(np.quantile(steady, 0.95))) if len(steady) > STEADY else None
    yaw = t.yaw[t.regime == INSIDE]
    slid, inserted = seconds[REGIMES[SLIDE]], seconds[REGIMES[INSIDE]]
    return Extent(
        begins_free=free,
        tilt=float(t.tilt[t.regime == FREE].max(initial=0.0)) if free >= AIR else 0.0,
        pressed=seconds[REGIMES[PRESS]] + slid,
        slid=slid,
        inserted=inserted,
        forces=forces,
        sectors=tuple(sectors.tolist()),
        blows=t.blows,
        hard=float(np.sum(t.force[t.regime == PRESS] >= HARD)) * step,
        yaw=(float(yaw.min()), float(yaw.max())) if inserted >= LONG else None,
        goal=t.goal,
    )


def _excited(extent: Extent) -> dict[str, str]:
    """Return effect -> why it is not excited, "" if it is."""
    lacks = lacking(extent)
    needing = sorted((list(NEEDS).index(e.needs), name) for name, e in REGISTRY.items() if e.needs)
    out = {}
    for _, name in needing:
        confounded = next(iter(effect(name).told_from), "")
        out[name] = lacks[effect(name).needs].format(other=confounded)
    return out


def together(checks: Sequence[ContactCheck]) -> dict[str, str]:
    """Return effect -> why these recordings together cannot identify it, "" if they can.

    Their excitation adds up: a press with 5 N in one and with 20 N in another counts as two forces, and insertions
    with different turns of the flange as turned insertions. Only what every recording lacks is reported.
    """
    return _excited(joined([check.extent for check in checks]))


def said(check: ContactCheck, excited: Mapping[str, str] | None = None) -> list[str]:
    """Return lines for the user: time and force in each regime, which effects are excited, and why others are not.

    With `excited` (from `together`) they are those of several recordings, without times and forces.
    """
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
