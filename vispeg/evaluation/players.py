"""Policies ready to play: from their folder, the scripted expert, or the user's own, behind the same interface."""

from __future__ import annotations

from typing import Any

from vispeg.evaluation import own
from vispeg.evaluation.entrants import EXPERT, Entrant, Policies, entrants
from vispeg.task.scripted import Scripted


def player(who: Entrant, config: Any) -> Any:
    """The policy of an entrant (see `vispeg.learn.policy.Policy`) for an environment of TaskConfig `config`."""
    if who.source is not None:
        return own.Own(own.made(who.source), who.name, who.modality, len(config.dof))
    if str(who.path) == EXPERT:
        return Scripted(config)
    from vispeg.learn.coarse_to_fine import open_policy

    return open_policy(who.path)


def ready(policies: Policies) -> list[Entrant]:
    """The entrants of these policies, each opened once, before anything is written.

    Raises:
        UserError: as `entrants`; a policy that cannot be played.
    """
    who = entrants(policies)
    for e in who:
        if not e.scripted and e.source is None:
            from vispeg.learn.coarse_to_fine import open_policy

            open_policy(e.path)
    return who
