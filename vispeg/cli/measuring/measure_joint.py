"""`vispeg measure plan | joint`: the motions to run on one joint, and what its recordings show."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from vispeg.cli.measuring.measure_stop import Asked, Stop
from vispeg.cli.output import Output, OutputOptions

if TYPE_CHECKING:
    from vispeg.measure.trace import Trace


@dataclass(frozen=True, kw_only=True)
class Plan:
    """Writes the motions for `measure joint`, ready to replay, and the order in which to run them (ORDER.md).

    Steps of three sizes both ways, sines of two amplitudes, triangles, a ladder of speeds; the first comes again at the
    end. `vispeg record ROBOT --motion PLAN/01-..csv` runs them on a simulated robot.

    Example: vispeg measure plan joint4 --robot iiwa14 --out plan
    """

    joint: tyro.conf.Positional[str]
    """The joint to measure."""
    out: Path
    """Folder of the motions."""
    robot: str = "iiwa14"
    """A robot's name, a model file, or a path to an MJCF or URDF."""
    posture: tuple[float, ...] = ()
    """Angles of all joints, rad; the usual centre where not given. Backlash shows where gravity does not load it."""
    size: float = 0.1
    """The greatest step, rad."""
    rate: float = 500.0
    """Samples a second; `vispeg record` and your robot should run at the same."""
    seed: int = 0
    """Seed of the order."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Writes the folder and prints the order."""
        import numpy as np

        from vispeg.api.inputs import read_model
        from vispeg.core.errors import UserError
        from vispeg.core.files import new_folder
        from vispeg.core.seeds import stream
        from vispeg.identify.record import centre_of
        from vispeg.measure.plan import plan, table
        from vispeg.robots.model import load

        world = read_model(self.robot)
        robot = load(world.robot, tool=world.tool)
        posture = np.array(self.posture) if self.posture else centre_of(robot)
        inside = (
            len(posture) == len(robot.joints)
            and ((posture >= robot.range[:, 0]) & (posture <= robot.range[:, 1])).all()
        )
        if not inside:
            expected = f"{len(robot.joints)} angles in the joints' ranges"
            raise UserError("not a posture", key="--posture", expected=expected, got=posture.tolist())
        if not 20 <= self.rate <= 5000:
            raise UserError("not a rate", key="--rate", expected="20 to 5000 Hz", got=self.rate)
        rng = stream(self.seed, "measure", "plan")
        middle = float(posture[robot.joints.index(self.joint)]) if self.joint in robot.joints else 0.0
        parts = plan(robot, self.joint, middle, self.size, self.rate, rng)
        names = [f"{k:02d}-{part.name}.csv" for k, part in enumerate(parts, 1)]
        lines = [f"{name}: {part.shows}, {part.time[-1]:.0f} s" for name, part in zip(names, parts, strict=True)]
        with new_folder(self.out, self.overwrite, holds="plan") as folder:
            for name, part in zip(names, parts, strict=True):
                (folder / name).write_text(table(part, robot.joints, posture, self.joint), encoding="utf-8")
            (folder / "ORDER.md").write_text(self._order(lines, names), encoding="utf-8")
        rows = [{"file": n, "shows": p.shows, "seconds": p.time[-1]} for n, p in zip(names, parts, strict=True)]
        minutes = sum(p.time[-1] for p in parts) / 60
        last = f"{self.out}: {len(parts)} motions, {minutes:.0f} minutes; see ORDER.md"
        self.output.give({"out": str(self.out), "joint": self.joint, "motions": rows}, [*lines, last])
        return 0

    def _order(self, lines: list[str], names: list[str]) -> str:
        runs = " ".join(Path(name).stem for name in names)
        listed = "\n".join(f"{k}. {line}" for k, line in enumerate(lines, 1))
        return (
            f"# {self.joint}: what to run, in this order\n\n{listed}\n\n"
            "Warm the joint up first, as it is in use. Before each motion drive slowly to its first command.\n"
            "Only the commanded angle moves the joint (`dq_cmd` is 0): a speed that is fed forward hides the servo.\n"
            "Log command, angle and the motor's torque (or current). Stop if the joint gets hot or noisy.\n"
            "Backlash shows only where gravity does not load the joint; friction shows everywhere.\n\n"
            "On a simulated robot:\n\n"
            f"    for m in {self.out}/*.csv; do\n"
            f"      vispeg record {self.robot} --motion $m --rate {self.rate:g} --torque-sensor motor "
            "--out runs/$(basename $m .csv)\n"
            "    done\n"
            f"    vispeg measure joint runs/* --joint {self.joint} --out {self.joint}\n\n"
            f"The recordings: {runs}.\n"
        )


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Measures a joint's servo, frequency response, friction and backlash from recordings of commanded motions.

    Uses steps, sines of three periods or more, sweeps, and ramps out and back, where it finds them. Writes
    OUT/measurement.yaml, OUT/actuator.xml (MuJoCo) and OUT/joint.png.

    Example: vispeg measure joint runs/* --joint joint4 --out joint4
    Example: vispeg measure joint log.csv.gz --columns time=t_s q_cmd=goal q=angle --joint elbow --out elbow
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or tables whose columns --columns names."""
    out: Path
    """Folder of the results."""
    joint: str | None = None
    """The joint. Not given, the one that moves most in the recordings."""
    columns: tuple[str, ...] = ()
    """For tables: time=COLUMN q_cmd=COLUMN q=COLUMN and, where there is one, tau=COLUMN (s, rad, N m)."""
    inertia: float | None = None
    """Inertia that the joint turns, kg m2, for the actuator. Not given, that of the robot's model, or 1."""
    conditions: tuple[str, ...] = ()
    """Conditions to note in the file, such as temperature=21."""
    seed: int = 0
    """Seed of the Monte Carlo propagation."""
    overwrite: bool = False
    """Replace OUT if it is there."""
    stop: Asked = Stop()
    output: OutputOptions = Output()

    def run(self) -> int:
        """Measures, writes the folder, prints the numbers."""
        from vispeg.api.playing import check_numbers
        from vispeg.cli.measuring.measure_write import complete, conditions, tell
        from vispeg.core.errors import UserError
        from vispeg.core.files import new_folder
        from vispeg.core.seeds import stream
        from vispeg.measure import joint as joints
        from vispeg.measure.actuator import parameters, text
        from vispeg.report.drawings.measured_joint import picture
        from vispeg.worlds.measurement_file import Measurement, measurement_text

        if self.inertia is not None and not 0 < self.inertia < float("inf"):
            raise UserError("not an inertia", key="--inertia", expected="above 0 kg m2", got=self.inertia)
        stated = conditions(self.conditions)
        check_numbers(self.stop.episodes, self.stop.workers)
        with new_folder(self.out, self.overwrite, holds="measurement", inputs=self.recordings) as folder:
            traces, name, robot = self._traces()
            measured = joints.measure(traces, stream(self.seed, "measure", "joint"))
            details, notes = dict(measured.details), list(measured.notes)
            if measured.servo is not None:
                inertia, why = self._inertia(name, robot)
                notes += [why] if why else []
                details["actuator"] = {"inertia_kgm2": inertia, **parameters(measured.servo, inertia)}
                source = f"from {len(traces)} motions by `vispeg measure joint`"
                (folder / "actuator.xml").write_text(text(measured.servo, name, inertia, source), encoding="utf-8")
            (folder / "joint.png").write_bytes(picture(name, measured))
            effects = tuple(joints.effects(name, measured))
            of_robot = robot if effects else None
            full = Measurement(
                "joint", name, tuple(measured.results), effects, of_robot, stated, {}, tuple(notes), details
            )
            full = complete(full, self.recordings, self.seed)
            (folder / "measurement.yaml").write_text(measurement_text(full), encoding="utf-8")
        said = f"{self.out}: measurement.yaml, joint.png" + (", actuator.xml" if measured.servo else "")
        tell(full, self.out / "measurement.yaml", self.stop, self.output, said, budget=False)
        return 0

    def _traces(self) -> tuple[list[Trace], str, str | None]:
        """The joint's traces, its name, and the robot where one is named."""
        from vispeg.core.errors import UserError
        from vispeg.measure.trace import from_recording, from_table

        twice = [p for p in self.recordings if [q.resolve() for q in self.recordings].count(p.resolve()) > 1]
        if not self.recordings or twice:
            raise UserError("given twice" if twice else "no recording given", file=twice[0] if twice else None)
        if all(path.is_dir() for path in self.recordings):
            traces, joint, robots = [], self.joint, []
            for path in self.recordings:
                some, joint, robot = from_recording(path, joint)
                traces += some
                robots.append(robot)
            if len(set(robots)) > 1:
                raise UserError("recordings of several robots", got=", ".join(sorted(set(robots))))
            return traces, str(joint), robots[0]
        names = {name: column for name, _, column in (text.partition("=") for text in self.columns)}
        if not names:
            raise UserError(
                "a table needs its columns named", key="--columns", expected="time=.. q_cmd=.. q=.. [tau=..]"
            )
        return [from_table(path, names) for path in self.recordings], self.joint or "joint", None

    def _inertia(self, joint: str, robot: str | None) -> tuple[float, str]:
        """The inertia in kg m^2, and a note where nothing is known of it."""
        import numpy as np

        from vispeg.core.errors import UserError
        from vispeg.measure.actuator import inertia
        from vispeg.recordings.load import load as load_recording
        from vispeg.robots.model import load

        if self.inertia is not None:
            return self.inertia, ""
        if robot is not None:
            try:
                rec = load_recording(self.recordings[0])
                model = load(robot, tool=rec.tool)
                return inertia(model, joint, np.nanmedian(rec.q, axis=0)), ""
            except UserError as error:
                return 1.0, f"the actuator is for an inertia of 1 kg m2: {error}"
        return 1.0, "the actuator is for an inertia of 1 kg m2: scale it, or state --inertia"
