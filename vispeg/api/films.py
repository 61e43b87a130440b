"""Videos of a policy's episodes: the cell, the policy's images, and its estimate of the goal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.core.seeds import check_seed
from vispeg.report.text.summary import Block, Line, Summarised


@dataclass(frozen=True)
class Film:
    """A video of one episode: seed, outcome, peak contact force (N), and path."""

    seed: int
    category: str
    peak_force: float
    file: str

    @property
    def line(self) -> str:
        """The video in one line of text."""
        return f"seed {self.seed}: {self.category}, peak force {self.peak_force:.0f} N, {self.file}"


def films(
    folder: str | Path, world: str, settings: Mapping[str, object], seeds: Sequence[int], out: Path, overwrite: bool
) -> Iterator[Film]:
    """Play a policy on these seeds, write a video of each episode, and yield the videos.

    Args:
        folder: a policy's folder, or the name of a bundled policy.
        world: a built-in world's name or a world file.
        settings: settings of the task, in place of the world's.
        seeds: seeds of the episodes.
        out: folder of the videos.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such policy or world; `out` exists.
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
                stem = place / f"{played.seed}-{category.replace(' ', '-')}"
                file = write_video(stem, played.frames, env.metadata["render_fps"])
                force = float(played.record.get("peak_force", 0.0))
                yield Film(played.seed, category, force, str(out / file.name))
    finally:
        env.close()


@dataclass(frozen=True)
class Films(Summarised):
    """Videos of a policy's episodes.

    Attributes:
        policy: the policy's folder or name, as given by the user.
        world: the world in which it was played.
        films: one video per episode, in the order of the seeds.
    """

    policy: str
    world: str
    films: Sequence[Film]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg play --json`."""
        return {"policy": self.policy, "world": self.world, "films": [asdict(film) for film in self.films]}

    @property
    def summary(self) -> list[Block]:
        """The outcome and video path of each episode."""
        return [Line(film.line, path=True) for film in self.films]


def played_in(
    policy: str | Path, world: str | Path | None = None, tolerance: float | None = None
) -> tuple[str, dict[str, object]]:
    """Return the world that a policy is played in, and the settings of its task; arguments as for `play`.

    Raises:
        UserError: no such policy or world.
    """
    from vispeg.learn.coarse_to_fine import open_policy
    from vispeg.learn.envs import home
    from vispeg.learn.meta import made_for
    from vispeg.task.registry import with_tolerance
    from vispeg.task.world_file import load_world

    opened = open_policy(policy)
    chosen = home(opened) if world is None else str(world)
    if tolerance is not None:
        return chosen, dict(with_tolerance(load_world(chosen).task, tolerance))
    return chosen, dict(made_for(opened.meta)) if world is None else {}


def play(
    policy: str | Path,
    *,
    world: str | Path | None = None,
    tolerance: float | None = None,
    episodes: int = 3,
    seed: int = 0,
    out: str | Path | None = None,
    overwrite: bool = False,
    watch: Callable[[Film], None] = lambda film: None,
) -> Films:
    """Play a policy and write a video of each episode.

    Args:
        policy: a policy's folder, or a bundled policy's name (`depth-S`).
        world: a built-in world's name or a world file; default: the training world.
        tolerance: width of the goal minus that of the part (`TaskConfig.tolerance`), mm; default: the world's, or the
            policy's in its training world.
        episodes: number of episodes.
        seed: seed of the first episode; the next ones count up.
        out: folder of the videos; default: films/POLICY-WORLD.
        overwrite: replace `out` if it exists.
        watch: called with each video after it is written.

    Raises:
        UserError: no such policy or world, fewer than one episode, or `out` exists.
    """
    if episodes < 1:
        raise UserError("must be at least 1", key="episodes", got=episodes)
    chosen, settings = played_in(policy, world, tolerance)
    usual = Path("films") / f"{Path(policy).resolve().name}-{Path(chosen).stem}"
    folder = usual if out is None else expanded(out)
    check_seed(seed)
    check_seed(seed + episodes - 1)  # the others count up
    seeds, made = [seed + k for k in range(episodes)], list[Film]()
    for film in films(policy, chosen, settings, seeds, folder, overwrite):
        made.append(film)
        watch(film)
    return Films(str(policy), chosen, made)
