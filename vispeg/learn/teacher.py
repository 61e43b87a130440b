"""Teachers: policies that know where the goal is, shown what their students see."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vispeg.core.errors import UserError
from vispeg.learn.layout import PRIVILEGED, VECTOR
from vispeg.learn.modalities import modality
from vispeg.learn.policy import load
from vispeg.render.image_kinds import GOAL_TOLD
from vispeg.task.registry import task_of
from vispeg.task.scripted import Scripted
from vispeg.task.terms import Observation


class Teacher(Protocol):
    """Says what to do in a student's environment."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of n episodes, or of those rows (n,) bool that are reset."""
        ...

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Give a student's observation with ground truth (n, ...) -> actions (n, action) within +-1."""
        ...


def knowing(obs: Mapping[str, np.ndarray], observed: Observation) -> dict[str, np.ndarray]:
    """Give a student's observation as a `state` policy would have it that believes the truth about the goal.

    A student's relative position counts from the goal's nominal place; a teacher's from where the goal is. The two
    differ by the goal's displacement, the same in every stacked observation. Who believes the truth makes no mistake
    about the goal, and of the ground truth that part is 0.

    Args:
        obs: `policy` (n, stack size) and `privileged` (n, k) at least.
        observed: the task's terms, `goal_away` in the unit of `tip`.
    """
    stack = obs[VECTOR].reshape(len(obs[VECTOR]), -1, observed.policy_size).copy()
    stack[:, :, observed["tip"]] -= obs[PRIVILEGED][:, None, observed["goal_away"]]
    truth = obs[PRIVILEGED].copy()
    truth[:, observed["mistake"]] = 0.0
    return {VECTOR: stack.reshape(obs[VECTOR].shape).astype(np.float32), PRIVILEGED: truth}


class Tare:
    """Takes the wrist sensor's zero off what is read: the mean reading of the episode's steps without contact.

    A policy of exact readings is ruined by a zero that is off by one newton. A robot's driver tares its sensor in free
    air; a teacher knows from the ground truth when that is.
    """

    def __init__(self, observed: Observation) -> None:
        self.wrench = slice(observed["force"].start, observed["torque"].stop)
        self.begin(0)

    def begin(self, n: int, rows: np.ndarray | None = None) -> None:
        """Forgets n episodes, or those rows (n,) bool of them."""
        if rows is None:
            self.age, self.free, self.sum = np.zeros(n, int), np.zeros(n), np.zeros((n, 6))
        else:
            self.age[rows], self.free[rows], self.sum[rows] = 0, 0.0, 0.0

    def __call__(self, stack: np.ndarray, touch: np.ndarray) -> np.ndarray:
        """Give the stack with its readings tared. To be asked once a step.

        Args:
            stack: (n, depth, size) observations, newest first. What an episode begins with is no reading and stays.
            touch: (n, 3) contact force, 0 without contact.
        """
        if len(stack) != len(self.age):
            self.begin(len(stack))
        free = (self.age > 0) & (touch == 0).all(axis=1)
        self.free += free
        self.sum[free] += stack[free, 0, self.wrench]
        zero = self.sum / np.maximum(self.free, 1)[:, None]
        read = np.arange(stack.shape[1]) < self.age[:, None]
        tared = stack.copy()
        tared[:, :, self.wrench] -= np.where(read[:, :, None], zero[:, None], 0.0)
        self.age += 1
        return tared


class StateTeacher:
    """A state policy, or the scripted expert, as the teacher of students that do not know the goal.

    Args:
        policy: with `reset(n, rows)` and `act(obs)`.
        observed: the task's terms.
    """

    def __init__(self, policy: Any, observed: Observation):
        self.policy, self.observed, self.tare = policy, observed, Tare(observed)

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """See Teacher."""
        self.policy.reset(n, rows)
        self.tare.begin(n, rows)

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """See Teacher; to be asked once a step."""
        informed = knowing(obs, self.observed)
        stack = informed[VECTOR].reshape(len(informed[VECTOR]), -1, self.observed.policy_size)
        tared = self.tare(stack, obs[PRIVILEGED][:, self.observed["contact"]])
        return self.policy.act(informed | {VECTOR: tared.reshape(informed[VECTOR].shape)})


def teacher_of(source: str | Path, config: Any) -> StateTeacher:
    """Give a teacher for students of a task.

    Args:
        source: folder of a policy of modality `state` or `privileged`, or `expert` for the scripted one.
        config: the task's TaskConfig.

    Raises:
        UserError: not a policy, one that does not know the goal, or one that was made for another stack of
            observations.
    """
    observed = Observation(task_of(config).terms, config)
    size = observed.policy_size
    if str(source) == "expert":
        return StateTeacher(Scripted(config), observed)
    policy = load(source)
    if modality(policy.modality).obs_mode not in GOAL_TOLD:
        expected = "a policy of modality state or privileged"
        raise UserError("a teacher knows the state", file=source, expected=expected, got=policy.modality)
    if policy.actor.layout.vector != config.stack * size:
        raise UserError(
            "the teacher was made for another stack of observations or other directions of motion",
            file=source,
            expected=config.stack * size,
            got=policy.actor.layout.vector,
        )
    return StateTeacher(policy, observed)
