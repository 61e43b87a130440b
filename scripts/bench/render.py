"""Measure how fast the cell is drawn, compared with MuJoCo's own renderers, in one run.

    python scripts/bench/render.py [--frames 60] [--rounds 5] [--json out.json] [--backends raycast filament]

Every row draws the same configurations of the same scene at 64 x 64 px, RGB and depth unless it says otherwise. Each
row has a process of its own, so that a driver's settings are those that the row's user would have; rows take turns,
`rounds` times. Figures are medians over rounds, ratios medians of the rounds' ratios.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")
sys.path.insert(0, str(Path(__file__).parents[2]))

import mujoco
import numpy as np

from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.standard import standard_cameras
from vispeg.render.cameras.view import view_of
from vispeg.robots.scene import build

SIDE = 64
POSE = np.array([0.0, 0.6, 0.0, -1.5, 0.0, 1.04, 0.0])  # rad: the peg over the hole


def configurations(nq: int, n: int) -> np.ndarray:
    """Return poses (n, nq) around the hole, the same in every run."""
    rng, out = np.random.default_rng(0), np.zeros((n, nq))
    out[:, :7] = POSE + rng.normal(0, 0.02, (n, 7))
    return out


class Defaults:
    """`mujoco.Renderer` on the same scene, MuJoCo's defaults for multisampling and shadows, two lights that cast them.

    A model camera where ours is; colour, then depth, as its interface has it.
    """

    def __init__(self, scene, camera, shadows: bool = True):
        spec = scene.spec()
        spec.visual.quality.offsamples, spec.visual.quality.shadowsize = 4, 4096
        spec.worldbody.add_camera(name="eye", fovy=2 * np.degrees(np.arctan(SIDE / 2 / camera.fy)))
        self.model = spec.compile()
        self.model.light_castshadow[:] = self.model.light_active & shadows
        self.data, self.camera = mujoco.MjData(self.model), camera
        self.renderer = mujoco.Renderer(self.model, SIDE, SIDE)

    def __call__(self, q: np.ndarray) -> None:
        """Draw one configuration (nq,)."""
        self.data.qpos[:] = q
        mujoco.mj_forward(self.model, self.data)
        view = view_of(self.camera, ("site", self.model.site("flange").id), self.data)
        quat = np.empty(4)
        mujoco.mju_mat2Quat(quat, (view.rot @ np.diag([1.0, -1, -1])).ravel())
        self.model.cam_pos[0], self.model.cam_quat[0] = view.pos, quat
        mujoco.mj_camlight(self.model, self.data)
        self.renderer.disable_depth_rendering()
        self.renderer.update_scene(self.data, "eye")
        self.renderer.render()
        self.renderer.enable_depth_rendering()
        self.renderer.render()


class Raw:
    """Plain MuJoCo: `mjv_updateScene`, `mjr_render`, `mjr_readPixels`, without shadows and multisampling."""

    def __init__(self, scene, camera, depth: bool = True):
        self.model = scene.compile()
        self.model.vis.quality.offsamples = 0
        self.data, self.camera, self.depth = mujoco.MjData(self.model), camera, depth
        self.gl = mujoco.GLContext(SIDE, SIDE)
        self.gl.make_current()
        self.context = mujoco.MjrContext(self.model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self.context)
        self.scene, self.option = mujoco.MjvScene(self.model, 200), mujoco.MjvOption()
        self.option.geomgroup[3:] = 0
        self.eye = mujoco.MjvCamera()
        self.eye.type = mujoco.mjtCamera.mjCAMERA_USER.value
        self.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW.value] = 0
        self.scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION.value] = 0
        self.rect = mujoco.MjrRect(0, 0, SIDE, SIDE)
        self.rgb, self.buffer = np.empty((SIDE, SIDE, 3), np.uint8), np.empty((SIDE, SIDE), np.float32)

    def __call__(self, q: np.ndarray) -> None:
        """Draw one configuration (nq,)."""
        self.gl.make_current()
        self.data.qpos[:] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        for eye in self.scene.camera:
            for key, value in view_of(self.camera, ("site", self.model.site("flange").id), self.data).frustum().items():
                setattr(eye, key, value)
        every = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, self.data, self.option, None, self.eye, every, self.scene)
        mujoco.mjr_render(self.rect, self.scene, self.context)
        mujoco.mjr_readPixels(self.rgb, self.buffer if self.depth else None, self.rect, self.context)


def ours(scene, cameras, backend: str = "classic", shadows: bool = False, **options) -> Callable[[np.ndarray], object]:
    """Return the function that draws with vispeg's renderer."""
    renderer = Renderer(scene, cameras, backend, shadows=shadows, **options)
    if shadows:
        renderer.model.light_castshadow[:] = renderer.model.light_active
    return renderer.render


def make(name: str) -> Callable[[np.ndarray], object]:
    """Return the function that draws a frame of a row."""
    scene = build()
    cameras = standard_cameras(scene.tip, scene.config.fixture)
    wide = cameras[:1]
    kinds: dict[str, Callable[[], Callable[[np.ndarray], object]]] = {
        DEFAULTS: lambda: Defaults(scene, wide[0]),
        "mujoco.Renderer, no shadows": lambda: Defaults(scene, wide[0], shadows=False),
        "raw mjr loop, RGB": lambda: Raw(scene, wide[0], depth=False),
        RAW: lambda: Raw(scene, wide[0]),
        OURS: lambda: ours(scene, wide),
        "vispeg, shadows of two lights": lambda: ours(scene, wide, shadows=True),
        "vispeg, with labels": lambda: ours(scene, wide, labels=True),
        "vispeg, three cameras": lambda: ours(scene, cameras),
        "vispeg, raycast": lambda: ours(scene, wide, "raycast"),
        "vispeg, filament": lambda: ours(scene, wide, "filament"),
    }
    return kinds[name]()


DEFAULTS, RAW, OURS = "mujoco.Renderer, defaults", "raw mjr loop", "vispeg"
SHARE = {  # of the frames that a row draws in a round: the slow ones fewer
    DEFAULTS: 0.05,
    "mujoco.Renderer, no shadows": 0.3,
    "raw mjr loop, RGB": 1.0,
    RAW: 1.0,
    OURS: 1.0,
    "vispeg, shadows of two lights": 0.3,
    "vispeg, with labels": 0.5,
    "vispeg, three cameras": 0.5,
    "vispeg, raycast": 0.2,
    "vispeg, filament": 0.2,
}


def work(pipe: Connection, name: str, frames: int) -> None:
    """Run a row's process: draw a round at each request, and answer with (wall, processor) ms for each frame."""
    draw, poses = make(name), configurations(8, frames)
    for q in poses[:3]:
        draw(q)
    pipe.send(None)
    while pipe.recv():
        wall, cpu = time.perf_counter(), time.process_time()
        for q in poses:
            draw(q)
        pipe.send(((time.perf_counter() - wall) / frames * 1e3, (time.process_time() - cpu) / frames * 1e3))


def main() -> int:
    """Print a Markdown table; return 0."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--backends", nargs="*", default=["raycast", "filament"])
    args = parser.parse_args()
    context, rows = multiprocessing.get_context("spawn"), {}
    for name, share in SHARE.items():
        extra = name.rpartition(", ")[2]
        if extra in ("raycast", "filament") and extra not in args.backends:
            continue
        here, there = context.Pipe()
        frames = max(int(share * args.frames), 2)
        rows[name] = here, context.Process(target=work, args=(there, name, frames), daemon=True)
        rows[name][1].start()
        here.recv()
    times: dict[str, list[tuple[float, float]]] = {name: [] for name in rows}
    for _ in range(args.rounds):
        for name, (pipe, _) in rows.items():
            pipe.send(True)
            times[name].append(pipe.recv())
    for pipe, process in rows.values():
        pipe.send(False)
        process.join()
    ms = {name: np.array(values) for name, values in times.items()}  # (rounds, 2)
    print("| RGB-D 64 x 64, wrist camera | ms a frame | processor ms | against defaults |\n|---|---|---|---|")
    for name, value in ms.items():
        wall, cpu = np.median(value, 0)
        ratio = np.median(ms[DEFAULTS] / value, 0)
        print(f"| {name} | {wall:.2f} | {cpu:.2f} | {ratio[0]:.0f}x ({ratio[1]:.0f}x) |")
    raw = np.median(ms[RAW] / ms[OURS], 0)
    both = np.median(ms[RAW] / ms["raw mjr loop, RGB"], 0)
    print(f"\nAgainst the raw loop: {raw[0]:.2f}x wall, {raw[1]:.2f}x processor.")
    print(f"RGB-D costs {both[0]:.2f}x of RGB by wall, {both[1]:.2f}x by processor time (raw loop both).")
    if args.json:
        args.json.write_text(json.dumps({name: value.tolist() for name, value in ms.items()}, indent=2) + "\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
