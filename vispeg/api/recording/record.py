"""Record simulated robots, as `vispeg record` does."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from vispeg.api.inputs import Model, read_model
from vispeg.api.recording.asked import Asked
from vispeg.api.recording.cell import cell_motion, motions_of
from vispeg.api.recording.look import LOOK_S, cameras_of, look_of, refuse_rate, scene_of
from vispeg.api.result import Result
from vispeg.core.counts import count
from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.core.several import several
from vispeg.identify.excitation import MOTIONS, Motion, motion
from vispeg.identify.motions.look_motion import LOOKS, look_motion
from vispeg.identify.motions.rehearse import rehearsed
from vispeg.identify.motions.replay import replay
from vispeg.identify.record import centre_of, controller
from vispeg.identify.record import record as simulate
from vispeg.recordings.cell import CellBelief
from vispeg.recordings.columns import columns_of
from vispeg.recordings.recording import Recording
from vispeg.recordings.tables.read import read_table
from vispeg.recordings.write import write
from vispeg.render.backends.backend import BackendName
from vispeg.render.cameras.camera import Camera
from vispeg.report.text.summary import Block, Line
from vispeg.robots.model import RobotModel, load
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.task.belief import DEFAULT, robot_of_world
from vispeg.task.rig.expert import EXPERT, record_expert
from vispeg.task.rig.record import record_cell
from vispeg.vision.board import board_of
from vispeg.vision.photograph import photograph
from vispeg.worlds.split import of_arm
from vispeg.worlds.world import World

Watch = Callable[[], AbstractContextManager[Callable[[float], None]]]
MARGIN = 0.5  # s without pictures at either end of a motion, so that what delayed pictures show is within the motion
OF_ARMS = "a motion of an arm alone; in a cell the task's controller runs, and motions have their own length"


@dataclass(frozen=True, repr=False)
class SimulatedRecording(Result):
    """A recording of a simulated robot.

    Attributes:
        recording: the recording, as `load_recording` reads it from the folder that `save` writes.
        robot: label of the robot with its hidden effects.
        repeat: number of runs of the motion.
        look: appearance of its pictures, WORLD/SEED; None for the plain cell.
        scaled: joint -> factor by which its motion was scaled down, so as not to exceed its speed limit.
        table: format of the samples that `save` writes.
        sources: files from which the recording was made.
    """

    recording: Recording
    robot: str
    repeat: int = 1
    look: str | None = None
    scaled: Mapping[str, float] = field(default_factory=dict)
    table: Literal["csv", "parquet"] = "csv"
    sources: tuple[str | Path, ...] = ()
    holds = "recording"  # class attribute, see `Result`

    @property
    def record(self) -> Mapping[str, object]:
        """The output of `vispeg record --json`, without the folder's name."""
        rec = self.recording
        values: dict[str, object] = {"samples": len(rec.time), "rate_hz": rec.rate_hz, "control": rec.control.mode}
        values |= {"motion": rec.motion, "robot": self.robot, "repeat": self.repeat}
        if rec.frames is not None:
            values |= {"frames": len(rec.frames), "cameras": [*rec.frames.cameras], "look": self.look}
        if self.scaled:
            values["scaled"] = dict(self.scaled)
        if rec.outcomes:
            values["outcomes"] = [o.category or ("success" if o.success else "failure") for o in rec.outcomes]
        return values

    @property
    def summary(self) -> list[Block]:
        """Motion, rate, controller and robot, and how its episodes ended."""
        return [Line(text, path=True) for text in self._lines()]

    def _lines(self) -> Iterator[str]:
        rec = self.recording
        runs = f"{self.repeat} runs of " if self.repeat > 1 else ""
        text = f"{runs}{rec.motion}, {rec.time[-1]:.3g} s at {rec.rate_hz:g} Hz, {rec.control.mode} control"
        if rec.frames is not None:
            text += f", {count(len(rec.frames), 'picture')} of {', '.join(rec.frames.cameras)}"
        yield f"{text}, {self.robot}" + (f", looking as {self.look}" if self.look is not None else "")
        if self.scaled:
            shares = ", ".join(f"{joint} {100 * share:.0f} %" for joint, share in self.scaled.items())
            yield f"made smaller, so that no joint passes its speed limit: {shares} of the motion"
        for o in rec.outcomes:
            end = o.category or ("success" if o.success else "failure")
            force = "" if o.peak_force is None else f", peak force {o.peak_force:.0f} N"
            depth = "" if o.depth is None else f", depth {1e3 * o.depth:.1f} mm"
            yield f"episode {o.episode}: {end}{force}{depth}"

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Write recording.yaml, the samples and the pictures; see `Result.save`."""
        return write(self.recording, out, overwrite=overwrite, table=self.table, inputs=self.sources)

    def _write(self, folder: Path) -> None:
        write(self.recording, folder, table=self.table)


def record(
    model: Model,
    motion: str | Path,
    *,
    duration: float | None = None,
    rate_hz: float = 500.0,
    control: Literal["position", "torque", "osc", "servo"] | None = None,
    kp: Sequence[float] | None = None,
    kd: Sequence[float] | None = None,
    effects: str | EffectInstance | Sequence[str | EffectInstance] = (),
    tool: str | None = None,
    noise: Mapping[str, float] | None = None,
    force_limit: float | None = None,
    torque_sensor: Literal["joint", "motor", "none"] = "joint",
    wrench_sensor: Literal["flange", "none"] = "flange",
    repeat: int = 1,
    cameras: str | Sequence[str] = (),
    size: str | tuple[int, int] = "320x240",
    fps: float = 3.0,
    look: str | None = None,
    backend: BackendName = "auto",
    seed: int = 0,
    name: str = "simulated",
    table: Literal["csv", "parquet"] = "csv",
    watch: Watch = lambda: nullcontext(lambda share: None),
) -> SimulatedRecording:
    """Record a simulated robot: only an arm, an arm in contact, or an arm whose cameras see a cell.

    Args:
        model: a model file, a robot's name, or a path to an MJCF or URDF; for a cell a world.
        motion: name of a motion, or a CSV or Parquet file with `time` and `q_cmd.*` (rad), or `ee_cmd.*` (m) in a cell.
        duration: seconds; default: 5 (osc: 9, look: 16). A CSV has its own duration.
        rate_hz: control and sample rate, Hz.
        control: the controller; default: position, or osc for the motion osc. With servo, only goals are sent.
        kp: stiffness: one number per joint (N m/rad), or six for osc (1/s^2).
        kd: damping: one number per joint (N m s/rad), or six for osc (1/s).
        effects: effects hidden in the robot, each EFFECT:WHERE[:param=number,...].
        tool: a tool at the flange that the recording states, such as none or meg50; default: the model file's.
        noise: sensor noise, such as q=2e-5 dq=1e-3 tau=0.2 ee=1e-4 ft=0.1 ft_torque=0.005 (1 sigma, SI units); default:
            that of a good arm.
        force_limit: in a cell: largest force that the controller commands, N; default: the task's or the motion's.
        torque_sensor: what `tau` measures: torque behind the gear, motor torque, or nothing.
        wrench_sensor: in a cell: record the wrench at the flange, or none; contact is then estimated from `tau`.
        repeat: number of runs of the motion, each an episode of the recording.
        cameras: cameras of the cell (wrist_wide, wrist_crop, external) or of the robot's own MJCF, or camera files;
            default for a look in a cell: wrist_wide.
        size: for pictures: width and height of the cell's cameras, px, as 320x240 or a pair of numbers.
        fps: for pictures: frame rate of each camera, Hz.
        look: for pictures: appearance of the cell, WORLD/SEED, such as S/3, as that world draws it for that seed;
            default: plain.
        backend: for pictures: the renderer.
        seed: seed of the motion and of the noise.
        name: name of the recording.
        table: format of the samples.
        watch: called when pictures are taken; returns a context manager that yields a function of the share done.

    Raises:
        UserError: no such model, motion, effect or camera; an option that this kind of motion does not support; or an
            arm that does not follow.
    """
    asked = Asked(
        model,
        str(motion),
        duration,
        rate_hz,
        control,
        None if kp is None else tuple(kp),
        None if kd is None else tuple(kd),
        several(effects),
        tool,
        noise or {},
        force_limit,
        torque_sensor,
        wrench_sensor,
        repeat,
        several(cameras),
        _pixels(size),
        fps,
        look,
        backend,
        seed,
        name,
    )
    if repeat < 1:
        raise UserError("nothing to record", key="--repeat", expected="1 or more", got=repeat)
    if force_limit is not None and not 0 < force_limit < float("inf"):
        raise UserError("must be above 0", key="--force-limit", got=force_limit)
    world = model if isinstance(model, World) else read_model(str(model))
    of_cells = motions_of(world)
    looks = asked.motion.startswith("look") and not asked.is_file and asked.motion not in of_cells
    on_bench = world.cell is None and asked.motion != "osc"
    # pictures without contact: a motion for cameras, or one of joints with `cameras`
    if looks or (asked.cameras and (asked.is_file or on_bench) and _of_joints(asked)):
        result = _of_cameras(asked, world, watch)
    elif world.cell is not None and (asked.motion in of_cells or not _of_joints(asked)):
        result = _of_contact(asked, world, watch)
    else:
        result = _of_arm(asked, world)
    files = (*([] if isinstance(model, World) else [model]), world.robot, *([motion] if asked.is_file else []))
    return replace(result, table=table, sources=(*files, *cameras))


def _pixels(size: str | tuple[int, int]) -> tuple[int, int]:
    """Return width and height, px, from a pair or a text such as `320x240`. Raises UserError: another text."""
    if not isinstance(size, str):
        return size
    width, _, height = size.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise UserError("not a size", key="--size", expected="WIDTHxHEIGHT, as 320x240", got=size)
    return int(width), int(height)


def _of_joints(asked: Asked) -> bool:
    """Return whether the motion is one of joints: a name, or a table without flange poses."""
    if not asked.is_file:
        return asked.motion in MOTIONS or asked.motion == "osc"
    path = Path(asked.motion)
    return path.is_file() and columns_of("ee_cmd", ())[0] not in read_table(path).names


def _of_arm(asked: Asked, world: World) -> SimulatedRecording:
    """Record an arm without a cell, on a motion of its joints or under operational space control."""
    asked.refuse(
        "not for an arm alone",
        "a motion that touches or looks, in a cell",
        cameras=((), [], None),
        look=(None,),
        force_limit=(None,),
        wrench_sensor=("flange",),
    )
    if asked.tool is not None:
        world = replace(world, tool=None if asked.tool == "none" else asked.tool)
    robot = load(world.robot, tool=world.tool)
    world = asked.hidden(world, robot)
    mode = asked.control or ("osc" if asked.motion == "osc" else "position")
    path = _joint_motion(asked, robot)
    kp, kd = (None if gains is None else np.asarray(gains, float) for gains in (asked.kp, asked.kd))
    control = controller(robot, mode, asked.rate_hz, centre_of(robot), kp, kd)
    path, share = (path, np.ones(len(robot.joints))) if asked.is_file else rehearsed(world, path, control)
    options = {"torque_sensor": asked.torque_sensor, "repeat": asked.repeat, "name": asked.name}
    rec = simulate(world, path, control, asked.levels, stream(asked.seed, "record", "noise"), **options)
    scaled = {joint: round(float(part), 3) for joint, part in zip(robot.joints, share, strict=True) if part < 1}
    return SimulatedRecording(rec, world.label, asked.repeat, scaled=scaled)


def _joint_motion(asked: Asked, robot: RobotModel) -> Motion:
    if asked.is_file:
        return replay(Path(asked.motion), robot, asked.rate_hz)
    osc = asked.motion == "osc"
    seconds = (9.0 if osc else 5.0) if asked.duration is None else asked.duration
    rng = stream(asked.seed, "record", asked.motion)
    return motion(asked.motion, robot, asked.rate_hz, seconds, rng, **({"model": compiled(robot)} if osc else {}))


def _of_contact(asked: Asked, world: World, watch: Watch) -> SimulatedRecording:
    """Record a motion in a cell under the task's controller; `expert` is a whole episode of the scripted policy.

    Pictures show the arm at its true angles; compliance of grip and fixture is too small to be visible.
    """
    none = (None,)
    asked.refuse(
        "not for a motion that touches",
        OF_ARMS,
        control=(None, "osc"),
        kp=none,
        kd=none,
        duration=none,
        tool=none,
    )
    if asked.torque_sensor == "none":
        asked.refuse("a motion in contact needs a sensor of force", "torques or a wrench", wrench_sensor=("flange",))
    if asked.torque_sensor == "motor":
        raise UserError("not in a cell", key="--torque-sensor", got="motor", choices=("joint", "none"))
    scene = robot_of_world(world)
    names = asked.cameras or (("wrist_wide",) if asked.motion.startswith("look") else ())
    if not names:
        asked.refuse("has no effect without pictures", "--cameras beside it", look=none)
    cameras: tuple[Camera, ...] = ()
    looks: tuple[EffectInstance, ...] = ()
    if isinstance(scene, Scene):
        cameras = cameras_of(names, scene, asked.pixels) if names else ()
        scene = replace(scene, cameras=tuple(c.name for c in cameras))
        looks = look_of(asked.look, scene) if asked.look is not None and cameras else ()
    if cameras and (asked.motion == EXPERT or asked.repeat > 1):
        raise UserError("pictures need a single run of a motion", key="--cameras", got=[c.name for c in cameras])
    world = asked.hidden(world, scene)
    noise, rng = asked.levels, stream(asked.seed, "record", "noise")
    options = {"rate_hz": asked.rate_hz, "torque_sensor": asked.torque_sensor, "repeat": asked.repeat}
    if asked.motion == EXPERT:
        rec = record_expert(
            world.add(*looks), asked.seed, noise, rng, **options, name=asked.name, force_limit=asked.force_limit
        )
    else:
        path = cell_motion(world, asked.motion, rate_hz=asked.rate_hz, seed=asked.seed, force_limit=asked.force_limit)
        if cameras:
            refuse_rate(asked.fps, asked.rate_hz, len(path.time), cameras)
        true: list[np.ndarray] = []
        rec = record_cell(world.add(*looks), path, noise, rng, **options, name=asked.name, watch=true.append)
        if cameras:
            rec = _photographed(asked, world.add(*looks), cameras, rec, true[0], rng, watch)
    if asked.wrench_sensor == "none":
        noise = {name: level for name, level in rec.noise.items() if not name.startswith("ft")}
        rec = replace(rec, ft=None, wrench=None, noise=noise)
    return SimulatedRecording(rec, world.label, asked.repeat, asked.look if looks else None)


def _of_cameras(asked: Asked, world: World, watch: Watch) -> SimulatedRecording:
    """Record the joints of an arm during a motion, and pictures of its scene.

    Effects of the arm act on the motion, those of cameras, appearance, fixture and grip on the pictures. So do those
    that its cell states, as far as the arm alone has their places; the recording mentions only these.
    """
    none = (None,)
    asked.refuse(
        "not for a motion that looks",
        control=(None, "position"),
        kp=none,
        kd=none,
        tool=none,
        repeat=(1,),
        force_limit=none,
        wrench_sensor=("flange",),
    )
    if asked.is_file:
        asked.refuse("a table has its own duration", duration=none)
    scene = scene_of(world)
    cameras = cameras_of(asked.cameras or (("wrist_wide",) if scene.goal else ()), scene, asked.pixels)
    scene = scene_of(world, cameras)
    looks = () if asked.look is None else look_of(asked.look, scene)
    world = asked.hidden(world, scene)
    if not asked.is_file and asked.motion in LOOKS:
        path = look_motion(asked.motion, scene, asked.rate_hz, LOOK_S if asked.duration is None else asked.duration)
    else:
        path = _joint_motion(asked, scene.nominal)
    refuse_rate(asked.fps, asked.rate_hz, len(path.time), cameras)
    stated = [e for e in scene.stated if effect(e.effect).targets(scene.nominal)]
    arm = replace(of_arm(world.over(stated)), cell=None)
    control = controller(scene.nominal, "position", asked.rate_hz, centre_of(scene.nominal))
    true: list[np.ndarray] = []
    noise, rng = asked.levels, stream(asked.seed, "record", "noise")
    sensor = asked.torque_sensor
    rec = simulate(arm, path, control, noise, rng, torque_sensor=sensor, name=asked.name, watch=true.append)
    cell = CellBelief(DEFAULT) if world.cell is not None and world.cell.open else world.cell
    rec = _photographed(asked, world.add(*looks), cameras, replace(rec, cell=cell), true[0], rng, watch)
    return SimulatedRecording(rec, world.label, look=asked.look)


def _photographed(
    asked: Asked,
    world: World,
    cameras: Sequence[Camera],
    rec: Recording,
    true: np.ndarray,
    rng: np.random.Generator,
    watch: Watch,
) -> Recording:
    """Return a recording with the pictures of its motion.

    Args:
        asked: the options.
        world: its effects act on scene, cameras and sensors; a board that its cell states is in view.
        cameras: the nominal cameras.
        rec: the recorded motion.
        true: (n, nj) true joint angles at its samples, rad.
        rng: random stream of the time stamps: as a camera has its own clock, they differ from those of the samples.
        watch: as for `record`.
    """
    times = np.arange(MARGIN, rec.time[-1] - MARGIN, 1 / asked.fps)
    times = times + rng.uniform(0, 0.5 / rec.rate_hz, len(times))
    with watch() as progress:
        frames = photograph(
            scene_of(world, cameras),
            cameras,
            world,
            CubicSpline(rec.time, true),
            times,
            asked.seed,
            backend=asked.backend,
            board=board_of(world.cell),
            progress=progress,
        )
    return replace(rec, frames=frames)
