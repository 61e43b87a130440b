"""The cost of the unexplained residual: success of a policy in the identified model, without and with the residual."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import rmtree

from vispeg.api.playing import check_numbers, play
from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.evaluation import runner
from vispeg.evaluation.entrants import Entrant, Policies
from vispeg.evaluation.folder import workplace
from vispeg.evaluation.jobs import Job, make_jobs, seeds_of
from vispeg.evaluation.players import ready
from vispeg.evaluation.schema.stress import RemainderCost
from vispeg.evaluation.stress import remainder
from vispeg.robots.model import same
from vispeg.task.world_file import WorldFile, load_world
from vispeg.worlds.world import World


@dataclass(frozen=True)
class Price:
    """The policies and the cell to play, read and checked before a diagnosis begins.

    Attributes:
        who: the policies.
        world: the cell.
        episodes: number of episodes of each policy, without and with the residual each.
    """

    who: tuple[Entrant, ...]
    world: WorldFile
    episodes: int

    @classmethod
    def of(cls, policies: Policies, world: str | Path, episodes: int, model: World) -> Price:
        """Read the policies and the cell.

        Args:
            policies: folders, NAME=FOLDER, names of bundled policies, or `expert`.
            world: a built-in world's name or a world file.
            episodes: number of episodes of each policy in each of the two settings.
            model: the diagnosed model.

        Raises:
            UserError: a policy that cannot be played, or the model's robot is not the cell's.
        """
        check_numbers(episodes, 1)
        file = load_world(world)
        cell = file.world.base.robot
        if not same(model.robot, cell):
            message = f"the policy's cell has another robot than the recordings: {file.name} has {cell}"
            raise UserError(message, key="--policy", expected=f"a model of {cell}, or --world", got=model.robot)
        return cls(tuple(ready(policies)), file, episodes)

    def paid(
        self,
        identified: World,
        missing_torque: Sequence[Mapping[str, object]],
        *,
        seed: int,
        part: Path | None,
        say: Callable[[str], None],
    ) -> RemainderCost:
        """Play the episodes, except for those kept in `part`, which is removed at the end; return the cost.

        Args:
            identified: the identified model.
            missing_torque: the `remainder` of a diagnosis.
            seed: seed of the episodes.
            part: folder that keeps played episodes; None keeps none.
            say: called with a line of text on the progress.

        Raises:
            UserError: the cell has no place for an effect of the model.
        """
        with workplace(part, "price.json", inputs=[e.path for e in self.who]) as place:
            settings = remainder.settings(self.world, identified, missing_torque, place / "worlds")
            jobs = make_jobs(self.who, settings, seeds_of(self.episodes, seed), place / "worlds")
            ends = play(jobs, place, 1, lambda jobs, folder: _reported(jobs, say))
            rows = remainder.summarise(ends)
        if part is not None:
            rmtree(part)
        about = {"name": self.world.name, "hash": self.world.hash}
        return {"world": about, "episodes": self.episodes, "policies": rows}


@contextmanager
def _reported(jobs: Sequence[Job], say: Callable[[str], None]) -> Iterator[runner.Watch]:
    """Yield a progress display that passes lines of text to `say`."""
    names = ", ".join(dict.fromkeys(job.entrant.name for job in jobs))
    say(f"{names} plays with the identified model, and with what is left")
    yield lambda new, done, total: say(f"{names}: {done} of {count(total, 'episode')}")
