"""Draws docs/img/sensor.png: the cell's depth as rendered, as each sensor sees it, and as block matching computes it.

python scripts/make_sensor_sheet.py [--out docs/img/sensor.png] [--overwrite]
"""

from __future__ import annotations

import argparse

import cv2
import mujoco
import numpy as np

from vispeg.core.effect import effect
from vispeg.core.files import write_bytes_atomic
from vispeg.core.frame import Frame
from vispeg.core.seeds import stream
from vispeg.render import block_matching
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.pipeline import Pipeline
from vispeg.render.cameras.standard import standard_cameras
from vispeg.robots.scene import Scene, build
from vispeg.worlds.randomized import RandomizedWorld
from vispeg.worlds.sensor import sensor, sensors

ZOOM = 2


def over_the_hole(scene: Scene, height: float = 0.02, aside: float = 0.015) -> np.ndarray:
    """Return qpos (nq,) with the tip pointing down, above the hole and a little aside, by damped Newton steps."""
    model = scene.compile()
    data, site = mujoco.MjData(model), model.site("peg_tip").id
    data.qpos[:7] = [0.0, 0.6, 0.0, -1.4, 0.0, 1.1, 0.0]
    goal = np.array(scene.config.fixture) + [0.0, aside, height]
    for _ in range(200):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        jac = np.zeros((6, model.nv))
        mujoco.mj_jacSite(model, data, jac[:3], jac[3:], site)
        axis = data.site_xmat[site].reshape(3, 3)[:, 2]
        down = np.array([0.0, 0.0, -1.0]) * np.sign(-axis[2] or 1.0)
        error = np.concatenate([goal - data.site_xpos[site], np.cross(axis, down)])
        j = jac[:, :7]
        data.qpos[:7] += j.T @ np.linalg.solve(j @ j.T + 1e-4 * np.eye(6), error)
    return data.qpos.copy()


def tile(depth: np.ndarray, like: np.ndarray, title: str) -> np.ndarray:
    """Return depth in colours, near red, black where there is none; the scale is that of the depth `like`."""
    low, high = np.percentile(like[like > 0], [1, 97])
    grey = (255 * (1 - np.clip((depth - low) / (high - low), 0, 1))).astype(np.uint8)
    out = cv2.applyColorMap(grey, cv2.COLORMAP_TURBO)
    out[depth <= 0] = 0
    return labelled(out, title)


def labelled(image: np.ndarray, title: str) -> np.ndarray:
    """Return the image (BGR) enlarged, with its title above."""
    big = cv2.resize(image, None, fx=ZOOM, fy=ZOOM, interpolation=cv2.INTER_NEAREST)
    head = np.full((16, big.shape[1], 3), 255, np.uint8)
    cv2.putText(head, title, (2, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.36, (0, 0, 0), 1, cv2.LINE_AA)
    return np.vstack([head, big])


def main() -> None:
    """Write the sheet, with one row for each camera."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", default="docs/img/sensor.png")
    parser.add_argument("--overwrite", action="store_true")
    args = parser.parse_args()
    scene, rows = build(), []
    cameras = standard_cameras(scene.tip, scene.config.fixture)
    with Renderer(scene, cameras) as renderer:
        shots = renderer.render(over_the_hole(scene))
        for camera in cameras:
            shot = shots[camera.name]
            row = [labelled(shot.rgb[..., ::-1], camera.name), tile(shot.depth, shot.depth, "as rendered")]
            for name in sensors():
                world = RandomizedWorld(ranges=sensor(name, camera.name)).sample(1, scene)
                rgb = shot.rgb[None].astype(np.float32) / 255
                frame = Frame(rgb, shot.depth[None], camera.K[None], time=np.zeros(1))
                seen = Pipeline([world], camera.name).run(frame, [stream(1, "sheet", name)])
                row.append(tile(seen.depth[0], shot.depth, name))
            values = {k: q.start for k, q in effect("block_matching").params.items()} | {"baseline": 0.018}
            matched = block_matching.depth(renderer, camera.name, values, stream(1, "sheet"))
            rows.append(np.hstack([*row, tile(matched, shot.depth, "block matching")]))
    _, code = cv2.imencode(".png", np.vstack(rows))
    print(write_bytes_atomic(args.out, code.tobytes(), overwrite=args.overwrite))


if __name__ == "__main__":
    main()
