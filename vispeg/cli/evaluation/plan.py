"""Says what transfer to expect of a task, before anything is built.

By an article of practitioners: success rates of such tasks, and its signs of a gap that cannot be bridged, each with
its number here. It measures nothing; `vispeg gap` and `vispeg run` do.

Example:
    vispeg plan S
    vispeg plan my-cell.yaml --repeatability 0.1 --varies --demonstrations 300 --a-day 80 --build-days 10
"""

from __future__ import annotations

from dataclasses import dataclass

import tyro

from vispeg.cli.output import Output, OutputOptions


@dataclass(frozen=True)
class Args:
    """Arguments of `vispeg plan`."""

    world: tyro.conf.Positional[str]
    """A built-in world's name or a world file."""
    repeatability: float | None = None
    """Pose repeatability of the robot, mm (ISO 9283); default: what the world states, or the arm's data sheet."""
    soft: bool = False
    """A part deforms, flows or is granular."""
    varies: bool = False
    """Success hangs on a property that varies from object to object, such as surface friction."""
    demonstrations: int | None = None
    """Demonstrations that would teach the task on the robot alone."""
    a_day: int | None = None
    """Demonstrations that can be recorded in a day."""
    build_days: float | None = None
    """Days to build and calibrate the simulation."""
    output: OutputOptions = Output()

    def run(self) -> int:
        """Print the verdict, the rates and the signs."""
        from vispeg.api.plan import plan

        answers = {k: getattr(self, k) for k in ("soft", "varies", "demonstrations", "a_day", "build_days")}
        result = plan(self.world, repeatability=self.repeatability, **answers)
        self.output.give(result.record, result.summary)
        return 0
