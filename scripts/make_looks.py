"""Draws a contact sheet of a world's looks, and counts the looks that the contrast guard refuses.

Each tile is a drawn world: wrist view, crop at the peg's tip, external view. The guard's counts are printed.

Example: python scripts/make_looks.py --world docs/examples/looks.yaml --draws 200 --out docs/img/looks.jpg --overwrite
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np

from vispeg.core.files import write_bytes_atomic
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.contrast import contrast, redraw
from vispeg.render.look import dress
from vispeg.robots.scene import build
from vispeg.task.world_file import load_world

ABOVE = np.array([0.0, 0.7774, 0.0, -1.4955, 0.0, 0.8687, 0.0, 0.0])  # rad: the tip 40 mm above the nominal hole
COLUMNS, TILES, SIZE = 4, 36, 80


def main() -> None:
    """Draw the looks, print the counts, and write the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="docs/examples/looks.yaml", help="a world's name or file")
    parser.add_argument("--draws", type=int, default=TILES)
    parser.add_argument("--out", type=Path, default=Path("looks.jpg"))
    parser.add_argument("--overwrite", action="store_true")
    args = parser.parse_args()
    scene, world = build(), load_world(args.world).world
    cameras = standard_cameras(scene.tip, scene.config.fixture)
    tiles, redraws, good, took = [], [], 0, 0.0
    with Renderer(scene.compile(), cameras, labels=True, shadows=True, parts=scene.parts) as renderer:
        for seed in range(args.draws):
            began = time.perf_counter()
            drawn, again = redraw(world, scene, renderer, seed, qpos=ABOVE)
            took += time.perf_counter() - began
            redraws.append(again)
            shots = renderer.render(ABOVE)
            good += contrast(shots, renderer.cameras, scene) >= 1
            if seed < TILES:
                tiles.append(
                    np.hstack([cv2.resize(s.rgb, (SIZE, SIZE), None, 0, 0, cv2.INTER_CUBIC) for s in shots.values()])
                )
            dress(renderer, scene, drawn)
    looks = sum(redraws) + len(redraws)
    print(f"{args.draws} worlds, {looks} looks drawn, {100 * np.mean(np.array(redraws) > 0):.0f} % of worlds redrawn,")
    print(f"at most {max(redraws)} times; {good} good in the end; {1e3 * took / looks:.0f} ms a look with its pictures")
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    sheet = np.vstack([np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)])
    ok, data = cv2.imencode(args.out.suffix, sheet[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    if not ok:
        raise SystemExit(f"cannot write {args.out.suffix} images")
    write_bytes_atomic(args.out, data.tobytes(), overwrite=args.overwrite)


if __name__ == "__main__":
    main()
