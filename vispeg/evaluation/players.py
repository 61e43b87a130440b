"""Policies ready to play: from their folder, or the scripted expert behind the same interface."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vispeg.evaluation.entrants import EXPERT, Entrant, entrants
from vispeg.task.scripted import Scripted


def player(who: Entrant, config: Any) -> Any:
    """The policy of an entrant (see `vispeg.learn.policy.Policy`) for an environment of TaskConfig `config`."""
    if str(who.path) == EXPERT:
        return Scripted(config)
    from vispeg.learn.coarse_to_fine import open_policy

    return open_policy(who.path)


def ready(texts: Sequence[str]) -> list[Entrant]:
    """The entrants of these texts, each policy opened once, before anything is written.

    Raises:
        UserError: as `entrants`; a policy that cannot be played.
    """
    who = entrants(texts)
    for e in who:
        if not e.scripted:
            from vispeg.learn.coarse_to_fine import open_policy

            open_policy(e.path)
    return who
