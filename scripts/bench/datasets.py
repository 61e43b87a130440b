"""Measure where the time of `vispeg render` goes, and the share that the renderers take.

    python scripts/bench/datasets.py [--world S] [--looks 4] [--shards 2] [--no-labels] [--json out.json]

Makes whole shards in this process, from the plan to the file's bytes, and notes the processor time of each part. The
renderers' part is that of drawing every frame through every camera, labels and shadows as asked: what `vispeg render`
would cost if nothing else did. Every worker does the same, so the share is that on all cores, but for start-up.

The line below the table says how much of the other parts is spent in libraries: MuJoCo's physics steps and the
controller's kinematics, drawing for the guard, OpenCV's encoder and filters, Arrow's writer. The bound is the share of
the renderers if only they and these libraries took time.

Below stands what a whole `vispeg render` of 300 frames in one process takes: start-up and planning are all that comes
before the first episode is played, from the start of Python to the compiled cell and its renderer.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")
sys.path.insert(0, str(Path(__file__).parents[2]))

from vispeg.datasets import episode
from vispeg.datasets.shards.plan import Shard
from vispeg.datasets.shards.shard import shard_bytes
from vispeg.demonstrations import stage
from vispeg.demonstrations.plan import plan_of
from vispeg.render.backends.backend import Renderer
from vispeg.render.cameras.pipeline import Pipeline

PARTS: tuple[tuple[str, Any, str], ...] = (
    ("physics, expert", stage.Stage, "play"),
    ("looks, contrast guard", stage, "redraw"),
    ("rendering", Renderer, "render"),
    ("sensor", Pipeline, "run"),
    ("pictures to bytes", episode, "encode"),
    ("statistics of pictures", episode.PictureStats, "add"),
)


def beneath(clock: Clock) -> None:
    """Count the time of the libraries, wherever they are called from."""
    import cv2
    import pyarrow.parquet as pq

    from vispeg.sim.nominal import Nominal
    from vispeg.task.cell import Cell

    for owner, part in ((Cell, "MuJoCo's steps"), (Nominal, "controller's kinematics")):
        begin = owner.__init__

        def init(self: Any, *args: Any, begin: Any = begin, part: str = part, **kwargs: Any) -> None:
            begin(self, *args, **kwargs)
            for name in ("step",) if part == "MuJoCo's steps" else ("forward",):
                clock.watch(part, self.batch, name)

        owner.__init__ = init
    for name in ("imencode", "GaussianBlur", "filter2D", "sepFilter2D", "remap", "resize", "blur", "boxFilter"):
        clock.watch("OpenCV", cv2, name)
    clock.watch("Arrow", pq.ParquetWriter, "write_table")
    clock.watch("Arrow", pq.ParquetWriter, "close")


WHOLE = """
import sys, time, vispeg
from vispeg.demonstrations.stage import Stage
play, begun = Stage.play, []
def timed(*args, **kwargs):
    begun.append(time.process_time())
    return play(*args, **kwargs)
Stage.play = timed
vispeg.render_dataset(sys.argv[1], sys.argv[2], frames=300, workers=0)
print("RESULT", begun[0], time.process_time())
"""


def start_up(world: str) -> tuple[float, float]:
    """Return processor seconds of `vispeg render`, 300 frames in one process: before its first episode, and in all."""
    with TemporaryDirectory() as folder:
        command = [sys.executable, "-c", WHOLE, str(Path(folder) / "frames"), world]
        run = subprocess.run(command, cwd=Path(__file__).parents[2], capture_output=True, text=True, check=True)
    said = next(line for line in run.stdout.splitlines() if line.startswith("RESULT")).split()
    return float(said[1]), float(said[2])


class Clock:
    """Processor time (s) and calls of functions by part; one that runs inside another counts as the other's.

    What runs inside the rendering of the clock `above` does not count.
    """

    def __init__(self, above: Clock | None = None) -> None:
        self.spent, self.calls, self.inside, self.above = defaultdict(float), defaultdict(int), "", above

    def watch(self, part: str, owner: Any, name: str) -> None:
        """Count every call of `owner.name` from now on."""
        setattr(owner, name, self._timed(part, getattr(owner, name)))

    def _timed(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*args: Any, **kwargs: Any) -> Any:
            if self.inside or (self.above and self.above.inside == "rendering"):
                return function(*args, **kwargs)
            self.inside, began = part, time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                self.spent[part] += time.process_time() - began
                self.calls[part] += 1
                self.inside = ""

        return timed


def main() -> None:
    """Measure and print a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="S")
    parser.add_argument("--looks", type=int, default=4)
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--no-labels", action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    plan, layout = plan_of(args.world, 2000, looks=args.looks, size=64, labels=not args.no_labels)
    clock, frames = Clock(), 0
    floor = Clock(clock)
    beneath(floor)
    shard_bytes(stage.shard, plan, layout, Shard(99, 0, 2 * args.looks))  # imports, the model, shaders
    floor.spent.clear()
    for part in PARTS:
        clock.watch(*part)
    began = time.process_time()
    for shard in plan.shards[: args.shards]:
        shard_bytes(stage.shard, plan, layout, shard)
        frames += shard.frames
    whole = time.process_time() - began
    # calls beside those of the frames place the fixture for the guard; they are no part of what is asked for
    spare = clock.spent["rendering"] * (1 - frames / clock.calls["rendering"])
    clock.spent["rendering"] -= spare
    clock.spent["looks, contrast guard"] += spare
    clock.spent["the rest"] = whole - sum(clock.spent.values())
    print(f"{frames} frames of {len(layout.cameras)} cameras, {args.looks} looks, labels: {plan.labels}\n")
    print("| part | ms a frame | share |\n|---|---|---|")
    for part, spent in clock.spent.items():
        print(f"| {part} | {1e3 * spent / frames:.2f} | {spent / whole:.2f} |")
    print(f"| all | {1e3 * whole / frames:.2f} | 1 |")
    least = {**floor.spent, "guard's pictures": spare}
    beneath_ms = ", ".join(f"{part} {1e3 * spent / frames:.2f}" for part, spent in least.items())
    bound = clock.spent["rendering"] / (clock.spent["rendering"] + sum(least.values()))
    print(f"\nIn the libraries beneath, ms a frame: {beneath_ms}. Bound on the renderers' share: {bound:.2f}")
    before, total = start_up(args.world)
    print(
        f"\n300 frames in one look, from the command's start: {total:.2f} s, {before:.2f} s before the first episode."
    )
    if args.json:
        found = {k: 1e3 * v / frames for k, v in clock.spent.items()} | {"all": 1e3 * whole / frames}
        args.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
