"""Kinds of actions, and their conversion to the commands of a task's controller.

The controller takes an `offset`: the displacement of the tip from its measured position, along the directions that the
policy moves, as shares of the greatest step. Joint angles, and positions and displacements of the tip in SI units, are
converted to an offset by the arm's kinematics. The conversion loses which posture of the arm reaches a pose, and
rotations of a tool that the task holds straight. Offsets beyond +-1 are cut later, see `Observer.asked`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.chain import Chain
from vispeg.interface.observer import Observer, Settings

OFFSET = "offset"
JOINT_GOAL, JOINT_DELTA, TIP_GOAL, TIP_DELTA = "joint_goal", "joint_delta", "tip_goal", "tip_delta"
KINDS: Mapping[str, str] = {
    OFFSET: "displacement of the tip from where it is measured, within +-1, as the task's own policies act",
    JOINT_GOAL: "angles of the joints, rad",
    JOINT_DELTA: "angles of the joints from where they are measured, rad",
    TIP_GOAL: "place of the tip in the base, m; or place and quaternion w x y z of the flange's turn",
    TIP_DELTA: "displacement of the tip from where it is measured, m, base axes; "
    "or that and the turn's rotation vector, rad",
}
STATED = "?action="  # separates the name of a policy or of demonstrations from the kind of their actions
MOST = 4 * np.pi  # rad, greatest angle of a joint; larger numbers can only be in degrees
OBSERVED = "observation."  # prefix of the features that LeRobot's policies observe
POSITION = ".pos"  # suffix of a motor's name in LeRobot's recordings
TIP = ("tip_x", "tip_y", "tip_z")  # names of an action's entries that mean TIP_GOAL


def split(text: str) -> tuple[str, str | None]:
    """Split a text NAME?action=KIND into the name and the kind of actions; None if no kind is stated."""
    place, stated, kind = text.partition(STATED)
    return place, kind if stated else None


def checked(kind: Any, source: Any = None) -> str:
    """Return a kind of action unchanged. Raises UserError, which names the file `source`, for an unknown one."""
    if kind not in KINDS:
        raise UserError("no such kind of action", file=source, key="action", got=kind, choices=KINDS)
    return kind


def entries(names: Any) -> tuple[str, ...]:
    """Return the names of a feature's numbers in a LeRobot data set; () if it has none.

    LeRobot writes a list of names, or a mapping to lists of names.
    """
    if isinstance(names, Mapping):
        names = [name for part in names.values() for name in (part if isinstance(part, list | tuple) else [])]
    return tuple(map(str, names)) if isinstance(names, list | tuple) else ()


def observed(features: Mapping[str, Any]) -> dict[str, tuple[str, int]]:
    """Return name -> (feature, column) for each named number in the observations of a data set's features."""
    places: dict[str, tuple[str, int]] = {}
    for feature, what in features.items():
        if feature.startswith(OBSERVED) and len(what["shape"]) == 1:
            for i, entry in enumerate(entries(what["names"])):
                places.setdefault(entry.removesuffix(POSITION), (feature, i))
    return places


def columns_of(names: Sequence[str], wanted: Sequence[str]) -> list[int] | None:
    """Return the indices of the wanted names in `names`, with or without the suffix `.pos`; None if one is missing."""
    places = {name.removesuffix(POSITION): i for i, name in enumerate(names)}
    return [places[name] for name in wanted] if all(name in places for name in wanted) else None


class Actions:
    """The meaning of a policy's actions on an arm.

    Args:
        kind: a key of KINDS; None to infer it from the names and the number of entries.
        settings: of the task.
        chain: the arm's kinematics, as its controller knows them.
        tip: height of the tip below the flange, m.
        joints: names of the arm's joints.
        names: of an action's entries; empty if they have none.
        width: number of an action's entries; None if not known.
        source: the file that states the kind, for errors.

    Attributes:
        kind: a key of KINDS.

    Raises:
        UserError: an unknown kind, a wrong number of entries for the kind, or a kind that cannot be inferred.
    """

    def __init__(
        self,
        kind: str | None,
        settings: Settings,
        chain: Chain,
        tip: float,
        joints: Sequence[str],
        *,
        names: Sequence[str] = (),
        width: int | None = None,
        source: Any = None,
    ):
        self.settings, self.chain, self.length, self.joints = settings, chain, tip, tuple(joints)
        known = self._inferred(names, width) if kind is None else checked(kind, source)
        if known is None:
            got = ", ".join(names) or f"{width} numbers"
            raise UserError(
                "the meaning of its actions is not stated", file=source, key="action", got=got, choices=KINDS
            )
        self.kind = known
        # if actions have further entries, such as a gripper's, use only those of the joints
        columns = columns_of(names, self.joints) if known in (JOINT_GOAL, JOINT_DELTA) else None
        self._columns = slice(None) if columns is None else np.array(columns)
        self._entries = None if columns is None else len(names)
        if width is not None:
            self.check(width, source)

    def _inferred(self, names: Sequence[str], width: int | None) -> str | None:
        """Return the kind of actions with these entries; None if it cannot be inferred."""
        if not names or tuple(names) == tuple(self.settings.dof):
            return OFFSET if width in (None, len(self.settings.dof)) else None
        if columns_of(names, self.joints) is not None:
            return JOINT_GOAL
        if len(names) == len(self.joints) and all(name.endswith(POSITION) for name in names):
            return JOINT_GOAL
        return TIP_GOAL if tuple(names) == TIP else None

    @property
    def widths(self) -> tuple[int, ...]:
        """The numbers of entries that an action may have."""
        each = {OFFSET: (len(self.settings.dof),), TIP_GOAL: (3, 7), TIP_DELTA: (3, 6)}
        return each.get(self.kind, (self._entries or len(self.joints),))

    def check(self, width: int, source: Any = None) -> None:
        """Raise UserError if actions of this kind cannot have `width` entries."""
        if width not in self.widths:
            expected = f"{' or '.join(map(str, self.widths))} numbers: {KINDS[self.kind]}"
            raise UserError(f"no {self.kind}", file=source, key="action", expected=expected, got=width)

    def offset(self, action: np.ndarray, here: Observer) -> np.ndarray:
        """Convert actions to offsets as the controller takes them.

        Args:
            action: (n, k).
            here: observer of the n arms, which has stored their present state (see `seen`).

        Returns:
            Offsets (n, len(dof)), not yet cut to +-1.

        Raises:
            UserError: a quaternion of length 0, or angles that can only be in degrees.
        """
        action = np.asarray(action, float)
        if self.kind == OFFSET:
            return action
        if self.kind == TIP_DELTA:
            motion = np.zeros((here.n, 6))
            motion[:, : action.shape[1]] = action
            motion /= np.repeat([self.settings.offset, self.settings.turn], 3)
        elif self.kind == TIP_GOAL:
            length = np.linalg.norm(action[:, 3:], axis=1, keepdims=True)
            if action.shape[1] > 3 and not length.all():
                raise UserError("a quaternion of length 0", key="action", got=[0.0] * 4)
            motion = here.offset_to(action[:, :3], action[:, 3:] / length if action.shape[1] > 3 else None)
        else:
            goal = action[:, self._columns]
            if np.abs(goal).max() > MOST:
                got = float(np.abs(goal).max())
                raise UserError("angles of more than two turns", key="action", expected="rad", got=got)
            there = self.seen(goal if self.kind == JOINT_GOAL else here.measured[0] + goal)
            motion = here.offset_to(there.tip(), there.turn)
        return motion[:, here.places]

    def seen(self, q: np.ndarray) -> Observer:
        """Return an observer of n arms at rest at the measured angles q (n, nj) rad."""
        q = np.asarray(q, float)
        observer = Observer(self.settings, self.chain, self.length, weight=np.zeros(3), size=0, n=len(q))
        observer.see(q, np.zeros_like(q))
        return observer
