"""Commands on policies and the worlds that they are trained in."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

from vispeg.cli.command import TOLERANCE, Call, Option, command, under
from vispeg.core.errors import UserError
from vispeg.core.interrupt import goes_on


@command()
def worlds(call: Call, family: str | None = None, search: str | None = None) -> None:
    """List the built-in worlds, whose names --world accepts.

    Example:
        vispeg worlds
        vispeg worlds --search sensor

    Args:
        family: only worlds of this kind: fixed or randomized.
        search: only worlds with this text in name or description.
    """
    from vispeg.api.library.catalogue import worlds
    from vispeg.cli.listing import show

    show("worlds", worlds(), "kind", family, search, call.output)


@command()
def policies(call: Call, family: str | None = None, search: str | None = None) -> None:
    """List the bundled policies, whose names can be used like folders.

    Example:
        vispeg policies
        vispeg policies --family depth

    Args:
        family: only policies of this modality: state, proprio, depth, rgb, rgbd.
        search: only policies with this text in name or description.
    """
    from vispeg.api.library.catalogue import policies
    from vispeg.cli.listing import show

    show("policies", policies(), "sees", family, search, call.output)


@command(
    "vispeg.api.train:train",
    "task",
    task=Option(default=None),
    settings=None,
    distill=None,
    show=None,
    tolerance=replace(TOLERANCE, group="task"),
    **under("task", "world", "curriculum", "start_radius", "stack", "dof", "reward", "ranges"),
    **under("learning", "steps", "recipe", "target", "seed", "envs", "threads", "engine", "device", "utd", "recurrent"),
    **under("learning", "symmetric", "replay"),
    **under("imitation", "teacher", "dataset", "distill_steps", "distill_updates", "distill_looks"),
    **under("evaluation", "every", "episodes", "films", "wandb"),
)
def train(
    call: Call,
    resume: Path | None = None,
    tolerance: float | None = None,
    stack: int | None = None,
    dof: tuple[str, ...] = (),
    reward: Literal["shaped", "paper"] | None = None,
    distill_steps: int = 4000,
    distill_updates: int = 2000,
    distill_looks: int = 1,
    films: int = 2,
) -> None:
    """Train a policy for the task of a world.

    TASK names the task and what the policy sees: {task}-state, {task}-proprio, {task}-depth, {task}-rgb, {task}-rgbd,
    {task}-privileged (a teacher with ground truth), or LABEL-MODALITY for your own task. The run's folder holds
    config.yaml, progress.csv, tensorboard/, checkpoints/best and, after reinforcement learning, checkpoints/last. Each
    checkpoint is a policy for `vispeg play` and `vispeg evaluate`.

    Example:
        vispeg train {task}-state --world nominal --seed 0
        vispeg train {task}-state {tolerance} 0.5 --curriculum 3 1 --target 0.98
        vispeg train {task}-state --world randomized --ranges adaptive
        vispeg train {task}-state --world P --dof x y z rx ry --stack 4
        vispeg train {task}-depth --recipe distill+sac --teacher runs/{task}-state/best
        vispeg train {task}-depth --recipe distill --dataset demos
        vispeg train {task}-state --recipe distill --teacher expert --engine warp --envs 1024
        vispeg train --resume runs/{task}-state/20261121-0900_s0 --steps 200000

    Args:
        resume: continue the run in this folder from its last checkpoint; only `steps` and `films` may be added.
        tolerance: width of the goal minus that of the part, mm; default: the world's.
        stack: number of successive observations and actions that the policy sees; default: the world's (2).
        dof: directions in which the policy moves, of x y z rx ry rz; default: the world's (x y z).
        reward: `shaped`, this project's reward, or `paper`, that of Kaspar and Bock; default: the world's (shaped).
        distill_steps: environment steps of each of the five rounds.
        distill_updates: gradient steps after each round.
        distill_looks: number of looks in which each state is stored, including the episode's own.
        films: number of episodes of the best policy to film at the end, if the run has no films.
    """
    if films < 0:
        raise UserError("must not be negative", key="--films", got=films)
    show = not call.output.quiet
    if resume is not None:
        if others := [word for word in call.changed if word not in ("--resume", "--steps", "--films")]:
            expected, got = "--steps and --films alone", " ".join(others)
            raise UserError("a resumed run keeps its options", key="--resume", expected=expected, got=got)
        from vispeg.api.train import resume as again

        with _goes_on(resume, films):
            _tell(call, again(resume, call.steps, show=show), films)
        return
    from vispeg.api.train import new_run
    from vispeg.task.registry import with_tolerance
    from vispeg.task.world_file import load_world

    task = call.task or ""
    settings: dict[str, Any] = {"stack": stack, "dof": dof or None, "reward": reward}
    settings |= {} if tolerance is None else with_tolerance(load_world(call.world).task, tolerance)
    settings = {key: value for key, value in settings.items() if value is not None}
    distill = {"steps": distill_steps, "updates": distill_updates, "looks": distill_looks}
    out = call.out or new_run(task, call.seed)
    with _goes_on(out, films):
        _tell(call, call(task=task, settings=settings, distill=distill, out=out, show=show), films)


def _goes_on(folder: Path, films: int):
    """Return a context in which an interrupt prints the command that resumes the run in `folder`."""
    more = () if films == 2 else ("--films", str(films))  # 2 is the default
    return goes_on(instead=("train", "--resume", str(folder), *more))


def _tell(call: Call, trained: Any, films: int) -> None:
    """Print the result of a training, and film the policy unless that was done before."""
    from vispeg.api.films import films as played
    from vispeg.learn.envs import HELD_OUT

    if not call.output.json:
        call.output.give({}, trained.summary)
    filmed, place = list[dict[str, object]](), trained.run / "films"
    if films and not place.exists():
        seeds = [HELD_OUT + k for k in range(films)]
        for film in played(trained.best, trained.world, trained.settings, seeds, place, False):
            filmed.append(asdict(film))
            call.output.line(film.line)
    call.output.give({**trained.record, "films": filmed}, [])


@command("vispeg.api.films:play", "policy", tolerance=TOLERANCE)
def play(call: Call) -> None:
    """Play a policy and write a video of each episode.

    A video shows the cell, the policy's images, and its estimate of the goal.

    Example:
        vispeg play runs/{task}-depth/20261121-0900_s0/checkpoints/best --episodes 3 --out films
        vispeg play state-3mm --world P --seed 7 --out films
    """
    result = call(watch=lambda film: call.output.line(film.line))
    call.output.give(result.record, [])


@command("vispeg.api.learning.finetune:finetune", "policy")
def finetune(call: Call) -> None:
    """Fine-tune a policy in a target world on demonstrations.

    Writes a policy's folder; finetune.json in it states success in the target before and after.

    Example:
        vispeg finetune runs/depth/best --world dev --teacher expert --demos 100 --out tuned
        vispeg finetune runs/depth/best --world dev --dataset demos --out tuned
    """
    quiet = call.output.quiet
    result = call(say=(lambda text: None) if quiet else call.output.line)
    call.output.give(result.record, result.summary if quiet else result.summary[-1:])


@command("vispeg.api.learning.combine:combine", "coarse", "fine", within=None)
def combine(call: Call, within_mm: float = 6.0) -> None:
    """Combine a coarse policy with a fine one for contact.

    Example:
        vispeg combine depth-S state-0.5mm --within-mm 6 --out depth-then-contact
        vispeg evaluate depth-then-contact --world S {tolerance} 0.5

    Args:
        within_mm: estimated distance of the tip from the goal's axis at which the fine policy takes over, mm.
    """
    call.give(call(within=within_mm / 1000))


@command("vispeg.api.export.export:export", "source")
def export(call: Call) -> None:
    """Export a policy to ONNX, or a model to MJCF or URDF.

    ONNX is for controllers without torch; its metadata describe inputs, outputs and arm. An MJCF holds the effects that
    MuJoCo has elements for: friction, damping, rotor inertia, springs, inertials, gravity, motor gain, bias and limit.
    A URDF holds masses, centres, inertias, damping and dry friction. Other effects are printed, and listed with their
    values in the file's first lines. Meshes are copied.

    Example:
        vispeg export runs/depth/20261121-0900_s0/checkpoints/best --out policy.onnx
        vispeg export found/model.yaml --to mjcf --out arm.xml
        vispeg export found/model.yaml --to urdf --out arm.urdf
    """
    call.give(call())
