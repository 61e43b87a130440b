"""Records a simulated robot with sensor noise.

Writes a recording folder. MOTION is a name (`vispeg motions` lists them) or a CSV with time, q_cmd.* and optionally
dq_cmd.*, such as the next_experiment/samples.csv of `vispeg diagnose`. `--effects` adds effects to those of the model
file. A named motion is scaled down, with a note, if a joint would exceed its speed limit; a CSV is replayed unchanged.

In a cell (MODEL is {cell}, a world, or a model with `cell`) MOTION may also be a motion in contact, a look, `expert`
(the scripted policy), or a CSV with time and ee_cmd.*. The task's controller runs and the wrench is recorded.
`--cameras` adds pictures, also of a robot whose own MJCF shows more than the arm.

Example:
    vispeg record iiwa14 --motion fourier --effects coulomb_friction:joint4:torque=1.2 --seed 1 --out rig-a
    vispeg record {cell} --motion slide --effects contact_friction:{held}:scale=1.7 --noise ft=0.1 --out slide-a
    vispeg record {cell} --motion look --cameras wrist_wide --effects camera_offset:wrist_wide:x=0.004 --out look-a
    vispeg record model.yaml --motion found/next_experiment/samples.csv --out rig-d
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, OutputOptions
from vispeg.core.errors import UserError


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg record`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF; for a cell a world."""
    motion: str
    """Name of a motion, or a CSV file with the commands."""
    out: Path
    """Folder of the recording."""
    duration: float | None = None
    """Seconds; default: 5 (osc: 9, look: 16). A CSV has its own."""
    rate: float = 500.0
    """Control and sample rate, Hz."""
    control: Literal["position", "torque", "osc", "servo"] | None = None
    """The controller; default: position, or osc for the motion osc. servo: only goals are sent."""
    kp: tuple[float, ...] | None = None
    """Stiffness: one a joint (N m/rad), or six for osc (1/s^2)."""
    kd: tuple[float, ...] | None = None
    """Damping: one a joint (N m s/rad), or six for osc (1/s)."""
    effects: tuple[str, ...] = ()
    """Effects hidden in the robot, each EFFECT:WHERE[:param=number,...]."""
    tool: str | None = None
    """A tool at the flange that the recording declares, such as none or meg50; default: the model file's."""
    noise: tuple[str, ...] = ()
    """Sensor noise, such as q=2e-5 dq=1e-3 tau=0.2 ee=1e-4 ft=0.1 ft_torque=0.005 (1 sigma, SI)."""
    force_limit: float | None = None
    """In a cell: greatest force that the controller commands, N; default: the task's or the motion's."""
    torque_sensor: Literal["joint", "motor", "none"] = "joint"
    """What `tau` measures: torque behind the gear, motor torque, nothing."""
    wrench_sensor: Literal["flange", "none"] = "flange"
    """In a cell: record the wrench at the flange, or none; contact is then estimated from `tau`."""
    repeat: int = 1
    """Runs of the same motion, each an episode of the recording."""
    table: Literal["csv", "parquet"] = "csv"
    """Format of the samples."""
    cameras: tuple[str, ...] = ()
    """Cameras of the cell (wrist_wide, wrist_crop, external) or of the robot's own MJCF, or camera files; default for a
    look in a cell: wrist_wide."""
    size: str = "320x240"
    """Pictures: width and height of the cell's cameras, px."""
    fps: float = 3.0
    """Pictures: frame rate of each camera, Hz."""
    look: str | None = None
    """Pictures: look of the cell, WORLD/SEED, such as S/3: drawn by that world for that seed; default: plain."""
    renderer: Literal["auto", "classic", "raycast", "filament"] = "auto"
    """Pictures: the renderer."""
    seed: int = 0
    """Seed of the motion and of the noise."""
    overwrite: bool = False
    """Replace OUT if it exists."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Simulate, write the folder, print what is in it."""
        from vispeg.api.recording.record import record
        from vispeg.cli.reading import progress_bar
        from vispeg.core.files import refuse

        refuse(self.out, self.overwrite, holds="recording", inputs=(self.model,))
        simulated = record(
            self.model,
            self.motion,
            duration=self.duration,
            rate_hz=self.rate,
            control=self.control,
            kp=self.kp,
            kd=self.kd,
            effects=self.effects,
            tool=self.tool,
            noise=dict(map(_level, self.noise)),
            force_limit=self.force_limit,
            torque_sensor=self.torque_sensor,
            wrench_sensor=self.wrench_sensor,
            repeat=self.repeat,
            cameras=[name for text in self.cameras for name in text.split(",") if name],
            size=_size(self.size),
            fps=self.fps,
            look=self.look,
            backend=self.renderer,
            seed=self.seed,
            name=self.out.name,
            table=self.table,
            watch=lambda: progress_bar("taking pictures", quiet=self.output.quiet),
        )
        simulated.save(self.out, overwrite=self.overwrite)
        self.output.give(
            {"recording": str(self.out), **simulated.record}, [*simulated.summary, f"recording: {self.out}"]
        )
        return 0


def _level(text: str) -> tuple[str, float]:
    """Signal and 1-sigma of `q=2e-5`. Raises UserError for no number."""
    name, _, number = text.partition("=")
    try:
        return name, float(number)
    except ValueError as error:
        key = f"--noise {name}"
        raise UserError("not a noise level", key=key, expected="a number, 0 or more", got=number) from error


def _size(text: str) -> tuple[int, int]:
    """Width and height in px of `320x240`; (0, 0) where it is none."""
    width, _, height = text.partition("x")
    return (int(width), int(height)) if (width + height).isdecimal() and width and height else (0, 0)
