"""The interface of an effect: one physical phenomenon with named parameters, which vanishes at their null values."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal, get_args

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.core.params import Param, Value
from vispeg.core.registry import Registry

Family = Literal["joint", "drive", "sensor", "body", "contact", "task", "camera", "appearance"]
ARM = ("joint", "drive", "sensor", "body")  # families that an arm alone can show; the others need a scene
STAGES = ("free air", "geometry", "compliance", "friction", "impact")  # of a diagnosis of contact, in order
FAMILIES: tuple[Family, ...] = get_args(Family)
OPTICAL = ("camera", "appearance")  # families that affect only images; the others affect the physics
Values = Mapping[str, np.ndarray]  # parameter name -> (nsim, ntarget)
REGISTRY: Registry[Effect] = Registry("effect", "vispeg.effects")


class Effect(ABC):
    """One physical or optical phenomenon. A subclass is one file; it registers itself under `name`.

    Every hook works on all simulations of a batch at once: `p[name]` has shape (nsim, ntarget), where a target is one
    of `targets(model)` and simulations without the effect carry the null value. `x` is the batch at the present physics
    step (`vispeg.sim.state.DriveState`), and `state` what `start` returned. A hook that is not overridden is never
    called. All arrays are SI and radians; joint arrays are (nsim, nj).

    Class attributes:
        name: the name in model files.
        family: the folder of `vispeg/effects` in which it is.
        searchable: False if a diagnosis of an arm does not search it, although its family is in `ARM`.
        params: its parameters.
        writes: the MjModel fields that `write` may change; a test enforces this.
        order: position among effects with the same hook; a smaller number acts earlier. For `drive` that is nearer to
            the command; from 80 on (`sim.physics.GEAR`) an effect acts behind the motor.
        commanded: True if `drive` depends on the command alone, not on the arm's motion.
        smooth: False if the residual is not smooth in the parameters (then a global search is used).
        telling: magnitudes of which one must differ from null for the effect to count as present (default: all of its
            magnitudes). If these are null, the effect equals another one.
        stage: stage of a contact diagnosis in which it is searched, one of STAGES; empty for never.
        sizes: parameter -> values that a contact diagnosis tries; if stated, other parameters keep their values.
        beside: parameters that matter only if one with `sizes` differs from its null; they are fitted along with it.
        posed: True if it is the pose of a part. Small errors of the arm's kinematics look like a change of that pose.
        remembers: True if it acts beyond a threshold only and leaves a lasting change (a slip). Contact diagnoses
            then try a larger size after each one with a gain, instead of extrapolating.
        shown_by: motions of contact or of a camera (`vispeg record`) that excite it; empty for any.
        told_from: effects with which it may be confused -> the motion that distinguishes it from each.
        told_by: parameter -> the motion that distinguishes it in place of those of `told_from`, if this parameter is
            the largest.
        needs: what a contact recording must contain to excite it, a key of `recordings.checks.extent.NEEDS`; empty for
            no check.
        grows_from: simpler effects for which it may be mistaken -> {own parameter: parameter of that effect from whose
            value its fit starts}.
        contains: simpler effects that are special cases of this one; it competes with them only if clearly better.
        moments: shape parameters whose product with the magnitude enters linearly, such as the position of a mass.
        torqueless: True if it causes no missing torque at its joint; it is then searched at every joint.
        common: a word for effects that every arm has in every joint, such as "friction". Effects with the same word are
            tried in all joints at once. Empty for others.
        conservative: True if its torque depends on the angle alone, which no form of friction can imitate.
        likelier: effects that are preferred to this one if the data hardly distinguish them, such as a payload, because
            the arm's load is often unknown.
        shared: True if one value for all joints (`where: all`) is the natural first guess.
    """

    name: ClassVar[str]
    family: ClassVar[Family]
    params: ClassVar[Mapping[str, Param]]
    writes: ClassVar[frozenset[str]] = frozenset()
    order: ClassVar[int] = 50
    searchable: ClassVar[bool] = True
    commanded: ClassVar[bool] = False
    smooth: ClassVar[bool] = True
    shared: ClassVar[bool] = False
    conservative: ClassVar[bool] = False
    likelier: ClassVar[tuple[str, ...]] = ()
    common: ClassVar[str] = ""
    moments: ClassVar[tuple[str, ...]] = ()
    torqueless: ClassVar[bool] = False
    telling: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    grows_from: ClassVar[Mapping[str, Mapping[str, str]]] = {}
    stage: ClassVar[str] = ""
    sizes: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    beside: ClassVar[tuple[str, ...]] = ()
    posed: ClassVar[bool] = False
    remembers: ClassVar[bool] = False
    shown_by: ClassVar[tuple[str, ...]] = ()
    told_from: ClassVar[Mapping[str, str]] = {}
    told_by: ClassVar[Mapping[str, str]] = {}
    needs: ClassVar[str] = ""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        name = cls.__dict__.get("name")
        if name is None:  # an abstract helper between Effect and an effect
            return
        file, family = cls.__module__, getattr(cls, "family", None)
        if family not in FAMILIES:
            what = "not stated" if family is None else "no such family"
            raise UserError(what, file=file, key=f"{cls.__name__}.family", got=family, choices=FAMILIES)
        if not isinstance(getattr(cls, "params", None), Mapping):
            raise UserError("not stated", file=file, key=f"{cls.__name__}.params", expected='{"NAME": Param(...)}')
        REGISTRY.enrol(name, cls())

    # Targets ----------------------------------------------------------------------------------------------------
    def targets(self, model: Any) -> list[str]:
        """List the names on which this effect can act in a RobotModel or Scene (default: every joint).

        An effect that needs a scene's parts, cameras or lights has no target on a bare robot.
        """
        return list(model.joints)

    # Hooks ------------------------------------------------------------------------------------------------------
    def build(self, spec: Any, robot: Any) -> None:
        """Add elements that `write` needs to the MjSpec of `robot` (a Scene), without changing the nominal motion.

        Added joints come last in their body. Only models for worlds with this effect are built with them.
        """

    def write(self, fields: Any, p: Values) -> None:
        """Change model fields: `fields[name]` (nsim, ...) holds the nominal values."""

    def stable_step(self, p: Mapping[str, float]) -> float:
        """Return the greatest physics step, s, at which the effect is simulated stably and accurately."""
        return float("inf")

    def start(self, x: Any, p: Values) -> Any:
        """Return the initial state for the hooks below, which change it from step to step; None for no state."""
        return None

    def drive(self, state: Any, tau: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Return the torque (nsim, nj) N m that leaves this stage of the drive if `tau` (nsim, nj) enters it."""
        return tau

    def goal(self, state: Any, goal: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Return the goal (nsim, nj) rad that reaches a position servo's loop; used there in place of `drive`."""
        return goal

    def regulate(self, loop: Any, p: Values) -> None:
        """Change the parameters of a position servo's own loop (`effects.common.servo_loop.ServoLoop`)."""

    def friction(self, state: Any, x: Any, p: Values) -> np.ndarray:
        """Return the level (nsim, nj) >= 0 in N m to add to the joints' dry friction for the next physics step."""
        raise NotImplementedError

    def torque(self, state: Any, x: Any, p: Values) -> np.ndarray:
        """Return the torque (nsim, nj) N m on the links that no actuator commands.

        It is held over the physics step. So `-s * x.dq`, with the speed at the step's beginning, diverges on a light
        link if `s` exceeds about `inertia / h`. With the speed at the step's end it is stable:
        `-s * x.dq / (1 + x.h * s / x.inertia)`.
        """
        raise NotImplementedError

    def along(self, path: np.ndarray, at: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Return the torque (m, nj) N m of an effect that remembers the path but not the time.

        Args:
            path: (n, nj) rad, joint angles.
            at: (m,) indices of samples of the path.
            x: the motion at these samples; `x.tau` is the torque that the links need.
            p: values.
        """
        raise NotImplementedError

    def observe(self, state: Any, q: np.ndarray, dq: np.ndarray, x: Any, p: Values) -> tuple[np.ndarray, np.ndarray]:
        """Return joint angles (rad) and velocities (rad/s), (nsim, nj) each, as the encoders read them.

        `q` and `dq` are the readings with the effects before this one; the arm's own state is `x.q` and `x.dq`.
        """
        return q, dq

    def wrench(self, state: Any, wrench: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Return the reading of the wrist's sensor (nsim, 6), N and N m, for a true wrench of the tool on the flange.

        Forces, then torques, at the flange and in its frame. Called once per control tick.
        """
        return wrench

    def unread(self, reading: np.ndarray, period: float, p: Mapping[str, float]) -> np.ndarray:
        """Return the true wrench (n, 6) for readings (n, 6) every `period` s: the inverse of `wrench`."""
        return reading

    def yields(self, load: np.ndarray, p: Values) -> np.ndarray:
        """Return the deflection (n, nj) rad of the joints behind their encoders.

        `load` (n, nj) N m is the joints' load minus that at the start.
        """
        return np.zeros_like(load)

    def imitated_by(self, scene: Any, model: Any, p: Mapping[str, float]) -> tuple[EffectInstance, ...]:
        """Return effects that together make the same wrench as this one with values `p`; none by default.

        The first is the one that matters most. `model` is the compiled scene.
        """
        return ()

    def resolution(self, p: Mapping[str, float]) -> float:
        """Return the quantization step of an angle's reading, rad; 0 for none."""
        return 0.0

    def reading_noise(self, sigma: float, p: Mapping[str, float]) -> float:
        """Return the RMS error of measured angles under the true model, rad, for sensor noise of `sigma` rad."""
        return sigma

    def believe(self, goal: np.ndarray, p: Values) -> np.ndarray:
        """Return the believed position of the task's goal for its true one, `goal`; both (nsim, 3) m, base frame."""
        return goal

    def image(self, state: Any, frame: Frame, p: Values, rng: Sequence[np.random.Generator]) -> None:
        """Change a camera's `frame` in place.

        `p[name]` is (frame.n,), and `rng` holds one generator per image. `state` is a dict for the effect's use: it is
        empty when an episode begins and kept from frame to frame (for temporal correlation or latency).
        """
        raise NotImplementedError

    def inverse(self, needed: np.ndarray, sensor: str, p: Values) -> np.ndarray:
        """Return the torque sensor's reading (n, nj) N m if the links need `needed` (n, nj) N m.

        This is the static inverse of a drive effect. `sensor` is the recording's `torque_sensor`.
        """
        raise NotImplementedError

    def regressor(self, look: Any, p: Values) -> np.ndarray:
        """Return the torque (n, nj) N m to command beyond what the links need, to first order in the magnitudes.

        This is for effects that no single sample of a motion shows: timing, readings, a gear that yields. Effects with
        `write`, `friction`, `torque`, `along` or `inverse` need no regressor, because their torque follows from these.

        Args:
            look: a measured motion. `sent` (n, nj) N m is the torque that drove it, `rate(values)` the time derivative
                of values, and `moved(shift)` the additional torque that the links need if they moved by `shift` (n, nj)
                rad more than was read.
            p: values.
        """
        raise NotImplementedError

    def guesses(self, look: Any) -> list[dict[str, float]]:
        """Return parameter values, estimated from data, from which a search may start; [] if data rule the effect out.

        Args:
            look: data of the joint on which the effect acts, None for other places. All are (n,): measured angle `q`,
                velocity `dq` and acceleration `ddq`, commanded motor torque `tau`, torque `needed` by the nominal arm
                for the motion, torque `excess` that the present model lacks, N m, and the unsmoothed angle `raw`.
                `inertia` is a number: kg m^2 that would take as much torque as is missing.
        """
        return [{}]

    def limits(self, model: Any, where: str) -> Mapping[str, tuple[float, float]]:
        """Return parameter -> (least, greatest) value for limits that the compiled `model` of an arm sets."""
        return {}

    def side(self) -> Literal["link", "drive"]:
        """Return 'link' if a joint torque sensor behind the gear measures this effect's torque, else 'drive'."""
        return "drive"

    def channels(self) -> frozenset[str]:
        """Return the channels of measured values that the effect changes. They follow from its hooks.

        - `angle`, `torque`: the motion under a known controller; effects on the arm's motion or its readings.
        - `servo`, `load`: the motion under a servo's own loop; these effects, and those in the loop.
        - `needed`: the torque of a measured motion by inverse dynamics; effects that follow from each sample or from
          the path so far, so not timing, gear play or readings.
        - `wrench`: the readings of a wrist's force sensor; its own errors, compliance of the arm, and effects on the
          model that need a scene.
        """
        motion = ("write", "drive", "friction", "torque", "observe")
        sample = ("write", "friction", "inverse", "along", *(() if self.overrides("start") else ("torque",)))
        out = {"angle", "torque", "servo", "load"} if any(map(self.overrides, motion)) else set()
        out |= {"servo", "load"} if any(map(self.overrides, ("goal", "regulate"))) else set()
        out |= {"needed"} if any(map(self.overrides, sample)) else set()
        scenic = self.family in ("contact", "task") or not self.searchable  # it acts only in a scene
        felt = self.overrides("wrench") or self.overrides("yields") or (scenic and self.overrides("write"))
        return frozenset(out | ({"wrench"} if felt else set()))

    def overrides(self, hook: str) -> bool:
        """Return whether this class overrides a hook."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def absent(self, shape: tuple[int, ...]) -> dict[str, np.ndarray]:
        """Return an array of this shape for each parameter, with the values of an absent effect."""
        return {name: np.full(shape, param.absent) for name, param in self.params.items()}

    def param(self, name: Any, *, file: str | Path | None = None, key: str | None = None) -> Param:
        """Return the parameter of a name. Raises UserError, with file and key if stated: no such parameter."""
        if name not in self.params:
            raise UserError(f"{self.name} has no such parameter", file=file, key=key, got=name, choices=self.params)
        return self.params[name]

    @property
    def magnitudes(self) -> list[str]:
        """Names of the parameters that make the effect vanish if they are null (all but the shape parameters)."""
        return [name for name, param in self.params.items() if not param.shape]

    @property
    def distant(self) -> bool:
        """Whether a magnitude is on a log scale: at its distant null the slope is 0, so a fit starts at a guess."""
        return any(self.params[name].scale == "log" for name in self.magnitudes)

    @property
    def straight(self) -> bool:
        """Whether the effect is proportional to its magnitudes, so that it can be proposed by linear least squares."""
        bent = any(p.scale == "log" or (p.shape and not self.moments) for p in self.params.values())
        return self.smooth and not self.torqueless and not bent


ALL_NAMES = "`vispeg effects` lists all; the variable VISPEG_PLUGINS names modules with others"


def searchable() -> dict[str, Effect]:
    """Return name -> registered effect, for those that a diagnosis of an arm searches."""
    return {name: e for name, e in sorted(REGISTRY.items()) if e.family in ARM and e.searchable}


def of_family(*families: Family) -> dict[str, Effect]:
    """Return name -> registered effect of these families."""
    return {name: e for name, e in sorted(REGISTRY.items()) if e.family in families}


def effect(name: Any, *, file: str | Path | None = None, key: str | None = None) -> Effect:
    """Return the registered effect of a name. Raises UserError, with file and key if stated: no such effect."""
    if not isinstance(name, str) or name not in REGISTRY:
        raise UserError("unknown effect", file=file, key=key, got=name, choices=sorted(REGISTRY), see=ALL_NAMES)
    return REGISTRY[name]


@dataclass(frozen=True)
class EffectInstance:
    """An effect at a place, with values.

    Attributes:
        effect: its name.
        where: the place: a target's name, or `all`.
        params: parameter -> value with its interval.
        origin: where the values come from, for files.
        partial: whether it was accepted although part of the error stayed unexplained.
        tentative: whether it lowers the error but its name is uncertain: another effect may be the cause.
    """

    effect: str
    where: str
    params: Mapping[str, Value]
    origin: Mapping[str, Any] = field(default_factory=dict)
    partial: bool = False
    tentative: bool = False

    @classmethod
    def of(cls, name: str, where: str, **values: float) -> EffectInstance:
        """Make an instance from values: `EffectInstance.of("coulomb_friction", "joint4", torque=1.3)`.

        Parameters that are not given are null or, for shape parameters, `start`.
        """
        kind = effect(name)
        for key in values:
            kind.param(key)
        full = {k: values.get(k, p.absent) for k, p in kind.params.items()}
        return cls(name, where, {k: Value(float(v)) for k, v in full.items()})

    @property
    def label(self) -> str:
        """Effect and place as text: `coulomb_friction(joint4)`."""
        return f"{self.effect}({self.where})"

    def __repr__(self) -> str:
        parts = [self.where, *(f"{name}={value.value!r}" for name, value in self.params.items())]
        parts += [mark for mark in ("partial", "tentative") if getattr(self, mark)]
        return f"{self.effect}({', '.join(parts)})"

    def with_values(self, **values: float) -> EffectInstance:
        """Return a copy with other values; their intervals are dropped."""
        params = {**self.params, **{k: Value(float(v)) for k, v in values.items()}}
        return EffectInstance(self.effect, self.where, params)


def told_apart_by(name: str, other: str) -> list[str]:
    """Return the motions that distinguish two kinds of effect, as they declare them (`told_from`); none if neither."""
    motions = (effect(name).told_from.get(other), effect(other).told_from.get(name))
    return [motion for motion in motions if motion]
