"""Effects that these views could show, and the motion that would show or separate the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from vispeg.core.effect import EffectInstance, effect, told_apart_by
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.worlds.world import World

MOVE = "look: tilts, rolls, approaches, both ways at two speeds"
ROOM = ("exposure", "white_balance")  # effects that an unknown room light or colour may imitate
LIT = "a stated look: a model with `appearance` effects, colours and lights as they are"


@dataclass(frozen=True)
class Excitation:
    """Change of the pictures due to a typical size of an effect, and the smallest detectable change.

    Attributes:
        effect, where: of the effect.
        channel: the readings with the clearest change: `border`, `depth` or `light`.
        change, needed: px RMS of borders, or multiples of a sensor figure's `ordinary` size.
        silent: its parameters of which a typical size changes too little.
    """

    effect: str
    where: str
    channel: str
    change: float
    needed: float
    silent: tuple[str, ...]

    @property
    def excited(self) -> bool:
        """Whether a typical size is detectable."""
        return self.change >= self.needed

    @property
    def unit(self) -> str:
        """Unit of `change` and `needed`."""
        return "px" if self.channel == "border" else "times what is ordinary"

    @property
    def motion(self) -> str:
        """Motion that shows the effect if these pictures do not."""
        return LIT if self.effect in ROOM else next(iter(effect(self.effect).shown_by), MOVE)

    def as_dict(self) -> dict:
        """Return the entry of check.json."""
        numbers = {"silent": list(self.silent), "excited": self.excited, "motion": self.motion}
        return {**asdict(self), "unit": self.unit, **numbers}


def border_excitations(search: PictureSearch, world: World) -> list[Excitation]:
    """Return the change of the held-out borders due to typical effects, with all their parameters at once."""
    out = []
    for name, where in search.places(world):
        kind = effect(name)
        typical = EffectInstance.of(name, where, **{k: kind.params[k].start for k in kind.magnitudes})
        change, least = search.judged.change(world.add(typical), world), search.least_of(typical)
        silent = tuple(kind.magnitudes) if change < least else ()
        out.append(Excitation(name, where, "border", change, least, silent))
    return out


def not_excited(excitations: Sequence[Excitation]) -> list[dict]:
    """Return the effects whose typical size changes these pictures too little to detect, the reason, and a motion.

    An effect with a single undetectable parameter is listed with that parameter.
    """
    return [_row(e) for e in excitations if e.silent]


def _row(e: Excitation) -> dict:
    row = {"effect": e.effect, "where": e.where}
    if len(e.silent) < len(effect(e.effect).magnitudes):
        row |= {"numbers": sorted(e.silent)}
    return row | {"why": _why(e), "motion": e.motion}


def _why(e: Excitation) -> str:
    if e.channel == "border":
        return f"a typical one moves these borders by {e.change:.2f} px"
    if e.effect in ROOM:
        return "no stated look: colours and light of the room are not known"
    sizes = ", ".join(f"{k} {effect(e.effect).params[k].start:g}" for k in sorted(e.silent))
    return f"a typical one ({sizes}) changes no figure of {e.channel}"


def motion_between(effect_name: str, others: Sequence[str]) -> str:
    """Return the motion that distinguishes an effect from others."""
    return next((motion for other in others for motion in told_apart_by(effect_name, other)), MOVE)
