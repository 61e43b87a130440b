"""The held-out frames with the largest edge errors, measured and rendered with both models, as a report shows them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vispeg.identify.pictures.evidence import BorderEvidence
from vispeg.identify.pictures.sight import Sight
from vispeg.vision.eye import delay_of
from vispeg.vision.predict import Predictor
from vispeg.worlds.world import World

MOST = 4  # frames


def shown_pictures(
    predictor: Predictor, sights: Sequence[Sight], before: World, after: World, judged: BorderEvidence, seed: int
) -> dict[str, np.ndarray]:
    """Return the arrays `view/I/...` of the worst held-out frames, I = 0, 1, ....

    `measured`, `before`, `after` (H, W, 3) uint8, the latter two rendered in the predictor's appearance; `depth`,
    `depth_before`, `depth_after` (H, W) float32 m where there is depth; `title`; `pixel`, `normal` (n, 2) of the
    predicted border points, and `along_before`, `along_after` (n,) px, their distances to the measured edges.
    """
    out: dict[str, np.ndarray] = {}
    for k, (index, frame) in enumerate(_worst(judged, before)):
        sight, item = sights[index], judged.items[index]
        name = f"view/{k}/"
        rgb, depth = sight.rgb(frame), sight.depth(frame)
        if rgb is not None:
            out[name + "measured"] = rgb
        if depth is not None:
            out[name + "depth"] = depth
        for word, world in (("before", before), ("after", after)):
            predictor.see(world)
            q = sight.at(np.array([frame]), -delay_of(predictor.world, sight.camera.name))[0]
            if not np.isfinite(q).all():
                continue
            image, distance = predictor.sensed(predictor.draw(sight.camera.name, q), seed)
            out[name + word] = image
            if depth is not None:
                out[name + f"depth_{word}"] = distance
        rows = (item.points.frame == frame) & item.valid[:, 0]
        for word, world in (("before", before), ("after", after)):
            out[name + f"along_{word}"] = judged.misplaced(world)[index][rows]
        out[name + "normal"], out[name + "pixel"] = item.points.normal[rows], item.points.pixel[rows]
        out[name + "title"] = np.array(f"{sight.name}, {sight.camera.name}, {sight.time[frame]:.2f} s")
    return out


def _worst(judged: BorderEvidence, world: World) -> list[tuple[int, int]]:
    """Return (item, frame) of the `MOST` frames with the largest RMS edge error, worst first."""
    errors = []
    for index, (item, away) in enumerate(zip(judged.items, judged.misplaced(world), strict=True)):
        good = item.valid[:, 0] & np.isfinite(away)
        for frame in np.unique(item.points.frame[good]):
            rows = good & (item.points.frame == frame)
            errors.append((float(np.sqrt(np.mean(away[rows] ** 2))), index, int(frame)))
    return [(i, f) for _, i, f in sorted(errors, reverse=True)[:MOST]]
