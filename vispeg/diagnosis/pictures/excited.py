"""Which effects these views could show at all, and the motion that would show or separate the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.diagnosis.pictures.sensors import Sensed
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
LIT = "a model that states how the room looks (`appearance` effects), with colours and lights as they are"


def not_excited(search: PictureSearch, sensed: Sequence[Sensed], world: World) -> list[dict]:
    """The effects of which a typical size would change these pictures by less than can be told, why, and what shows it.

    An effect of which one number alone is silent is listed with that number.
    """
    out = []
    for name, where in search.places(world):
        kind = effect(name)
        typical = EffectInstance.of(name, where, **{k: kind.params[k].start for k in kind.magnitudes})
        size = search.judged.change(world.add(typical), world)
        if size < search.least_of(typical):
            why = f"a typical one moves these borders by {size:.2f} px"
            out.append({"effect": name, "where": where, "why": why, "motion": SHOWN.get(name, MOVE)})
    for kind, silent in ((s.kind, s.silent) for s in sensed):
        out += [_silent(kind, name, where, numbers) for (name, where), numbers in silent.items()]
    return out


def _silent(kind: str, name: str, where: str, numbers: Mapping[str, float]) -> dict:
    """A row of an effect on the sensor, of which these numbers at a typical size change no figure."""
    said = {"effect": name, "where": where}
    if len(numbers) < len(effect(name).magnitudes):
        said |= {"numbers": sorted(numbers)}
    if name in ROOM:
        return said | {"why": "no stated look: colours and light of the room are not known", "motion": LIT}
    sizes = ", ".join(f"{k} {effect(name).params[k].start:g}" for k in sorted(numbers))
    return said | {"why": f"a typical one ({sizes}) changes no figure of {kind}", "motion": SHOWN.get(name, MOVE)}


def motion_between(effect_name: str, others: Sequence[str]) -> str:
    """The motion that tells an effect from others."""
    words = [SEPARATE.get(frozenset({effect_name, other})) for other in others]
    return next((w for w in words if w), MOVE)
