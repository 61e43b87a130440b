"""Write a motion as a file that a robot can replay, as `vispeg motions NAME --out` does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vispeg.api.inputs import read_model
from vispeg.api.recording.cell import cell_motion, motions_of
from vispeg.api.recording.look import LOOK_S, scene_of
from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.core.paths import expanded
from vispeg.core.seeds import stream
from vispeg.identify.excitation import MOTIONS as JOINT
from vispeg.identify.excitation import motion as excitation
from vispeg.identify.motions.look_motion import LOOKS, look_motion
from vispeg.recordings.cell import OPEN_CELL
from vispeg.recordings.columns import columns_of
from vispeg.report.text.summary import Line, html
from vispeg.robots.model import load
from vispeg.task.belief import model_cell
from vispeg.task.rig import table
from vispeg.task.rig.commanded import CellMotion
from vispeg.task.rig.expert import EXPERT

JOINT_S = 5.0  # s, default duration of joint motions
COLUMNS = ("q_cmd", "dq_cmd", "ee_cmd", "kp", "force_limit", "q_null")  # columns of a motion file besides `time`


@dataclass(frozen=True)
class MotionFile:
    """A motion in a CSV: `time` with `q_cmd.*` and `dq_cmd.*` of the joints, or `ee_cmd.*` of the flange and gains.

    Attributes:
        motion: name of the motion.
        model: the robot or cell that moves.
        seconds: duration, s.
        rate_hz: rate of commands, Hz.
        path: the file.
        kp: gains of the intended controller for translation and rotation, 1/s^2; None for a motion of joints.
        force_limit: force limit of that controller, N.
    """

    motion: str
    model: str
    seconds: float
    rate_hz: float
    path: Path
    kp: tuple[float, float] | None = None
    force_limit: float | None = None

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg motions NAME --json`."""
        sizes: dict[str, object] = {"seconds": self.seconds, "rate_hz": self.rate_hz, "out": str(self.path)}
        if self.kp is not None:
            sizes |= {"kp": list(self.kp), "force_limit": self.force_limit}
        return {"motion": self.motion, "model": self.model, **sizes}

    def __str__(self) -> str:
        text = f"{self.path}: {self.motion}, {self.seconds:.3g} s at {self.rate_hz:g} Hz"
        if self.kp is None:
            return text
        gains = f"kp {self.kp[0]:g} (translation) and {self.kp[1]:g} 1/s^2 (rotation)"
        return f"{text}; for a controller with {gains}, critically damped, that may ask for {self.force_limit:.3g} N"

    def _repr_html_(self) -> str:
        return html([Line(str(self), path=True)])


def names(space: str | None = None, model: str | None = None) -> list[str]:
    """Return the names of motions for a model, all or those of one `space`.

    The spaces are `joint`, `contact`, and `cell`: the motions for cameras.
    """
    world = None if model is None else read_model(model)
    contact = [name for name in motions_of(world) if name != EXPERT]  # this one is a policy, not a path
    spaces = {"joint": [*JOINT], "contact": contact, "cell": [*LOOKS]}
    found = [name for key, group in spaces.items() if space in (None, key) for name in group]
    return [*dict.fromkeys(found)]  # `mix` is a motion of joints and one in contact


def write_motion(
    name: str,
    out: str | Path | None,
    *,
    model: str | None = None,
    duration: float | None = None,
    rate_hz: float = 500.0,
    seed: int = 0,
    overwrite: bool = False,
) -> MotionFile:
    """Write the commands of a motion.

    Args:
        name: the motion to write.
        out: the CSV to write.
        model: the robot; default: the default cell for motions in contact and for cameras, else iiwa14.
        duration: length, s; default: 5 for a joint motion, 16 for a motion for cameras. Motions in contact have a fixed
            length.
        rate_hz: rate of commands, Hz.
        seed: seed of the motion.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such motion or model, a motion that the arm cannot make, or `out` cannot be written.
    """
    choices = names(model=model)
    if name not in choices:
        raise UserError("unknown motion", key="name", got=name, choices=choices)
    if out is None or expanded(out).suffix != ".csv":
        raise UserError("no file to write to", key="--out", expected="a .csv file", got=out)
    path = expanded(out)
    if overwrite and path.exists():
        _refuse_other(path)
    model = model or (OPEN_CELL if name in (*names("contact"), *names("cell")) else "iiwa14")
    text, seconds, in_cell = _commands(model, name, rate_hz=rate_hz, seed=seed, duration=duration)
    write_text_atomic(path, text, overwrite=overwrite)
    controller = (None, None) if in_cell is None else (in_cell.stiffness, in_cell.force_limit)
    return MotionFile(name, model, seconds, rate_hz, path, *controller)


def _commands(
    model: str, name: str, *, rate_hz: float, seed: int, duration: float | None
) -> tuple[str, float, CellMotion | None]:
    """Return a motion as a CSV that a robot can replay.

    Args:
        model: the model of the robot or cell.
        name: one of `names(model=model)`.
        rate_hz: rate of commands, Hz.
        seed: seed of the motion.
        duration: duration of a joint motion or a motion for cameras, s.

    Returns:
        The text of the CSV, its duration, s, and for motions in contact the motion with the intended controller.

    Raises:
        UserError: no such motion or model, or one that the arm cannot make.
    """
    world = read_model(model)
    # a name that joint and contact motions share, as `mix`, is the contact motion for a model with a cell
    if name in motions_of(world) and (world.cell is not None or name not in JOINT):
        commanded, cell = cell_motion(world, name, rate_hz=rate_hz, seed=seed), model_cell(world)
        stiffness = commanded.stiffness or cell.config.stiffness
        force_limit = commanded.force_limit or cell.config.force_limit
        commanded = replace(commanded, stiffness=stiffness, force_limit=force_limit)
        return table.text(commanded, cell.scene.joints), float(commanded.time[-1]), commanded
    if name in LOOKS:
        scene = scene_of(world)
        joints, moved = scene.joints, look_motion(name, scene, rate_hz, LOOK_S if duration is None else duration)
    else:
        robot = load(world.robot, tool=world.tool)
        joints = robot.joints
        seconds = JOINT_S if duration is None else duration
        moved = excitation(name, robot, rate_hz, seconds, stream(seed, "record", name))
    head = ["time", *columns_of("q_cmd", joints), *columns_of("dq_cmd", joints)]
    rows = np.column_stack([moved.time, moved.q_cmd, moved.dq_cmd])
    lines = [",".join(head), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n", float(moved.time[-1]), None


def _refuse_other(path: Path) -> None:
    """Refuse to replace a file that is not a motion file, such as a log.

    Raises:
        UserError: the first line has other columns than a motion file.
    """
    if not path.is_file():
        raise UserError("not a file", file=path)
    with path.open("rb") as file:
        head = file.readline(100_000).decode("utf-8", "replace").strip().split(",")
    if head[0] != "time" or not all(n.partition(".")[0] in COLUMNS for n in head[1:]):
        raise UserError(
            "is not a motion file, and is not replaced", file=path, expected="time, q_cmd.*, dq_cmd.*, ee_cmd.*"
        )
