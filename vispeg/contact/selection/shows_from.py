"""Minimum detectable size of each effect: it shows in the fitted recordings and in the held-out ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from vispeg.contact.evidence import ContactEvidence
from vispeg.contact.selection.profile import outward, places, size_of
from vispeg.contact.selection.repeats import uncertainty
from vispeg.contact.selection.screen import Screen, chatter
from vispeg.contact.selection.searching import ContactSearching
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.worlds.model_file import model_text
from vispeg.worlds.world import World

Tried = tuple[str, EffectInstance, float]  # parameter, effect with one size of it, share of the needed change


def least_sizes(search: ContactSearching, world: World) -> dict[tuple[str, str], dict[str, float]]:
    """Return the size of each parameter alone, added to a world, that is detected with probability `RULES.power`.

    It is detected in the fitted recordings and in the held-out ones. For a pose it is larger by the interval's
    allowance for the arm's repeatability, so that the interval excludes null with the same probability.
    """
    where = places(search.evidence, world)
    question = ["contact sizes", model_text(world), [list(p) for p in where]]
    tried = search.progress.recall(question, lambda: _tried(search, world, where))
    least = shown_from([(k, EffectInstance.of(n, at, **{k: value}), share) for n, at, k, value, share in tried])
    # in standard uncertainties: half of a 95 % interval, and the scatter of its middle
    ends = 1.96 + float(stats.norm.ppf(RULES.power))
    return {
        key: {n: within(key[0], n, float(np.hypot(s, ends * uncertainty(key[0], n)))) for n, s in sizes.items()}
        for key, sizes in least.items()
    }


def _tried(
    search: ContactSearching, world: World, where: Sequence[tuple[str, str]]
) -> list[tuple[str, str, str, float, float]]:
    """Return (effect, place, parameter, value, share of the needed change) of sizes, outward until one shows."""
    judged = search.judge.evidence
    assert isinstance(judged, ContactEvidence)
    fitted, held = search.screen(world), Screen(judged, world, ())
    needs = surely(search.evidence, search.need()), surely(judged, search.confirms())
    ways, out = [way for name, at in where for way in outward(name, at)], []
    for step in range(max((len(w) for w in ways), default=0)):
        ways = [w for w in ways if len(w) > step]
        shares = _shares(fitted, [w[step] for w in ways], needs[0])
        # held-out recordings are simulated with sizes that the fitted ones show, and with the last, to extrapolate
        both = [k for k, w in enumerate(ways) if shares[k] >= 1.0 or len(w) == step + 1]
        shares[both] = np.minimum(shares[both], _shares(held, [ways[k][step] for k in both], needs[1]))
        asked = zip((w[step] for w in ways), shares.tolist(), strict=True)
        out += [(e.effect, e.where, k, e.params[k].value, share) for (k, e), share in asked]
        ways = [w for w, share in zip(ways, shares, strict=True) if share < 1.0]
    return out


def _shares(screen: Screen, tries: Sequence[tuple[str, EffectInstance]], need: float) -> np.ndarray:
    """Return the squared changes that sizes make in all of the recordings, over the needed one; 0 if not felt."""
    moved = np.array([p.moved for p in screen.ask(tries)])
    return np.where(moved > chatter(), moved / need, 0.0)


def surely(evidence: ContactEvidence, drop: float) -> float:
    """Return the least d^2 for which fitting a residual change of norm d gains over `drop` with probability `power`.

    The fit lowers the squared residual by d^2 + 2 d e, where e is the error along that change, with the variance used
    for acceptance.
    """
    error = float(stats.norm.ppf(RULES.power) * np.sqrt(evidence.correlated * evidence.variance(1.0)))
    return float((error + np.sqrt(error**2 + drop)) ** 2)


def shown_from(tried: Sequence[Tried]) -> dict[tuple[str, str], dict[str, float]]:
    """Return for each (effect, place) the least distance of each parameter from null that is detectable.

    The distance of a scale is its factor; it is infinite if no size in the range is detectable. For each sign it is
    scaled down from the nearest detectable size, as if the change of the residual grew linearly, but not below a size
    that is not detectable.
    """
    out: dict[tuple[str, str], dict[str, float]] = {}
    ways: dict[tuple[tuple[str, str], str, bool], list[tuple[float, float]]] = {}
    for name, placed, share in tried:
        size = size_of(placed.effect, name, placed)
        ways.setdefault(((placed.effect, placed.where), name, size > 0), []).append((abs(size), share))
    for (key, name, _), sizes in ways.items():
        unseen, from_ = 0.0, np.inf
        for size, share in sorted(sizes):
            if share > 0:
                from_ = max(unseen, size / np.sqrt(share))
            if share >= 1.0:
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
