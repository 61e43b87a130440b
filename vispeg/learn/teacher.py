"""Teachers: policies that know where the goal is, and act on their students' observations plus ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from vispeg.core.errors import UserError
from vispeg.interface.terms import LIMIT, PRIVILEGED
from vispeg.learn.layout import VECTOR
from vispeg.learn.meta import interface, refuse_other_actions
from vispeg.learn.modalities import modality
from vispeg.learn.policy import load
from vispeg.render.image_kinds import GOAL_TOLD
from vispeg.task.registry import task_of
from vispeg.task.scripted import Scripted
from vispeg.task.terms import Observation


class Teacher(Protocol):
    """The interface of a teacher: it acts on a student's observations."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of all n rows, or only of those where `rows` (n,) is True."""
        ...

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return actions (n, action) within +-1 for a student's observation with ground truth (n, ...)."""
        ...


def knowing(obs: Mapping[str, np.ndarray], observed: Observation) -> dict[str, np.ndarray]:
    """Return a student's observation as a `state` policy would see it that is told the goal's true place.

    A student's tip position is relative to the believed place of the goal, a teacher's to the true one. The two differ
    by the error of the believed place (`mistake`), the same in every stacked observation. An error beyond the range of
    that term is a blind student's, who believes the nominal place: there it is minus the goal's displacement
    (`goal_away`). The error is set to 0 in the ground truth.

    Args:
        obs: `policy` (n, stack * size) and `privileged` (n, k) at least.
        observed: the task's terms; `goal_away` must have the scale of `tip`, `mistake` may have another.
    """
    stack = obs[VECTOR].reshape(len(obs[VECTOR]), -1, observed.policy_size).copy()
    mistake, away = (obs[PRIVILEGED][:, None, observed[name]] for name in ("mistake", "goal_away"))
    near = mistake * (observed.term("mistake").scale / observed.term("tip").scale)
    stack[:, :, observed["tip"]] += np.where(np.abs(mistake) < LIMIT, near, -away)
    truth = obs[PRIVILEGED].copy()
    truth[:, observed["mistake"]] = 0.0
    return {VECTOR: stack.reshape(obs[VECTOR].shape).astype(np.float32), PRIVILEGED: truth}


class Tare:
    """Subtract the wrist sensor's offset from its readings: the mean over the episode's steps without contact.

    An offset of one newton ruins a policy that was trained on exact readings. A robot's driver tares its sensor in
    free air; a teacher knows from the ground truth when there is no contact.
    """

    def __init__(self, observed: Observation) -> None:
        self.wrench = slice(observed["force"].start, observed["torque"].stop)
        self.begin(0)

    def begin(self, n: int, rows: np.ndarray | None = None) -> None:
        """Begin new episodes in all n rows, or only in those where `rows` (n,) is True."""
        # steps of the episode, those of them without contact, and the sum of their readings
        if rows is None:
            self.age, self.free, self.sum = np.zeros(n, int), np.zeros(n), np.zeros((n, 6))
        else:
            self.age[rows], self.free[rows], self.sum[rows] = 0, 0.0, 0.0

    def __call__(self, stack: np.ndarray, touch: np.ndarray) -> np.ndarray:
        """Return the stack with its readings tared. Call this once per step.

        Args:
            stack: (n, depth, size) observations, newest first. Entries of an episode's start are not readings of the
                sensor and stay as they are.
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
    """Use a state policy, or the scripted expert, as the teacher of students that do not know the goal.

    Args:
        policy: has `reset(n, rows)` and `act(obs)`.
        observed: the task's terms.
    """

    def __init__(self, policy: Any, observed: Observation):
        self.policy, self.observed, self.tare = policy, observed, Tare(observed)

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """See Teacher."""
        self.policy.reset(n, rows)
        self.tare.begin(n, rows)

    def act(self, obs: Mapping[str, np.ndarray]) -> np.ndarray:
        """See Teacher. Call this once per step."""
        informed = knowing(obs, self.observed)
        stack = informed[VECTOR].reshape(len(informed[VECTOR]), -1, self.observed.policy_size)
        tared = self.tare(stack, obs[PRIVILEGED][:, self.observed["contact"]])
        return self.policy.act(informed | {VECTOR: tared.reshape(informed[VECTOR].shape)})


def teacher_of(source: str | Path, config: Any) -> StateTeacher:
    """Return a teacher for students of a task.

    Args:
        source: folder of a policy of modality `state` or `privileged`, or `expert` for the scripted one.
        config: the task's TaskConfig.

    Raises:
        UserError: not a policy, one that does not know the goal, or one whose observation has another length or whose
            actions have another meaning.
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
    refuse_other_actions("the teacher was made for other actions", asdict(config), interface(policy.meta), source)
    return StateTeacher(policy, observed)
