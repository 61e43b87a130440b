"""Plays a policy and writes a video of each episode: the cell, the policy's own view, and where it thinks the peg is.

Example:
    vispeg play runs/peg-depth/20261121-0900_s0/checkpoints/best --episodes 3 --out films
    vispeg play state-3mm --world P --seed 7 --rerun seed-7.rrd --out films
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

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

            shown = played(entrant(str(self.policy)), world, settings, seeds)
            write_episodes(self.rerun, f"play {self.policy}", shown)
            self.output.line(f"rerun: {self.rerun}")
            record["rerun"] = str(self.rerun)
        self.output.give(record, [])
        return 0


@dataclass(frozen=True)
class Film:
    """A video of one episode: its seed, how it ended, its peak contact force in N, where it lies."""

    seed: int
    category: str
    peak_force: float
    file: str

    @property
    def line(self) -> str:
        """For a person."""
        return f"seed {self.seed}: {self.category}, peak force {self.peak_force:.0f} N, {self.file}"


def films(
    folder: Path, world: str, settings: dict[str, Any], seeds: list[int], out: Path, overwrite: bool
) -> Iterator[Film]:
    """Plays a policy on these seeds and writes a video of each, which it gives.

    Args:
        folder: of the policy.
        world: built-in name or world file.
        settings: of the task, in place of the world's.
        seeds: of the episodes.
        out: folder of the videos.
        overwrite: whether it may be replaced.
    """
    from vispeg.core.files import new_folder
    from vispeg.evaluation.films.video import write_video
    from vispeg.learn.coarse_to_fine import open_policy
    from vispeg.learn.envs import of_policy
    from vispeg.learn.play import play

    policy = open_policy(folder)
    env = of_policy(policy, world)(1, {"render_mode": "rgb_array", **settings})
    try:
        with new_folder(out, overwrite, holds="films", inputs=(folder, world)) as place:
            for played in play(policy, env, seeds):
                category = str(played.record.get("category", "episode"))
                file = write_video(place / f"{played.seed}-{category.replace(' ', '-')}", played.frames)
                force = float(played.record.get("peak_force", 0.0))
                yield Film(played.seed, category, force, str(out / file.name))
    finally:
        env.close()
