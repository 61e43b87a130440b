"""`vispeg measure plan | joint`: the motions to run on one joint, and what its recordings show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from vispeg.cli.measuring.measuring import Measuring, stated
from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Writes the motions for `measure joint`, ready to replay, and the order in which to run them (ORDER.md).

    Steps of three sizes both ways, sines of two amplitudes, triangles, a ladder of speeds; the first is repeated at the
    end. `vispeg record ROBOT --motion PLAN/01-..csv` runs them on a simulated robot.

    Example:
        vispeg measure plan joint4 --robot iiwa14 --out plan
    """

    joint: tyro.conf.Positional[str]
    """The joint to measure."""
    out: Path
    """Folder of the motions."""
    robot: str = "iiwa14"
    """A robot's name, a model file, or a path to an MJCF or URDF."""
    posture: tuple[float, ...] = ()
    """Angles of all joints, rad; default: the middle posture. Backlash shows only where gravity does not load it."""
    size: float = 0.1
    """Largest step, rad."""
    rate: float = 500.0
    """Sample rate, Hz; the same as of `vispeg record` or your robot."""
    seed: int = 0
    """Seed of the order of motions."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Write the folder and print the order."""
        from vispeg.api.measure.plan import plan_joint

        result = plan_joint(
            self.joint,
            self.out,
            robot=self.robot,
            posture=self.posture,
            size=self.size,
            rate_hz=self.rate,
            seed=self.seed,
            overwrite=self.overwrite,
        )
        self.output.give(result.record, result.summary)
        return 0


@dataclass(frozen=True, kw_only=True)
class Joint(Measuring):
    """Measures a joint's servo, frequency response, friction and backlash from recordings of commanded motions.

    Uses steps, sines of three periods or more, sweeps, and ramps out and back, where it finds them. Writes
    OUT/measurement.yaml, OUT/actuator.xml (MuJoCo) and OUT/joint.png.

    Example:
        vispeg measure joint runs/* --joint joint4 --out joint4
        vispeg measure joint log.csv.gz --columns time=t_s q_cmd=goal q=angle --joint elbow --out elbow
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or tables whose columns --columns names."""
    out: Path
    """Folder of the results."""
    joint: str | None = None
    """The joint; default: the one that moves most in the recordings."""
    columns: tuple[str, ...] = ()
    """Tables: time=COLUMN q_cmd=COLUMN q=COLUMN, optionally tau=COLUMN (s, rad, N m)."""
    inertia: float | None = None
    """Inertia that the joint turns, kg m2, for the actuator; default: of the robot's model, or 1."""

    def run(self) -> int:
        """Measures, writes the folder, prints the numbers."""
        from vispeg.api.measure.joint import measure_joint

        settings = self.settings()
        pairs = stated(self.columns, "--columns", "NAME=COLUMN")
        result = measure_joint(
            self.recordings,
            self.out,
            joint=self.joint,
            columns=pairs,
            inertia=self.inertia,
            settings=settings,
        )
        return self.tell(result)
