"""Records a simulated robot: runs a model through a motion and writes a recording folder with sensor noise.

MOTION is fourier, chirp, triangle, steps, sweep, mix, osc, or a CSV with time, q_cmd.* and (optional) dq_cmd.*, such as
the next_experiment/samples.csv that `vispeg diagnose` writes. `--effects` hides more than the model file says. A named
motion is made smaller where a joint would pass its speed limit, and that is said; a CSV is replayed as it stands.
In a cell (MODEL is peg-cell, a world, or a model with `cell`) MOTION may also be free, press, slide, insert, rock, tap,
insert-turned, hard-press, touch-datum, mix, expert (a whole insertion by the scripted policy) or a CSV with time and
ee_cmd.*: the tool touches, the wrench is recorded, the task's own controller runs; with `--cameras` pictures are taken.
Or it is look, look-tilt, look-roll, look-approach, look-sideways or look-fast: cameras take pictures, nothing touches.
look-and-insert is both.

Example:
    vispeg record iiwa14 --motion fourier --effects coulomb_friction:joint4:torque=1.2 --seed 1 --out rig-a
    vispeg record peg-cell --motion slide --effects contact_friction:peg:scale=1.7 --noise ft=0.1 --out slide-a
    vispeg record peg-cell --motion look --cameras wrist_wide --effects camera_offset:wrist_wide:x=0.004 --out look-a
    vispeg record model.yaml --motion found/next_experiment/samples.csv --out rig-d
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro

from vispeg.cli.output import Output, Told


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg record`."""

    model: tyro.conf.Positional[str]
    """A model file, a robot's name, or a path to an MJCF or URDF: a world for a cell."""
    motion: str
    """Name of a motion, or a CSV file with the commands."""
    out: Path
    """Folder of the recording."""
    duration: float | None = None
    """Seconds; 5 (osc: 9, look: 16) where not given. A CSV file has its own."""
    rate: float = 500.0
    """Control ticks and samples a second."""
    control: Literal["position", "torque", "osc", "servo"] | None = None
    """The controller that runs; position where not given, osc for the motion osc. servo: goals alone are sent."""
    kp: tuple[float, ...] | None = None
    """Stiffness: one a joint (N m/rad), or six for osc (1/s^2)."""
    kd: tuple[float, ...] | None = None
    """Damping: one a joint (N m s/rad), or six for osc (1/s)."""
    effects: tuple[str, ...] = ()
    """Effects hidden in the robot, each NAME:WHERE[:param=number,...]."""
    tool: str | None = None
    """A tool at the flange that the recording declares (none, meg50, meg50+peg40); the model file's where not given."""
    noise: tuple[str, ...] = ()
    """Sensor noise, such as q=2e-5 dq=1e-3 tau=0.2 ee=1e-4 ft=0.1 ft_torque=0.005 (1 sigma, SI)."""
    force_limit: float | None = None
    """In a cell: greatest force that the controller asks for, N; the task's or the motion's where not given."""
    torque_sensor: Literal["joint", "motor", "none"] = "joint"
    """What `tau` measures: torque behind the gear, motor torque, nothing."""
    repeat: int = 1
    """Runs of the same motion; more than one become episodes of the recording."""
    table: Literal["csv", "parquet"] = "csv"
    """Format of the samples."""
    cameras: tuple[str, ...] = ()
    """In a cell: wrist_wide, wrist_crop, external, or camera files; a look has wrist_wide where none is given."""
    size: str = "320x240"
    """Pictures: width and height of the cell's cameras, px."""
    fps: float = 3.0
    """Pictures: pictures a second of each camera."""
    look: str | None = None
    """Pictures: how the cell looks, WORLD/SEED as in S/3: what that world draws; the plain cell where not given."""
    renderer: Literal["auto", "classic", "raycast", "filament"] = "auto"
    """Pictures: what draws the pictures."""
    seed: int = 0
    """Seed of the motion and of the noise."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: Told = Output()

    def run(self) -> int:
        """Simulates, writes the folder, prints what is in it."""
        from vispeg.api.record_cell import MOTIONS as CELL_MOTIONS
        from vispeg.core.errors import UserError
        from vispeg.core.seeds import stream
        from vispeg.identify.motions.rehearse import rehearsed
        from vispeg.identify.record import centre_of, controller, record
        from vispeg.recordings.write import write
        from vispeg.robots.model import load
        from vispeg.task.belief import of_world
        from vispeg.task.world_file import is_world
        from vispeg.worlds.model_file import load_model
        from vispeg.worlds.words import parse

        if self.repeat < 1:
            raise UserError("nothing to record", key="--repeat", expected="1 or more", got=self.repeat)
        if self.out.exists() and not self.overwrite and (not self.out.is_dir() or any(self.out.iterdir())):
            raise UserError("exists already; name another or pass --overwrite", file=self.out)
        if self.motion.startswith("look") and not Path(self.motion).suffix and self.motion not in CELL_MOTIONS:
            from vispeg.cli.recordings.record_look import run

            return run(self)
        world = of_world(self.model) if is_world(self.model) else load_model(self.model)
        if world.cell is not None and (self.motion in CELL_MOTIONS or not self._of_joints()):
            from vispeg.cli.recordings.record_cell import run

            return run(self, world)
        world = world if self.tool is None else replace(world, tool=None if self.tool == "none" else self.tool)
        robot = load(world.robot, tool=world.tool)
        world = world.add(*(placed for text in self.effects for placed in parse(text, robot)))
        mode = self.control or ("osc" if self.motion == "osc" else "position")
        motion = self._motion(robot)
        gains = (None if g is None else list(g) for g in (self.kp, self.kd))
        control = controller(robot, mode, self.rate, centre_of(robot), *gains)  # type: ignore[arg-type]
        motion, share = rehearsed(world, motion, control) if not Path(self.motion).suffix else (motion, None)
        rng = stream(self.seed, "record", "noise")
        sensor, name = self.torque_sensor, self.out.name
        rec = record(world, motion, control, self.sigmas(), rng, torque_sensor=sensor, repeat=self.repeat, name=name)
        inputs = (self.model, world.robot, self.motion)
        write(rec, self.out, overwrite=self.overwrite, table=self.table, inputs=inputs)
        runs = f"{self.repeat} runs of " if self.repeat > 1 else ""
        how = f"{runs}{motion.name}, {motion.time[-1]:.3g} s at {self.rate:g} Hz, {mode} control"
        values = {"samples": len(rec.time), "rate_hz": self.rate, "control": mode, "motion": motion.name}
        values |= {"recording": str(self.out), "robot": world.label, "repeat": self.repeat}
        shares = zip(robot.joints, [] if share is None else share, strict=False)
        less = {joint: round(float(s), 3) for joint, s in shares if s < 1}
        said = ", ".join(f"{joint} {100 * s:.0f} %" for joint, s in less.items())
        lines = [f"{self.out}: {how}, {world.label}"]
        lines += (
            [f"made smaller, so that no joint passes its speed limit: {said} of the motion"]
            if less and not self.output.quiet
            else []
        )
        self.output.give(values | ({"scaled": less} if less else {}), lines)
        return 0

    def _of_joints(self) -> bool:
        """Whether MOTION moves an arm alone: by name, or a table without flange poses."""
        from vispeg.identify.excitation import MOTIONS
        from vispeg.recordings.columns import columns_of
        from vispeg.recordings.tables.table import read_table

        path = Path(self.motion)
        if not path.suffix:
            return self.motion in MOTIONS or self.motion == "osc"
        return path.is_file() and columns_of("ee_cmd", ())[0] not in read_table(path).names

    def _motion(self, robot):
        from vispeg.core.seeds import stream
        from vispeg.identify.excitation import motion
        from vispeg.identify.motions.replay import replay
        from vispeg.sim.compiled import compiled

        if Path(self.motion).suffix:
            return replay(Path(self.motion), robot, self.rate)
        seconds = self.duration or (9.0 if self.motion == "osc" else 5.0)
        options = {"model": compiled(robot)} if self.motion == "osc" else {}
        return motion(self.motion, robot, self.rate, seconds, stream(self.seed, "record", self.motion), **options)

    def sigmas(self) -> dict[str, float]:
        """Sensor noise by signal. Raises UserError: an unknown signal, or no level."""
        from vispeg.core.errors import UserError
        from vispeg.task.peg.rig.record import NOISE

        out = dict(NOISE)
        for text in self.noise:
            name, _, number = text.partition("=")
            if name not in NOISE:
                raise UserError("unknown noise", key="--noise", got=name, choices=NOISE)
            try:
                out[name] = float(number)
            except ValueError:
                out[name] = -1.0
            if not 0 <= out[name] < float("inf"):
                raise UserError("not a noise level", key=f"--noise {name}", expected="a number, 0 or more", got=number)
        return out
