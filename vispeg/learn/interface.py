"""The meaning of a trained policy's inputs and outputs, from its record and the world that it was trained in."""

from __future__ import annotations

from vispeg.core.errors import UserError
from vispeg.interface.interface import Interface, NoInterface
from vispeg.learn.envs import home
from vispeg.learn.meta import interface, made_for, worlds
from vispeg.learn.modalities import modality
from vispeg.learn.policy import Policy
from vispeg.task.environments.vector import world_of
from vispeg.task.interface import interface_in


def interface_of_policy(policy: Policy, world: str | None = None, digest: str = "") -> Interface:
    """Return what a policy's observation and action mean on the arm of a world.

    Args:
        policy: a policy from `vispeg.learn.policy.load`.
        world: name or file of the world; None for the one that the policy was trained in.
        digest: hash of the policy's folder.

    Raises:
        NoInterface: no such world, a training world that has changed, or a policy that reads ground truth, which no
            robot has.
        UserError: the policy's observation is not that of the world's task.
    """
    senses = modality(policy.modality)
    if senses.knows:
        raise NoInterface("reads the ground truth, which no robot has", key="modality", got=policy.modality)
    meta = policy.meta
    tolerance = {} if world else made_for(meta)
    memory = {"stack": 1} if policy.recurrent else {}
    try:
        at = world or home(policy)
        _, config, file = world_of(at, {**memory, **tolerance, **interface(meta)})
    except UserError as error:
        raise NoInterface(f"the world it was trained in: {error}", expected="--world NAME or FILE") from error
    trained = str(meta.get("world_hash") or ("" if file is None else file.hash))
    out = interface_in(
        config,
        file,
        senses.obs_mode,
        policy.layout.images,
        modality=policy.modality,
        recurrent=policy.recurrent,
        world=str(meta.get("world") or at),
        world_hash=trained,
        **worlds(meta),
        policy=digest,
    )
    size = out.stack * sum(term.size for term in out.told)
    if size != policy.layout.vector:
        raise UserError("made for another observation", key="policy", expected=size, got=policy.layout.vector)
    return out
