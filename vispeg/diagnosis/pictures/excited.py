"""Which effects these views could show at all, and the motion that would show or separate the others."""

from __future__ import annotations

from collections.abc import Sequence

from vispeg.core.effect import EffectInstance, effect
from vispeg.diagnosis.pictures.search import PictureSearch
from vispeg.worlds.world import World

# pairs that look alike in one kind of motion, and the motion in which they do not
SEPARATE = {
    frozenset({"focal_error", "camera_offset"}): "tilts of 20 degrees or more and an approach from 0.4 to 0.15 m",
    frozenset({"principal_point_error", "camera_offset"}): "rolls of 90 degrees about the optical axis, with tilts",
    frozenset({"focal_error", "lens_distortion"}): "views with the fixture near the image's edges and corners",
    frozenset({"camera_delay", "camera_offset"}): "the same path both ways, at two speeds",
    frozenset({"camera_delay", "rolling_shutter"}): "look-fast: fast motion up and down the image, both ways",
    frozenset({"camera_delay", "encoder_offset"}): "the same path both ways, at two speeds",
    frozenset({"encoder_offset", "camera_offset"}): "the fixture seen with the wrist joints turned both ways",
    frozenset({"depth_scale", "depth_bias"}): "a flat part at distances that differ by a factor of two",
}
MOVE = "look: tilts, rolls, approaches, both ways at two speeds"


def not_excited(search: PictureSearch, world: World) -> list[dict]:
    """The effects that, at a typical size, would move these pictures by less than can be told from a look."""
    out = []
    for name, where in search.places(world):
        kind = effect(name)
        typical = EffectInstance.of(name, where, **{k: kind.params[k].start for k in kind.magnitudes})
        size = search.judged.change(world.add(typical), world)
        if size < search.least:
            out.append({"effect": name, "where": where, "typical_px": round(size, 3)})
    return out


def motion_between(one: str, others: Sequence[str]) -> str:
    """The motion that tells an effect from others."""
    words = [SEPARATE.get(frozenset({one, other})) for other in others]
    return next((w for w in words if w), MOVE)
