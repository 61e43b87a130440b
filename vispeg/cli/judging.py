"""Commands that judge policies."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vispeg.cli.command import REQUIRED, TOLERANCE, Call, Option, command
from vispeg.core.counts import count
from vispeg.core.interrupt import goes_on

if TYPE_CHECKING:
    from vispeg.evaluation.jobs import Job
    from vispeg.evaluation.runner import Watch

OUT = Option(default=REQUIRED)


def played(call: Call, **more: Any) -> Any:
    """Call the command's function with a progress bar for its episodes."""
    from vispeg.cli.progress import playing

    return call(playing=lambda jobs, folder: playing(jobs, folder, call.output.quiet), **more)


def _task(call: Call, who: Iterable[Any], tolerance: float | None) -> Mapping[str, float]:
    """Return the task's settings that the tolerance changes in the command's world, see `at_tolerance`."""
    from vispeg.cli.tolerance import at_tolerance
    from vispeg.task.world_file import load_world

    return at_tolerance(who, load_world(call.world), tolerance)


def _judged(call: Call, tolerance: float | None) -> None:
    """Call the function with the task's tolerance; print the result and the path of its page."""
    from vispeg.evaluation.entrants import entrants

    result = played(call, task=_task(call, entrants(call.policies), tolerance))
    call.give(result, str(call.out / result.page))


@command(
    "vispeg.api.evaluate:evaluate",
    "policies",
    videos=Option(default=4),
    controls=Option(bare=True),
    trials=Option("keep_trials"),
    tolerance=TOLERANCE,
)
@goes_on()
def evaluate(call: Call, tolerance: float | None = None) -> None:
    """Evaluate policies in one world, with 95 % intervals.

    A policy is a folder with policy.json and policy.safetensors, NAME=FOLDER, `expert` (the scripted policy), an .onnx
    file by `vispeg export`, your own policy as MODULE:CLASS or MODULE:FUNCTION, a .zip by Stable-Baselines3, or
    lerobot:FOLDER for a policy saved by LeRobot. If its actions are joint angles or metres, append ?action=KIND
    (joint_goal, joint_delta, tip_goal, tip_delta). Several policies play the same seeds. Writes OUT/evaluate.json,
    OUT/evaluate.html, OUT/episodes.jsonl and videos of failures: success, time, force, kinds of failure, differences.
    OUT is evaluated/POLICIES-WORLD by default. Repeat the command to continue a stopped evaluation.

    Example:
        vispeg evaluate runs/{task}-state/20261121-0900_s0/checkpoints/best --world randomized --episodes 500
        vispeg evaluate mine=my_module:Policy model.zip --world VNP
        vispeg evaluate depth=runs/d/best rgb=runs/r/best --world S --controls shuffled frozen --workers 2 --out both

    Args:
        tolerance: width of the goal minus that of the part, mm; default: the world's.
    """
    from vispeg.evaluation.entrants import entrants
    from vispeg.task.world_file import load_world

    who = entrants(call.policies)
    task = _task(call, who, tolerance)
    name = f"{'+'.join(dict.fromkeys(e.name for e in who))}-{load_world(call.world).name}"
    out = call.out or Path("evaluated") / name
    result = played(call, task=task, out=out)
    call.give(result, str(out / "evaluate.html"))


@command("vispeg.api.stress.perturb:perturb", "policies", out=OUT, tolerance=TOLERANCE)
@goes_on()
def perturb(call: Call, tolerance: float | None = None) -> None:
    """Test policies at hard positions, with and without pushes.

    A push is 20 to 60 N for 0.2 s. Writes OUT/perturb.json and OUT/perturb.html: success with its interval at each
    position, and the loss of success due to pushes.

    Example:
        vispeg perturb runs/{task}-state/best --world randomized --episodes 40 --out pushed
        vispeg perturb runs/{task}-depth/best --positions my-positions.yaml --force 20 40 --out pushed

    Args:
        tolerance: width of the goal minus that of the part, mm; default: the world's.
    """
    _judged(call, tolerance)


@command("vispeg.api.stress.exploit:exploit", "policies", out=OUT, tolerance=TOLERANCE)
@goes_on()
def exploit(call: Call, tolerance: float | None = None) -> None:
    """Test whether a policy exploits the contact solver.

    Half of the trials have fixed contact parameters; in the other half contact stiffness, damping, restitution, solver
    iterations and the physics time step are drawn widely, on the same seeds. Writes OUT/exploit.json and
    OUT/exploit.html.

    Example:
        vispeg exploit runs/{task}-state/best --world randomized --episodes 100 --out exploit

    Args:
        tolerance: width of the goal minus that of the part, mm; default: the world's.
    """
    _judged(call, tolerance)


@command(
    "vispeg.api.stress.sensitivity:sensitivity",
    "policies",
    sweeps=Option("sweep", default=(), repeats=True),
    out=OUT,
)
@goes_on()
def sensitivity(call: Call) -> None:
    """Plot success over one parameter of one effect.

    SWEEP is focal-length, camera-shift, camera-turn, depth-noise, light, latency, image-latency, encoder-noise,
    force-bias, force-noise, friction, or EFFECT[@WHERE].PARAM[,PARAM]=VALUE,VALUE,... It may also be a model file by
    `vispeg diagnose`, to play without and with each of its effects, or a measurement file, to play over its interval.
    Effects on images need policies with cameras. Writes OUT/sensitivity.json and OUT/sensitivity.html.

    Example:
        vispeg sensitivity runs/depth/best --world S --sweep focal-length --episodes 200 --out focal
        vispeg sensitivity depth-S --world S --sweep found/model.yaml --out cost
        vispeg sensitivity depth-S --world S --sweep mass.yaml --episodes 400 --out enough
        vispeg sensitivity runs/d/best runs/r/best --sweep "camera_offset@wrist_wide.x=0,0.005,0.02" --out shift
    """
    result = played(call)
    call.give(result, str(call.out / result.page))


@command("vispeg.api.gap:gap", "policies", out=OUT, videos=Option(default=2), controls=Option(bare=True))
@goes_on()
def gap(call: Call) -> None:
    """Measure what policies lose in other worlds, factor by factor.

    All policies play the same seeds. The first world is the reference, the others are targets. The loss in a combined
    world (VNP combines V, N and P) is split into shares. Controls (the policies with shuffled or frozen images, or
    with a goal that never moves) are played in the first and the last world; the blind control is a separate policy of
    modality `proprio`. Writes OUT/gap.json, OUT/gap.html, OUT/episodes.jsonl.

    A world that a policy was trained in is marked as its home. A policy that was not trained in a target, but with a
    held-out part of it (its looks, its plant), is refused without --fine-tuned. --measured adds a real robot's trials
    as a target: a folder by `vispeg run`, or a CSV (policy, configuration, seed, outcome, category). --records reuses
    episodes of `vispeg evaluate` or `vispeg gap`; videos then need the policies too.

    Example:
        vispeg gap runs/depth_s* runs/rgb_s* --worlds S V N P VNP --episodes 500 --workers 2 --out gap
        vispeg gap --records gap/episodes.jsonl --worlds S VNP --out again
        vispeg gap runs/depth_s* runs/rgb_s* --records gap/episodes.jsonl --episodes 500 --videos 4 --out filmed
        vispeg gap depth=runs/d/best --worlds S --measured robot.csv --out real
    """
    from vispeg.cli.progress import playing

    quiet = call.output.quiet

    def announced(jobs: Sequence[Job], folder: Path) -> AbstractContextManager[Watch]:
        total, controlled = sum(len(j.seeds) for j in jobs), sum(len(j.seeds) for j in jobs if j.control)
        if controlled and not quiet:
            text = f"{count(total, 'episode')}, {controlled} of them of controls (--controls none leaves those out)"
            print(text, file=sys.stderr)
        return playing(jobs, folder, quiet)

    call.give(call(playing=announced), str(call.out / "gap.html"))


@command("vispeg.api.explain:explain", "trials", out=OUT, tolerance=TOLERANCE)
@goes_on()
def explain(call: Call, tolerance: float | None = None) -> None:
    """Explain why trials of a policy fail on a robot.

    Replays every trial's start in simulation with several draws of the world, by the policy and by the trial's own
    actions. Replaces one sense of the policy at a time by simulation's, to see which changes its action. Plays each
    effect of a model file from those starts, to see how much success it costs; `vispeg diagnose` finds such effects
    from motions in free air or from pictures. `--remainder N` plays N episodes with the unexplained torque, and states
    whether the gap is unbridgeable here. Lists next steps with the success that they can win back at most, and
    their hours. Writes OUT/explain.json and OUT/explain.html.

    Example:
        vispeg explain trials --policy runs/{task}-state/best --world randomized --out why
        vispeg explain trials --policy runs/{task}-state/best --model diagnosis/model.yaml --apply --out why
        vispeg explain trials --policy runs/{task}-state/best --model diagnosis/model.yaml --remainder 200 --out why

    Args:
        tolerance: width of the goal minus that of the part, mm; default: the world's.
    """
    from vispeg.evaluation.entrants import entrants

    result = played(call, task=_task(call, entrants([call.policy]), tolerance))
    call.give(result, str(call.out / result.page))


@command("vispeg.api.plan:plan", "world", world=Option(default=REQUIRED))
def plan(call: Call) -> None:
    """Estimate the transfer to expect for a task, before building it.

    States success rates that an article of practitioners gives for such tasks, and its signs of a gap that cannot be
    bridged, each with its value here. It measures nothing; `vispeg gap` and `vispeg run` do.

    Example:
        vispeg plan S
        vispeg plan my-cell.yaml --repeatability 0.1 --varies --demonstrations 300 --a-day 80 --build-days 10
    """
    call.give(call())
