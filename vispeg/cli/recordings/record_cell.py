"""`vispeg record` of a robot in its cell: motions that touch, under the task's own controller, with cameras or not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.cli.recordings.record import Args
    from vispeg.worlds.world import World


def run(args: Args, world: World) -> int:
    """Simulates, writes the folder, prints what is in it."""
    from vispeg.api.look import cameras_of, look_of
    from vispeg.api.record_cell import record_in_cell
    from vispeg.cli.reading import told
    from vispeg.cli.recordings.record_look import size_of
    from vispeg.recordings.write import write
    from vispeg.robots.scene import Scene
    from vispeg.task.belief import robot_of_world
    from vispeg.worlds.words import parse

    _refuse(args)
    scene = robot_of_world(world)
    asked = args.cameras or (("wrist_wide",) if args.motion.startswith("look") else ())
    names = [name for text in asked for name in text.split(",") if name]
    cameras = cameras_of(names, scene, size_of(args.size)) if names and isinstance(scene, Scene) else ()
    scene = replace(scene, cameras=tuple(c.name for c in cameras)) if isinstance(scene, Scene) else scene
    hidden = world.add(*(placed for text in args.effects for placed in parse(text, scene)))
    looks = look_of(args.look, scene) if args.look is not None and cameras and isinstance(scene, Scene) else ()
    world = hidden.add(*looks)
    sensor = "none" if args.torque_sensor == "none" else "joint"
    with told("taking pictures", quiet=args.output.quiet or not cameras) as share:
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
            cameras=cameras,
            fps=args.fps,
            backend=args.renderer,
            told=share,
        )
    write(rec, args.out, overwrite=args.overwrite, table=args.table, inputs=(args.model, world.robot, args.motion))
    runs = f"{args.repeat} runs of " if args.repeat > 1 else ""
    how = f"{runs}{rec.motion}, {rec.time[-1]:.3g} s at {args.rate:g} Hz, osc control"
    values = {"samples": len(rec.time), "rate_hz": args.rate, "control": "osc", "motion": rec.motion}
    values |= {"recording": str(args.out), "robot": hidden.label, "repeat": args.repeat}
    if cameras and rec.frames is not None:
        how = f"{how}, {len(rec.frames)} pictures of {', '.join(c.name for c in cameras)}"
        values |= {"frames": len(rec.frames), "cameras": [c.name for c in cameras], "look": args.look}
    lines = [f"{args.out}: {how}, {hidden.label}" + (f", looking as {args.look}" if looks else "")]
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
