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

    POLICY is a folder, a bundled policy's name, or an .onnx file by `vispeg export`, which needs neither torch nor a
    simulator; NAME=POLICY gives it a name for tables. With --world it may be your own policy: lerobot:FOLDER,
    MODULE:CLASS, or a .zip by Stable-Baselines3; if its actions are joint angles or metres, append ?action=KIND
    (joint_goal, joint_delta, tip_goal, tip_delta). The robot holds a flange pose by itself; the policy moves that pose
    every 160 ms. ROBOT is one of: `sim:WORLD`, a simulated robot in a separate process with the world's hidden effects
    (`sim:WORLD?latency=0.01` delays commands and readings); `ros2`, an arm over ROS 2 (`ros2:FILE.yaml` names its
    topics); `lerobot:TYPE`, a robot of LeRobot (`lerobot:TYPE:FILE.yaml` assigns motors to joints); `log:FOLDER`,
    recordings by `vispeg convert` of the policy under another program; `python:MODULE:CALLABLE`, your own driver with
    the methods connect, read, command and stop.

    The arm stops at a limit (joints, joint speeds, speed of the tip, force, workspace), when no readings arrive, and
    when you press the space bar, q, Escape or Ctrl-C. Each episode becomes a folder OUT/trial-NNNN, a recording that
    `compare`, `diagnose` and `gap --measured` read.

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
        raise UserError("there is no terminal to ask in", key="--ask", expected="a terminal")
    how = How(Limits(**call.given_to(LIMITS)), **call.given_to(HOW))
    show = (lambda step: None) if call.output.quiet or not sys.stderr.isatty() else _show
    with _pressed() as key:
        call.give(call(how=how, ask=_answer if asked else None, show=show, key=key))


def _show(step: Step) -> None:
    """Overwrite the status line: step, tip, force, delay, missed deadlines."""
    x, y, z = 1e3 * step.tip
    force = "" if step.force is None else f"  {step.force:5.1f} N"
    text = f"step {step.number:3d}/{step.of}  tip {x:+6.1f} {y:+6.1f} {z:+6.1f} mm{force}"
    text += f"  late {1e3 * step.late:4.0f} ms, missed {step.missed}"
    print(f"\r{text}  (space stops)", end="\n" if step.number == step.of else "", file=sys.stderr, flush=True)


@contextmanager
def _pressed() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether space, q or Escape was pressed; without a terminal, always False."""
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
    """Ask the user how the episode ended; return the outcome."""
    import termios

    terminal = termios.tcgetattr(sys.stdin)
    plain = list(terminal)
    plain[3] |= termios.ICANON | termios.ECHO
    termios.tcsetattr(sys.stdin, termios.TCSADRAIN, plain)
    try:
        answer = input(f"\n{outcome.category}. Success? y, or what went wrong in a word; return to leave it: ").strip()
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, terminal)
    if not answer:
        return outcome
    success = answer.lower() in ("y", "yes", "success")
    return outcome.model_copy(
        update={"success": success, "category": "success" if success else answer.lower(), "by": "person"}
    )
