"""Measure actuators and objects, with their uncertainty.

Every protocol writes a file `vispeg-measurement/1`: value, standard uncertainty, 95 % interval, uncertainty budget by
source, and the effect for a model. `vispeg add MODEL FILE` and a world's `model: FILE` take that file.

Example:
    vispeg measure plan joint4 --robot iiwa14 --out plan
    vispeg measure joint runs/* --joint joint4 --out joint4
    vispeg measure friction slides.csv --resolution angle_deg=0.1 --out friction.yaml
"""

from __future__ import annotations

from typing import Any

from vispeg.cli.command import Call, Option, command

SETTINGS, ENOUGH = "vispeg.api.measure.result:MeasureSettings", "vispeg.api.measure.enough:enough"
MEASURED: dict[str, Any] = {"also": (SETTINGS, ENOUGH), "policies": Option("policy", default=())}
NO_READINGS: dict[str, Any] = {**MEASURED, "resolution": None, "accuracy": None}


def _measured(call: Call) -> None:
    """Print the measurement; if policies are given, play them and print whether its precision suffices."""
    from vispeg.api.measure.enough import check_enough, enough
    from vispeg.api.measure.result import MeasureSettings
    from vispeg.cli.progress import playing
    from vispeg.report.text.summary import print_summary

    options = call.given_to(ENOUGH)
    check_enough(**options)
    result = call(settings=MeasureSettings(**call.given_to(SETTINGS)))
    if not call.output.json:
        print_summary(result.summary)
    if options["policies"]:
        judged = enough(result, **options, playing=lambda jobs, folder: playing(jobs, folder, call.output.quiet))
        result = judged.result
        if not call.output.json:
            print_summary(judged.summary)
    if call.output.json:
        call.output.give(result.record, [])


@command("vispeg.api.measure.plan:plan_joint", "joint", rate_hz=Option("rate"))
def plan(call: Call) -> None:
    """Write the motions for `measure joint`, ready to replay, and the order in which to run them (ORDER.md).

    Steps of three sizes both ways, sines of two amplitudes, triangles, a ladder of speeds; the first is repeated at the
    end. `vispeg record ROBOT --motion PLAN/01-..csv` runs them on a simulated robot.

    Example:
        vispeg measure plan joint4 --robot iiwa14 --out plan
    """
    call.give(call())


@command("vispeg.api.measure.joint:measure_joint", "recordings", **NO_READINGS)
def joint(call: Call) -> None:
    """Measure a joint's servo, frequency response, friction and backlash from recordings of commanded motions.

    Uses steps, sines of three periods or more, sweeps, and ramps out and back, where it finds them. Writes
    OUT/measurement.yaml, OUT/actuator.xml (MuJoCo) and OUT/joint.png.

    Example:
        vispeg measure joint runs/* --joint joint4 --out joint4
        vispeg measure joint log.csv.gz --columns time=t_s q_cmd=goal q=angle --joint elbow --out elbow
    """
    _measured(call)


@command("vispeg.api.measure.zeros:measure_zeros", "table", **NO_READINGS)
def zeros(call: Call) -> None:
    """Measure joint zeros and the frames of base and tip, from poses at rest.

    One row per pose, no time: the joint angles as read (named like the joints, or q1, q2, ..), the tip's measured x y
    z, and if there is one its orientation: qw qx qy qz, rx ry rz, or roll pitch yaw. Units are given in the header
    (x_mm, q1_deg), or inferred from the data. A zero that the poses cannot distinguish from an error of a frame is
    reported as such, without a value.

    Example:
        vispeg measure zeros tracker.csv --robot iiwa14 --out zeros.yaml
    """
    _measured(call)


@command("vispeg.api.measure.quantity:measure_mass", "readings", **MEASURED)
def mass(call: Call) -> None:
    """Measure a mass by a scale.

    Columns: mass and, if the empty scale was read before each, tare (kg; or mass_g, tare_g).

    Example:
        vispeg measure mass tool.csv --resolution mass_g=1 --out mass.yaml
    """
    _measured(call)


@command("vispeg.api.measure.quantity:measure_com", "readings", mass_file=Option("mass"), **MEASURED)
def com(call: Call) -> None:
    """Measure a centre of mass, from wrenches at rest or plumb lines on a photograph.

    A table has columns fx fy fz tx ty tz and gravity's direction gx gy gz in the same frame, four attitudes or more; or
    x, y and angle of two plumb lines or more. Recordings hold still in four attitudes or more and have `ft`.

    Example:
        vispeg measure com attitude-a attitude-b attitude-c attitude-d --out com.yaml
    """
    _measured(call)


@command("vispeg.api.measure.quantity:measure_friction", "readings", **MEASURED)
def friction(call: Call) -> None:
    """Measure a coefficient of friction, on an incline or from forces while sliding.

    Columns: angle (rad, or angle_deg) at which it lets go; with distance and time also how it slid; or normal and
    tangential (N); and place (a number) of three places or more. Recordings have `ft`, begin in free air, and slide.

    Example:
        vispeg measure friction slides.csv --resolution angle_deg=0.1 --out friction.yaml
    """
    _measured(call)


@command("vispeg.api.measure.quantity:measure_restitution", "readings", **MEASURED)
def restitution(call: Call) -> None:
    """Measure a coefficient of restitution.

    Columns: t1 t2 t3 (s) of three touches; or flight1 flight2 (s); or drop bounce (m).

    Example:
        vispeg measure restitution bounces.csv --resolution t1=0.001 t2=0.001 t3=0.001 --out e.yaml
    """
    _measured(call)


@command("vispeg.api.measure.quantity:measure_stiffness", "readings", readings=Option(default=None), **MEASURED)
def stiffness(call: Call) -> None:
    """Measure a fixture's stiffness, from presses on a rigid stop and on the fixture.

    Two arm poses or more.

    A table has columns force (N), depth (m), on (0 stop, 1 fixture), and pose and ramp (numbers). Recordings have `ft`,
    begin in free air, and press along the flange's z; the n-th of --stop and of --fixture are of one arm pose.

    Example:
        vispeg measure stiffness presses.csv --resolution force=0.1 depth=1e-5 --out stiffness.yaml
    """
    _measured(call)
