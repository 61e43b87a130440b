"""Write the motions that measure a joint into a folder, as `vispeg measure plan` does."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vispeg.api.inputs import read_model
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.core.seeds import stream
from vispeg.identify.record import centre_of
from vispeg.measure.plan import Part, plan, table
from vispeg.report.text.summary import Block, Line, Summarised
from vispeg.robots.model import load


@dataclass(frozen=True)
class MotionPlan(Summarised):
    """Motions for one joint, ready to replay.

    Attributes:
        out: folder of the motions, with ORDER.md.
        joint, robot: the joint and its robot.
        rate_hz: sample rate, Hz.
        parts: the motions, in the order in which to run them.
    """

    out: Path
    joint: str
    robot: str
    rate_hz: float
    parts: Sequence[Part]

    @property
    def names(self) -> list[str]:
        """File names of the motions."""
        return [f"{k:02d}-{part.name}.csv" for k, part in enumerate(self.parts, 1)]

    @property
    def lines(self) -> list[str]:
        """A line on each motion: file, purpose and duration."""
        return [f"{n}: {p.shows}, {p.time[-1]:.0f} s" for n, p in zip(self.names, self.parts, strict=True)]

    @property
    def record(self) -> dict[str, object]:
        """The output of `vispeg measure plan --json`."""
        pairs = zip(self.names, self.parts, strict=True)
        rows = [{"file": name, "shows": part.shows, "seconds": part.time[-1]} for name, part in pairs]
        return {"out": str(self.out), "joint": self.joint, "motions": rows}

    @property
    def summary(self) -> list[Block]:
        """The motions in order, and their total duration."""
        minutes = sum(part.time[-1] for part in self.parts) / 60
        last = f"{self.out}: {len(self.parts)} motions, {minutes:.0f} minutes; see ORDER.md"
        return [Line(text, path=True) for text in (*self.lines, last)]

    @property
    def order(self) -> str:
        """Content of ORDER.md."""
        runs = " ".join(Path(name).stem for name in self.names)
        out, joint, robot = (shlex.quote(str(word)) for word in (self.out, self.joint, self.robot))
        listed = "\n".join(f"{k}. {line}" for k, line in enumerate(self.lines, 1))
        return (
            f"# {self.joint}: what to run, in this order\n\n{listed}\n\n"
            "Warm the joint up first, as it is in use. Before each motion drive slowly to its first command.\n"
            "Only the commanded angle moves the joint (`dq_cmd` is 0): a speed that is fed forward hides the servo.\n"
            "Log command, angle and the motor's torque (or current). Stop if the joint gets hot or noisy.\n"
            "Backlash shows only where gravity does not load the joint; friction shows everywhere.\n\n"
            "On a simulated robot:\n\n"
            f"    for m in {out}/*.csv; do\n"
            f'      vispeg record {robot} --motion "$m" --rate {self.rate_hz:g} --torque-sensor motor '
            '--out "runs/$(basename "$m" .csv)"\n'
            "    done\n"
            f"    vispeg measure joint runs/* --joint {joint} --out {joint}\n\n"
            f"The recordings: {runs}.\n"
        )


def plan_joint(
    joint: str,
    out: str | Path,
    *,
    robot: str = "iiwa14",
    posture: Sequence[float] = (),
    size: float = 0.1,
    rate_hz: float = 500.0,
    seed: int = 0,
    overwrite: bool = False,
) -> MotionPlan:
    """Write the motions that `measure_joint` reads, and the order in which to run them.

    Args:
        joint: the joint to measure.
        out: folder of the motions.
        robot: a robot's name, a model file, or a path to an MJCF or URDF.
        posture: angles of all joints, rad; default: the middle posture. Backlash shows only where gravity does not load
            the joint.
        size: largest step, rad.
        rate_hz: sample rate, Hz, 20 to 5000; use that of `vispeg record` or of your robot.
        seed: seed of the order of the motions.
        overwrite: replace `out` if it exists.

    Raises:
        UserError: no such robot or joint, a posture, step or rate outside its range, or `out` exists.
    """
    world = read_model(robot)
    arm = load(world.robot, tool=world.tool)
    centre = np.array(posture) if posture else centre_of(arm)
    if len(centre) != len(arm.joints) or not ((centre >= arm.range[:, 0]) & (centre <= arm.range[:, 1])).all():
        expected = f"{len(arm.joints)} angles in the joints' ranges"
        raise UserError("not a posture", key="--posture", expected=expected, got=centre.tolist())
    if not 20 <= rate_hz <= 5000:
        raise UserError("not a rate", key="--rate", expected="20 to 5000 Hz", got=rate_hz)
    middle = float(centre[arm.joints.index(joint)]) if joint in arm.joints else 0.0
    parts = plan(arm, joint, middle, size, rate_hz, stream(seed, "measure", "plan"))
    result = MotionPlan(expanded(out), joint, robot, rate_hz, parts)
    with new_folder(out, overwrite, holds="plan") as folder:
        for name, part in zip(result.names, parts, strict=True):
            (folder / name).write_text(table(part, arm.joints, centre, joint), encoding="utf-8")
        (folder / "ORDER.md").write_text(result.order, encoding="utf-8")
    return result
