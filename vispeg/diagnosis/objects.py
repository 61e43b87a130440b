"""Find the contact effects that a free object's model lacks, from recordings of its tosses.

Each toss is cut into short windows, and the model predicts a window from the measured pose at its start. Effects are
fitted to some tosses and judged on others. Null is the value of a parameter at which an effect does nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy import stats

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.params import Param
from vispeg.core.rules import RULES
from vispeg.diagnosis.conclusion.least_sizes import Trace, least_alone
from vispeg.diagnosis.findings import Score
from vispeg.diagnosis.plain import concluded
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import Diagnosis
from vispeg.diagnosis.schema import NextMotion, ShowsFrom
from vispeg.diagnosis.selection.plain import PlainSearch
from vispeg.diagnosis.selection.state import State
from vispeg.diagnosis.window_profile import profile, sizes
from vispeg.effects.common.parts import shapes
from vispeg.effects.common.solref import damping_ratio, springs
from vispeg.effects.contact.restitution import rebound
from vispeg.identify.fit import Fit
from vispeg.identify.pool import Submit
from vispeg.identify.restarts import Restarts
from vispeg.identify.surface import line_job, with_intervals
from vispeg.recordings.objects import ObjectRecording
from vispeg.robots.objects import ObjectModel
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

# Name -> length (s) of the windows; None: each toss is one window. The search uses the first, the record has all.
WINDOWS = {"41 ms": 0.041, "162 ms": 0.162, "whole tosses": None}
TOSS = "Let the object go by hand, 20 times or more, each time turned otherwise, and record its pose, a toss an episode"
WEIGH = "Weigh the object five times (`vispeg measure mass`), and write its mass into the model"


class ObjectSearch(PlainSearch):
    """The plain search on windows of tosses.

    The squared error is no parabola in the parameters of a contact, so effects are tried at finite sizes instead of by
    their derivatives, and fitted by line searches.
    """

    asks = "tosses"
    evidence: Restarts
    judged: Restarts
    seed = 0  # of the intervals

    def tries(self, places: Sequence[tuple[str, str]]) -> list[tuple[EffectInstance, str, float]]:
        """Return each effect at each size of each of its magnitudes, with that magnitude's name and value."""
        rows = [(n, at, k, v) for n, at in places for k in effect(n).magnitudes for v in sizes(effect(n).params[k])]
        return [(EffectInstance.of(n, at, **{k: v}), k, v) for n, at, k, v in rows]

    def scored(self, state: State, places: Sequence[tuple[str, str]] | None = None) -> list[Score]:
        """Score each effect at the size that lowers the error of the fitted tosses most, as in `PlainSearch`."""
        tries = self.tries(self.places(state.world) if places is None else places)
        after = self.evidence.each_residual([state.world.add(e) for e, *_ in tries])
        before = float(state.residual @ state.residual)
        scores = [Score(e, before - float(r @ r)) for (e, *_), r in zip(tries, after, strict=True)]
        best = {s.key: s for s in sorted(scores, key=lambda s: s.gain)}
        return sorted(best.values(), key=lambda s: -s.gain)

    def job(
        self, evidence: Restarts, world: World, n_fixed: int, ended: tuple[Sequence[float], bool] | None = None
    ) -> Callable[[Submit], Fit]:
        """Return the fit of all effects after the first `n_fixed` by line searches, as in `PlainSearch`."""
        return line_job(world, range(n_fixed, len(world.effects)), ended=ended)

    def finish(self, state: State) -> World:
        """Set final values and intervals from a quadratic surface over resampled tosses, as in `PlainSearch`."""
        free, rng = range(state.n_fixed, len(state.world.effects)), np.random.default_rng([self.seed, 19])
        state.world = with_intervals(self.evidence, state.world, free, rng)
        (state.loss,), (state.residual,) = self.judge.losses([state.world]), self.evidence.residuals([state.world])
        return state.world

    def shows_from(self, state: State) -> list[ShowsFrom]:
        """Return for each effect that a state lacks the parameter values that would go unnoticed in held-out tosses.

        For each tried value, `least_alone` gives the multiple of its distance from null that would just pass the
        held-out tests, if the change of the residual grew in proportion to the distance.
        """
        places = self.places(state.world)
        tries = self.tries(places)
        before, *after = self.judged.residuals([state.world, *(state.world.add(e) for e, *_ in tries)])
        drop = RULES.gain / (1.0 - RULES.gain) * float(before @ before)  # least fall of the squared residual
        level, none = float(stats.norm.isf(RULES.discoveries / max(len(places), 1))), np.zeros((len(before), 0))
        asked: dict[tuple[str, str], dict[str, list[tuple[float, float]]]] = {}
        for (e, name, value), r in zip(tries, after, strict=True):
            times = least_alone(Trace.of(before - r, none, before, self.judge.blocks), drop, level)
            asked.setdefault((e.effect, e.where), {}).setdefault(name, []).append((value, times))
        return [
            {"effect": n, "where": at, "between": {k: _hidden(effect(n).params[k], v) for k, v in rows.items()}}
            for (n, at), rows in asked.items()
        ]


def _hidden(param: Param, tries: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Return the range of values around null that would go unnoticed; None if every value would.

    On each side of null the tried values are visited outwards. The range ends at the distance that the first noticed
    value says would just be noticed, but not before the last value that was not noticed. If none was noticed, it ends
    at the parameter's bound.

    Args:
        param: the parameter; distances are logarithmic if its scale is.
        tries: (value, times): `times` the value's distance from null would just be noticed; 1 or less if the value is.
    """
    log = param.scale == "log"
    ends = [param.low, param.high]
    for side, sign in enumerate((-1.0, 1.0)):
        unseen = 0.0  # distance of the last value that was not noticed
        away = [(sign * (np.log(v / param.null) if log else v - param.null), times) for v, times in tries]
        for size, times in sorted(a for a in away if a[0] > 0):
            if times <= 1.0:
                end = sign * max(unseen, size * times)
                ends[side] = param.null * float(np.exp(end)) if log else param.null + end
                break
            unseen = size
    return None if ends == [param.low, param.high] else (float(ends[0]), float(ends[1]))


def diagnose_object(
    world: World,
    model: ObjectModel,
    fitted: Sequence[ObjectRecording],
    held_out: Sequence[ObjectRecording],
    *,
    seed: int = 0,
    nthread: int = 2,
    say: Callable[[str], None] = lambda _: None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find the contact effects that an object's model lacks; errors of the record are on the held-out tosses.

    `progress` stores results, so that a killed diagnosis with the same arguments can resume.

    Raises:
        UserError: recordings of another object, without free flight or without contact.
    """
    first = next(iter(WINDOWS.values()))
    evidence = Restarts(fitted, model, first, nthread=nthread)
    judged = Restarts(held_out, model, first, sigma=evidence.sigma, nthread=nthread)
    search = ObjectSearch(evidence, judged, say, progress)
    search.seed = seed
    diagnosis, state = concluded(search, world, (fitted, held_out))
    say("what each length of window can tell")
    work_out = partial(windows, search, world, state)
    rows = search.progress.recall(["windows", model_text(state.world)], work_out)
    record = diagnosis.record
    never = [s for s in record.get("shows_from", ()) if not any(s["between"].values())]
    record["object"], record["restarts"] = model.name, rows
    record["contact"] = contact_numbers(model, diagnosis.world)
    record["next_experiment"] = _next([s["effect"] for s in never], rows)
    record["notes"] += [
        f"{s['effect']}({s['where']}) cannot be told: no size of it shows in these tosses" for s in never
    ]
    return diagnosis


def contact_numbers(model: ObjectModel, world: World) -> dict[str, float]:
    """Return friction, restitution, time constant (s) and damping ratio of the object's contacts in a world.

    A contact without damping has no time constant.
    """
    from mujoco.batch import Batch

    from vispeg.sim.placement import activate
    from vispeg.sim.state import Fields

    compiled = model.compile(1e-3)
    batch = Batch(compiled, 1)
    fields = Fields(batch, model)
    for a in activate(model, [world]):
        a.effect.write(fields, a.p)
    geom = shapes(compiled, model.name)[0]
    solref = fields["geom_solref"][0, geom]
    _, damping = springs(solref)
    ratio = damping_ratio(solref)
    return {
        "friction": float(fields["geom_friction"][0, geom, 0]),
        **({"time_constant_s": 2 / float(damping)} if damping > 0 else {}),
        "damping_ratio": float(ratio),
        "restitution": float(rebound(ratio)),
    }


def windows(search: ObjectSearch, before: World, state: State) -> list[Mapping[str, object]]:
    """Return for each window length both models' errors on held-out tosses, and the profiles of fitted parameters.

    A profile is the error of the fitted tosses over one parameter of an effect that the search has fitted.
    """
    rows = []
    rng = np.random.default_rng([search.seed, 41])
    for label, seconds in WINDOWS.items():
        evidence, judged = search.evidence.over(seconds), search.judged.over(seconds)
        row: dict[str, object] = {"window": label, "count": sum(len(w.first) for w in judged.items)}
        for name, world in (("before", before), ("after", state.world)):
            distance, turn = judged.missed(world)
            row[name] = {"median_m": float(np.median(distance)), "median_rad": float(np.median(turn)),
                         "rms_m": float(np.sqrt(np.mean(distance**2)))}  # fmt: skip
        parameters: list[Mapping[str, object]] = []
        for e in state.added:
            for name in effect(e.effect).magnitudes:
                p = profile(evidence, state.world, e, name, rng)
                parameters.append({
                    "parameter": p.label, "best": p.best, "low": p.low, "high": p.high, "told": p.determined,
                    "profile": {"value": p.values.tolist(), "error": p.error.tolist()},
                })  # fmt: skip
        rows.append({**row, "parameters": parameters})
    return rows


def _next(never: Sequence[str], rows: Sequence[Mapping[str, Any]]) -> NextMotion | None:
    """Return what to record next, if anything would help.

    `never` has the effects that no size would show; `rows` are those of `windows`, of which the shortest length counts.
    """
    weak = sorted({p["parameter"] for p in rows[0]["parameters"] if not p["told"]})
    if weak:
        return {"motion": "tosses with more single bounces, from 0.1 to 0.5 m", "why": f"would tell {', '.join(weak)}",
                "how": TOSS}  # fmt: skip
    if "object_mass" in never:
        why = "a scale tells its mass: in free flight and against a fixed table only forces over mass can be told"
        return {"motion": "", "why": why, "how": WEIGH}
    return None
