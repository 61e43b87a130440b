"""How fast a dataset is rendered, against what the renderers alone could do, taking turns in one run.

    python scripts/bench/datasets.py [--world S] [--looks 4] [--rounds 5] [--json out.json]

One process, CPU time. A round draws the same recorded episode: once as `vispeg render` does, with look, guard, sensor
and files, and once by the renderer alone, dressed in the same look. Physics is measured apart and shared by the looks.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MUJOCO_GL", "egl")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np  # noqa: E402

from vispeg.datasets.shard import counted  # noqa: E402
from vispeg.learn.demonstration_plan import plan_of  # noqa: E402
from vispeg.learn.demonstrations import ROWS, Stage  # noqa: E402


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--world", default="S")
    parser.add_argument("--looks", type=int, default=4)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--no-labels", action="store_true")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    plan, layout = plan_of(args.world, 1000, looks=args.looks, size=64, labels=not args.no_labels)
    stage = Stage(plan, layout)
    began = time.process_time()
    played = stage.play([plan.episode_seed(0, i) for i in range(ROWS)])
    physics = (time.process_time() - began) / sum(len(moments) for _, moments, _, _ in played)
    whole, alone = [], []
    for k in range(args.rounds):
        seed, moments, record, drawn = played[k % ROWS]
        began = time.process_time()
        counted(layout, stage.draw(seed, k, moments, record, drawn), 0, 0)
        whole.append((time.process_time() - began) / len(moments))
        began = time.process_time()
        for moment in moments:
            stage.plain.render(moment.qpos, moment.bodies)
        alone.append((time.process_time() - began) / len(moments))
    frame = float(np.median(whole)) + physics / args.looks
    found = {
        "cameras": len(layout.cameras),
        "labels": plan.labels,
        "physics_ms": 1e3 * physics,
        "render_ms": 1e3 * float(np.median(alone)),
        "frame_ms": 1e3 * frame,
        "frames_per_s_and_core": 1 / frame,
        "share_of_renderers_alone": float(np.median(alone)) / frame,
    }
    for key, value in found.items():
        print(f"{key:28} {value:.2f}" if isinstance(value, float) else f"{key:28} {value}")
    if args.json:
        args.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
