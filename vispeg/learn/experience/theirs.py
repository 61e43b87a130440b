"""Build a policy's input from a robot's data set that `vispeg render` did not write.

`vispeg render` stores the policy's vector (`observation.policy`). Other folders in LeRobot's layout hold joint angles,
positions, velocities and wrenches, each number with a name. From these the vector is built as on a robot, with the
terms and the observer of `vispeg.interface`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

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

    def __init__(self, data: Dataset, interface: Interface, action: str | None):
        self.interface, self.folder = interface, data.folder
        self._places = observed(data.info["features"])  # value's name -> (feature, index in it)
        acted = data.info["features"].get(ACTION)
        if acted is None:
            raise UserError("has no actions", file=self.folder, key=ACTION, choices=data.info["features"])
        arm = interface.arm
        stated = {"names": entries(acted["names"]), "width": int(np.prod(acted["shape"])), "source": self.folder}
        self.actions = Actions(action, interface, interface.chain, interface.tool.tip_m, arm.joints, **stated)
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

    def _values(
        self, number: int, episode: Mapping[str, np.ndarray], names: Sequence[str], first: int = 0
    ) -> np.ndarray:
        """Return the named values of an episode's frames from the `first` on, (T - first, len(names)).

        Raises:
            UserError: one is not finite. As 0 it would be a place, a speed or a force that was not measured.
        """
        places = [self._places[name] for name in names]
        columns = [episode[f].reshape(len(episode[f]), -1)[first:, i] for f, i in places]
        return finite(np.stack(columns, axis=1).astype(float), names, self.folder, number, first)

    def read(self, number: int, episode: Mapping[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Return the policy's observation in each frame of an episode, (T, k) float32, and the intended offset (T, d).

        Args:
            number: the episode's, for errors.
            episode: its values by feature, those of `features` at least.

        Raises:
            UserError: numbers that are not finite, or actions that are not of the kind that the data set declares.
        """
        meant = episode[ACTION].reshape(len(episode[ACTION]), -1)
        o = self._observer(number, episode, len(meant))
        offset = finite(self.actions.offset(meant, o), ACTION, self.folder, number)
        executed = offset
        if self._executed:
            executed = finite(episode[EXECUTED].reshape(len(meant), -1), EXECUTED, self.folder, number)
        o.action[1:] = np.clip(executed, -1, 1)[:-1]  # of the step before; none at the first frame
        values, stack = scaled(self.interface.terms, o), Stack(self.interface.stack, o.n, o.stack.values.shape[-1])
        for back in range(self.interface.stack):
            stack.values[back] = values[np.maximum(np.arange(o.n) - back, 0)]
        return policy_part(stack), offset

    def _observer(self, number: int, episode: Mapping[str, np.ndarray], n: int) -> Observer:
        """Return an observer with one row for each of the episode's n frames; `number` is the episode's, for errors."""
        o = self.interface.observer(n)
        o.believed[:] = self.interface.goal.nominal_m
        if self._has(self.joints):
            q = self._values(number, episode, self.joints)
            if np.abs(q).max() > MOST:
                got = float(np.abs(q).max())
                raise UserError(
                    "angles of more than two turns", file=self.folder, key="joints", expected="rad", got=got
                )
            dq = self._values(number, episode, self.speeds) if self._has(self.speeds) else np.zeros_like(q)
            o.see(q, dq)
        else:
            o.flange, o.turn = self._values(number, episode, TIP) + [0, 0, o.length], np.tile(DOWN, (n, 1))
            o.twist = np.zeros((n, 6))
        if self._has(VELOCITY):
            o.twist[:, :3] = self._values(number, episode, VELOCITY)
        for part in (slice(0, 3), slice(3, 6)):
            if self._has(WRENCH[part]):
                # as on a robot, 0 at the first frame
                o.wrench[1:, part] = self._values(number, episode, WRENCH[part], first=1)
        return o


def finite(values: np.ndarray, names: str | Sequence[str], folder: Path, number: int, first: int = 0) -> np.ndarray:
    """Return an episode's values (T, n), which must be finite.

    Args:
        values: to be checked.
        names: of the feature, or of each of its n values.
        folder: of the data set, for the error.
        number: the episode's, for the error.
        first: the frame to which the first row belongs.

    Raises:
        UserError: a value is not finite; the error names it, its episode and its frame.
    """
    if len(bad := np.argwhere(~np.isfinite(values))):
        frame, column = bad[0].tolist()
        name, got = names if isinstance(names, str) else names[column], float(values[frame, column])
        where = f"{name}, episode {number}, frame {first + frame}"
        raise UserError("is not finite", file=folder, key=where, expected="a number", got=got)
    return values
