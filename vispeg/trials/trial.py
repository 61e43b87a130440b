"""A trial: one episode of a policy on a robot, as a folder (`vispeg-trial/1`, docs/formats.md)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import yaml
from pydantic import BaseModel, ConfigDict, Field

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.seeds import LAST_SEED
from vispeg.formats.format import Format, enrol
from vispeg.formats.typed import typed
from vispeg.recordings.cell import Outcome
from vispeg.recordings.load import load
from vispeg.recordings.recording import Control, Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.write import fill, write_csv
from vispeg.render.image_kinds import GOAL_TOLD

if TYPE_CHECKING:
    from vispeg.task.start import Start

NAME, FILE, STEPS = "vispeg-trial/1", "trial.yaml", "steps.csv"
POSE = ("x", "y", "z", "qw", "qx", "qy", "qz")
TRIAL = Format(NAME, "a trial", ("policy", "robot", "task", "seed", "world", "start", "outcome", "timing", "how"))
By = Literal["robot", "person", "measured", "simulator"]

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Seed = Annotated[int, Field(ge=0, le=LAST_SEED)]
Vec3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class PolicyPart(_Part):
    """The policy: its name in tables, the SHA-256 of its folder, its modality, and the seed of its training."""

    name: Annotated[str, Field(min_length=1)]
    digest: str = ""
    modality: str = ""
    train_seed: Seed = 0


class WorldPart(_Part):
    """The world of a simulated robot."""

    name: str = ""
    hash: str = ""


class StartPart(_Part):
    """The start: joint angles (rad), measured and believed goal if known (m, in the base), and simulated effects."""

    q_rad: Annotated[list[Finite], Field(min_length=1, max_length=64)]
    goal_m: Vec3 | None = None
    believed_m: Vec3 | None = None
    effects: list[dict[str, Any]] | None = None


class OutcomePart(_Part):
    """The outcome, and who judged it; `why` is the driver's reason if the robot was lost."""

    success: Annotated[bool, Field(strict=True)]
    category: Annotated[str, Field(min_length=1)]
    by: By
    time_s: Positive
    peak_force_n: Positive | None = None
    depth_m: Finite | None = None
    why: str | None = None


class TimingPart(_Part):
    """Timing of the loop.

    Attributes:
        period_s: policy period.
        steps: number of policy steps.
        clipped: steps whose action exceeded the allowed range.
        missed: steps later than `deadline_s`.
        late_median_s, late_most_s: median and largest delay of a step.
        reads: number of readings.
        stale: readings that were no newer than the one before.
    """

    period_s: Positive = 0.0
    steps: int = 0
    clipped: int = 0
    missed: int = 0
    deadline_s: Positive = 0.0
    late_median_s: Finite = 0.0
    late_most_s: Finite = 0.0
    reads: int = 0
    stale: int = 0


class HowPart(_Part):
    """Settings of the run, see `vispeg.trials.loop.How`."""

    shadow: bool = False
    slow: Annotated[float, Field(gt=0, le=1)] = 1.0


class Said(_Part):
    """Content of trial.yaml, without its format."""

    policy: PolicyPart
    robot: str = ""
    task: str = ""
    seed: Seed | None = None
    world: WorldPart = WorldPart()
    start: StartPart
    outcome: OutcomePart
    timing: TimingPart = TimingPart()
    how: HowPart = HowPart()

    @property
    def full_speed(self) -> bool:
        """Whether the policy moved the arm, at full speed; only then it says how well the policy does."""
        return not self.how.shadow and self.how.slow == 1.0

    def begin(self) -> Start:
        """Return the start for `reset(options={"start": ...})` of an environment. Raises UserError: unknown effect."""
        from vispeg.task.start import Start
        from vispeg.worlds.model_file import read_placed

        s = self.start
        effects = None
        if s.effects is not None:
            effects = tuple(read_placed(e, Path(FILE), f"start.effects[{i}]") for i, e in enumerate(s.effects))
        goal, believed = (None if v is None else np.array(v) for v in (s.goal_m, s.believed_m))
        return Start(np.array(s.q_rad), goal, believed, effects)

    def again(self) -> Start:
        """Return the start for a replay in another world: its seed draws the effects.

        If nobody measured the goal, it is where the policy believed it, or, for a policy that is not told the goal,
        where the seed draws it.

        Raises:
            UserError: unknown effect or modality.
        """
        from vispeg.learn.modalities import modality

        begun, name = replace(self.begin(), effects=None), self.policy.modality
        told = name != "" and modality(name).obs_mode in GOAL_TOLD
        return replace(begun, goal=begun.believed) if told and begun.goal is None else begun


@dataclass(frozen=True, eq=False)
class Steps:
    """The policy's observations and actions.

    Attributes:
        time: (n,) time of each observation on the recording's clock, s.
        late: (n,) delay of each command after its due time, s.
        seen: (n, d) the part `policy` of the observations; pictures are the recording's frames at these times.
        action: (n, k) actions.
        target: (n, 7) commanded flange poses, m and quaternion w x y z.
    """

    time: np.ndarray
    late: np.ndarray
    seen: np.ndarray
    action: np.ndarray
    target: np.ndarray


@dataclass(frozen=True, eq=False)
class Trial:
    """One trial.

    Attributes:
        said: content of trial.yaml.
        recording: joints, wrench and pictures.
        steps: the policy's observations and actions.
        path: the trial's folder; None if it was not read from one.
    """

    said: Said
    recording: Recording
    steps: Steps
    path: Path | None = field(default=None)


def write_trial(trial: Trial, folder: str | Path, overwrite: bool = False) -> Path:
    """Write a trial's folder, a recording with two additional files; it appears completely or not at all.

    Raises:
        UserError: the folder exists, or cannot be written.
    """
    target, steps = Path(folder), trial.steps
    outcome = trial.said.outcome
    ended = Outcome(outcome.success, 0, outcome.category, outcome.peak_force_n, outcome.depth_m)
    data = {"format": NAME, **trial.said.model_dump(exclude_none=True)}
    columns = {"time": steps.time, "late": steps.late}
    columns |= {f"seen.{i}": column for i, column in enumerate(steps.seen.T)}
    columns |= {f"action.{i}": column for i, column in enumerate(steps.action.T)}
    columns |= dict(zip((f"target.{axis}" for axis in POSE), steps.target.T, strict=True))
    with new_folder(target, overwrite, holds="recording") as part:
        fill(part, replace(trial.recording, outcomes=(ended,)), target)
        write_csv(part / STEPS, columns)
        text = yaml.safe_dump(data, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
        (part / FILE).write_text(text, encoding="utf-8")
    return target


def _example(folder: Path) -> Path:
    time = np.arange(40) / 200.0
    q = 0.1 * np.sin(time)[:, None] * np.ones(7)
    rec = Recording(folder, "iiwa14", tuple("abcdefg"), 200.0, Control(), time, q, ft=np.ones((40, 6)))
    pose = np.tile([0.5, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0], (2, 1))
    steps = Steps(time[[0, 32]], np.array([0.001, 0.002]), np.ones((2, 4)), np.zeros((2, 3)), pose)
    delay = {"effect": "command_delay", "where": "all", "params": {"delay": 0.01}}
    start = StartPart(q_rad=q[0].tolist(), goal_m=[0.6, 0.0, 0.05], believed_m=[0.6, 0.0, 0.05], effects=[delay])
    outcome = OutcomePart(success=False, category="jam", by="person", time_s=0.2, peak_force_n=12.0)
    said = Said(
        policy=PolicyPart(name="a", digest="0" * 64), robot="mine", task="mine", seed=3, start=start, outcome=outcome
    )
    return write_trial(Trial(said, rec, steps), folder / "trial-0001")


def is_trial(folder: str | Path) -> bool:
    """Return whether a folder is that of a trial."""
    return (Path(folder) / FILE).is_file()


def folders(place: str | Path) -> list[Path]:
    """Return the folders of the trials in a folder, sorted by name; the folder itself if it is a trial.

    Raises:
        UserError: there are none.
    """
    place = Path(place)
    found = [place] if is_trial(place) else []
    if not found and place.is_dir():
        found = sorted(p for p in place.glob("*") if is_trial(p))
    if not found:
        raise UserError("holds no trials", file=place, expected=f"folders with {FILE}")
    return found


def read_said(folder: str | Path) -> Said:
    """Read a trial's trial.yaml.

    Raises:
        UserError: no such file, a missing or unknown key, an impossible value, or a contradictory outcome.
    """
    file = Path(folder) / FILE
    said = typed(Said, TRIAL.read(file), file)
    if said.outcome.success != (said.outcome.category == "success"):
        got = f"{said.outcome.success}, {said.outcome.category}"
        raise UserError("success and category contradict each other", file=file, key="outcome", got=got)
    return said


@enrol(NAME, _example)
def read_trial(folder: str | Path) -> Trial:
    """Read a trial. Raises UserError: as `read_said`, an invalid recording or table, or a table that was cut off."""
    path = Path(folder)
    said = read_said(path)
    steps, stated = _steps(path / STEPS), said.timing.steps  # 0 where another program does not state it
    if stated and stated != len(steps.time):
        expected = f"{count(stated, 'row')} by timing.steps of {FILE}"
        raise UserError(
            "has the wrong number of rows (cut off?)", file=path / STEPS, expected=expected, got=len(steps.time)
        )
    return Trial(said, load(path), steps, path)


def _steps(file: Path) -> Steps:
    table = read_table(file)

    def block(name: str, labels: Sequence[str] | None = None) -> np.ndarray:
        """Return the columns NAME.LABEL side by side (n, k); without labels all columns NAME.*, in the file's order."""
        if labels is None:
            names = [n for n in table.names if n.startswith(f"{name}.")]
        else:
            names = [f"{name}.{label}" for label in labels]
        if not names:
            raise UserError("columns are missing", file=file, expected=f"{name}.0, ..")
        return np.stack([_number(table, n) for n in names], axis=1)

    time, late = _number(table, "time"), _number(table, "late")
    return Steps(time, late, block("seen"), block("action"), block("target", POSE))


def _number(table: Any, name: str) -> np.ndarray:
    values = table.number(name)
    if not np.isfinite(values).all():
        row = int(np.flatnonzero(~np.isfinite(values))[0])
        raise UserError("is not a finite number", file=table.file, key=f"{table.row(row)}, column {name}")
    return values
