"""Run a policy on a robot: read in every control period, act in every policy period, stop at a limit."""

from __future__ import annotations

import _thread
import signal
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from vispeg.control.laws import rotated
from vispeg.core.errors import UserError
from vispeg.interface.builder import Builder, Picture
from vispeg.interface.interface import Interface
from vispeg.interface.observer import RECENT
from vispeg.recordings.cell import WrenchSensor, canonical, reaction
from vispeg.render.image_kinds import camera_of
from vispeg.trials.driver import Connected, Driver, Reading
from vispeg.trials.limits import STOPPED, WATCHDOG, WORKSPACE, Limits
from vispeg.trials.tape import Tape
from vispeg.trials.trial import HowPart, OutcomePart, PolicyPart, Said, StartPart, TimingPart, Trial, WorldPart

# s at rest in free air: `compare` and `diagnose` need 1 s of it to use the joints, 0.3 s to use the wrench.
REST = 1.2
SILENCE = 0.25  # s without a new reading after which the arm stops, less than two policy steps


class Acts(Protocol):
    """The interface of a policy: `vispeg.learn.policy.Policy`, or `vispeg.interface.exported.Exported`."""

    def reset(self, n: int, rows: np.ndarray | None = None) -> None:
        """Clear the memory of all n rows, or only of those where `rows` (n,) is True."""
        ...

    def act(self, obs: Any) -> np.ndarray:
        """Return actions (n, action) within +-1 for observation arrays (n, ...)."""
        ...


class Clock:
    """The host's clock; a replay or a simulation that waits for its policy replaces it."""

    def now(self) -> float:
        """Return the time in s since an arbitrary origin."""
        return time.monotonic()

    def wait(self, until: float) -> None:
        """Sleep until the time `until`; return at once if it has passed."""
        left = until - time.monotonic()
        if left > 0:
            time.sleep(left)


@dataclass(frozen=True)
class How:
    """Settings of a policy's run.

    Attributes:
        limits: safety limits that stop the arm.
        shadow: compute and record commands, but do not send them.
        slow: factor on each action, 0.05 to 1; an episode gets correspondingly more steps.
        goal: believed position of the goal in the base, m; default: what the robot states, else the nominal position.
        silence: time without a new reading after which the arm stops, s.
        rest: time for which the arm is recorded at rest before the policy acts, s, on the host's and robot's clocks.
    """

    limits: Limits = Limits()
    shadow: bool = False
    slow: float = 1.0
    goal: tuple[float, float, float] | None = None
    silence: float = SILENCE
    rest: float = REST

    def __post_init__(self) -> None:
        if not 0.05 <= self.slow <= 1.0:
            raise UserError("out of bounds", key="--slow", expected="0.05 to 1", got=self.slow)


@dataclass(frozen=True, eq=False)
class Step:
    """Status of an episode after a policy step, for display.

    Attributes:
        number, of: number of the step, from 1, and number of steps in the episode.
        tip: (3,) measured tip position relative to the believed goal, m.
        force: contact force on the wrist, N; None if the robot measures none.
        late: delay of the command after its due time, s.
        missed: number of missed deadlines so far.
        pose, target: (7,) measured and commanded flange pose in the base, m and quaternion w x y z.
        wrench: (6,) wrench that the policy observes, N and N m; None if the robot measures none.
        shares: limit -> used share, 1 at the limit.
        pictures: camera name -> picture that the policy saw.
    """

    number: int
    of: int
    tip: np.ndarray
    force: float | None
    late: float
    missed: int
    pose: np.ndarray
    target: np.ndarray
    wrench: np.ndarray | None
    shares: Mapping[str, float]
    pictures: Mapping[str, Picture]


@dataclass
class Watchdog:
    """Stop the robot from a separate thread if the loop hangs."""

    stop: Callable[[], object]
    silence: float
    barked: bool = False
    _last: float = field(default_factory=time.monotonic)
    _before: Any = None  # the previous handler of SIGINT
    _over: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Watchdog:
        self._last, self._before = time.monotonic(), signal.getsignal(signal.SIGINT)
        if not callable(self._before):  # SIGINT is ignored, as under `nohup ... &`, so nothing could interrupt the loop
            signal.signal(signal.SIGINT, signal.default_int_handler)
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def beat(self) -> None:
        """Report that the loop is alive."""
        self._last = time.monotonic()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        if not callable(self._before):
            signal.signal(signal.SIGINT, signal.SIG_DFL if self._before is None else self._before)

    def _watch(self) -> None:
        while not self._over.wait(self.silence / 5):
            if time.monotonic() - self._last > self.silence:
                self.barked = True
                with suppress(Exception):  # an error here must not keep the loop from being interrupted
                    self.stop()
                _thread.interrupt_main()
                return


def run_episode(
    policy: Acts,
    interface: Interface,
    robot: Driver,
    who: PolicyPart,
    seed: int,
    how: How | None = None,
    *,
    name: str = "",
    clock: Clock | None = None,
    show: Callable[[Step], None] = lambda step: None,
    key: Callable[[], bool] = lambda: False,
    watch: bool = True,
) -> Trial:
    """Run one episode.

    Args:
        policy: the policy.
        interface: meaning of the policy's observations and actions.
        robot: the robot's driver; the robot is stopped at the end in any case.
        who: description of the policy, for the trial.
        seed: number of the episode, from which a simulated robot draws its start.
        how: settings of the run.
        name: name of the robot, for the trial.
        clock: clock of the loop; by default the host's.
        show: called after every policy step.
        key: called in every control period; returns whether a person wants the arm to stop.
        watch: whether a watchdog thread stops the robot if the loop hangs; only possible in the main thread.

    Raises:
        UserError: a picture that the policy needs is missing or unfit, the joints are those of another arm, or the
            robot lacks the sensor that the policy or a limit needs.
    """
    how, clock = how or How(), clock or Clock()
    connected = robot.connect(interface, seed) or Connected()
    how.limits.fit(interface, connected.wrench is not None)
    loop = _Loop(policy, interface, robot, connected, how, clock, show, key)
    ended: str | None = None
    verdict: Mapping[str, Any] | None = None
    # for a call that does not return; the loop itself ends after `silence`, and has several times that to do so
    dog = Watchdog(robot.stop, 4 * how.silence) if watch else None
    try:
        if dog is None:
            ended = loop.run(lambda: None)
        else:
            with dog:
                ended = loop.run(dog.beat)
    except KeyboardInterrupt:
        ended = WATCHDOG if dog is not None and dog.barked else STOPPED
    except EOFError:  # a log is over
        ended = None
    except OSError as error:  # the robot is gone, or a part of it is silent
        ended, loop.why = WATCHDOG, str(error) or None
    finally:
        with suppress(OSError):
            verdict = robot.stop()
    return loop.trial(ended, verdict, who, seed, name)


class _Loop:
    """One episode in progress."""

    def __init__(
        self,
        policy: Acts,
        interface: Interface,
        robot: Driver,
        connected: Connected,
        how: How,
        clock: Clock,
        show: Callable[[Step], None],
        key: Callable[[], bool],
    ):
        self.policy, self.robot, self.connected, self.how = policy, robot, connected, how
        self.clock, self.show, self.key = clock, show, key
        self.interface = interface
        slowed = interface.model_copy(
            update={"offset_m": how.slow * interface.offset_m, "turn_rad": how.slow * interface.turn_rad}
        )
        self.builder, self.tape = Builder(slowed), Tape(interface, connected.wrench is not None)
        self.count, self.missed, self.reads, self.stale, self.peak = round(interface.steps / how.slow), 0, 0, 0, 0.0
        self.cameras = tuple(dict.fromkeys(camera_of(key) for key in interface.images))
        # s; a later command answers a mean wrench of which nothing is left in the window over which it is averaged
        self.deadline = RECENT * interface.controller.period_s
        believed = how.goal or connected.start.get("believed_m")
        self.ended: Callable[[], bool | None] = getattr(robot, "ended", lambda: None)
        self.goal = None if believed is None else np.asarray(believed, float)
        self.target = np.zeros(7)
        self.first: Reading | None = None
        # (6,) N, N m at the flange: the tool's weight in the pose in which the sensor was last zeroed
        self.tared_weight: np.ndarray | None = None
        self.why: str | None = None

    def run(self, beat: Callable[[], None]) -> str | None:
        """Run the episode; return the limit that ended it, `success` at the measured goal, or None.

        None stands for a timeout, or for an end that the robot itself knows of.
        """
        interface, period = self.interface, self.interface.controller.period_s
        self.policy.reset(1)
        rest = round(self.how.rest / period)  # ticks before the policy acts
        begin, tick, steps = self.clock.now(), 0, 0
        newest, arrived = -np.inf, begin  # the newest reading: its time on the robot's clock, its arrival on the host's
        while True:
            due = begin + tick * period
            self.clock.wait(due)
            if not steps and tick >= rest and self.tape.length < self.how.rest - 1.5 * period:
                rest = tick + 1  # the robot's clock is slower than the host's: rest longer
            acts = tick >= rest + steps * interface.ticks
            reading = self.robot.read(self.cameras if acts else ())
            beat()
            self.reads += 1
            self._check(reading)
            wrench = self._wrench(reading)
            if self.first is None or (acts and steps == 0):
                self._begin(reading)
            elif reading.time > newest and self.tape.felt:
                self.builder.feel(wrench)
            if reading.time > newest:
                passed, arrived = self.clock.now() - arrived, self.clock.now()
                if np.isfinite(newest) and reading.time - newest > passed + self.how.silence:
                    self.why = f"the robot's clock jumped forward by {reading.time - newest:.3g} s"
                    return WATCHDOG
                newest = reading.time
            else:
                self.stale += 1
                if self.clock.now() - arrived > self.how.silence:
                    self.why = f"no new reading for {self.how.silence:g} s"
                    return WATCHDOG
            self.tape.tick(reading.time, reading.q, reading.dq, wrench, self.target)
            seen = self.builder.observer
            if acts:
                obs = self.builder.observe(reading.q, reading.dq, reading.pictures)
            else:
                seen.see(np.asarray(reading.q, float)[None], np.asarray(reading.dq, float)[None])
            force = self._force(wrench)
            if self.key():
                return STOPPED
            if (limit := self.how.limits.broken(interface, seen, force)) is not None:
                return limit
            if acts:
                tip = seen.tip()[0] - seen.believed[0]
                over = self.ended()
                if over is None and self._reached(seen.tip()[0]):
                    return "success"
                if steps >= self.count or (steps and over):
                    return None
                if (limit := self._act(obs, reading, due, steps, tip, force)) is not None:
                    return limit
                steps += 1
            now = self.clock.now()
            # a whole step is lost: shift the schedule instead of catching up in a burst
            if now - due > interface.policy_period_s:
                begin += now - due
            tick = max(tick + 1, int((now - begin) / period + 1e-6))

    def _check(self, reading: Reading) -> None:
        i = self.interface
        nj, got = len(i.arm.joints), (np.shape(reading.q), np.shape(reading.dq))
        if got != ((nj,), (nj,)):
            expected = f"{nj} angles and velocities, as {i.arm.robot} has"
            raise UserError("joints of another arm", key="--robot", expected=expected, got=got)
        if self.tape.felt and (reading.wrench is None or np.shape(reading.wrench) != (6,)):
            expected = "six numbers, or Connected(wrench=None) from `connect`"
            raise UserError("no wrench", key="--robot", expected=expected, got=reading.wrench)

    def _reached(self, tip: np.ndarray) -> bool:
        """Return whether a measured tip (3,), m in the base, is as deep as the task asks for, and not beside the goal.

        A goal whose place nobody stated may be elsewhere, so that the depth below its nominal place alone counts.
        """
        goal = self.interface.goal
        x, y, z = tip - (self.builder.observer.believed[0] if self.how.goal is None else self.how.goal)
        stated = goal.told or self.how.goal is not None
        beside = stated and goal.within_m is not None and np.hypot(x, y) > goal.within_m
        return bool(z <= goal.reached_m[2]) and not beside

    def _begin(self, reading: Reading) -> None:
        """Start the observer and the commanded pose from the first reading, and again from the last one at rest."""
        self.first = reading
        self.builder.begin(reading.q, reading.dq, self.goal)
        self.target = np.concatenate([self.builder.observer.goal[0], self.builder.observer.rot[0]])

    def _wrench(self, reading: Reading) -> np.ndarray:
        """Return the wrench (6,) of the tool on the flange, weight included, in flange axes; zeros without a sensor."""
        sensor = self.connected.wrench
        if sensor is None:
            return np.zeros(6)
        wrench = np.asarray(reading.wrench, float)
        if sensor == WrenchSensor(acts_on="flange"):
            return wrench
        turn = self.builder.observer.chain.rotation(np.asarray(reading.q, float)[None])
        out = reaction(canonical(wrench[None], sensor, turn))[0]
        if self.tared_weight is None or sensor.tared == "weight":  # this robot subtracts the weight at every pose
            self.tared_weight = self.interface.tool.weight_at(turn[0])
        if sensor.tared:
            out += self.tared_weight
        return out

    def _force(self, wrench: np.ndarray) -> float | None:
        """Return the contact force on the wrist, N, and update its peak; None if the robot measures none."""
        if not self.tape.felt:
            return None
        turned = rotated(self.builder.observer.turn, wrench[None, :3])[0]
        force = float(np.linalg.norm(turned - self.interface.tool.weight_n))
        self.peak = max(self.peak, force)
        return force

    def _act(
        self, obs: Any, reading: Reading, due: float, number: int, tip: np.ndarray, force: float | None
    ) -> str | None:
        seen, action = self.builder.observer, np.asarray(self.policy.act(obs), float).reshape(-1)
        shares = self.how.limits.shares(self.interface, seen, force)
        target = self.builder.act(action)
        commanded_tip = seen.held[0] if seen.turns else seen.goal[0] - [0, 0, seen.length]
        if not self.how.limits.inside(self.interface, seen, commanded_tip):
            return WORKSPACE
        if not self.how.shadow:
            self.robot.command(target)
            self.target = target
        late = self.clock.now() - due
        self.missed += late > self.deadline
        self.tape.step(late, obs["policy"], action, target, reading.pictures, moves=not self.how.shadow)
        pose, felt = np.concatenate([seen.flange[0], seen.turn[0]]), seen.wrench[0] if self.tape.felt else None
        step = number + 1, self.count, tip, force, late, self.missed
        self.show(Step(*step, pose, target, felt, shares, reading.pictures))
        return None

    def trial(
        self, ended: str | None, verdict: Mapping[str, Any] | None, who: PolicyPart, seed: int, name: str
    ) -> Trial:
        """Return the episode as a trial; `verdict` is the robot's, see `Driver.stop`.

        Raises:
            UserError: the episode ended before the policy acted.
        """
        if self.first is None:
            raise UserError("the robot gave no reading", key="--robot", got=name)
        if not len(self.tape.late):
            raise UserError("the arm was stopped before the policy acted", key="--robot", got=self.why or ended or name)
        late, i = self.tape.late, self.interface
        ended = ended or "timeout"
        outcome = {"success": ended == "success", "category": ended, "by": "measured", "why": self.why}
        outcome |= {"peak_force_n": self.peak if self.tape.felt else None}
        # the robot's verdict counts unless a limit ended the episode
        if verdict is not None and ended in ("success", "timeout"):
            outcome |= {**verdict, "by": "robot"}
        start = {**self.connected.start, "believed_m": self.builder.observer.believed[0].tolist()}
        start |= {"q_rad": np.asarray(self.first.q, float).tolist()}
        timing = TimingPart(
            period_s=i.policy_period_s,
            steps=len(late),
            clipped=int(self.builder.observer.clipped[0]),
            missed=self.missed,
            deadline_s=self.deadline,
            late_median_s=float(np.median(late)),
            late_most_s=float(late.max()),
            reads=self.reads,
            stale=self.stale,
        )
        said = Said(
            policy=who,
            robot=name,
            task=i.task,
            seed=seed,
            world=WorldPart(**self.connected.world),
            start=StartPart(**start),
            outcome=OutcomePart(**{"time_s": self.tape.length - self.tape.begun, **outcome}),
            timing=timing,
            how=HowPart(shadow=self.how.shadow, slow=self.how.slow),
        )
        return Trial(said, self.tape.recording(notes=f"run on {name}"), self.tape.steps())
