"""Minimum detectable size of each effect in the fitted recordings and, at that size, in the held-out ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.profile import places, size_of
from vispeg.contact.selection.repeats import uncertainty
from vispeg.contact.selection.screen import Probe, Screen
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.worlds.world import World

if TYPE_CHECKING:
    from vispeg.contact.selection.search import ContactSearch


def least_sizes(search: ContactSearch, world: World) -> dict[tuple[str, str], dict[str, float]]:
    """Return the size of each parameter alone, added to a world, that is detected with probability `RULES.power`.

    The size is larger if the held-out recordings need more. For a pose it is also larger by the interval's allowance
    for the arm's repeatability, so that the interval excludes null with the same probability.
    """
    where = places(search.evidence, world)
    least = shown_from(search.probed(world, where), surely(search.evidence, search.need()))
    asked = [(key, name, size) for key, sizes in least.items() for name, size in sizes.items() if np.isfinite(size)]
    judged = search.judge.evidence
    assert isinstance(judged, ContactEvidence)
    tries = [(name, EffectInstance.of(*key, **{name: value(key[0], name, size)})) for key, name, size in asked]
    for (key, name, size), probe in zip(asked, Screen(judged, world, ()).ask(tries)[0], strict=True):
        short = surely(judged, search.confirms()) / max(probe.moved, 1e-12)
        if short > 1.0:
            least[key][name] = further(key[0], name, size, float(np.sqrt(short)))
    # in standard uncertainties: half of a 95 % interval, and the scatter of its middle
    ends = 1.96 + float(stats.norm.ppf(RULES.power))
    return {
        key: {n: within(key[0], n, float(np.hypot(s, ends * uncertainty(key[0], n)))) for n, s in sizes.items()}
        for key, sizes in least.items()
    }


def surely(evidence: ContactEvidence, drop: float) -> float:
    """Return d^2 of a residual change of norm d that a fit removes with a drop over `drop`, with probability `power`.

    The fit lowers the squared residual by d^2 + 2 d e, where e is the error along that change, with the variance used
    for acceptance.
    """
    error = float(stats.norm.ppf(RULES.power) * np.sqrt(evidence.correlated * evidence.variance(1.0)))
    return float((error + np.sqrt(error**2 + drop)) ** 2)


def shown_from(probes: Sequence[Probe], need: float) -> dict[tuple[str, str], dict[str, float]]:
    """Return for each (effect, place) the least distance of each parameter from null that is detectable.

    A change of the squared residual by `need` is detectable. The distance of a scale is its factor; it is infinite if
    no size in the range is detectable. For each sign it is scaled down from the nearest detectable size, as if the
    change of the residual grew linearly, but not below a size that is not detectable.
    """
    out: dict[tuple[str, str], dict[str, float]] = {}
    ways: dict[tuple[tuple[str, str], str, bool], list[tuple[float, float]]] = {}
    for p in probes:
        size = size_of(p.placed.effect, p.name, p.placed)
        ways.setdefault((p.key, p.name, size > 0), []).append((abs(size), p.moved))
    for (key, name, _), sizes in ways.items():
        unseen, from_ = 0.0, np.inf
        for size, moved in sorted(sizes):
            if moved > RULES.felt**2:
                from_ = max(unseen, size * np.sqrt(need / moved))
            if moved >= need:
                break
            unseen = size
        least_of = out.setdefault(key, {})
        least = float(np.exp(from_)) if effect(key[0]).params[name].scale == "log" else float(from_)
        least_of[name] = within(key[0], name, min(least_of.get(name, np.inf), least))
    return out


def within(name: str, parameter: str, size: float) -> float:
    """Return a size, or infinity if it is beyond the parameter's range."""
    param = effect(name).params[parameter]
    if param.scale == "log":
        return size if size <= max(param.high / param.null, param.null / param.low) else np.inf
    return size if size <= max(param.high - param.null, param.null - param.low) else np.inf


def value(name: str, parameter: str, size: float) -> float:
    """Return the value of an effect's parameter at distance `size` from null, as in `shown_from`."""
    param = effect(name).params[parameter]
    return float(np.clip(param.null * size if param.scale == "log" else param.null + size, param.low, param.high))


def further(name: str, parameter: str, size: float, times: float) -> float:
    """Return a size that is `times` times as far from null; infinity beyond the parameter's range."""
    log = effect(name).params[parameter].scale == "log"
    return within(name, parameter, float(size**times if log else size * times))
