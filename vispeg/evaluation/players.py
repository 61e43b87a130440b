"""Load policies to play, all with the same interface: from a folder, the scripted expert, or a user's own."""

from __future__ import annotations

from typing import Any

from vispeg.core.errors import UserError
from vispeg.evaluation import own
from vispeg.evaluation.entrants import EXPERT, Entrant, Policies, entrants
from vispeg.evaluation.lerobot import LeRobot
from vispeg.interface.actions import OFFSET, Actions
from vispeg.task.config import TaskConfig
from vispeg.task.contract import Task
from vispeg.task.kinematics import chain_of
from vispeg.task.registry import task_of
from vispeg.task.scripted import Scripted


def player(who: Entrant, config: Any) -> Any:
    """Return an entrant's policy (see `vispeg.learn.policy.Policy`) for an environment with TaskConfig `config`."""
    if who.source is not None:
        return own_player(who, config)
    if str(who.path) == EXPERT:
        return Scripted(config)
    from vispeg.learn.coarse_to_fine import open_policy

    return open_policy(who.path)


def own_player(who: Entrant, config: TaskConfig) -> own.Own:
    """Return a user's own policy, whose actions are converted to the offsets that the task's controller accepts.

    Raises:
        UserError: as `vispeg.interface.actions.Actions`; or the task defines its own actions and the policy's are not
            offsets.
    """
    target, task = own.made(who.source), task_of(config)
    scene, kind = task.cell(config), own.acts(who.source, target)
    arm, file = scene.nominal, own.origin(who.source)
    stated: Any = {"names": target.action_names, "width": target.action_width} if isinstance(target, LeRobot) else {}
    actions = Actions(kind, config, chain_of(arm), scene.tip, arm.joints, **stated, source=file)
    if actions.kind != OFFSET and type(task).command is not Task.command:
        what = f"{who.name}: the task {config.name} has actions of its own"
        raise UserError(what, key="action", expected=OFFSET, got=actions.kind)
    return own.Own(target, who.name, who.modality, actions)


def ready(policies: Policies) -> list[Entrant]:
    """Return the entrants of these policies; load each policy's folder once, so that errors come before any output.

    Raises:
        UserError: as `entrants`, or a policy that cannot be loaded.
    """
    who = entrants(policies)
    for e in who:
        if not e.scripted and e.source is None:
            from vispeg.learn.coarse_to_fine import open_policy

            open_policy(e.path)
    return who
