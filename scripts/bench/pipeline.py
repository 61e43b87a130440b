"""The camera pipeline against drawing the same frames, in one run on one core.

OMP_NUM_THREADS=1 python scripts/bench/pipeline.py [--images 8] [--repeats 30]

A frame is 64 x 64 RGB-D of the whole cell without shadows. Times are processor time, the best of the repeats: what
other programs on the machine disturb least.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from vispeg.core.effect import EffectInstance, of_family
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import build
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.sensor import sensor, sensors
from vispeg.worlds.world import World

HOME = np.array([0.0, 0.6, 0.0, -1.2, 0.0, 1.3, 0.0, 0.0])  # rad; the peg's slip in m
COLOUR = range(40, 71)  # orders of the effects on colour, occlusion and lens among them


def best(call, repeats: int) -> float:
    """Return the least processor time of a call, s."""
    times = []
    for _ in range(repeats):
        begin = time.process_time()
        call()
        times.append(time.process_time() - begin)
    return min(times)


def everything(orders=range(100)) -> World:
    """Return a world with every image effect of these orders at its start value."""
    kinds = [(n, e) for n, e in of_family("camera").items() if e.overrides("image") and e.order in orders]
    return World().add(*(EffectInstance.of(n, "all", **{k: q.start for k, q in e.params.items()}) for n, e in kinds))


def main() -> None:
    """Print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--images", type=int, default=8)
    parser.add_argument("--repeats", type=int, default=30)
    args = parser.parse_args()
    n, scene = args.images, build()
    camera = standard_cameras()[0]
    with Renderer(scene, [camera]) as renderer:
        shot = renderer.render(HOME)[camera.name]
        drawn = best(lambda: [renderer.render(HOME) for _ in range(n)], args.repeats) / n
        print(f"drawing with {renderer.backend}: {1e3 * drawn:.2f} ms a frame\n")
    frame = Frame(
        rgb=np.repeat(shot.rgb[None], n, 0).astype(np.float32) / 255,
        depth=np.repeat(shot.depth[None], n, 0),
        K=np.repeat(camera.K[None], n, 0),
        velocity=np.full((n, 6), 0.02),
        time=np.zeros(n),
    )
    rng = [stream(0, "bench", i) for i in range(n)]
    worlds = {
        "every effect on depth and time": everything(set(range(100)) - set(COLOUR)),
        "every effect on colour": everything(COLOUR),
        "every effect": everything(),
    }
    worlds |= {f"sensor {name}": RandomizedWorld(ranges=sensor(name, "all")).sample(0, scene) for name in sensors()}
    print("| pipeline | effects | ms a frame | of drawing it |\n|---|---|---|---|")
    for name, world in worlds.items():
        pipeline = Pipeline([world] * n, camera.name)
        spent = best(lambda p=pipeline: p.run(frame, rng), args.repeats) / n
        print(f"| {name} | {len(pipeline.stages)} | {1e3 * spent:.2f} | {spent / drawn:.2f} |", flush=True)


if __name__ == "__main__":
    main()
