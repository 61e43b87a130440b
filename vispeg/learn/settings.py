"""Settings of soft actor-critic."""

from __future__ import annotations

from dataclasses import dataclass

from vispeg.core.errors import UserError


@dataclass(frozen=True)
class SacSettings:
    """Soft actor-critic (Haarnoja et al. 2018) with critics on ground truth.

    Attributes:
        lr: learning rate of actor, critics and temperature (Adam).
        batch: transitions per update; a recurrent actor draws batch / 32 whole episodes instead.
        gamma: discount per policy step.
        tau: share of the way that target critics move to the critics in one update.
        entropy: starting temperature; it is tuned from there towards an entropy of -1 nat an action dimension.
        utd: critic updates per environment step (update-to-data ratio).
        critic_per_actor: critic updates per actor update.
        replay: entries of the replay buffer; each transition takes one, and each episode's end one more.
        warmup: environment steps of uniformly random actions before learning.
        hidden: widths of all perceptrons.
        recurrent: width of the actor's LSTM; 0 for a feed-forward actor.
        horizon: largest number of steps of an episode that a recurrent actor learns from.
        shift: largest random shift of images, in pixels.
        symmetric: whether critics see what the actor sees, in place of ground truth; they have no memory.
        demo_fraction: share of each batch that is drawn from demonstrations, if there are any.
        clone_start, clone_end, clone_updates: weight of the imitation loss in the actor's loss; it goes linearly from
            `clone_start` to `clone_end` over `clone_updates` actor updates.
        actor_frozen: critic updates before the first actor update, for an actor that is already trained.
    """

    lr: float = 3e-4
    batch: int = 256
    gamma: float = 0.97
    tau: float = 0.005
    entropy: float = 0.01
    utd: float = 0.5
    critic_per_actor: int = 1
    replay: int = 300_000
    warmup: int = 2_000
    hidden: tuple[int, ...] = (256, 256)
    recurrent: int = 0
    horizon: int = 50
    shift: int = 2
    symmetric: bool = False
    demo_fraction: float = 0.5
    clone_start: float = 1.0
    clone_end: float = 0.1
    clone_updates: int = 20_000
    actor_frozen: int = 0

    def __post_init__(self) -> None:
        for name in ("lr", "batch", "tau", "utd", "entropy", "critic_per_actor", "replay", "horizon"):
            if not getattr(self, name) > 0:
                raise UserError("must be positive", key=name, got=getattr(self, name))
        for name in ("gamma", "demo_fraction", "tau"):
            if not 0 <= getattr(self, name) <= 1:
                raise UserError("must lie between 0 and 1", key=name, got=getattr(self, name))
        if not self.hidden or min(self.hidden) < 1:
            raise UserError("needs one width at least", key="hidden", got=self.hidden)


def defaults(sees: bool) -> SacSettings:
    """Return the default settings, for policies that see images (`sees`) or for those that do not."""
    return SacSettings(lr=1e-3, batch=128, critic_per_actor=2, replay=100_000, utd=1.0) if sees else SacSettings()
