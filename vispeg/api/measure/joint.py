"""Measure a joint's servo, friction and backlash from recordings, as `vispeg measure joint` does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from vispeg.api.measure.result import MeasurementResult, MeasureSettings, complete
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.core.files import new_folder
from vispeg.core.paths import expanded
from vispeg.core.seeds import stream
from vispeg.core.several import each_once, several
from vispeg.measure import joint as joints
from vispeg.measure.actuator import alone, parameters, text
from vispeg.measure.arm import Arm, arm_of
from vispeg.measure.trace import Trace, from_recording, from_table, most_moved
from vispeg.recordings.load import load as load_recording
from vispeg.report.drawings.measured_joint import picture
from vispeg.worlds.measurement_file import Measurement, measurement_text

NAME = "measurement.yaml"


def measure_joint(
    recordings: str | Path | Sequence[str | Path],
    out: str | Path,
    *,
    joint: str | None = None,
    columns: Mapping[str, str] | None = None,
    inertia: float | None = None,
    settings: MeasureSettings | None = None,
) -> MeasurementResult:
    """Measure a joint's servo, frequency response, friction and backlash.

    Args:
        recordings: recordings, or tables with the columns that `columns` names.
        out: folder of measurement.yaml, joint.png and, with a servo, actuator.xml for MuJoCo.
        joint: the joint; default: the one that moves most in the recordings.
        columns: for tables: time=COLUMN q_cmd=COLUMN q=COLUMN, optionally tau=COLUMN (s, rad, N m).
        inertia: inertia that the joint turns, kg m2, for the actuator; default: from the robot's model, or 1.
        settings: conditions, seed, overwrite.

    Raises:
        UserError: recordings that show nothing of the joint, or of several robots; tables without `columns`; an
            impossible inertia; or `out` exists.
    """
    settings = settings or MeasureSettings()
    paths = [Path(path) for path in several(recordings)]
    if inertia is not None and not 0 < inertia < float("inf"):
        raise UserError("not an inertia", key="--inertia", expected="above 0 kg m2", got=inertia)
    with new_folder(out, settings.overwrite, holds="measurement", inputs=paths) as folder:
        traces, name, robot = _traces(paths, joint, columns or {})
        arm, why = _arm(paths[0], name, robot)
        measured = joints.measure(traces, stream(settings.seed, "measure", "joint"), arm, inertia)
        effects, beyond = joints.effects(name, measured)
        details, notes = dict(measured.details), [*measured.notes, *beyond]
        if measured.servo is not None:
            loop, friction = measured.loop, _friction_attributes(effects)
            if loop is None:
                notes += [f"the actuator is for an inertia of 1 kg m2: {why}"]
                loop, friction = alone(measured.servo, 1.0)[0], "none is known in N m"
            turned = inertia if inertia is not None else (1.0 if arm is None else arm.held)
            details["actuator"] = {"inertia_kgm2": turned, **parameters(loop)}
            if arm is not None:
                details["actuator"] |= {"servo_reference_inertia_kgm2": arm.reference}
            about = [
                f"From {len(traces)} motions by `vispeg measure joint`; gravity compensated.",
                f"With the other joints held, the joint turns {turned:.4g} kg m2.",
                f"The joint's own friction is not in these numbers; give it to the joint: {friction}.",
            ]
            (folder / "actuator.xml").write_text(text(measured.servo, loop, name, about), encoding="utf-8")
        (folder / "joint.png").write_bytes(picture(name, measured))
        full = Measurement(
            "joint",
            name,
            tuple(measured.results),
            tuple(effects),
            robot if effects else None,
            dict(settings.conditions or {}),
            {},
            tuple(notes),
            details,
        )
        full = complete(full, paths, settings.seed)
        (folder / NAME).write_text(measurement_text(full), encoding="utf-8")
    written = f"{out}: {NAME}, joint.png" + (", actuator.xml" if measured.servo else "")
    return MeasurementResult(full, expanded(out) / NAME, written, budget=False)


def _traces(
    paths: Sequence[Path], joint: str | None, columns: Mapping[str, str]
) -> tuple[list[Trace], str, str | None]:
    """Return the joint's traces, its name, and the robot, which is None for tables."""
    if not paths:
        raise UserError("no recording given")
    each_once(paths)
    if all(path.is_dir() for path in paths):
        traces, robots, joint = list[Trace](), list[str](), joint or most_moved(paths)
        for path in paths:
            own, robot = from_recording(path, joint)
            traces += own
            robots.append(robot)
        if len(set(robots)) > 1:
            raise UserError("recordings of several robots", got=", ".join(sorted(set(robots))))
        return traces, joint, robots[0]
    if not columns:
        raise UserError("a table needs its columns named", key="--columns", expected="time=.. q_cmd=.. q=.. [tau=..]")
    return [from_table(path, columns) for path in paths], joint or "joint", None


def _arm(recording: Path, joint: str, robot: str | None) -> tuple[Arm | None, str]:
    """Return the arm of a recording and "", or None and the reason."""
    if robot is None:
        return None, "scale it, or state --inertia"
    try:
        return arm_of(load_recording(recording), joint), ""
    except UserError as error:
        return None, str(error)


def _friction_attributes(effects: Sequence[EffectInstance]) -> str:
    """Return the joint's friction in the effects as attributes of a MuJoCo joint."""
    words = {"coulomb_friction": ("torque", "frictionloss"), "viscous_friction": ("damping", "damping")}
    attributes = []
    for e in effects:
        if e.effect in words:
            key, word = words[e.effect]
            attributes.append(f'{word}="{e.params[key].value:.6g}"')
    return " ".join(attributes) or "none was found"
