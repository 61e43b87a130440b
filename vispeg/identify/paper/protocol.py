"""Sub-trajectory protocol: fit link masses, joint damping and gravity to the flange's path by CMA-ES.

A recording under operational space control is cut into short pieces. Each is simulated from its own measured start,
so that an error does not grow along the whole motion. The cost is the sum over the pieces of the 2-norm of measured
minus simulated flange positions. The protocol uses only the flange position; `vispeg fit --effects` uses all channels.
`vispeg.identify.paper.intervals` computes the accuracy of the values. The paper is Kaspar and Bock's, see
docs/sources.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.errors import UserError
from vispeg.identify.checkpoint import Trace
from vispeg.identify.cmaes import minimise
from vispeg.identify.nominal import robot_of
from vispeg.recordings.recording import Recording
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled, flange_pose
from vispeg.sim.nominal import Nominal
from vispeg.sim.rollout import simulate
from vispeg.sim.segments.segment import Segment, segments
from vispeg.worlds.places import ALL
from vispeg.worlds.world import World

PIECES, STEPS = 9, 50  # number of pieces of a recording, and of compared samples in each
TILT, MASS, DECAY = 0.01, 0.3, 2.0  # rad, kg, 1/s: typical sizes; damping is DECAY times inertia
WORST = 1.0  # m, error in each coordinate where a rollout diverged
GENERATIONS = 120


@dataclass(frozen=True)
class Pieces:
    """Sub-trajectories of one recording.

    Attributes:
        robot: the nominal robot.
        segments: as `simulate` takes them, with `STEPS` sample times each.
        measured: (npiece, nstep, 3) m, flange positions in the base frame; NaN where none was measured.
    """

    robot: RobotModel
    segments: tuple[Segment, ...]
    measured: np.ndarray

    @property
    def time(self) -> np.ndarray:
        """Time of the pieces laid end to end, (npiece * nstep,) s."""
        length = self.segments[0].ticks * self.segments[0].tick
        return np.concatenate([k * length + s.time for k, s in enumerate(self.segments)])

    @property
    def compared(self) -> float:
        """Mean number of coordinates in a piece that were measured, and so are compared."""
        return float(np.isfinite(self.measured).sum() / len(self.measured))


def cut(rec: Recording, pieces: int = PIECES, steps: int = STEPS) -> Pieces:
    """Cut a recording into equal pieces, or use its episodes if there are as many.

    Raises:
        UserError: another controller than osc, too few samples, or a piece in which no pose was measured.
    """
    if rec.control.mode != "osc":
        expected = "osc, such as from `vispeg record --motion osc`"
        raise UserError(
            "another controller", file=rec.path, key="control.mode", expected=expected, got=rec.control.mode
        )
    robot, runs = robot_of(rec), segments(rec)
    if len(runs) not in (1, pieces):
        raise UserError(
            "cannot be cut", file=rec.path, key="episode", expected=f"1 or {pieces} episodes", got=len(runs)
        )
    parts = pieces // len(runs)
    ticks = min(s.ticks for s in runs) // parts
    if ticks < steps:
        raise UserError(
            "is too short", file=rec.path, expected=f"{parts * steps} control ticks or more", got=parts * ticks
        )
    out = [_piece(s, k * ticks, ticks, steps) for s in runs for k in range(parts)]
    if rec.ee is not None:
        path = rec.ee[:, :3]
    else:
        read = np.isfinite(rec.q).all(axis=1, keepdims=True)
        path = np.where(read, flange_pose(robot, rec.q)[:, :3], np.nan)
    measured = np.stack(
        [np.stack([np.interp(s.rows, np.arange(len(path)), column) for column in path.T], 1) for s in out]
    )
    if any(np.isnan(piece).all() for piece in measured):
        raise UserError("has a piece without a measured pose", file=rec.path, key="q" if rec.ee is None else "ee")
    return Pieces(robot, tuple(out), measured)


def _piece(run: Segment, first: int, ticks: int, steps: int) -> Segment:
    """Return `ticks` control ticks of an episode from number `first` on, with `steps` evenly spaced sample times."""
    rows = slice(first, first + ticks)
    # ticks at which the flange is compared, the last at the end of a piece
    at = np.arange(1, steps + 1) * ticks // steps - 1
    grid = np.interp((first + at) * run.tick, run.time, run.rows)  # row numbers, integers if the clocks agree
    command = {name: values[rows] for name, values in run.command.items()}
    q, dq, raw = run.q[rows], run.dq[rows], run.q_raw[rows]
    return Segment(run.control, run.tick, command, q, dq, raw, at * run.tick, grid, run.begun + first * run.tick)


def paths(pieces: Pieces, worlds: Sequence[World], nthread: int = 1) -> np.ndarray:
    """Return flange positions (nworld, npiece, nstep, 3) m of simulated worlds; NaN where a rollout diverged."""
    responses = simulate(pieces.robot, worlds, pieces.segments, h_max=2e-3, nthread=nthread, want_ee=True)
    return np.stack([r.ee[:, :, :3] for r in responses if r.ee is not None], axis=1)


def cost(pieces: Pieces, simulated: np.ndarray) -> float:
    """Return the sum over pieces of the 2-norm of measured minus simulated positions (npiece, nstep, 3), m.

    Steps without a measured position are not compared.
    """
    gap = np.where(np.isnan(pieces.measured), 0.0, np.nan_to_num(pieces.measured - simulated, nan=WORST))
    return float(np.linalg.norm(gap.reshape(len(gap), -1), axis=1).sum())


class Coordinates:
    """Parameters of the protocol as a vector in typical sizes: tilt (2), link masses (nj), damping (nj).

    Attributes:
        world: the given model without those effects at `all` places, which `placed` holds for each place.
        axes: effect, place, parameter and typical size of each coordinate.
        placed: (effect, place) -> the given model's effect there or at `all` places, at null if it lacks both.
    """

    def __init__(self, world: World, pieces: Pieces):
        robot = pieces.robot
        nominal = Nominal(compiled(robot), robot.joints, robot.flange, 1, 1)
        mass = nominal.operational(pieces.segments[0].q[:1])[0][0]
        inertia = 1.0 / np.diagonal(np.linalg.inv(mass))  # of each joint if the others are free
        self.axes: list[tuple[str, str, str, float]] = [("gravity_tilt", "base", k, TILT) for k in ("roll", "pitch")]
        self.axes += [("link_mass", link, "mass", MASS) for link in robot.links]
        self.axes += [("viscous_friction", j, "damping", DECAY * i) for j, i in zip(robot.joints, inertia, strict=True)]
        self.placed = {(name, where): EffectInstance.of(name, where) for name, where, _, _ in self.axes}
        for e in world.effects:  # of two at one place the later one counts
            at = [(name, where) for name, where in self.placed if name == e.effect and e.where in (where, ALL)]
            self.placed |= {(name, where): replace(e, where=where) for name, where in at}
        spread = {(name, ALL) for name, _ in self.placed}
        self.world = replace(world, effects=tuple(e for e in world.effects if (e.effect, e.where) not in spread))

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds, (2 + 2 nj,) each."""
        params = [effect(name).params[key] for name, _, key, _ in self.axes]
        unit = np.array([a[3] for a in self.axes])
        return np.array([p.low for p in params]) / unit, np.array([p.high for p in params]) / unit

    @property
    def start(self) -> np.ndarray:
        """The given model's values, (2 + 2 nj,)."""
        return np.array([self.placed[name, where].params[key].value / unit for name, where, key, unit in self.axes])

    def at(self, x: np.ndarray) -> World:
        """Return the world at a point (2 + 2 nj,), which is clipped to the bounds."""
        low, high = self.bounds
        values: dict[tuple[str, str], dict[str, float]] = {}
        for (name, where, key, unit), v in zip(self.axes, np.clip(x, low, high), strict=True):
            values.setdefault((name, where), {})[key] = float(v * unit)
        return self.world.add(*(self.placed[at].with_values(**v) for at, v in values.items()))


def fit_paper(
    world: World,
    pieces: Pieces,
    *,
    rng: np.random.Generator,
    generations: int = GENERATIONS,
    nthread: int = 1,
    trace: Trace | None = None,
) -> World:
    """Return the world with the masses, damping and gravity that fit the flange's path best.

    Args:
        world: the given model, at which the search starts.
        pieces: the fitted recording.
        rng: of CMA-ES.
        generations: number of generations of CMA-ES.
        nthread: threads of the simulation.
        trace: each generation is recorded in it, and the search resumes from where it ends; None records nothing.
    """
    space = Coordinates(world, pieces)
    low, high = space.bounds

    def costs(points: list[np.ndarray]) -> list[float]:
        return [cost(pieces, y) for y in paths(pieces, [space.at(x) for x in points], nthread)]

    start = np.clip(space.start, low, high)
    best = minimise(costs, start, low, high, sigma=0.5, generations=generations, rng=rng, trace=trace)
    return space.at(best)
