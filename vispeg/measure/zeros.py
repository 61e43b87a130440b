"""Fit joint zeros and frames to static poses: `M_i = W F(q_i - o) T` for measured poses M_i of a tip.

W is the pose of the base in the tracker's frame, T that of the tip in the flange's frame, o the offsets by which the
encoders read too much. Positions alone do not determine T's rotation. Some zeros cannot be identified, such as the
first joint's if the base's rotation about its axis is unknown, or the last joint's if the tool's is. They show as null
directions of the Jacobian. Such a zero stays 0 and is reported, and the frames are those for that choice.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import stats
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from vispeg.core.errors import UserError
from vispeg.measure.screws import Screws
from vispeg.render.calibration.rigid import shifted

ROUNDS = 3  # rounds of estimating the weights of positions and rotations, and solving
ARM = 0.1  # m/rad, initial weight of an error of rotation relative to one of position
STEP = 1e-5  # m and rad, step of central differences
NULL = 1e-6  # share of the largest singular value (columns of length 1) below which a direction is null
OPEN = 1e-3  # least component of a parameter in a null direction for it to be part of that
FIRST, TURNS = 8, 40  # rounds of the search for a start: for all candidates, and for the best
ODD = 4.0  # standard deviations beyond which a row is reported


@dataclass(frozen=True)
class Poses:
    """Measured poses of a tip.

    Attributes:
        q: (n, nj) rad, joint angles that the encoders read.
        position: (n, 3) m, of the tip in the tracker's frame.
        turn: (n, 3, 3) rotation matrices of the tip in the tracker's frame; None if only positions were measured.
    """

    q: np.ndarray
    position: np.ndarray
    turn: np.ndarray | None = None


@dataclass(frozen=True)
class Confounded:
    """A joint zero that these poses do not identify, and the parameters that could explain the same data.

    Attributes:
        joint: index of the joint.
        base, tool: whether the base's or the tool's frame is among these parameters.
        others: indices of further joints whose zeros are.
    """

    joint: int
    base: bool
    tool: bool
    others: tuple[int, ...] = ()


@dataclass(frozen=True)
class Zeros:
    """A solution.

    Attributes:
        offset: (nj,) rad, measured minus true angle; 0 if it is not identified.
        base: (4, 4) W, m.
        tool: (4, 4) T, m; with the flange's rotation if only positions were measured.
        u: standard uncertainties by name: `offset` (nj,) rad; `base` (6,) and `tool` (6,), m along the axes of the
            frame in which the pose is stated, then rad about the pose's own axes. 0 for parameters that are not fitted.
        dof: degrees of freedom.
        confounded: the zeros that are not identified.
        error_m, error_rad: RMS residual per axis, corrected for the degrees of freedom; `error_rad` is None if only
            positions were measured.
        odd: row -> its error in standard deviations, for rows beyond `ODD`.
    """

    offset: np.ndarray
    base: np.ndarray
    tool: np.ndarray
    u: dict[str, np.ndarray]
    dof: int
    confounded: tuple[Confounded, ...]
    error_m: float
    error_rad: float | None
    odd: dict[int, float] = field(default_factory=dict)


@dataclass
class _Fit:
    """The least-squares problem; `free` (12 + nj,) says which parameters of W (6), T (6) and the offsets are fitted."""

    arm: Screws
    poses: Poses
    free: np.ndarray
    base: np.ndarray
    tool: np.ndarray
    offset: np.ndarray

    def moved(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return W, T and the offsets, changed by the free parameters x."""
        full = np.zeros(12 + len(self.offset))
        full[self.free] = x
        return shifted(self.base, full[:6]), shifted(self.tool, full[6:12]), self.offset + full[12:]

    def residual(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return position errors (n, 3) m and rotation errors (n, 3) rad; the latter are empty without rotations."""
        base, tool, offset = self.moved(x)
        tip = base @ self.arm.poses(self.poses.q - offset) @ tool
        away = self.poses.position - tip[:, :3, 3]
        if self.poses.turn is None:
            return away, np.zeros((0, 3))
        turned = np.swapaxes(tip[:, :3, :3], 1, 2) @ self.poses.turn
        return away, Rotation.from_matrix(turned).as_rotvec()

    def flat(self, x: np.ndarray, scale: tuple[float, float]) -> np.ndarray:
        """Return all errors in one array, divided by `scale` (m, rad)."""
        away, turned = self.residual(x)
        return np.concatenate([away.ravel() / scale[0], turned.ravel() / scale[1]])

    def jacobian(self, x: np.ndarray, scale: tuple[float, float]) -> np.ndarray:
        """Return the derivatives of `flat` with respect to the free parameters, by central differences."""
        steps = STEP * np.eye(len(x))
        return np.stack([(self.flat(x + s, scale) - self.flat(x - s, scale)) / (2 * STEP) for s in steps], axis=1)


def solve(poses: Poses, arm: Screws, *, base_known: bool = False, tool_known: bool = False) -> Zeros:
    """Fit joint zeros and frames.

    Args:
        poses: angles and measured poses.
        arm: the nominal arm.
        base_known: whether the poses are in the base's frame, so that W is the identity.
        tool_known: whether the poses are the flange's, so that T is the identity.

    Raises:
        UserError: too few readings for the unknowns, or poses that do not determine the frames.
    """
    nj = poses.q.shape[1]
    frame = np.ones(12 + nj, bool)
    frame[:6] = not base_known
    frame[6:12] = not tool_known
    if poses.turn is None:
        frame[9:12] = False
    readings = poses.position.size + (0 if poses.turn is None else poses.turn.shape[0] * 3)
    if readings < frame.sum() + 3:
        need = int(np.ceil((frame.sum() + 3) / (readings / len(poses.q))))
        raise UserError("too few poses", expected=f"{need} or more for {frame.sum()} unknowns", got=len(poses.q))
    base, tool = _start(poses, arm.poses(poses.q), base_known, tool_known)
    fit = _Fit(arm, poses, frame, base, tool, np.zeros(nj))
    scale = (ARM, 1.0)
    confounded = _fix(fit, scale)
    count = int(fit.free.sum())
    x = np.zeros(count)
    for _ in range(ROUNDS):
        solution = least_squares(
            fit.flat, x, jac=lambda x, scale: fit.jacobian(x, scale), args=(scale,), x_scale="jac", max_nfev=60
        )
        x = solution.x
        away, turned = fit.residual(x)
        share = (readings - count) / readings
        sizes = [np.sqrt(max(float(np.mean(part**2)), 1e-24) / share) for part in (away, turned) if part.size]
        scale = (float(sizes[0]), float(sizes[1]) if len(sizes) > 1 else 1.0)
    jac = fit.jacobian(x, scale)
    u = np.zeros(12 + nj)
    u[fit.free] = np.sqrt(np.diag(np.linalg.pinv(jac.T @ jac)))
    base, tool, offset = fit.moved(x)
    away, turned = fit.residual(x)
    worst = np.max(np.abs(away), axis=1) / scale[0]
    if poses.turn is not None:
        worst = np.maximum(worst, np.max(np.abs(turned), axis=1) / scale[1])
    return Zeros(
        offset,
        base,
        tool,
        {"base": u[:6], "tool": u[6:12], "offset": u[12:]},
        readings - count,
        confounded,
        scale[0],
        None if poses.turn is None else scale[1],
        {int(i): float(worst[i]) for i in np.flatnonzero(worst > ODD)},
    )


def roughly(poses: Poses, arm: Screws, *, base_known: bool = False, tool_known: bool = False) -> tuple[float, float]:
    """Return the RMS residuals, m and rad, of fitted frames without joint zeros: enough to recognize a wrong unit."""
    flange = arm.poses(poses.q)
    base, tool = _start(poses, flange, base_known, tool_known)
    fit = _Fit(arm, poses, np.zeros(12 + poses.q.shape[1], bool), base, tool, np.zeros(poses.q.shape[1]))
    away, turned = fit.residual(np.zeros(0))
    return float(np.sqrt(np.mean(away**2))), float(np.sqrt(np.mean(turned**2))) if turned.size else 0.0


def half_width(u: np.ndarray, dof: int) -> np.ndarray:
    """Return the half widths of 95 % intervals for standard uncertainties u with `dof` degrees of freedom."""
    return stats.t.ppf(0.975, dof) * u


def _fix(fit: _Fit, scale: tuple[float, float]) -> tuple[Confounded, ...]:
    """Fix joint zeros in null directions, one after the other, until no null direction is left; changes `fit.free`.

    Raises:
        UserError: a null direction without joint zeros: the poses do not determine the frames, for example because only
            one joint moves.
    """
    out: list[Confounded] = []
    while True:
        places = np.flatnonzero(fit.free)
        jac = fit.jacobian(np.zeros(len(places)), scale)
        length = np.linalg.norm(jac, axis=0)
        seen = length > NULL * length.max()
        unseen = places[~seen]
        if (unseen < 12).any():
            raise UserError("the poses do not determine the frames", expected="poses in which several joints turn")
        for place in unseen:  # a joint that does not move the tip
            out.append(Confounded(int(place) - 12, False, False))
        if len(unseen):
            fit.free[unseen] = False
            continue
        _, sizes, rows = np.linalg.svd(jac / length, full_matrices=False)
        null = rows[sizes < NULL * sizes[0]]
        if not len(null):
            return tuple(sorted(out, key=lambda c: c.joint))
        part = np.linalg.norm(null, axis=0)
        held = [i for i, place in enumerate(places) if place >= 12 and part[i] > OPEN]
        if not held:
            raise UserError("the poses do not determine the frames", expected="poses in which several joints turn")
        first = max(held, key=lambda i: part[i] + 1e-9 * (len(places) - i))  # the one with the largest component
        coefficient = null.T @ null[:, first] / part[first]
        mixed = places[np.abs(coefficient) > OPEN]
        others = tuple(int(p) - 12 for p in mixed if p >= 12 and p != places[first])
        out.append(
            Confounded(
                int(places[first]) - 12, bool((mixed < 6).any()), bool(((mixed >= 6) & (mixed < 12)).any()), others
            )
        )
        fit.free[places[first]] = False


def _start(poses: Poses, flange: np.ndarray, base_known: bool, tool_known: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return W and T for offsets of 0: the best pair of several starts, from each of which both are fitted in turn."""
    starts = [np.eye(4)]
    if not tool_known:
        starts = _points() if poses.turn is None else _turned()
    found = [(np.eye(4), tool) for tool in starts]
    for turns, kept in ((FIRST, 2), (TURNS, 1)):  # the two best are continued
        done = [_alternated(poses, flange, base, tool, turns, base_known, tool_known) for base, tool in found]
        found = sorted(done, key=lambda pair: _apart(poses, pair[0] @ flange @ pair[1]))[:kept]
    return found[0]


def _alternated(
    poses: Poses, flange: np.ndarray, base: np.ndarray, tool: np.ndarray, turns: int, base_known: bool, tool_known: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Fit the base for a given tool, and the tool for a given base, in alternation, `turns` times."""
    for _ in range(turns):
        base = base if base_known else _base(poses, flange, tool)
        tool = tool if tool_known else _tool(poses, flange, base)
    return base, tool


def _apart(poses: Poses, tip: np.ndarray) -> float:
    """Return the mean squared difference between the measured poses and `tip` (n, 4, 4), m^2; rotations times ARM^2."""
    out = float(np.mean((poses.position - tip[:, :3, 3]) ** 2))
    return out if poses.turn is None else out + ARM**2 * float(np.mean((poses.turn - tip[:, :3, :3]) ** 2))


def _points() -> list[np.ndarray]:
    """Return candidates of T for measured positions: tips at the flange and 0.15 m from it along each axis."""
    out = []
    for at in np.concatenate([np.zeros((1, 3)), 0.15 * np.eye(3), -0.15 * np.eye(3)]):
        tool = np.eye(4)
        tool[:3, 3] = at
        out.append(tool)
    return out


def _turned() -> list[np.ndarray]:
    """Return candidates of T for measured rotations: the 24 rotations of a cube."""
    out = []
    for turn in Rotation.create_group("O").as_matrix():
        tool = np.eye(4)
        tool[:3, :3] = turn
        out.append(tool)
    return out


def _base(poses: Poses, flange: np.ndarray, tool: np.ndarray) -> np.ndarray:
    """Return the base W that brings the tips closest to the measured poses, for a given tool T."""
    tip = flange @ tool
    here, there = tip[:, :3, 3], poses.position
    spread = (there - there.mean(axis=0)).T @ (here - here.mean(axis=0))
    if poses.turn is not None:
        spread = spread + ARM**2 * np.einsum("nij,nkj->ik", poses.turn, tip[:, :3, :3])
    out = np.eye(4)
    out[:3, :3] = _nearest(spread)
    out[:3, 3] = there.mean(axis=0) - out[:3, :3] @ here.mean(axis=0)
    return out


def _tool(poses: Poses, flange: np.ndarray, base: np.ndarray) -> np.ndarray:
    """Return the tool T that brings the tips closest to the measured poses, for a given base W."""
    at = base @ flange
    out = np.eye(4)
    if poses.turn is not None:
        out[:3, :3] = _nearest(np.einsum("nji,njk->ik", at[:, :3, :3], poses.turn))
    out[:3, 3] = np.mean(np.einsum("nji,nj->ni", at[:, :3, :3], poses.position - at[:, :3, 3]), axis=0)
    return out


def _nearest(matrix: np.ndarray) -> np.ndarray:
    """Return the rotation nearest to a matrix (3, 3)."""
    left, _, right = np.linalg.svd(matrix)
    return left @ np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))]) @ right
