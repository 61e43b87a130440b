"""`vispeg record` of a robot in its cell: motions that touch, under the task's own controller."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.cli.record import Args
    from vispeg.worlds.world import World


def run(args: Args, world: World) -> int:
    """Simulates, writes the folder, prints what is in it."""
    from vispeg.api.record_cell import record_in_cell
    from vispeg.recordings.write import write
    from vispeg.task.belief import robot_of_world
    from vispeg.worlds.words import parse

    _refuse(args)
    scene = robot_of_world(world)
    world = world.add(*(placed for text in args.effects for placed in parse(text, scene)))
    sensor = "none" if args.torque_sensor == "none" else "joint"
    rec = record_in_cell(
        world,
        args.motion,
        args.sigmas(),
        rate_hz=args.rate,
        seed=args.seed,
        force_limit=args.force_limit,
        torque_sensor=sensor,
        repeat=args.repeat,
        label=args.out.name,
    )
    write(rec, args.out, overwrite=args.overwrite, table=args.table, inputs=(args.model, world.robot, args.motion))
    runs = f"{args.repeat} runs of " if args.repeat > 1 else ""
    how = f"{runs}{rec.motion}, {rec.time[-1]:.3g} s at {args.rate:g} Hz, osc control"
    values = {"samples": len(rec.time), "rate_hz": args.rate, "control": "osc", "motion": rec.motion}
    values |= {"recording": str(args.out), "robot": world.label, "repeat": args.repeat}
    lines = [f"{args.out}: {how}, {world.label}"]
    for one in rec.outcomes:
        end = one.category or ("success" if one.success else "failure")
        values.setdefault("outcomes", []).append(end)  # type: ignore[union-attr]
        lines.append(f"episode {one.episode}: {end}, peak force {one.peak_force:.0f} N, depth {1e3 * one.depth:.1f} mm")  # type: ignore[operator]
    args.output.give(values, lines)
    return 0


def _refuse(args: Args) -> None:
    """Raises UserError for what a motion of a cell does not take."""
    for key, value, usual in (
        ("--control", args.control, (None, "osc")),
        ("--kp", args.kp, (None,)),
        ("--kd", args.kd, (None,)),
        ("--duration", args.duration, (None,)),
        ("--tool", args.tool, (None,)),
    ):
        if value not in usual:
            expected = (
                "a motion of an arm alone; in a cell the task's controller runs, and motions have their own length"
            )
            raise UserError("not for a motion that touches", key=key, expected=expected, got=value)
    if args.torque_sensor == "motor":
        raise UserError("not in a cell", key="--torque-sensor", got="motor", choices=("joint", "none"))
