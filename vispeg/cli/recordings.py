"""Commands that make and check recordings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

from vispeg.cli.command import Call, Option, command
from vispeg.core.counts import count
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.recordings.importers.mapping import ColumnMap


@command("vispeg.api.recording.check:check", "recordings")
def check(call: Call) -> None:
    """Check recordings: clock, limits, noise, excitation, contact.

    Also states which effects a recording can show. For camera frames: clock, light, depth, views, and which camera
    errors they can show.

    For the wrench of a described sensor: time in each regime of contact, forces, speeds, and which contact effects it
    can show.
    Exit code 0: the recordings can be used, with or without warnings; 2: one cannot, and an error line names it.

    Example:
        vispeg check rig-a rig-b
        vispeg check rig-a slide-a --out checked
    """
    from vispeg.cli.progress import progress_bar, size_of

    def watch(what: str, path: Path):
        return progress_bar(f"{what} {path}", size_of(path) if what == "reading" else 0, call.output.quiet)

    call.give(call(watch=watch))
    if call.out is not None:
        call.output.line(f"report: {call.out / 'report.html'}")


@command(
    "vispeg.api.recording.convert:convert",
    "source",
    out=Option(default=None),
    mapping=Option("map"),
    column_names=None,
)
def convert(
    call: Call,
    guess: bool = False,
    yes: bool = False,
    save_map: Path | None = None,
    columns: str | None = None,
    calibration: Path | None = None,
    episodes: str | None = None,
    topic: str | None = None,
    command_topic: str | None = None,
    pose_topic: str | None = None,
    wrench_topic: str | None = None,
    images: tuple[str, ...] = (),
) -> None:
    """Convert a table, an archive or a ROS bag into a recording.

    Example:
        vispeg convert log.csv --robot iiwa14 --guess --save-map map.yaml
        vispeg convert log.csv --robot iiwa14 --map map.yaml --out rig-a
        vispeg convert run.mcap --robot arm.urdf --topic /joint_states --torque-sensor joint --out rig-b
        vispeg convert run.mcap --robot iiwa14 --images all --cameras wrist.yaml --out rig-c
        vispeg convert so101-pick-place --robot so101_new_calib.xml --guess --yes --out pick
        vispeg convert episode_0.hdf5 --robot arm.urdf --guess --rate-hz 50 --save-map map.yaml
        vispeg convert tosses.npz --robot cube.xml --rate-hz 148 --episodes 0:285 --out toss-a

    SOURCE is a table, a file of arrays (HDF5, MATLAB, NumPy, JSON), a LeRobot data set or a ROS bag.
    A map names columns and units, one per line:
    `time: {column: t, unit: ms}`, `q.joint1: {column: pos_1, unit: deg}`;
    `joints: {joint1: lbr_A1}` renames a bag's joints, `recording: {control: {mode: torque}}` adds to recording.yaml,
    `table: {separator: ";", decimal: ","}` describes a text table. `--guess` proposes a map from a table's header
    and ranges. Impossible units (200 kHz, angles far outside the joints' ranges) are refused
    without `--insist`.

    Args:
        guess: tables: propose the map, with a reason for each column, and ask before it is used.
        yes: with `guess`: accept the proposed map without a question.
        save_map: with `guess`: write the proposed map to this file, to be edited and passed as --map.
        columns: names of the columns of a table without a header line, separated by commas: time,q1,q2.
        calibration: with `guess`: LeRobot's calibration file (encoder ranges); default: calibration.json in the data
            set.
        episodes: for an object's archive: tosses to convert, FIRST:LAST without LAST. The others can be held out.
        topic: bags: the JointState topic of measured values; default: the only one.
        command_topic: bags: the JointState topic of commands.
        pose_topic: bags: the PoseStamped topic of the flange in the base; default: the only one.
        wrench_topic: bags: the WrenchStamped topic at the flange; default: the only one.
        images: pictures to convert: topics of a bag (NAME=TOPIC names the camera), videos of a LeRobot table
            (observation.images.wrist), or all.
    """
    from vispeg.api.recording.convert import placed
    from vispeg.cli.progress import progress_bar
    from vispeg.recordings.columns import SIGNALS
    from vispeg.recordings.importers.rosbag import Topics
    from vispeg.robots.objects import is_object

    if not call.source.exists():
        raise UserError("does not exist", file=call.source)
    if is_object(placed(call.robot)):
        return _convert_object(call, episodes)
    if episodes is not None:
        raise UserError("--episodes is for a free object's tosses", file=call.source)
    names = [] if columns is None else [name.strip() for name in columns.split(",")]
    mapping = call.mapping
    if guess:
        mapping = _guessed(call, names, calibration, save_map, yes)
        if mapping is None:
            return
    _need_out(call)
    with progress_bar(f"reading {call.source}", call.source.stat().st_size) as share:
        rec = call(
            mapping=mapping,
            topics=Topics(topic, command_topic, pose_topic, wrench_topic, images),
            torque_constants=() if guess else call.torque_constants,
            column_names=names,
            progress=share,
        )
    signals = [*(name for name in SIGNALS if getattr(rec, name) is not None), *rec.signals]
    shape = {"samples": len(rec.time), "joints": list(rec.joints), "rate_hz": rec.rate_hz}
    frames = 0 if rec.frames is None else len(rec.frames)
    size = f"{count(len(rec.time), 'sample')} of {count(len(rec.joints), 'joint')}"
    line = f"{call.out}: {size} at {rec.rate_hz:g} Hz: "
    line += ", ".join(signals)
    line += f"; {count(frames, 'frame')} of {', '.join(rec.frames.names)}" if rec.frames is not None else ""
    call.output.give({"recording": str(call.out), **shape, "signals": signals, "frames": frames}, [line])


def _need_out(call: Call) -> None:
    if call.out is None:
        raise UserError("no folder to write to", key="--out", expected="--out FOLDER")


def _convert_object(call: Call, episodes: str | None) -> None:
    """Convert a free object's tosses."""
    from vispeg.api.recording.convert import convert_object

    first, last = _span(episodes)
    _need_out(call)
    options = {"rate_hz": call.rate_hz, "overwrite": call.overwrite}
    rec = convert_object(call.source, call.robot, call.out, first=first, last=last, **options)
    tosses = len(rec.tosses)
    record = {"recording": str(call.out), "object": rec.name_of, "samples": len(rec.time), "episodes": tosses}
    thrown = f"{tosses} {'toss' if tosses == 1 else 'tosses'} of {rec.name_of}"
    line = f"{call.out}: {thrown}, {len(rec.time)} samples at {rec.rate_hz:g} Hz"
    call.output.give(record, [line])


def _span(episodes: str | None) -> tuple[int, int | None]:
    """Return FIRST and LAST of a text FIRST:LAST; LAST is excluded, None for the end."""
    if episodes is None:
        return 0, None
    first, colon, last = episodes.partition(":")
    if not (colon and (first or "0").isdigit() and (last or "0").isdigit()) or len(episodes) > 20:
        raise UserError("not a range", key="--episodes", expected="FIRST:LAST, such as 0:285", got=episodes)
    return int(first or 0), int(last) if last else None


def _guessed(
    call: Call, names: list[str], calibration: Path | None, save_map: Path | None, yes: bool
) -> ColumnMap | None:
    """Propose a map, print it and save it if asked to; return it if the user accepts it now, else None."""
    from vispeg.api.recording.guess import propose

    if call.mapping is not None:
        raise UserError("a map is given already", key="--guess", expected="--guess or --map, not both")
    options = {"rate_hz": call.rate_hz, "columns": names, "torque_constants": call.torque_constants}
    proposed = propose(call.source, call.robot, call.torque_sensor, calibration=calibration, **options)
    call.output.line(str(proposed))
    if save_map is not None:
        proposed.save(save_map, overwrite=call.overwrite)
        call.output.line(f"written to {save_map}; use it with --map {save_map}")
    if call.out is not None and (yes or _confirmed(call)):
        return proposed.mapping
    map_file = None if save_map is None else str(save_map)
    call.output.give({"recording": None, "map": map_file, "proposal": proposed.record}, [])
    return None


def _confirmed(call: Call) -> bool:
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        expected = "--yes to accept it, or --save-map FILE to check it and pass it as --map"
        raise UserError("a guess must be confirmed", key="--guess", expected=expected)
    if input("Convert with this map? [y/N] ").strip().lower() in ("y", "yes"):
        return True
    call.output.line("nothing written; --save-map FILE writes the map, to be corrected")
    return False


@command(
    "vispeg.api.recording.record:record",
    "model",
    rate_hz=Option("rate"),
    backend=Option("renderer"),
    name=None,
)
def record(call: Call, out: Path, overwrite: bool = False) -> None:
    """Record a simulated robot with sensor noise.

    Writes a recording folder. MOTION is a name (`vispeg motions` lists them) or a CSV with time, q_cmd.* and optionally
    dq_cmd.*, such as the next_experiment/samples.csv of `vispeg diagnose`. `--effects` adds effects to those of the
    model file. A named motion is scaled down, with a note, if a joint would exceed its speed limit; a CSV is replayed
    unchanged.

    In a cell (MODEL is {cell}, a world, or a model with `cell`) MOTION may also be a motion in contact, a motion for
    cameras, `expert` (the scripted policy), or a CSV with time and ee_cmd.*. The task's controller runs and the wrench
    is recorded. `--cameras` adds pictures, also of a robot whose own MJCF shows more than the arm.

    Example:
        vispeg record iiwa14 --motion fourier --effects coulomb_friction:joint4:torque=1.2 --seed 1 --out rig-a
        vispeg record {cell} --motion slide --effects contact_friction:{held}:scale=1.7 --noise ft=0.1 --out slide-a
        vispeg record {cell} --motion look --cameras wrist_wide --effects camera_offset:wrist_wide:x=0.004 --out look-a
        vispeg record model.yaml --motion found/next_experiment/samples.csv --out rig-d

    Args:
        out: folder of the recording.
        overwrite: replace `out` if it exists.
    """
    from vispeg.cli.progress import progress_bar

    cameras = [name for text in call.cameras for name in text.split(",") if name]
    watch = {"watch": lambda: progress_bar("taking pictures", quiet=call.output.quiet)}
    result = call.saved(out, overwrite, "recording", (call.model,), cameras=cameras, name=out.name, **watch)
    call.output.give({"recording": str(out), **result.record}, [*result.summary, f"recording: {out}"])


@command(
    "vispeg.api.recording.commands:write_motion",
    "name",
    name=Option(default=None),
    out=Option(default=None),
    rate_hz=Option("rate"),
)
def motions(call: Call, family: str | None = None, search: str | None = None) -> None:
    """List the motions of `vispeg record`, or write one as a CSV.

    A robot can replay the CSV. It holds `time` with `q_cmd.*` and `dq_cmd.*` of the joints or, for motions in contact,
    `ee_cmd.*` of the flange with the gains (`kp.*`, 1/s^2) and the force limit (N) of the intended controller.

    Example:
        vispeg motions
        vispeg motions --family joint
        vispeg motions press --model {cell} --out press.csv
        vispeg motions look --out look.csv

    Args:
        family: only motions in this space: joint, cartesian, contact or cell.
        search: only motions with this text in name or description.
    """
    from vispeg.api.library.catalogue import motions
    from vispeg.cli.listing import show

    if call.name is not None:
        made = call()
        call.output.give(made.record, [str(made)])
        return
    if call.out is not None:
        raise UserError("which motion?", key="--out", expected="vispeg motions NAME --out FILE.csv")
    show("motions", motions(), "space", family, search, call.output)
