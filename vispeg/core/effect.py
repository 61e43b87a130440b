"""What an effect is: one physical phenomenon with named parameters that vanish at null."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.frame import Frame
from vispeg.core.params import Param, Value
from vispeg.core.registry import Registry

Family = Literal["joint", "drive", "sensor", "body", "contact", "task", "camera", "appearance"]
ARM = ("joint", "drive", "sensor", "body")  # families that an arm alone can show; the others need a scene
STAGES = ("free air", "geometry", "compliance", "friction", "impact")  # of a diagnosis of contact
OPTICAL = ("camera", "appearance")  # families that are only seen; the others are felt
Values = Mapping[str, np.ndarray]  # parameter name -> (nsim, ntarget)
REGISTRY: Registry[Effect] = Registry("effect", "vispeg.effects")


class Effect(ABC):
    """One physical or optical phenomenon. A subclass enrols itself by `name`, in one file, with no edit elsewhere.

    Every hook works on all simulations of a batch at once: `p[name]` has shape (nsim, ntarget), where a target is one
    of `targets(model)` and simulations without the effect carry the null value. A hook that is not overridden is never
    called. All arrays are SI and radians; joint arrays are (nsim, nj).

    Class attributes:
        name, family: the name in model files; the folder of the library that it stands in.
        searchable: False if a diagnosis of an arm does not search it, though its family is one of an arm.
        params: its parameters.
        writes: the MjModel fields that `write` may touch; a test holds it to that.
        order: position in the chain of drive hooks; smaller acts earlier (nearer to the command).
        commanded: True where `drive` is of the command alone, whatever the arm does meanwhile.
        smooth: False where the residual is not smooth in the parameters (a global search is then used).
        telling: magnitudes without which this effect equals another one (default: any of them).
        stage: of a contact diagnosis in which it is searched (one of STAGES, in their order); empty: never.
        sizes: parameter -> values that a contact diagnosis tries; other parameters stay.
        beside: parameters that show only where one with sizes is off its null, and are fitted with it.
        posed: True where it is the pose of a part, which an arm's kinematics, a little off, seem to change as well.
        remembers: True where what it did once remains, so that no part of a recording shows it.
        shown_by: contact motions (`vispeg record`) that excite it; empty: any.
        told_from, told_by: effects it may be confused with -> the motion that separates them; parameter -> another one.
        needs: what a contact recording must contain to excite it, a key of `extent.NEEDS`; empty: not checked.
        grows_from: simpler effects that it may be mistaken for -> {own parameter: that one's, where its fit starts}.
        contains: simpler effects that this one turns into at some of its values; it rivals them only by being better.
        moments: shapes in which, times the magnitude, the effect is linear: a mass at x is a moment of mass times x.
        torqueless: True if no torque is missing at the joint, so that the effect is searched at every joint.
        common: effects of one word, which every arm has in every joint, are tried in all joints at once.
        conservative: True where what it adds in a joint is of the angle alone, which no form of friction leaves.
        likelier: effects that are taken in its place where data hardly tell them apart: what an arm holds is not known.
        shared: True where one value for all joints (`where: all`) is the natural first guess.
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
        REGISTRY.enrol(name, cls())

    # Where ------------------------------------------------------------------------------------------------------
    def targets(self, model: Any) -> list[str]:
        """Names this effect can act on (default: every joint). `model` is a RobotModel or a Scene; an effect that needs
        a scene's parts, cameras or lights has no target on a bare robot.
        """
        return list(model.joints)

    # How --------------------------------------------------------------------------------------------------------
    def build(self, spec: Any, robot: Any) -> None:
        """Add to an MjSpec of `robot` (a Scene) what `write` needs and the nominal one lacks; nothing else may move.

        Joints come last in their body, and only models in which some world has the effect get them.
        """

    def write(self, fields: Any, p: Values) -> None:
        """Set model fields, `fields[name]` of shape (nsim, ...), already holding the nominal values."""

    def stable_step(self, p: Mapping[str, float]) -> float:
        """Greatest physics step, s, at which its own motion stays stable and exact with these values."""
        return float("inf")

    def start(self, x: Any, p: Values) -> Any:
        """State carried from step to step, or None."""
        return None

    def drive(self, state: Any, tau: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Give the torque that leaves this stage of the drive, given the torque (nsim, nj) that enters it. N m."""
        return tau

    def goal(self, state: Any, goal: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Give the goal (nsim, nj), rad, that reaches a servo's loop at each physics step; there in the place of
        `drive`.
        """
        return goal

    def regulate(self, loop: Any, p: Values) -> None:
        """Change the numbers of a position servo's own loop (`effects.common.servo_loop.ServoLoop`)."""

    def friction(self, state: Any, x: Any, p: Values) -> np.ndarray:
        """Friction level (nsim, nj) >= 0 in N m, added to the joint's dry friction for the next physics step."""
        raise NotImplementedError

    def torque(self, state: Any, x: Any, p: Values) -> np.ndarray:
        """Torque (nsim, nj) on the link that no actuator commands, N m."""
        raise NotImplementedError

    def along(self, path: np.ndarray, at: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Return `torque` (m, nj) N m of a rate-independent effect with memory, at samples `at` (m,) of a path (n, nj)
        rad.

        The motion there is `x`, and `x.tau` what the links need.
        """
        raise NotImplementedError

    def observe(self, state: Any, q: np.ndarray, dq: np.ndarray, x: Any, p: Values) -> tuple[np.ndarray, np.ndarray]:
        """Joint angles and velocities, both (nsim, nj), as the encoders read them."""
        return q, dq

    def wrench(self, state: Any, wrench: np.ndarray, x: Any, p: Values) -> np.ndarray:
        """Give the tool's wrench on the flange (nsim, 6), N and N m, as the wrist's sensor reads it.

        Forces, then torques, at the flange and in its frame; asked once a control tick.
        """
        return wrench

    def unread(self, reading: np.ndarray, period: float, p: Mapping[str, float]) -> np.ndarray:
        """Inverse of `wrench`: the true wrench (n, 6) from readings every `period` s."""
        return reading

    def yields(self, load: np.ndarray, p: Values) -> np.ndarray:
        """Deflection (n, nj) rad of joints behind their encoders, by `load` (n, nj) N m beyond that at the start."""
        return np.zeros_like(load)

    def resolution(self, p: Mapping[str, float]) -> float:
        """Quantization step of a reading, rad; 0 for none."""
        return 0.0

    def reading_noise(self, sigma: float, p: Mapping[str, float]) -> float:
        """RMS of a measured angle about the right model's, rad, if the sensor's noise is `sigma`."""
        return sigma

    def believe(self, goal: np.ndarray, p: Values) -> np.ndarray:
        """Believed position of the task's goal (nsim, 3), m, from the true one; base frame."""
        return goal

    def image(self, state: Any, frame: Frame, p: Values, rng: Sequence[np.random.Generator]) -> None:
        """Change a camera's `frame` in place; `rng` holds one stream an image.

        `p[name]` is (frame.n,). `state` is a dict of the effect's own, empty when the episode begins and kept from
        frame to frame (temporal correlation, latency).
        """
        raise NotImplementedError

    def inverse(self, needed: np.ndarray, sensor: str, p: Values) -> np.ndarray:
        """Return the torque sensor's reading (n, nj) N m when the link needs `needed`: the static inverse of a drive
        effect.
        """
        raise NotImplementedError

    def regressor(self, look: Any, p: Values) -> np.ndarray:
        """Return the torque (n, nj) N m that must be sent beyond what the links need, to first order in the magnitudes.

        For what shows in no sample of a motion alone: timing, readings, a gear that yields. What acts through `write`,
        `friction`, `torque`, `along` or `inverse` needs none: its torque follows from these.

        Args:
            look: a measured motion: `sent` (n, nj) N m, what drove it; `rate(values)` their derivative in time, 1/s;
                `moved(shift)` the torque that the links need beyond the measured motion's where they moved by
                `shift` (n, nj) rad more than was read.
        """
        raise NotImplementedError

    def guesses(self, look: Any) -> list[dict[str, float]]:
        """Parameter values at which to take a signature, from the data; [] if the data rule the effect out.

        Args:
            look: what is known at the place, None where it is no joint: `q`, `dq`, `tau`, `needed` (n,) measured angle,
                velocity, commanded motor torque and the torque that the nominal arm needs for the motion,
                `excess` (n,) the torque in N m that the present model lacks there, `raw` the unsmoothed angle.
        """
        return [{}]

    def limits(self, model: Any, where: str) -> Mapping[str, tuple[float, float]]:
        """Return least and greatest values of parameters that an arm, its compiled `model`, sets itself."""
        return {}

    def side(self) -> Literal["link", "drive"]:
        """Whether a joint torque sensor (behind the gear) sees this effect's torque: 'link' if it does."""
        return "drive"

    def channels(self) -> frozenset[str]:
        """Channels of measured values that it affects.

        `angle` and `torque`, the motion under a known controller: whatever moves the arm or its readings. `servo` and
        `load`, the motion under a servo's own loop: that, and what is in the loop. `needed`, the torque of a measured
        motion by inverse dynamics: what follows from each sample or the path so far, so no timing, gear play, readings.
        `wrench`, what a wrist's force sensor reads: its own errors, a give of the arm, what needs a scene to act on.
        """
        motion = ("write", "drive", "friction", "torque", "observe")
        sample = ("write", "friction", "inverse", "along", *(() if self.overrides("start") else ("torque",)))
        out = {"angle", "torque", "servo", "load"} if any(map(self.overrides, motion)) else set()
        out |= {"servo", "load"} if any(map(self.overrides, ("goal", "regulate"))) else set()
        out |= {"needed"} if any(map(self.overrides, sample)) else set()
        scenic = self.family in ("contact", "task") or not self.searchable
        felt = self.overrides("wrench") or self.overrides("yields") or (scenic and self.overrides("write"))
        return frozenset(out | ({"wrench"} if felt else set()))

    def overrides(self, hook: str) -> bool:
        """Whether this class has a hook of its own."""
        return getattr(type(self), hook) is not getattr(Effect, hook)

    def absent(self, shape: tuple[int, ...]) -> dict[str, np.ndarray]:
        """Arrays of this shape, one a parameter, with the values of an effect that is not there."""
        return {name: np.full(shape, param.absent) for name, param in self.params.items()}

    def param(self, name: Any, *, file: str | Path | None = None, key: str | None = None) -> Param:
        """Give the parameter of that name; a UserError (with file and key, if they are stated) with the names
        otherwise.
        """
        if name not in self.params:
            raise UserError(f"{self.name} has no such parameter", file=file, key=key, got=name, choices=self.params)
        return self.params[name]

    @property
    def magnitudes(self) -> list[str]:
        """The parameters whose null makes the effect vanish (all but the shape parameters)."""
        return [name for name, param in self.params.items() if not param.shape]

    @property
    def distant(self) -> bool:
        """Whether it vanishes far away, on a log scale, without a slope there: a fit starts at one of its guesses."""
        return any(self.params[name].scale == "log" for name in self.magnitudes)

    @property
    def straight(self) -> bool:
        """Whether what it does grows in proportion to its magnitudes, so that linear algebra can propose it."""
        bent = any(p.scale == "log" or p.shape and not self.moments for p in self.params.values())
        return self.smooth and not self.torqueless and not bent


ALL_NAMES = "`vispeg effects` lists all; the variable VISPEG_PLUGINS names modules with others"


def searchable() -> dict[str, Effect]:
    """Give the registered effects that a diagnosis of an arm chooses from, by name."""
    return {name: e for name, e in sorted(REGISTRY.items()) if e.family in ARM and e.searchable}


def of_family(*families: Family) -> dict[str, Effect]:
    """Give the registered effects of these families, by name."""
    return {name: e for name, e in sorted(REGISTRY.items()) if e.family in families}


def effect(name: Any, *, file: str | Path | None = None, key: str | None = None) -> Effect:
    """Give the registered effect of that name; a UserError (with file and key, if they are stated) otherwise."""
    if not isinstance(name, str) or name not in REGISTRY:
        raise UserError("unknown effect", file=file, key=key, got=name, choices=sorted(REGISTRY), see=ALL_NAMES)
    return REGISTRY[name]


@dataclass(frozen=True)
class EffectInstance:
    """An effect at a place, with values.

    Attributes:
        partial: it was accepted while something else was left unexplained.
        tentative: it lowers the error, but its name is not certain: it may stand in for another.
    """

    effect: str
    where: str
    params: Mapping[str, Value]
    origin: Mapping[str, Any] = field(default_factory=dict)
    partial: bool = False
    tentative: bool = False

    @classmethod
    def of(cls, name: str, where: str, **values: float) -> EffectInstance:
        """`EffectInstance.of("coulomb_friction", "joint4", torque=1.3)`; other parameters: start (shape) or null."""
        kind = effect(name)
        for key in values:
            kind.param(key)
        full = {k: values.get(k, p.absent) for k, p in kind.params.items()}
        return cls(name, where, {k: Value(float(v)) for k, v in full.items()})

    @property
    def label(self) -> str:
        """`coulomb_friction(joint4)`."""
        return f"{self.effect}({self.where})"

    def __repr__(self) -> str:
        said = [", ".join(f"{name}={value.value!r}" for name, value in self.params.items())]
        said += [word for word in ("partial", "tentative") if getattr(self, word)]
        return f"{self.effect}({', '.join([self.where, *filter(None, said)])})"

    def with_values(self, **values: float) -> EffectInstance:
        """Return a copy with other values; their intervals are dropped."""
        params = {**self.params, **{k: Value(float(v)) for k, v in values.items()}}
        return EffectInstance(self.effect, self.where, params)
