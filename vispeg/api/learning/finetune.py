"""Fine-tune a trained policy in a target world, as `vispeg finetune` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from vispeg.api.policies import load_policy
from vispeg.core.errors import UserError
from vispeg.core.extras import require
from vispeg.core.paths import expanded
from vispeg.formats.json_data import read_json
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.task.start import Start
from vispeg.trials.trial import FILE, folders, read_said

if TYPE_CHECKING:
    from vispeg.learn.policy import Policy


@dataclass(frozen=True)
class FinetunedPolicy(Summarised):
    """A fine-tuned policy.

    Attributes:
        folder: folder of the policy.
        measured: content of finetune.json: success `before` and `after` in the target world (0 to 1), settings, seed.
    """

    folder: Path
    measured: Mapping[str, object]

    def open(self) -> Policy:
        """Load the policy."""
        return load_policy(self.folder)

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg finetune --json`."""
        return {"policy": str(self.folder), **self.measured}

    @property
    def summary(self) -> list[Block]:
        """Success before and after, and the policy's folder."""
        change = [
            f"success {when} fine-tuning: {share:.0%}"
            for when in ("before", "after")
            if isinstance(share := self.measured.get(when), float)
        ]
        return [*(Line(text) for text in change), Line(f"policy: {self.folder}", path=True)]


def finetune(
    policy: str | Path,
    world: str | Path,
    out: str | Path,
    *,
    teacher: str = "expert",
    dataset: str | Path | None = None,
    starts: str | Path | None = None,
    demos: int = 100,
    updates: int = 2000,
    lr: float | None = None,
    known: float = 0.15,
    known_world: str | None = None,
    episodes: int = 50,
    seed: int = 0,
    device: Literal["cpu", "cuda", "auto"] = "cpu",
    overwrite: bool = False,
    say: Callable[[str], None] = lambda text: None,
) -> FinetunedPolicy:
    """Fine-tune a policy in a target world on a few demonstrations; see docs/learning.md.

    Args:
        policy: a policy's folder, or a bundled policy's name.
        world: the target world: a built-in name or a world file.
        out: folder of the new policy.
        teacher: demonstrator: `expert` for the scripted policy, or a state policy's folder or name.
        dataset: demonstrations in LeRobot's layout, in place of a teacher. FOLDER?action=KIND states the kind of its
            actions.
        starts: a folder of trials; demonstrations begin at the starts of those that failed.
        demos: number of successful demonstrations in the target world.
        updates: number of gradient steps. Image encoders are frozen for the first half, then learn at a hundredth of
            `lr`.
        lr: learning rate; default: a tenth of that in training.
        known: share of each batch that comes from the training world, 0 to 0.5.
        known_world: the training world, if the policy's record does not name a built-in one.
        episodes: number of episodes of the evaluations before and after.
        seed: seed of everything random.
        device: where the network runs.
        overwrite: replace `out` if it exists.
        say: called with a sentence on each stage.

    Raises:
        UserError: no such policy, world or teacher; the policy does not fit the world; `out` exists.
    """
    require("torch", "fine-tuning")
    from vispeg.learn.methods import finetune as tuning

    if starts is not None and dataset is not None:
        raise UserError("cannot be combined with --dataset", key="--starts", expected="one of them")
    begun = () if starts is None else failed_starts(Path(starts))
    settings = tuning.FinetuneSettings(demos, updates, lr, known=known, episodes=episodes)
    folder = tuning.finetune_in_worlds(
        Path(policy),
        str(world),
        known_world,
        teacher,
        expanded(out),
        settings,
        seed,
        dataset=None if dataset is None else Path(dataset),
        starts=begun,
        device=device,
        overwrite=overwrite,
        say=say,
    )
    return FinetunedPolicy(folder, read_json(folder / "finetune.json"))


def failed_starts(trials: Path) -> tuple[Start, ...]:
    """Return the starts of trials that failed at full speed, without their effects, which are drawn anew.

    Raises:
        UserError: there are none.
    """
    said = {folder: read_said(folder) for folder in folders(trials)}
    full_speed = {folder: trial for folder, trial in said.items() if trial.full_speed}
    starts = tuple(
        replace(trial.again(), source=folder / FILE)
        for folder, trial in full_speed.items()
        if not trial.outcome.success
    )
    if not starts:
        got = f"{len(full_speed)} at full speed that succeeded"
        raise UserError("no trial failed", file=trials, key="--starts", got=got)
    return starts
