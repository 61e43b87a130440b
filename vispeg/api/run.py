"""Run a policy on a robot, and keep each episode as a trial, as `vispeg run` does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from vispeg.core.disk import written
from vispeg.core.errors import UserError
from vispeg.core.lock import claimed
from vispeg.core.paths import expanded
from vispeg.core.seeds import check_seed
from vispeg.interface.exported import Exported
from vispeg.interface.interface import Interface, NoInterface
from vispeg.interface.terms import FELT
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.report.text.tables import Column, Sheet
from vispeg.trials.driver import Driver
from vispeg.trials.live import Live
from vispeg.trials.logged import LoggedRobot
from vispeg.trials.loop import Acts, Clock, How, Step, run_episode
from vispeg.trials.named import driver
from vispeg.trials.trial import OutcomePart, PolicyPart, Said, is_trial, write_trial

if TYPE_CHECKING:
    from vispeg.evaluation.entrants import Entrant

DIGITS = 4  # number of digits of a trial's number


@dataclass(frozen=True)
class RunResult(Summarised):
    """The trials of a run.

    Attributes:
        folder: folder of the trials.
        trials: name of a trial's folder -> content of its trial.yaml.
        policy, robot: names of the policy and the robot.
    """

    folder: Path
    trials: dict[str, Said]
    policy: str
    robot: str

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg run --json`."""
        each = [
            {"trial": str(self.folder / name), **said.outcome.model_dump(), "timing": said.timing.model_dump()}
            for name, said in self.trials.items()
        ]
        success = sum(said.outcome.success for said in self.trials.values())
        return {"policy": self.policy, "robot": self.robot, "success": success, "trials": each}

    @property
    def summary(self) -> list[Block]:
        """One row per trial, and the number of successes."""
        rows = []
        for name, said in self.trials.items():
            o, t = said.outcome, said.timing
            force = "-" if o.peak_force_n is None else f"{o.peak_force_n:.0f} N"
            late = f"{t.missed} of {t.steps} (worst {1e3 * t.late_most_s:.0f} ms)"
            rows.append([name, o.category, o.by, f"{o.time_s:.1f} s", force, late])
        heads = ("trial", "outcome", "said by", "time", "peak force", "missed deadlines")
        good = sum(said.outcome.success for said in self.trials.values())
        why = [Line(f"{name}: {s.outcome.why}", warning=True) for name, s in self.trials.items() if s.outcome.why]
        text = f"{self.policy} on {self.robot}: {good} of {len(rows)} succeeded; trials in {self.folder}"
        lines = [*why, Line(text, path=True)]
        if cut := sum(said.timing.clipped for said in self.trials.values()):
            steps = sum(said.timing.steps for said in self.trials.values())
            lines.append(Line(f"{cut} of {steps} actions asked for more than the controller takes"))
        return [Sheet([Column(head) for head in heads], rows), *lines]


def run(
    policy: str | Path,
    robot: str | Driver,
    out: str | Path,
    *,
    episodes: int | None = None,
    seed: int | None = None,
    how: How | None = None,
    world: str | Path | None = None,
    name: str | None = None,
    clock: Clock | None = None,
    ask: Callable[[OutcomePart], OutcomePart] | None = None,
    ready: Callable[[int], None] = lambda number: None,
    show: Callable[[Step], None] = lambda step: None,
    key: Callable[[], bool] = lambda: False,
    watch: bool = True,
) -> RunResult:
    """Run a policy on a robot; every episode becomes a folder in `out`.

    Args:
        policy: a policy's folder, a bundled policy's name, an .onnx file, or your own policy; with or without NAME=.
        robot: sim:WORLD, ros2[:FILE.yaml], lerobot:TYPE[:FILE.yaml], log:FOLDER, or python:MODULE:CALLABLE.
        out: folder of the trials; existing trials stay, and numbers continue.
        episodes: number of episodes; default: 1, for a log all its episodes.
        seed: seed of a simulated robot's first start; default: the trial's number.
        how: settings of the run: limits, shadow, slow, the believed goal.
        world: the world with the arm and cameras of the robot; default: the policy's training world.
        name: name of the policy in tables; default: NAME, or that of its folder or file.
        clock: clock of the run loop; default: the host's.
        ask: called with each outcome; returns the outcome that a person states.
        ready: called before each episode with its number.
        show, key, watch: as in `run_episode`.

    Raises:
        UserError: no such policy or robot, a policy that cannot be run, or `out` holds other files.
    """
    if episodes is not None and episodes < 1:
        raise UserError("no episodes", key="--episodes", expected="1 or more", got=episodes)
    if seed is not None:  # the episodes' seeds count up from it
        check_seed(seed)
        check_seed(seed + (episodes or 1) - 1)
    acts, interface, who = opened(policy, world, name)
    robot_name = robot if isinstance(robot, str) else type(robot).__name__
    target = driver(robot) if isinstance(robot, str) else robot
    if isinstance(target, LoggedRobot):
        how, clock, watch, most = target.how(how or How()), target, False, target.episodes
        target.check(episodes or most)
    else:
        most = 1
    count = episodes or most
    trials: dict[str, Said] = {}
    try:
        with _place(expanded(out)) as place, Live(place, who.name, robot_name, count) as live:
            first = _next(place)

            def shown(step: Step) -> None:
                live.step(step)
                show(step)

            def stopped() -> bool:
                return key() or live.stopped()

            for k in range(count):
                ready(k)
                stem = f"trial-{first + k:0{DIGITS}d}"
                live.begin(stem, k + 1)
                options = {"name": robot_name, "clock": clock, "show": shown, "key": stopped, "watch": watch}
                trial = run_episode(acts, interface, target, who, k + (first if seed is None else seed), how, **options)
                if ask is not None:
                    said = trial.said.model_copy(update={"outcome": ask(trial.said.outcome)})
                    trial = type(trial)(said, trial.recording, trial.steps)
                folder = write_trial(trial, place / stem)
                live.end(trial.said.outcome.category)
                trials[folder.name] = trial.said
    finally:
        close = getattr(target, "close", None)
        if callable(close):
            close()
    return RunResult(expanded(out), trials, who.name, robot_name)


def opened(policy: str | Path, world: str | Path | None, name: str | None) -> tuple[Acts, Interface, PolicyPart]:
    """Return a policy, its interface (the meaning of its numbers), and its description for trials.

    Raises:
        NoInterface: a policy that no robot can run, or whose world no longer exists.
        UserError: no such policy, or it cannot be read.
    """
    text = str(policy)
    called, _, place = text.rpartition("=")  # NAME=FILE, as `entrant` takes it
    if Path(place).suffix.lower() == ".onnx":
        if world is not None:
            raise UserError(
                "is fixed in an exported policy", key="--world", expected="vispeg export --world", got=world
            )
        exported = Exported(expanded(place))
        meaning = exported.interface
        part = PolicyPart(name=name or called or Path(place).stem, digest=meaning.policy, modality=meaning.modality)
        meaning.observer()  # check that its observations and actions can be built here
        return exported, meaning, part
    from vispeg.evaluation.entrants import EXPERT, entrant
    from vispeg.learn.coarse_to_fine import open_policy
    from vispeg.learn.interface import interface_of_policy

    who = entrant(text)
    if who.scripted:
        raise NoInterface("cannot be run on a robot", key="policy", expected="a policy's folder or .onnx", got=EXPERT)
    if who.source is not None:
        return _own(who, world, name)
    network = open_policy(who.path)
    meaning = interface_of_policy(network, None if world is None else str(world), who.digest)
    meaning.observer()
    part = PolicyPart(name=name or who.name, digest=who.digest, modality=who.modality, train_seed=who.train_seed)
    return network, meaning, part


def _own(who: Entrant, world: str | Path | None, name: str | None) -> tuple[Acts, Interface, PolicyPart]:
    """Return the user's or another tool's policy, whose arm is that of `world`. Raises UserError: no world."""
    from vispeg.evaluation.lerobot import LeRobot
    from vispeg.evaluation.players import own_player
    from vispeg.task.environments.vector import world_of
    from vispeg.task.interface import interface_in

    if world is None:
        what = "the policy does not say which arm and cameras it is for"
        raise UserError(what, key="--world", expected="the world in which it was trained")
    _, config, file = world_of(str(world), who.task)
    meaning = interface_in(
        config,
        file,
        who.modality,
        modality=who.modality,
        recurrent=0,
        world=str(world),
        world_hash="" if file is None else file.hash,
        policy=who.digest,
    )
    meaning.observer()
    part = PolicyPart(name=name or who.name, digest=who.digest, modality=who.modality, train_seed=who.train_seed)
    acts = own_player(who, config)
    if isinstance(acts.target, LeRobot) and not acts.target.feels(len(meaning.arm.joints)):
        meaning = meaning.model_copy(update={"told": tuple(t for t in meaning.told if t.name not in FELT)})
    acts.reset(1)  # fail before the robot is connected, and do slow initialization now
    return acts, meaning, part


@contextmanager
def _place(out: Path) -> Iterator[Path]:
    """Yield the folder of trials, locked against other processes. Raises UserError: it holds other files."""
    inside = [p for p in out.iterdir() if not p.name.startswith(".")] if out.is_dir() else []
    if out.exists() and (not out.is_dir() or (inside and not any(map(is_trial, inside)))):
        raise UserError("is not a folder of trials", file=out, expected="a new or empty folder, or one with trials")
    with claimed(out):
        with written(out):
            out.mkdir(parents=True, exist_ok=True)
        try:
            yield out
        finally:
            if not any(out.iterdir()):
                out.rmdir()


def _next(place: Path) -> int:
    """Return the number of the next trial."""
    numbers = [p.name.rpartition("-")[2] for p in place.glob("trial-*")]
    return 1 + max((int(n) for n in numbers if n.isdigit()), default=0)
