"""Plays a policy and writes a video of each episode: the cell, the policy's own view, and where it thinks the peg is.

Example:
    vispeg play runs/peg-depth/20261121-0900_s0/checkpoints/best --episodes 3 --out films
    vispeg play state-3mm --world P --seed 7 --rerun seed-7.rrd --out films
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import tyro

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg play`."""

    policy: tyro.conf.Positional[Path]
    """A policy's folder, or the name of one that comes with the package (`depth-S`)."""
    out: Path | None = None
    """Folder of the videos; films/POLICY-WORLD where not given."""
    world: str | None = None
    """A built-in world or a world file; the one that the policy was trained in where not given."""
    clearance: float | None = None
    """Diametral clearance in mm; where not given the world's, or the policy's own in the world it was trained in."""
    episodes: int = 3
    """How many episodes."""
    seed: int = 0
    """Seed of the first; the next ones count up."""
    rerun: Path | None = None
    """A file FILE.rrd for the Rerun viewer with the same episodes in 3D: forces, what the policy sees and estimates."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    def run(self) -> int:
        """Plays and writes."""
        from vispeg.api.films import Film, films
        from vispeg.core.errors import UserError
        from vispeg.learn.coarse_to_fine import open_policy
        from vispeg.learn.envs import home
        from vispeg.learn.meta import made_for
        from vispeg.report.rrd.stream import check_target

        if self.episodes < 1:
            raise UserError("must be at least 1", key="episodes", got=self.episodes)
        if self.rerun is not None:
            check_target(self.rerun, self.overwrite)
        policy = open_policy(self.policy)
        world, settings = self.world or home(policy), {}
        if self.clearance is not None:
            settings = {"clearance_mm": self.clearance}
        elif self.world is None:
            settings = dict(made_for(policy.meta))
        out = self.out or Path("films") / f"{self.policy.resolve().name}-{Path(world).stem}"
        seeds = [self.seed + k for k in range(self.episodes)]
        made = list[Film]()
        for film in films(self.policy, world, settings, seeds, out, self.overwrite):
            made.append(film)
            self.output.line(film.line)
        record = {"policy": str(self.policy), "world": world, "films": [asdict(film) for film in made]}
        if self.rerun is not None:
            from vispeg.evaluation.entrants import entrant
            from vispeg.report.rrd.episode import played, write_episodes

            replays = played(entrant(str(self.policy)), world, settings, seeds)
            write_episodes(self.rerun, f"play {self.policy}", replays)
            self.output.line(f"rerun: {self.rerun}")
            record["rerun"] = str(self.rerun)
        self.output.give(record, [])
        return 0
