"""Plays a policy and writes a video of each episode: the cell, the policy's own view, and where it thinks the peg is.

Example:
    vispeg play runs/peg-depth/20261121-0900_s0/checkpoints/best --episodes 3 --out films
    vispeg play assets/policies/peg-state-3mm --world P --seed 7 --out films
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg play`."""

    policy: tyro.conf.Positional[Path]
    """A policy's folder."""
    out: Path
    """Folder of the videos."""
    world: str | None = None
    """A built-in world or a world file; the one that the policy was trained in where not given."""
    clearance: float | None = None
    """Diametral clearance in mm; the world's where not given."""
    episodes: int = 3
    """How many episodes."""
    seed: int = 0
    """Seed of the first; the next ones count up."""
    overwrite: bool = False
    """Replace OUT if it is there."""

    def run(self) -> int:
        """Plays and writes."""
        from vispeg.core.files import new_folder
        from vispeg.evaluate.video import write_video
        from vispeg.learn.envs import of_policy
        from vispeg.learn.play import play
        from vispeg.learn.policy import load

        policy = load(self.policy)
        world = self.world or str(policy.meta.get("world") or "nominal")
        settings = {} if self.clearance is None else {"clearance_mm": self.clearance}
        env = of_policy(policy, world)(1, {"render_mode": "rgb_array", **settings})
        seeds = [self.seed + k for k in range(self.episodes)]
        with new_folder(self.out, self.overwrite) as folder:
            for played in play(policy, env, seeds):
                category = str(played.record.get("category", "episode"))
                file = write_video(folder / f"{played.seed}-{category.replace(' ', '-')}", played.frames)
                force = float(played.record.get("peak_force", 0.0))
                print(f"seed {played.seed}: {category}, peak force {force:.0f} N, {self.out / file.name}")
        env.close()
        return 0
