"""`vispeg record` of a cell with cameras: joints and pictures of an arm that looks about."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.cli.recordings.record import Args

LARGEST = 4096  # px


def run(args: Args) -> int:
    """Simulates, takes the pictures, writes the folder, prints what is in it."""
    from vispeg.api.look import cameras_of, look_of, record_look, scene_of
    from vispeg.cli.reading import told
    from vispeg.recordings.write import write
    from vispeg.worlds.model_file import load_model
    from vispeg.worlds.words import parse

    _refuse(args)
    world = load_model(args.model)
    names = [name for text in args.cameras or ("wrist_wide",) for name in text.split(",") if name]
    cameras = cameras_of(names, scene_of(world), size_of(args.size))
    scene = scene_of(world, cameras)
    looks = () if args.look is None else look_of(args.look, scene)
    hidden = world.add(*(placed for text in args.effects for placed in parse(text, scene)))
    world = hidden.add(*looks)
    with told("taking pictures", quiet=args.output.quiet) as share:
        rec = record_look(
            world,
            args.motion,
            cameras,
            fps=args.fps,
            duration=args.duration,
            rate_hz=args.rate,
            noise=args.sigmas(),
            seed=args.seed,
            backend=args.renderer,
            name=args.out.name,
            told=share,
        )
    write(rec, args.out, overwrite=args.overwrite, table=args.table, inputs=(args.model, *names))
    count = 0 if rec.frames is None else len(rec.frames)
    where = ", ".join(c.name for c in cameras)
    values = {"samples": len(rec.time), "frames": count, "cameras": [c.name for c in cameras], "motion": rec.motion}
    values |= {"recording": str(args.out), "robot": hidden.label, "look": args.look, "rate_hz": args.rate}
    said = f"{args.out}: {rec.motion}, {rec.time[-1]:.3g} s at {args.rate:g} Hz, {count} pictures of {where}"
    args.output.give(values, [f"{said}, {hidden.label}" + (f", looking as {args.look}" if args.look else "")])
    return 0


def _refuse(args: Args) -> None:
    """Raises UserError for what a look does not take."""
    for key, value, usual in (
        ("--control", args.control, (None, "position")),
        ("--kp", args.kp, (None,)),
        ("--kd", args.kd, (None,)),
        ("--tool", args.tool, (None,)),
        ("--repeat", args.repeat, (1,)),
    ):
        if value not in usual:
            raise UserError(f"a motion that looks has no {key}", key=key, got=value)


def size_of(text: str) -> tuple[int, int]:
    """Width and height in px of `320x240`."""
    width, x, height = text.partition("x")
    good = x and width.isdigit() and height.isdigit() and len(width) < 5 and len(height) < 5
    if not good or not (16 <= int(width) <= LARGEST and 16 <= int(height) <= LARGEST):
        raise UserError("not a size", key="--size", expected=f"WIDTHxHEIGHT, 16 to {LARGEST} px, as 320x240", got=text)
    return int(width), int(height)
