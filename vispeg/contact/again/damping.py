"""Contact damping from impacts: one parameter, as MuJoCo's damping ratio or, equivalently, a restitution.

It is the only effect sought in impacts. It is named only if no other effect fits them as well: a softer contact,
fixture or arm lengthens an impact, and a sensor delay shifts it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.again.blows import Blow, blows, predicted, restarts
from vispeg.contact.law import within
from vispeg.contact.remainder import most_left
from vispeg.contact.selection.profile import looked_for, place_of, tries
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Value
from vispeg.core.rules import RULES
from vispeg.diagnosis.schema import NotExcited
from vispeg.effects.common.parts import shapes
from vispeg.effects.common.solref import damping_ratio
from vispeg.effects.contact.restitution import rebound
from vispeg.recordings.checks.extent import lacks_blows
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.task.belief import recorded_cell
from vispeg.worlds.world import World

NAME, TWIN = "contact_damping", "restitution"
SCALES = np.geomspace(0.05, 10.0, 15)  # times the nominal damping
FINER = 4  # steps of the second grid per step of the first, on both sides of the best value
READINGS = 2  # of a blow, impulse and flight, whose errors count as one
BESIDE = ("compliance", "friction", "free air")  # stages of other effects that may explain impacts


@dataclass(frozen=True)
class Unsearched:
    """What is found without a search: here the damping.

    Attributes:
        effects: the effects with their intervals.
        notes: notes for the user.
        unseen: the effects that no impact can show.
    """

    effects: tuple[EffectInstance, ...] = ()
    notes: tuple[str, ...] = ()
    unseen: tuple[NotExcited, ...] = ()


def struck(world: World, fitted: Sequence[Recording], held_out: Sequence[Recording], nthread: int = 1) -> Unsearched:
    """Fit the damping to the impacts of some recordings, and judge it on those of others.

    Args:
        world: the model with the effects that were found so far.
        fitted, held_out: recordings; those with a stated osc controller are simulated.
        nthread: threads of the simulation.
    """
    if any(e.effect in (NAME, TWIN) for e in world.effects):
        return Unsearched()
    fit, judge = ([b for rec in recordings for b in blows(rec)] for recordings in (fitted, held_out))
    if not fit or not judge:
        return Unsearched(unseen=_unseen({"fitted": (fitted, fit), "held-out": (held_out, judge)}))
    scene = fit[0].scene
    where = place_of(effect(NAME), scene)
    scale, low, high, least, none = _fitted(world, where, fit, nthread)
    best = EffectInstance.of(NAME, where, scale=scale)
    before, after = (_off(judge, w, nthread) for w in (world, world.add(best)))
    count = f"{len(fit)} impacts and {len(judge)} held-out ones, simulated from just before each"
    flight = f"the time from each held-out impact to the next contact is wrong by {1e3 * before.rms:.2g} ms RMS"
    rise, bar = _rise(least, fit), after.count * most_left(after.count / READINGS)
    if none - least <= rise or within(low, high) or before.square - after.square <= RULES.interval * READINGS:
        e = " to ".join(f"{_restitution(scene, where, s):.2g}" for s in (high, low))
        text = f"{low:.2g} to {high:.2g} times the nominal damping ({TWIN} {e}) fit them"
        if min(before.square, after.square) > bar:
            text = "no damping explains them"
        elif not low <= 1.0 <= high:
            law = "which the contact law's own error may also explain"
            text += f", {law if within(low, high) else 'but it does not improve the held-out impacts'}: not named"
        return Unsearched(notes=(f"{count}: {flight}; {text}",))
    rivals = _rivals(world, scene, fit, least + rise, nthread)
    if after.square > bar or rivals:
        why = f"{' or '.join(rivals)} explain them as well" if rivals else "no damping explains them"
        return Unsearched(
            notes=(f"{count}: {flight}, {1e3 * after.rms:.2g} ms with {best.label} at {scale:.2g}; {why}: not named",)
        )
    named = EffectInstance(NAME, where, {"scale": Value(scale, low, high)})
    e = [_restitution(scene, where, s) for s in (scale, high, low)]
    text = f"{count}: {flight}, {1e3 * after.rms:.2g} ms with {best.label}; this is equivalent to {TWIN} "
    return Unsearched((named,), (f"{text}e = {e[0]:.2g} [{e[1]:.2g}, {e[2]:.2g}]",))


@dataclass(frozen=True)
class _Off:
    """Error of a world on some impacts: squared whitened residual, number of readings, RMS error of flights in s."""

    square: float
    count: int
    rms: float


def _off(hits: Sequence[Blow], world: World, nthread: int) -> _Off:
    error = np.array([b.felt - np.nan_to_num(predicted(b, [world], nthread)[0]) for b in hits])
    sigma = np.array([b.sigma for b in hits])
    return _Off(float(np.sum((error / sigma) ** 2)), error.size, float(np.sqrt(np.mean(error[:, 1] ** 2))))


def _squares(hits: Sequence[Blow], worlds: Sequence[World], nthread: int) -> np.ndarray:
    """Return the squared whitened residual (nworld,) over all impacts.

    A world without contact has no impulse and no flight.
    """
    total = np.zeros(len(worlds))
    for b in hits:
        total += np.sum(((b.felt - np.nan_to_num(predicted(b, worlds, nthread))) / b.sigma) ** 2, axis=1)
    return total


def _rise(least: float, hits: Sequence[Blow]) -> float:
    """Return the rise of the squared residual above its `least` value at the ends of an interval."""
    return RULES.interval * READINGS * max(1.0, least / sum(len(b.felt) for b in hits))


def _fitted(world: World, where: str, hits: Sequence[Blow], nthread: int) -> tuple[float, float, float, float, float]:
    """Fit the scale of the damping on two grids.

    Returns:
        (best scale, its interval's low end, its high end, squared residual at the best, squared residual at scale 1).
    """

    def squares(scales: np.ndarray) -> np.ndarray:
        return _squares(hits, [world.add(EffectInstance.of(NAME, where, scale=float(s))) for s in scales], nthread)

    coarse = squares(SCALES)
    k = int(np.argmin(coarse))
    finer = np.geomspace(SCALES[max(k - 1, 0)], SCALES[min(k + 1, len(SCALES) - 1)], 2 * FINER + 1)
    scales, values = np.r_[SCALES, finer, 1.0], np.r_[coarse, squares(finer), squares(np.ones(1))]
    none, order = float(values[-1]), np.argsort(scales)
    scales, values = scales[order], values[order]
    best = int(np.argmin(values))
    level = float(values[best]) + _rise(float(values[best]), hits)
    inside = np.flatnonzero(values <= level)
    low, high = inside[0], inside[-1]  # indices of `scales`
    return (
        float(scales[best]),
        _crossing(scales, values, level, low, max(low - 1, 0)),
        _crossing(scales, values, level, high, min(high + 1, len(scales) - 1)),
        float(values[best]),
        none,
    )


def _crossing(scales: np.ndarray, values: np.ndarray, level: float, inside: int, outside: int) -> float:
    """Return the scale at which the squared residual crosses `level`, between the grid points `inside` and `outside`.

    If it is below the level at both, the scale at `inside` is returned.
    """
    if values[outside] <= level:
        return float(scales[inside])
    share = (level - values[inside]) / (values[outside] - values[inside])
    return float(np.exp(np.log(scales[inside]) * (1 - share) + np.log(scales[outside]) * share))


def _rivals(world: World, scene: Scene, hits: Sequence[Blow], most: float, nthread: int) -> list[str]:
    """Return labels of effects that at some size explain the impacts to within the squared residual `most`."""
    present = {e.effect for e in world.effects}
    kinds = [k for k in looked_for() if k.stage in BESIDE and k.name not in present and place_of(k, scene)]
    probes = [p for k in kinds for _, p in tries(k.name, place_of(k, scene))]
    squares = _squares(hits, [world.add(p) for p in probes], nthread)
    return sorted({p.label for p, square in zip(probes, squares, strict=True) if square <= most})


def _restitution(scene: Scene, where: str, scale: float) -> float:
    """Return the coefficient of restitution of the contact with its damping scaled."""
    model = compiled(scene)
    return float(rebound(scale * damping_ratio(model.geom_solref[shapes(model, where)[0]])))


def _unseen(groups: Mapping[str, tuple[Sequence[Recording], Sequence[Blow]]]) -> tuple[NotExcited, ...]:
    """Return why no impact shows the damping; every one of the `groups` of recordings needs an impact."""
    speeds = {
        name: [b.speed for b in hit] if any(map(restarts, recs)) else None for name, (recs, hit) in groups.items()
    }
    lacks = {name: text for name, v in speeds.items() if (text := lacks_blows(v))}
    same = len(lacks) == len(groups) and len(set(lacks.values())) == 1
    why = (
        next(iter(lacks.values())) if same else "; ".join(f"{text}, in the {n} recordings" for n, text in lacks.items())
    )
    rec = next(rec for recs, _ in groups.values() for rec in recs)
    where = place_of(effect(NAME), recorded_cell(rec).scene)
    return ({"effect": NAME, "where": where, "why": why, "motion": effect(NAME).shown_by[0]},)
