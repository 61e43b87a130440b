"""Build a policy's input from a robot's data set that `vispeg render` did not write.

`vispeg render` stores the policy's vector (`observation.policy`). Other folders in LeRobot's layout hold joint angles,
positions, velocities and wrenches, each number with a name. From these the vector is built as on a robot, with the
terms and the observer of `vispeg.interface`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from vispeg.core.errors import UserError
from vispeg.datasets.read import Dataset
from vispeg.demonstrations.plan import TASK_STATE
from vispeg.interface.actions import JOINT_DELTA, JOINT_GOAL, MOST, Actions, entries, observed
from vispeg.interface.interface import Interface
from vispeg.interface.observer import DOWN, Observer, Stack
from vispeg.interface.terms import policy_part, scaled

ACTION, EXECUTED = "action", "executed.action"
TIP, VELOCITY, WRENCH = TASK_STATE[:3], TASK_STATE[3:6], TASK_STATE[6:]
RATE = 0.05  # largest relative difference of a folder's frame rate: LeRobot's are whole, so 6 Hz in place of 6.25 Hz


class Theirs:
    """Read another program's data set as the observations and actions of one of our policies.

    Args:
        data: the data set.
        interface: the policy's interface.
        action: the kind of the data set's actions; None for the kind that their names tell.

    Attributes:
        features: names of the features that `read` needs.
        actions: the meaning of the data set's actions.

    Raises:
        UserError: it lacks a value that the policy observes, has another rate, or its actions are of no known kind.
    """

    def __init__(self, data: Dataset, interface: Interface, action: str | None = None):
        self.interface, self.folder = interface, data.folder
        self._places = observed(data.info["features"])  # value's name -> (feature, index in it)
        acted = data.info["features"].get(ACTION)
        if acted is None:
            raise UserError("has no actions", file=self.folder, key=ACTION, choices=data.info["features"])
        i, arm = interface, interface.arm
        stated = {"names": entries(acted["names"]), "width": int(np.prod(acted["shape"])), "source": self.folder}
        self.actions = Actions(action, i, i.chain, i.tool.tip_m, arm.joints, **stated)
        self.joints, self.speeds = arm.joints, tuple(f"{joint}.vel" for joint in arm.joints)
        self._executed = EXECUTED in data.info["features"]
        self._check(data.info["fps"])
        wanted = (*self.joints, *self.speeds, *TASK_STATE)
        read = [self._places[name][0] for name in wanted if name in self._places]
        acts = [ACTION, EXECUTED] if self._executed else [ACTION]
        self.features: list[str] = list(dict.fromkeys([*read, *acts]))

    def _check(self, rate: float) -> None:
        """Raise UserError where the frame rate (Hz) differs, or the folder lacks values for one of the terms."""
        period = self.interface.policy_period_s
        if abs(rate * period - 1) > RATE:
            raise UserError(
                "frames at another rate than the policy acts", file=self.folder, expected=1 / period, got=rate
            )
        joints = (self.joints,)
        # term -> the groups of values of which one suffices
        needs: dict[str, Sequence[Sequence[str]]] = {"tip": (self.joints, TIP), "turn": joints}
        needs |= {"velocity": (VELOCITY, (*self.joints, *self.speeds)), "spin": ((*self.joints, *self.speeds),)}
        needs |= {"force": (WRENCH[:3],), "torque": (WRENCH[3:],)}
        asked = {term.name: needs[term.name] for term in self.interface.terms if term.name in needs}
        if self.actions.kind in (JOINT_GOAL, JOINT_DELTA):
            asked[f"action ({self.actions.kind})"] = joints
        for term, ways in asked.items():
            if not any(self._has(way) for way in ways):
                raise UserError(
                    f"lacks what the policy needs for its {term}",
                    file=self.folder,
                    expected=" or ".join(" ".join(way) for way in ways),
                    choices=sorted(self._places),
                )

    def _has(self, names: Sequence[str]) -> bool:
        return all(name in self._places for name in names)

    def _values(self, episode: Mapping[str, np.ndarray], names: Sequence[str]) -> np.ndarray:
        """Return the named values of an episode's frames, (T, len(names))."""
        places = [self._places[name] for name in names]
        return np.stack([episode[f].reshape(len(episode[f]), -1)[:, i] for f, i in places], axis=1).astype(float)

    def read(self, episode: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the policy's observation in each frame of an episode, (T, k) float32, and the intended offset (T, d).

        Raises:
            UserError: numbers that are not finite, or actions that are not of the kind that the data set declares.
        """
        meant = episode[ACTION].reshape(len(episode[ACTION]), -1)
        o = self._observer(episode, len(meant))
        offset = self.actions.offset(meant, o)
        if not np.isfinite(offset).all():
            raise UserError("actions that are not finite", file=self.folder, key=ACTION)
        done = episode[EXECUTED].reshape(len(meant), -1) if self._executed else offset
        o.action[1:] = np.clip(done, -1, 1)[:-1]  # of the step before; none at the first frame
        values, stack = scaled(self.interface.terms, o), Stack(self.interface.stack, o.n, o.stack.values.shape[-1])
        for back in range(self.interface.stack):  # as on a robot, what is not a number becomes 0 (`Stack.push`)
            stack.values[back] = np.nan_to_num(values[np.maximum(np.arange(o.n) - back, 0)])
        return policy_part(stack), offset

    def _observer(self, episode: Mapping[str, np.ndarray], n: int) -> Observer:
        """Return an observer with one row for each of the episode's n frames."""
        o = self.interface.observer(n)
        o.believed[:] = self.interface.goal.nominal_m
        if self._has(self.joints):
            q = self._values(episode, self.joints)
            if np.abs(q).max() > MOST:
                got = float(np.abs(q).max())
                raise UserError(
                    "angles of more than two turns", file=self.folder, key="joints", expected="rad", got=got
                )
            dq = self._values(episode, self.speeds) if self._has(self.speeds) else np.zeros_like(q)
            o.see(q, dq)
        else:
            o.flange, o.turn = self._values(episode, TIP) + [0, 0, o.length], np.tile(DOWN, (n, 1))
            o.twist = np.zeros((n, 6))
        if self._has(VELOCITY):
            o.twist[:, :3] = self._values(episode, VELOCITY)
        for part in (slice(0, 3), slice(3, 6)):
            if self._has(WRENCH[part]):
                o.wrench[1:, part] = self._values(episode, WRENCH[part])[1:]  # as on a robot, 0 at the first frame
        return o
