"""Which effects these views could show at all, and the motion that would show or separate the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.worlds.world import World

FASTER = "look-fast: fast motion up and down the image, both ways"
# pairs that look alike in one kind of motion, and the motion in which they do not
SEPARATE = {
    frozenset({"focal_error", "camera_offset"}): "tilts of 20 degrees or more and an approach from 0.4 to 0.15 m",
    frozenset({"principal_point_error", "camera_offset"}): "rolls of 90 degrees about the optical axis, with tilts",
    frozenset({"focal_error", "lens_distortion"}): "views with the fixture near the image's edges and corners",
    frozenset({"camera_delay", "camera_offset"}): "the same path both ways, at two speeds",
    frozenset({"camera_delay", "rolling_shutter"}): FASTER,
    frozenset({"camera_delay", "encoder_offset"}): "the same path both ways, at two speeds",
    frozenset({"encoder_offset", "camera_offset"}): "the fixture seen with the wrist joints turned both ways",
    frozenset({"depth_scale", "depth_bias"}): "a flat part at distances that differ by a factor of two",
}
MOVE = "look: tilts, rolls, approaches, both ways at two speeds"


SHOWN = {  # what shows an effect where the motion of these views did not
    "rolling_shutter": FASTER,
    "motion_blur": FASTER,
    "camera_delay": FASTER,
    "near_limit": "an approach to 0.1 m and nearer",
}
ROOM = ("exposure", "white_balance")  # that a room's own light and colours may make as well
LIT = "a stated look: a model with `appearance` effects, colours and lights as they are"


@dataclass(frozen=True)
class Excitation:
    """By how much a typical size of an effect changes pictures, and from where on that can be told.

    Attributes:
        effect, where: of the effect.
        channel: the readings that it changes most clearly: `border`, `depth` or `light`.
        change, needed: px RMS of borders, or multiples of what is ordinary of a sensor's figure.
        silent: its numbers of which a typical size changes too little.
    """

    effect: str
    where: str
    channel: str
    change: float
    needed: float
    silent: tuple[str, ...]

    @property
    def excited(self) -> bool:
        """Whether a typical size would show."""
        return self.change >= self.needed

    @property
    def unit(self) -> str:
        """Unit of `change` and `needed`."""
        return "px" if self.channel == "border" else "times what is ordinary"

    @property
    def motion(self) -> str:
        """What shows it where these pictures do not."""
        return LIT if self.effect in ROOM else SHOWN.get(self.effect, MOVE)

    def as_dict(self) -> dict:
        """For check.json."""
        numbers = {"silent": list(self.silent), "excited": self.excited, "motion": self.motion}
        return {**asdict(self), "unit": self.unit, **numbers}


def border_excitations(search: PictureSearch, world: World) -> list[Excitation]:
    """Return the change of the held-out borders due to typical effects, all their parameters at once."""
    out = []
    for name, where in search.places(world):
        kind = effect(name)
        typical = EffectInstance.of(name, where, **{k: kind.params[k].start for k in kind.magnitudes})
        change, least = search.judged.change(world.add(typical), world), search.least_of(typical)
        silent = tuple(kind.magnitudes) if change < least else ()
        out.append(Excitation(name, where, "border", change, least, silent))
    return out


def not_excited(excitations: Sequence[Excitation]) -> list[dict]:
    """Give the effects of which a typical size would change these pictures by less than can be told, why, and what
    shows it.

    An effect of which one number alone is silent is listed with that number.
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
    """Give the motion that tells an effect from others."""
    words = [SEPARATE.get(frozenset({effect_name, other})) for other in others]
    return next((w for w in words if w), MOVE)
