"""The meaning of a policy's inputs and outputs: observation terms, images, actions, arm, tool, goal and controller.

An exported file contains it (`vispeg-interface/1`, docs/formats.md), so that the policy can run without other files.
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
from vispeg.interface.observer import RECENT, Observer
from vispeg.interface.terms import FELT, LIMIT, SENSED, Sensed
from vispeg.render.cameras.camera import Camera
from vispeg.render.image_kinds import KINDS

FORMAT = "vispeg-interface/1"
KEY = "vispeg"  # key of the interface in an ONNX file's metadata
OFFSET = "offset from the measured pose"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Vec3 = Annotated[tuple[Finite, ...], Field(min_length=3, max_length=3)]
Six = Annotated[tuple[Finite, ...], Field(min_length=6, max_length=6)]
Count = Annotated[int, Field(ge=1, le=4096)]
Open = Annotated[float, BeforeValidator(lambda value: np.inf if value is None else value)]  # null: no limit


class NoInterface(UserError):
    """A policy that cannot run on a robot: its observations or actions need the simulation, or its world is missing."""


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="allow")


class Told(_Part):
    """A term of the observation's vector part, see `vispeg.interface.terms.Sensed`.

    Attributes:
        name: of the term.
        size: how many numbers it has.
        unit: of these numbers.
        scale: by which they are divided.
        about: what they are.
    """

    name: str
    size: Count
    unit: str
    scale: Positive
    about: str = ""


class Seen(_Part):
    """An image of the observation.

    Attributes:
        kind: see `vispeg.render.image_kinds`.
        unit: of its values.
        shape: (C, H, W).
        camera: arguments of the Camera that takes it; its pose is in the frame of its `parent`, with OpenCV axes.
    """

    kind: str
    unit: str
    shape: tuple[Count, Count, Count]
    camera: dict[str, Any]

    @cached_property
    def eye(self) -> Camera:
        """The camera that takes the image. Raises UserError: wrong arguments of a camera."""
        try:
            return Camera(**self.camera)
        except TypeError as error:
            raise UserError(f"not a camera ({error})", key="images") from None


class Arm(_Part):
    """The arm as its controller knows it; a limit of null is not known.

    Attributes:
        robot: name or path of its model.
        joints: names, in order.
        low_rad, high_rad: limits of the angles.
        velocity_limit, torque_limit: largest speed, rad/s, and torque, N m.
        home_rad: angles at home.
        chain: kinematics from base to flange, see `vispeg.interface.chain.Chain`.
    """

    robot: str
    joints: Annotated[tuple[str, ...], Field(min_length=1)]
    low_rad: tuple[Annotated[float, BeforeValidator(lambda v: -np.inf if v is None else v)], ...]
    high_rad: tuple[Open, ...]
    velocity_limit: tuple[Open, ...]
    torque_limit: tuple[Open, ...]
    home_rad: tuple[Finite, ...]
    chain: dict[str, Any]


class Tool(_Part):
    """The tool and the held part.

    Attributes:
        name: of the tool.
        tip_m: height of the tip below the flange.
        weight_n: weight that the wrist's sensor carries at rest, base axes.
        mass_kg, com_m, inertia_kgm2: mass, centre of mass and inertia of everything that the flange carries, flange
            axes.
    """

    name: str = ""
    tip_m: Finite
    weight_n: Vec3
    mass_kg: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    com_m: Vec3
    inertia_kgm2: Vec3

    def weight_at(self, turn: np.ndarray) -> np.ndarray:
        """Return the wrench (6,) N, N m of the weight on the flange, in its axes; `turn` (3, 3) is flange to base."""
        force = turn.T @ self.weight_n
        return np.concatenate([force, np.cross(self.com_m, force)])


class Controller(_Part):
    """The controller that holds the flange, with the wrench `Lambda (kp e - kd v)`.

    Attributes:
        law: its name.
        period_s: time between two commands.
        kp, kd: gains per unit of mass and inertia, x y z, then rotation, 1/s^2 and 1/s.
        force_limit_n: bound of the commanded force.
        nullspace: gains and angles of the law in the null space, as in a recording.
        avoid_limits: gain of the law that keeps joints from their limits, 1/s^2; 0 for none.
        gravity_compensation: the model's gravity is added.
    """

    law: Literal["operational space"] = "operational space"
    period_s: Positive
    kp: Six
    kd: Six
    force_limit_n: Positive
    nullspace: dict[str, Any]
    avoid_limits: Finite = 0.0
    gravity_compensation: Literal["model"] = "model"


class Goal(_Part):
    """The goal and its surroundings.

    Attributes:
        nominal_m: nominal position of the goal in the base.
        told: whether the policy is told where the goal is believed to be; otherwise it is told the nominal position.
        reached_m: position of the tip in the goal's frame that the task asks for.
        within_m: greatest distance of the tip from the goal's axis at which it counts as there; None if not stated.
        cell: settings of the believed cell, as in a recording.
    """

    nominal_m: Vec3
    told: bool
    reached_m: Vec3
    within_m: Positive | None = None
    cell: dict[str, Any] = {}


class Interface(_Part):
    """Everything that is needed to run a policy on an arm. Numbers are in SI units.

    Attributes:
        format: name and version of the format.
        task, title: the task's name, and the task as an instruction in a sentence.
        modality: of the policy.
        told: terms of the observation's part `policy`, in order. Each is divided by its scale and cut to +-`limit`.
        limit: see `told`.
        stack: number of time steps that the part `policy` holds, newest first. At an episode's begin the first one is
            repeated.
        images: images of the observation by key.
        recurrent: width of the policy's memory; 0 for none.
        dof: directions that an action moves.
        offset_m, turn_rad: displacement and rotation for an action of 1.
        action: kind of the network's actions, a key of `vispeg.interface.actions.KINDS`.
        law: how an offset becomes a target, see `Observer.offset_by`.
        policy_period_s: time between two actions.
        steps: actions in an episode.
        wrench_periods: number of control periods over which the wrench is averaged.
        arm, tool, goal, controller: see these classes.
        force_abort_n: contact force above which an episode ends.
        start_height_m, start_radius_m: start of the tip in training, relative to the nominal goal: lowest and highest
            height above it, greatest offset to the side.
        world, world_hash: the world in which the policy was trained, and its hash.
        world_hashes, world_parts: hashes of all worlds in which it was trained or fine-tuned, and hash -> file name of
            each part that these are composed of.
        policy: hash of the policy's folder.
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
    world_hashes: tuple[str, ...] = ()
    world_parts: dict[str, str] = {}
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
        """The same as `offset_m`, for `vispeg.interface.observer.Settings`."""
        return self.offset_m

    @property
    def turn(self) -> float:
        """The same as `turn_rad`, for `vispeg.interface.observer.Settings`."""
        return self.turn_rad

    @property
    def feels(self) -> bool:
        """Whether the policy observes force or torque."""
        return any(term.name in FELT for term in self.told)

    @property
    def ticks(self) -> int:
        """Control periods per action."""
        return round(self.policy_period_s / self.controller.period_s)

    @cached_property
    def chain(self) -> Chain:
        """The arm's kinematics. Raises UserError: wrong data."""
        return Chain.from_json(self.arm.chain)

    def flange(self, q: np.ndarray) -> np.ndarray:
        """Return the flange pose (7,), m and w x y z in the base, at joint angles (nj,) rad."""
        pos, turn, _, _ = self.chain.pose(q[None], 0 * q[None])
        return np.concatenate([pos[0], turn[0]])

    @cached_property
    def terms(self) -> tuple[Sensed, ...]:
        """The terms, with the scales of this interface. Raises NoInterface: a term that is not in `SENSED`."""
        out = []
        for told in self.told:
            if told.name not in SENSED:
                raise NoInterface("a term that only its own task knows", key="told", got=told.name, choices=SENSED)
            known = SENSED[told.name]
            out.append(Sensed(told.name, known.read, told.size, told.unit, told.scale, told.about))
        return tuple(out)

    def observer(self, n: int = 1) -> Observer:
        """Return an observer of `n` such arms. Raises NoInterface: the task has its own law for actions."""
        if self.law != OFFSET:
            raise NoInterface("actions of a task's own law", key="law", expected=OFFSET, got=self.law)
        size = sum(told.size for told in self.told)
        return Observer(self, self.chain, self.tool.tip_m, np.array(self.tool.weight_n), size, n)

    def text(self) -> str:
        """Return the interface as JSON, from which `read` restores it exactly."""
        return json.dumps(_plain(self.model_dump()), allow_nan=False)


def read(text: str, file: Any) -> Interface:
    """Read an interface from JSON text, such as a file's metadata.

    Args:
        text: JSON.
        file: for errors.

    Raises:
        UserError: not JSON, or an entry that is missing or impossible; it names the file and the key.
    """
    try:
        data = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise UserError("not JSON", file=file, key=KEY, got=str(error)) from None
    out = typed(Interface, data, file)
    arm = out.arm
    for key in ("low_rad", "high_rad", "velocity_limit", "torque_limit", "home_rad"):
        if len(getattr(arm, key)) != len(arm.joints):
            raise UserError("not one per joint", file=file, key=f"arm.{key}", expected=len(arm.joints))
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
    """Return data with null in place of infinite numbers, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and np.isinf(value) else value
