"""The layout of a policy's observation and action: names and shapes, checked before any weights are loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from vispeg.core.errors import UserError
from vispeg.interface.terms import POLICY, PRIVILEGED
from vispeg.task.standard_terms import TIP_IN_GOAL

MOST = 4096  # largest length of a vector, and largest side of an image in pixels
VECTOR = POLICY  # key of the vector that the actor sees; critics may see PRIVILEGED too
ESTIMATE = slice(0, TIP_IN_GOAL.size)  # entries of the ground truth that actors with images estimate: tip_in_goal
OFFSET_M = TIP_IN_GOAL.scale  # m per unit of these entries


@dataclass(frozen=True)
class Layout:
    """The shapes of a policy's observation and action.

    Attributes:
        vector: length of the observation's `policy` part.
        images: shape (C, H, W) of every image the policy sees, by key: `depth_<camera>` in metres, `rgb_<camera>` in
            0-255.
        action: length of the action.
        truth: length of the observation's `privileged` part; 0 for a policy that does not read it.
        reads: indices of the `privileged` entries that the policy reads.
    """

    vector: int
    images: Mapping[str, tuple[int, int, int]]
    action: int = 3
    truth: int = 0
    reads: tuple[int, ...] = ()

    @classmethod
    def of(
        cls, observation_space: Any, action_space: Any, kinds: tuple[str, ...], reads: tuple[int, ...] = ()
    ) -> Layout:
        """Return the layout for the spaces of a single environment.

        Args:
            observation_space: gymnasium Dict with `policy` and perhaps images.
            action_space: gymnasium Box.
            kinds: kinds of images that the policy sees, any of `depth` and `rgb`.
            reads: indices of the `privileged` entries that the policy reads.

        Raises:
            UserError: the space lacks `policy`, `privileged` where it is read, or images of one of the kinds.
        """
        spaces = getattr(observation_space, "spaces", {})
        for key in (VECTOR, PRIVILEGED) if reads else (VECTOR,):
            if key not in spaces:
                raise UserError("the environment's observation lacks a part", expected=key, got=sorted(spaces))
        images = {}
        for kind in kinds:
            matching = {key: tuple(space.shape) for key, space in spaces.items() if key.startswith(f"{kind}_")}
            if not matching:
                raise UserError("the environment gives no such images", expected=f"{kind}_<camera>", got=sorted(spaces))
            images |= matching
        truth = spaces[PRIVILEGED].shape[0] if reads else 0
        return cls(spaces[VECTOR].shape[0], images, action_space.shape[-1], truth, reads)

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of the observation that the policy reads, in order."""
        return (*self.vectors, *self.images)

    @property
    def vectors(self) -> dict[str, int]:
        """Length of every part that is not an image, by key, in order."""
        return {VECTOR: self.vector, **({PRIVILEGED: self.truth} if self.truth else {})}

    def check(self, obs: Mapping[str, Any]) -> None:
        """Check that an observation has this layout. `obs` holds arrays with one leading axis.

        Raises:
            UserError: a key is missing or has another shape.
        """
        for key, shape in self.shapes.items():
            if key not in obs:
                raise UserError("the observation lacks a part that the policy needs", key=key, got=sorted(obs))
            if tuple(obs[key].shape[1:]) != shape:
                raise UserError("made for another observation", key=key, expected=shape, got=tuple(obs[key].shape[1:]))

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shape of every part, without the leading axis."""
        vectors = {key: (length,) for key, length in self.vectors.items()}
        return {**vectors, **{key: tuple(shape) for key, shape in self.images.items()}}

    def to_json(self) -> Mapping[str, object]:
        """Return the layout as JSON data, which `from_json` reads."""
        return {
            "vector": self.vector,
            "images": {key: list(shape) for key, shape in self.images.items()},
            "action": self.action,
            **({"truth": self.truth, "reads": list(self.reads)} if self.truth else {}),
        }

    @classmethod
    def from_json(cls, entries: Mapping[str, Any]) -> Layout:
        """Return the layout that `to_json` wrote. Raises UserError where an entry is missing or invalid."""
        try:
            images = {str(key): _chw(shape) for key, shape in entries["images"].items()}
            lengths = [_count(entries["vector"], 1), _count(entries["action"], 1), _count(entries.get("truth", 0), 0)]
            reads = tuple(_count(entry, 0) for entry in entries.get("reads", ()))
            if reads and max(reads) >= lengths[2]:
                raise ValueError(reads)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise UserError(
                "not a policy's layout", key="layout", expected="vector, images, action", got=entries
            ) from error
        return cls(lengths[0], images, lengths[1], lengths[2], reads)


def _chw(shape: Any) -> tuple[int, int, int]:
    channels, height, width = (_count(size, 1) for size in shape)
    return channels, height, width


def _count(value: Any, least: int) -> int:
    """Return the value. Raises ValueError unless it is a whole number from `least` to MOST."""
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= MOST:
        raise ValueError(value)
    return value
