"""`vispeg run`: a policy on a robot."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from vispeg.cli.command import Call, Option, command
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.trials.loop import Step
    from vispeg.trials.trial import OutcomePart

HOW, LIMITS = "vispeg.trials.loop:How", "vispeg.trials.limits:Limits"


@command("vispeg.api.run:run", "policy", also=(HOW, LIMITS), asked=Option("ask"), silence=None, rest=None, watch=None)
def run(call: Call, asked: bool = False) -> None:
    """Run a policy on a robot.

    POLICY is a folder, a bundled policy's name, or an .onnx by `vispeg export`, which needs neither torch nor a
    simulator. With --world it may be one of your own: lerobot:FOLDER, MODULE:CLASS, or a .zip by Stable-Baselines3,
    with ?action=KIND behind it where its actions are joints or metres (joint_goal, joint_delta, tip_goal, tip_delta). A
    robot holds a flange pose by itself; the policy moves that pose every 160 ms. A robot is `sim:WORLD`, a simulated
    one in a process of its own with the world's hidden effects (`sim:WORLD?latency=0.01` delays commands and readings),
    `ros2`, an arm over ROS 2 (`ros2:FILE.yaml` says how its topics are called), `lerobot:TYPE`, a robot of LeRobot's
    (`lerobot:TYPE:FILE.yaml` says which motor is which joint's), `log:FOLDER`, recordings by `vispeg convert` of what
    the policy did under another program, or `python:MODULE:CALLABLE`, a driver of your own with the calls connect,
    read, command and stop.

    The arm stops at a limit (joints, joint speeds, speed of the tip, force, workspace), when readings stay away, and
    when you press the space bar, q or Ctrl-C. Each episode becomes a folder OUT/trial-NNNN, which is a recording too:
    `compare`, `diagnose` and `gap --measured` read it.

    Example:
        vispeg run state-3mm --robot sim:VNP --episodes 3 --out trials
        vispeg run policy.onnx --robot ros2:fr3.yaml --shadow --out first-look
        vispeg run policy.onnx --robot log:converted --out trials
        vispeg run policy.onnx --robot python:my_driver:Robot --slow 0.3 --force 15 --ask --episodes 20 --out trials

    Args:
        asked: ask after each episode how it ended.
    """
    from vispeg.trials.limits import Limits
    from vispeg.trials.loop import How

    if asked and not sys.stdin.isatty():
        raise UserError("nobody to ask", key="--ask", expected="a terminal")
    how = How(Limits(**call.given_to(LIMITS)), **call.given_to(HOW))
    show = (lambda step: None) if call.output.quiet or not sys.stderr.isatty() else _show
    with _pressed() as key:
        call.give(call(how=how, ask=_answer if asked else None, show=show, key=key))


def _show(step: Step) -> None:
    """Give a line that is written over: step, tip, force, lateness, missed deadlines."""
    x, y, z = 1e3 * step.tip
    force = "" if step.force is None else f"  {step.force:5.1f} N"
    text = f"step {step.number:3d}/{step.of}  tip {x:+6.1f} {y:+6.1f} {z:+6.1f} mm{force}"
    text += f"  late {1e3 * step.late:4.0f} ms, missed {step.missed}"
    print(f"\r{text}  (space stops)", end="\n" if step.number == step.of else "", file=sys.stderr, flush=True)


@contextmanager
def _pressed() -> Iterator[Callable[[], bool]]:
    """Whether the space bar, q or escape was pressed, without waiting; never where there is no terminal."""
    if not sys.stdin.isatty():
        yield lambda: False
        return
    import select
    import termios
    import tty

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)

    def pressed() -> bool:
        return bool(select.select([sys.stdin], [], [], 0)[0]) and sys.stdin.read(1) in " q\x1b"

    try:
        yield pressed
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _answer(outcome: OutcomePart) -> OutcomePart:
    """Give the outcome as a person saw it."""
    import termios

    terminal = termios.tcgetattr(sys.stdin)
    plain = list(terminal)
    plain[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, plain)
    try:
        said = input(f"\n{outcome.category}. Success? y, or what went wrong in a word; return to leave it: ").strip()
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, terminal)
    if not said:
        return outcome
    success = said.lower() in ("y", "yes", "success")
    return outcome.model_copy(
        update={"success": success, "category": "success" if success else said.lower(), "by": "person"}
    )
