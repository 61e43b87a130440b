"""Videos of a policy's episodes: the cell, what the policy sees, and where it thinks its goal is."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.files import new_folder


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
    folder: str | Path, world: str, settings: Mapping[str, object], seeds: Sequence[int], out: Path, overwrite: bool
) -> Iterator[Film]:
    """Plays a policy on these seeds and writes a video of each, which it gives.

    Args:
        folder: of the policy, or the name of one that comes with the package.
        world: built-in name or world file.
        settings: of the task, in place of the world's.
        seeds: of the episodes.
        out: folder of the videos.
        overwrite: whether it may be replaced.

    Raises:
        UserError: no such policy or world; `out` is there.
    """
    from vispeg.evaluation.films.video import write_video
    from vispeg.learn.coarse_to_fine import open_policy
    from vispeg.learn.envs import of_policy
    from vispeg.learn.play import play

    policy = open_policy(folder)
    env = of_policy(policy, world)(1, {"render_mode": "rgb_array", **settings})
    try:
        with new_folder(out, overwrite, holds="films", inputs=(folder, world)) as place:
            for played in play(policy, env, [*seeds]):
                category = str(played.record.get("category", "episode"))
                file = write_video(place / f"{played.seed}-{category.replace(' ', '-')}", played.frames)
                force = float(played.record.get("peak_force", 0.0))
                yield Film(played.seed, category, force, str(out / file.name))
    finally:
        env.close()
