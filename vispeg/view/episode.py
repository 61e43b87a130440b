"""Play episodes of a policy in a worker process, and send each step to be drawn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.films.moments import moments, stage
from vispeg.sim.compiled import compiled


class Episodes:
    """The object of the page's worker; `tell` gets "cell" (side, MjModel, world), then "moment" (side, Moment)."""

    def __init__(self, tell: Callable[[str, Any], None]):
        self.tell = tell

    def play(self, name: str, worlds: tuple[str, ...], seed: int) -> None:
        """Play a policy's episode with a seed in each world; "" is the world that the policy was trained in.

        Raises:
            UserError: unknown policy or world, a policy that does not fit the world, or torch is not installed.
        """
        who = entrant(name)
        for side, world in enumerate(worlds):
            with stage(who, world) as (env, policy, at):
                self.tell("say", f"{name} in {at}, seed {seed}")
                for step, moment in enumerate(moments(env, policy, seed)):
                    if step == 0:
                        self.tell("cell", (side, compiled(env.sim.scene), at))
                    self.tell("moment", (side, moment))
