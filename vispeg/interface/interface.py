"""The meaning of a policy's numbers: what it is told, what it sees, what its actions ask for, of which arm.

An exported file carries it (`vispeg-interface/1`, docs/formats.md), so that it can be played where nothing else is.
"""

from __future__ import annotations

import json
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator

from vispeg.core.errors import UserError
from vispeg.formats.typed import typed
from vispeg.interface.actions import KINDS as ACTIONS
from vispeg.interface.actions import OFFSET as SHARE
from vispeg.interface.chain import Chain
from vispeg.interface.observer import DOF, RECENT, Observer
from vispeg.interface.terms import FELT, LIMIT, SENSED, Sensed
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import KINDS

FORMAT = "vispeg-interface/1"
KEY = "vispeg"  # of an ONNX file's metadata
OFFSET = "offset from the measured pose"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Vec3 = Annotated[tuple[Finite, ...], Field(min_length=3, max_length=3)]
Six = Annotated[tuple[Finite, ...], Field(min_length=6, max_length=6)]
Count = Annotated[int, Field(ge=1, le=4096)]
Open = Annotated[float, BeforeValidator(lambda value: np.inf if value is None else value)]  # null: no limit


class NoInterface(UserError):
    """A policy that no robot can be given: it reads or does what only simulation has, or its world is gone."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="allow")


class Told(_Part):
    """A term of the vector, see `vispeg.interface.terms.Sensed`."""

    name: str
    size: Count
    unit: str
    scale: Positive
    about: str = ""


class Seen(_Part):
    """An image (C, H, W): its kind, and the camera that takes it, px and OpenCV axes in the frame of `parent`."""

    kind: str
    unit: str
    shape: tuple[Count, Count, Count]
    camera: dict[str, Any]

    @cached_property
    def eye(self) -> Camera:
        """The camera. Raises UserError: one that cannot be."""
        try:
            return Camera(**self.camera)
        except TypeError as error:
            raise UserError(f"not a camera ({error})", key="images") from None


class Arm(_Part):
    """The arm as its controller knows it; null limits are unknown."""

    robot: str
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    low_rad: tuple[Annotated[float, BeforeValidator(lambda v: -np.inf if v is None else v)], ...]
    high_rad: tuple[Open, ...]
    velocity_limit: tuple[Open, ...]
    torque_limit: tuple[Open, ...]
    home_rad: tuple[Finite, ...]
    chain: dict[str, Any]


class Tool(_Part):
    """Height of the tip below the flange, m; what the wrist's sensor carries at rest, N in the base's axes; and mass
    (kg), centre (m) and inertia (kg m^2) of all that the flange carries, in its axes.
    """

    name: str = ""
    tip_m: Finite
    weight_n: Vec3
    mass_kg: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    com_m: Vec3
    inertia_kgm2: Vec3


class Controller(_Part):
    """The law that holds the flange: forces `Lambda (kp e - kd v)`, gains per unit mass, 1/s^2 and 1/s."""

    law: Literal["operational space"] = "operational space"
    period_s: Positive
    kp: Six
    kd: Six
    force_limit_n: Positive
    nullspace: dict[str, Any]
    avoid_limits: Finite = 0.0
    gravity_compensation: Literal["model"] = "model"


class Goal(_Part):
    """Where the goal nominally is, m in the base; whether the policy is told another place where one is believed; and
    the tip's place in the goal's frame that the task asks for, m; `cell`: what is believed to stand there, as a
    recording states it.
    """

    nominal_m: Vec3
    told: bool
    reached_m: Vec3
    cell: dict[str, Any] = {}


class Interface(_Part):
    """Everything that must be known to play a policy on an arm. Numbers in SI units.

    Attributes:
        task, title: its name, and what a person would ask for.
        modality: what the policy sees.
        told: terms of the observation's part `policy`, in order, each divided by its scale and cut to +-20.
        stack: moments of these, newest first; an episode begins with its first one repeated.
        images: further parts by key.
        recurrent: width of the policy's memory.
        dof, offset_m, turn_rad: what an action within +-1 moves, and how far 1 is.
        action: what the numbers of the network's action are, of `vispeg.interface.actions.KINDS`.
        law: how an offset becomes a target, see `Observer.offset_by`.
        policy_period_s, steps: of an action; of an episode.
        wrench_periods: control periods over whose mean the wrench is told.
        force_abort_n: contact force that ends an episode.
        start_height_m, start_radius_m: where episodes began in training, the tip above the nominal goal.
        world, world_hash, policy: where it was trained, and the hash of its folder.
    """

    format: Literal["vispeg-interface/1"] = FORMAT
    task: str
    title: str
    modality: str
    told: Annotated[tuple[Told, ...], Field(min_length=1)]
    limit: Annotated[float, Field(ge=LIMIT, le=LIMIT)] = LIMIT
    stack: Count
    images: dict[str, Seen] = {}
    recurrent: Annotated[int, Field(ge=0)] = 0
    dof: Annotated[tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...], Field(min_length=1)]
    offset_m: Positive
    turn_rad: Positive
    action: str = SHARE
    law: str = OFFSET
    policy_period_s: Positive
    steps: Count
    wrench_periods: Literal[4] = RECENT
    arm: Arm
    tool: Tool
    goal: Goal
    controller: Controller
    force_abort_n: Positive
    start_height_m: tuple[Finite, Finite]
    start_radius_m: Finite
    world: str = ""
    world_hash: str = ""
    policy: str = ""

    @field_validator("images")
    @classmethod
    def _kinds(cls, images: dict[str, Seen]) -> dict[str, Seen]:
        for key, seen in images.items():
            if seen.kind not in KINDS:
                raise ValueError(f"image {key} is of an unknown kind {seen.kind!r}")
        return images

    @field_validator("action")
    @classmethod
    def _known(cls, action: str) -> str:
        if action not in ACTIONS:
            raise ValueError(f"action is of an unknown kind {action!r}, known are {', '.join(ACTIONS)}")
        return action

    @property
    def offset(self) -> float:
        """As `offset_m`."""
        return self.offset_m

    @property
    def turn(self) -> float:
        """As `turn_rad`."""
        return self.turn_rad

    @property
    def feels(self) -> bool:
        """Whether the policy is told force or torque."""
        return any(term.name in FELT for term in self.told)

    @property
    def ticks(self) -> int:
        """Control periods of an action."""
        return round(self.policy_period_s / self.controller.period_s)

    @cached_property
    def chain(self) -> Chain:
        """The arm's kinematics. Raises UserError: no such."""
        return Chain.from_json(self.arm.chain)

    def flange(self, q: np.ndarray) -> np.ndarray:
        """Return the flange pose (7,), m and w x y z in the base, at joint angles (nj,) rad."""
        pos, turn, _, _ = self.chain.pose(q[None], 0 * q[None])
        return np.concatenate([pos[0], turn[0]])

    @cached_property
    def terms(self) -> tuple[Sensed, ...]:
        """The terms with the scales of this interface. Raises NoInterface: one that nobody here can build."""
        out = []
        for told in self.told:
            if told.name not in SENSED:
                raise NoInterface("a term that only its own task knows", key="told", got=told.name, choices=SENSED)
            known = SENSED[told.name]
            out.append(Sensed(told.name, known.read, told.size, told.unit, told.scale, told.about))
        return tuple(out)

    def observer(self, n: int = 1) -> Observer:
        """Return an observer of this arm. Raises NoInterface: actions that mean something of a task's own."""
        if self.law != OFFSET:
            raise NoInterface("actions of a task's own law", key="law", expected=OFFSET, got=self.law)
        size = sum(told.size for told in self.told)
        return Observer(self, self.chain, self.tool.tip_m, np.array(self.tool.weight_n), size, n)

    def text(self) -> str:
        """As JSON; `read` reads it to the same bits."""
        return json.dumps(_plain(self.model_dump()), allow_nan=False)


def read(text: str, file: Any) -> Interface:
    """Return the interface that a file's metadata hold.

    Raises:
        UserError: no JSON, or an entry that is missing or cannot be; names the file and the key.
    """
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise UserError("not JSON", file=file, key=KEY, got=str(error)) from None
    out = typed(Interface, data, file)
    arm = out.arm
    for key in ("low_rad", "high_rad", "velocity_limit", "torque_limit", "home_rad"):
        if len(getattr(arm, key)) != len(arm.joints):
            raise UserError("not one a joint", file=file, key=f"arm.{key}", expected=len(arm.joints))
    try:
        if sorted(out.chain.order.tolist()) != list(range(len(arm.joints))):
            raise UserError("not each joint once", key="arm.chain.order", expected=f"0 to {len(arm.joints) - 1}")
        for seen in out.images.values():
            if (seen.eye.height, seen.eye.width) != seen.shape[1:]:
                raise UserError("not the size of its camera", key="images", expected=seen.shape[1:])
    except UserError as error:
        raise UserError(str(error), file=file) from None
    return out


def _plain(value: Any) -> Any:
    """Without infinities, which JSON has not: null."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and np.isinf(value) else value


__all__ = ["DOF", "FORMAT", "KEY", "OFFSET", "Interface", "NoInterface", "read"]
