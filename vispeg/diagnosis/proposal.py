"""Propose effects in torque space, in seconds: a linear model of every effect, searched by add, remove and exchange.

Along a measured motion (q, dq, ddq) the drive of joint j gave tau_j, measured or computed from a known controller. The
nominal arm needs tau0_j by inverse dynamics. For effects whose torque is linear in their sizes c, the difference is

    y = tau - tau0 = X c + e,    e_j ~ N(0, s_j^2 + (0.05 rms(y_j))^2)    for each joint j

y is the missing torque. Each column of X is the torque of one effect along the motion (its `write`, `friction`,
`torque`, `along`, `inverse` or `regressor`), the difference between a world with that effect and the world without. So
y is the same for all sizes, and the column of a sensor gain is the model's torque, not the measured one (regressed on
the measured torque, a gain of 0 would fit perfectly). s is the standard deviation of y due to sensor noise, from a
simulated repeat. No law is exact, so a further 5 % of the missing torque counts as noise.

With a prior c ~ N(0, P), the log evidence L of a set S of effects on the fitted recordings, and its log likelihood H on
the held-out ones, are, with the Gram matrix A = I + P^1/2 X'WX P^1/2 and b = P^1/2 X'W y of its columns,

    L(S) = 1/2 b' A^-1 b - 1/2 log det A - |S| log N,        H(S) = -1/2 |y - X c(S)|^2_W  held out

N is the number of candidates, |S| the number of effects in S. W holds the inverse variances of e, scaled down because
neighbouring samples are correlated. An added effect must raise both H and L + H. One Gram matrix serves all moves.

This only proposes: effects that are nonlinear in their sizes, or that act only in closed loop, are not in the model.
Rollouts confirm. Sources: Gautier and Khalil, IEEE Transactions on Robotics and Automation 6(3), 1990, on what is
linear in torque; MacKay, Neural Computation 4(3), 1992, on evidence.

A magnitude is a parameter whose null, a value such as 0, removes the effect; a shape is any other parameter. An effect
may have a column for each magnitude, and one for each of its moments: shapes whose product with the magnitude enters
linearly, such as the position of a mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from vispeg.core.effect import Effect, EffectInstance, effect, searchable
from vispeg.core.rules import RULES
from vispeg.diagnosis.evidence.localise import joint_data, missing_torque
from vispeg.diagnosis.evidence.signatures import STEP, Probe, Signature, probes
from vispeg.diagnosis.schema import Likely, Place, ProposalRecord
from vispeg.identify.channels import shows
from vispeg.identify.drives import Drives, noise
from vispeg.identify.inverse import MOTION_HZ
from vispeg.identify.space import Freedom, Space
from vispeg.recordings.recording import Recording
from vispeg.sim.compiled import compiled
from vispeg.worlds.world import World

STEPS = 3  # most Gauss-Newton steps of the last fit
BATCH = 16  # worlds whose torques are computed at once, to limit memory

Move = tuple[float, str, list[int]]  # L + H after it, its words, and the set that it leads to


@dataclass(frozen=True)
class Named:
    """One effect of a proposal.

    Attributes:
        placed: the effect with its values.
        share: share of the user's model's squared missing torque (weighted by W) that the effect removes, when the
            effects are added one by one, the most useful first.
        equals: (effect, where) of effects whose L + H in its place is as high or nearly so.
    """

    placed: EffectInstance
    share: float
    equals: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Proposal:
    """Effects proposed from torques alone, before any rollout.

    Attributes:
        named: the effects, by decreasing share.
        joints: names of the nj joints.
        before, after: (nj,) RMS missing torque of each joint while it moves, N m, on the held-out recordings: of the
            user's model and of the model with the effects.
        floor: (nj,) the same due to noise alone, on the fitted recordings.
        measured: whether the torques were measured, not computed from the controller.
        path: moves of the search, in order.
    """

    named: tuple[Named, ...]
    joints: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    floor: np.ndarray
    measured: bool
    path: tuple[str, ...] = field(default=(), compare=False)

    @property
    def errors(self) -> tuple[float, float]:
        """RMS over all joints of `before` and of `after`, N m."""
        return float(np.sqrt(np.mean(self.before**2))), float(np.sqrt(np.mean(self.after**2)))

    @property
    def record(self) -> ProposalRecord:
        """The proposal as diagnosis.json holds it."""
        effects: list[Likely] = []
        for n in self.named:
            params = {
                name: {"value": float(v.value), "unit": effect(n.placed.effect).params[name].unit}
                for name, v in n.placed.params.items()
            }
            equals: list[Place] = [{"effect": name, "where": where} for name, where in n.equals]
            name, where, share = n.placed.effect, n.placed.where, round(n.share, 4)
            effects.append({"effect": name, "where": where, "params": params, "share": share, "equals": equals})
        rows = zip(self.joints, self.before, self.after, self.floor, strict=True)
        return {
            "effects": effects,
            "torque": "measured" if self.measured else "sent by the controller",
            "before": self.errors[0],
            "after": self.errors[1],
            "unit": "N m RMS",
            "joints": [{"joint": j, "before": float(b), "after": float(a), "noise": float(n)} for j, b, a, n in rows],
        }


def propose(world: World, fitted: Sequence[Recording], held_out: Sequence[Recording]) -> Proposal | None:
    """Propose effects to add to `world` from torques; None if no drive torque is known or no joint moves.

    Args:
        world: the model as given.
        fitted, held_out: recordings of one arm; those without known drive torque are left out.
    """
    linear = linear_of(world, fitted, held_out)
    return None if linear is None else linear.proposal(*linear.search())


def linear_of(world: World, fitted: Sequence[Recording], held_out: Sequence[Recording]) -> Linear | None:
    """Return the linear model in which `propose` searches; None as there."""
    ours, theirs = Drives(fitted), Drives(held_out)
    if not ours or not theirs:
        return None
    data = _Side(world, ours), _Side(world, theirs)
    if not data[0].moves.any() or not data[1].moves.any():
        return None
    return Linear(_candidates(world, ours), data, noise(ours.recordings, world))


def placed(proposal: Proposal | None) -> list[EffectInstance]:
    """Return the effects of a proposal, by decreasing share; none without one."""
    return [] if proposal is None else [n.placed for n in proposal.named]


class _Side:
    """The fitted or the held-out recordings as n rows of the linear model.

    Attributes:
        world: the user's model.
        drives: the drive torques of the recordings.
        base: (n, nj) N m, the torque that the model needs.
        moves: (n, nj) bool, where the joint moves; only these rows count.
        y: (n, nj) N m, missing torque, 0 in the other rows.
    """

    def __init__(self, world: World, drives: Drives):
        self.world, self.drives = world, drives
        self.base = drives.needed([world])[0]
        self.moves = drives.valid & (np.abs(drives.dq) > RULES.first_slow)
        self.y = np.where(self.moves, drives.torque - self.base, 0.0)

    def lacks(self, *worlds: World) -> np.ndarray:
        """Return the missing torque (n, nj) N m of a world, drive torque minus needed; of several (nworld, n, nj)."""
        parts = [worlds[k : k + BATCH] for k in range(0, len(worlds), BATCH)]
        needed = np.concatenate([self.drives.needed(part) for part in parts])
        out = np.where(self.moves, self.drives.torque - needed, 0.0)
        return out if len(worlds) > 1 else out[0]

    def columns(self, variants: Sequence[EffectInstance]) -> np.ndarray:
        """Return the torque (nvariant, n, nj) N m of each effect when added to the world."""
        parts = (variants[k : k + BATCH] for k in range(0, len(variants), BATCH))
        lacks = [self.lacks(*(self.world.add(v) for v in part)).reshape(-1, *self.y.shape) for part in parts]
        return np.concatenate([(self.y - part).astype(np.float32) for part in lacks])

    @property
    def power(self) -> np.ndarray:
        """Mean square (nj,) of each joint's missing torque while it moves, (N m)^2."""
        return (self.y**2).sum(axis=0) / np.maximum(self.moves.sum(axis=0), 1)


def _candidates(world: World, drives: Drives) -> list[Probe]:
    """Return probes of the effects visible in torques that the world lacks, at every place.

    Shape parameters are estimated from the data.
    """
    item = drives.items[0]
    predicted = drives.needed([world])[0]
    ends = np.cumsum([len(i.segment.time) for i in drives.items])[:-1]
    missing = [missing_torque(i, y) for i, y in zip(drives.items, np.split(predicted, ends), strict=True)]
    taken = {(e.effect, e.where) for e in world.effects}
    places = [
        (name, where)
        for name, kind in searchable().items()
        if shows(kind, "needed") or kind.overrides("regressor") and not drives.measured
        for where in (["all"] if kind.shared else kind.targets(item.robot))
        if (name, where) not in taken and (name, "all") not in taken
    ]
    return probes(places, item, joint_data(missing, [*drives.items]))


class Linear:
    """The linear model of all candidates, on fitted and held-out recordings, as Gram matrices.

    Sets of effects (`chosen`) are lists of indices into `entries`; in a search they are sorted, so that rounding cannot
    make one set better than itself.

    Args:
        candidates: effects with the values at which their columns are evaluated.
        sides: fitted and held-out rows.
        floor: (nj,) standard deviation of the missing torque due to noise, N m.

    Attributes:
        entries: candidates whose columns are not zero.
        of: for each entry the indices of its columns.
        first: for each column the first column of the same entry, that of a magnitude.
        shift: for each column whether it belongs to a moment.
        bounds: (2, k) of the coefficients of the k columns.
        compatible: (nentry, nentry) bool, whether two entries may be in one set.
        prior: (k,) standard deviations P^1/2 of the coefficients.
        parts: for each side the sums X'X, X'y and y'y of each joint, columns multiplied by `prior`.
        price: log of the number of entries, by which each effect of a set lowers L.
        gram, slope, total: the fitted sums, weighted and added over joints; `held` has the same of the held-out rows.
        matrix: A of all columns.
    """

    def __init__(self, candidates: Sequence[Probe], sides: tuple[_Side, _Side], floor: np.ndarray):
        self.sides, self.floor, own = sides, floor, sides[0].drives
        variants = [v for probe in candidates for v in probe.variants]
        starts = np.cumsum([0, *(len(p.variants) for p in candidates)])
        numbered = zip(starts, candidates, strict=False)
        lead = np.concatenate([[-1] * len(p.names) + [k] * len(p.moments) for k, p in numbered]).astype(int)
        sums = [_sums(side, variants, lead) for side in sides]
        self.entries: list[Signature] = []
        self.of: list[np.ndarray] = []
        kept: list[int] = []
        at, shown = 0, np.diagonal(sums[0][0], axis1=1, axis2=2).sum(axis=0) > 0
        for probe in candidates:
            rows = np.arange(at, at + len(probe.variants))
            at += len(rows)
            if shown[rows].all():
                self.of.append(np.arange(len(kept), len(kept) + len(rows)))
                self.entries.append(Signature(probe.placed, probe.names, np.empty((0, len(rows))), probe.moments))
                kept += rows.tolist()
        arm = compiled(own.items[0].robot)
        limits = [effect(s.probe.effect).limits(arm, s.probe.where) for s in self.entries]
        self.bounds = np.concatenate([_bounds(*pair) for pair in zip(self.entries, limits, strict=True)], axis=1)
        self.first = np.repeat([rows[0] for rows in self.of], [len(rows) for rows in self.of])
        self.shift = np.concatenate(
            [np.arange(len(rows)) >= len(s.names) for s, rows in zip(self.entries, self.of, strict=True)]
        )
        keys = [s.key for s in self.entries]
        self.compatible = np.array([[not _exclude(a, b) for b in keys] for a in keys])
        self.prior = np.concatenate([_width(s) for s in self.entries])
        self.parts = [
            (gram[:, kept][:, :, kept] * np.outer(self.prior, self.prior), slope[:, kept] * self.prior, total)
            for gram, slope, total in sums
        ]
        self.price = float(np.log(max(len(self.entries), 2)))
        self.weigh(floor**2 + RULES.first_form**2 * sides[0].power)

    def weigh(self, variance: np.ndarray) -> None:
        """Set the variances (nj,) of each joint's missing torque, (N m)^2, due to noise and model form."""
        drives = self.sides[0].drives
        # samples of a signal band-limited to MOTION_HZ are correlated: 2 MOTION_HZ per second are independent
        rate = len(drives.torque) / sum(float(np.ptp(i.segment.time)) for i in drives.items)
        self.variance = variance
        self.weight = weight = min(1.0, 2.0 * MOTION_HZ / rate) / (variance + 1e-12)
        (self.gram, self.slope, self.total), self.held = (
            tuple(np.tensordot(weight, part, axes=1) for part in parts) for parts in self.parts
        )
        self.matrix = self.gram + np.eye(len(self.gram))

    def score(self, chosen: Sequence[int]) -> tuple[float, float, np.ndarray]:
        """Return L and H of a set of entries, and its coefficients, each over the standard deviation of its prior."""
        if not len(chosen):
            return 0.0, -0.5 * float(self.held[2]), np.zeros(0)
        i = self._rows(chosen)
        factor = cho_factor(self.matrix[np.ix_(i, i)], lower=True)
        c = cho_solve(factor, self.slope[i])
        evidence = 0.5 * c @ self.slope[i] - np.log(np.diag(factor[0])).sum() - self.price * len(chosen)
        gram, slope, total = self.held
        return float(evidence), -0.5 * _squared(c, i, gram, slope, float(total)), c

    def additions(self, chosen: Sequence[int]) -> list[int]:
        """Return up to `looked` entries that raise L if added to the chosen ones, by decreasing rise."""
        matrix, slope = self.matrix, self.slope
        if len(chosen):
            i = self._rows(chosen)
            answer = cho_solve(cho_factor(matrix[np.ix_(i, i)]), np.column_stack([matrix[i], slope[i]]))
            matrix, slope = matrix - matrix[:, i] @ answer[:, :-1], slope - matrix[:, i] @ answer[:, -1]
        rise = {}
        for k in self._free(chosen):
            j = self.of[k]
            if len(j) == 1:
                rise[k] = 0.5 * (slope[j[0]] ** 2 / matrix[j[0], j[0]] - np.log(matrix[j[0], j[0]]))
            else:
                block = matrix[np.ix_(j, j)]
                rise[k] = 0.5 * (slope[j] @ np.linalg.solve(block, slope[j]) - np.linalg.slogdet(block)[1])
        raising = sorted((k for k in rise if rise[k] > self.price), key=lambda k: -rise[k])
        return [*islice((k for k in raising if self.possible([*chosen, k])), RULES.looked)]

    def possible(self, chosen: Sequence[int]) -> bool:
        """Return whether all sizes of a set lie within their bounds."""
        i = self._rows(chosen)
        c = self.score(chosen)[2] * self.prior[i]
        scale = np.zeros(len(self.prior))
        scale[i] = c
        # the coefficient of a shape parameter, divided by its magnitude's, is its shift; a magnitude is not divided
        size = np.where(self.shift[i], np.abs(scale[self.first[i]]), 1.0)
        return bool(np.all((c >= self.bounds[0, i] * size) & (c <= self.bounds[1, i] * size)))

    def search(self) -> tuple[list[int], list[str]]:
        """Search for the set of which no move raises L + H; also return the moves that led to it.

        The held-out residual of a joint measures there the error of the laws' form. While it exceeds the variance
        assumed so far, the search continues with the larger variance, until that changes nothing in the set. Then one
        effect is tried in place of several (`in_place`): masses and centres of links may imitate a load so well that
        no exchange of one for one leads to it.
        """
        chosen, path = self.climb([])
        while True:
            c, i = self.score(chosen)[2], self._rows(chosen)
            squares = np.array([_squared(c, i, *joint) for joint in zip(*self.parts[1], strict=True)])
            self.weigh(np.maximum(self.variance, squares / np.maximum(self.sides[1].moves.sum(axis=0), 1)))
            chosen, climbed = self.climb(chosen)
            path += climbed
            if not climbed:
                moves = (self.in_place(chosen, k) for k in self._free(chosen))
                best = self._best(chosen, [m for m in moves if m is not None])
                if best is None:
                    return chosen, path
                _, move, chosen = best
                path.append(move)

    def climb(self, chosen: list[int]) -> tuple[list[int], list[str]]:
        """Add, remove or swap an effect, whichever raises L + H most, until no move raises it.

        Return the set and the moves.
        """
        path: list[str] = []
        while True:
            best = self._best(chosen, self._single(chosen))
            if best is None:
                return chosen, path
            _, move, chosen = best
            path.append(move)

    def _best(self, chosen: Sequence[int], moves: Sequence[Move]) -> Move | None:
        """Return the move to a possible set that raises L + H most; None if none raises it."""
        now = self.merit(chosen)
        return max((m for m in moves if m[0] > now and self.possible(m[2])), default=None, key=lambda m: m[0])

    def _single(self, chosen: list[int]) -> list[Move]:
        """Return the moves that add, remove or swap one effect."""
        moves, held = [], self.score(chosen)[1]
        for k in self.additions(chosen):
            more = sorted([*chosen, k])
            evidence, likelihood, _ = self.score(more)
            if likelihood > held:
                moves.append((evidence + likelihood, f"+ {self._label(k)}", more))
        for k in chosen:
            kept = [c for c in chosen if c != k]
            moves.append((self.merit(kept), f"- {self._label(k)}", kept))
            swapped = [other for other in self.additions(kept) if other != k]
            sets = [sorted([*kept, o]) for o in swapped]
            moves += [
                (self.merit(s), f"{self._label(k)} > {self._label(o)}", s) for o, s in zip(swapped, sets, strict=True)
            ]
        return moves

    def in_place(self, chosen: Sequence[int], new: int) -> Move | None:
        """Return the move that adds `new` and removes, one by one, what then raises L + H by its removal.

        None if nothing is removed, or if `new` does not raise L of the others that stay, as an addition must.
        """
        best, out = sorted([*chosen, new]), []
        value = self.merit(best)
        while True:
            fewer = [[c for c in best if c != k] for k in best if k != new]
            after, kept = max(((self.merit(s), s) for s in fewer), default=(-np.inf, best))
            if after <= value:
                break
            out += set(best) - set(kept)
            value, best = after, kept
        without = [k for k in best if k != new]
        if not out or self.score(best)[0] <= self.score(without)[0]:
            return None
        return value, f"{', '.join(map(self._label, out))} > {self._label(new)}", best

    def merit(self, chosen: Sequence[int]) -> float:
        """Return L + H of a set of entries."""
        return sum(self.score(chosen)[:2])

    def proposal(self, chosen: Sequence[int], path: Sequence[str]) -> Proposal:
        """Return the proposal of a set of entries, with sizes refined by the exact, nonlinear laws."""
        c, at, placed = self.score(chosen)[2] * self.prior[self._rows(chosen)], 0, []
        for k in chosen:
            placed.append(self.entries[k].placed(c[at : at + len(self.of[k])].tolist()))
            at += len(self.of[k])
        placed = _fitted(self.sides[0], placed, self.weight)
        total, shares, named = self.merit(chosen), self._shares(chosen), []
        for k, effect_there in zip(chosen, placed, strict=True):
            kept = [other for other in chosen if other != k]
            equals = [o for o in self.additions(kept) if self.merit([*kept, o]) > total - RULES.first_tie]
            keys = dict.fromkeys(self.entries[o].key for o in equals if self.entries[o].key != self.entries[k].key)
            named.append(Named(effect_there, shares[k], tuple(keys)))
        named.sort(key=lambda n: -n.share)
        side = self.sides[1]
        lacking = side.lacks(side.world.add(*placed))
        before, after = (np.sqrt((y**2).sum(axis=0) / np.maximum(side.moves.sum(axis=0), 1)) for y in (side.y, lacking))
        joints = side.drives.items[0].robot.joints
        return Proposal(tuple(named), joints, before, after, self.floor, side.drives.measured, tuple(path))

    def _shares(self, chosen: Sequence[int]) -> dict[int, float]:
        """Return the share of the squared missing torque that each entry removes, adding the most useful first."""
        inside: list[int] = []
        out, now = {}, self._loss([])
        while len(inside) < len(chosen):
            new, k = min((self._loss([*inside, k]), k) for k in chosen if k not in inside)
            out[k], now = (now - new) / max(self.total, 1e-12), new
            inside.append(k)
        return out

    def _loss(self, chosen: Sequence[int]) -> float:
        """Return the weighted squared residual of a set on the fitted recordings."""
        return _squared(self.score(chosen)[2], self._rows(chosen), self.gram, self.slope, float(self.total))

    def _rows(self, chosen: Sequence[int]) -> np.ndarray:
        return np.concatenate([self.of[k] for k in chosen]) if len(chosen) else np.zeros(0, int)

    def _free(self, chosen: Sequence[int]) -> list[int]:
        """Return the entries that are compatible with all chosen ones."""
        return np.flatnonzero(self.compatible[list(chosen)].all(axis=0)).tolist()

    def _label(self, k: int) -> str:
        return self.entries[k].probe.label


def _exclude(a: tuple[str, str], b: tuple[str, str]) -> bool:
    """Return whether two effects at one place describe the same phenomenon: equal, or with a common nested effect."""
    return a[1] == b[1] and not {a[0], *effect(a[0]).contains}.isdisjoint({b[0], *effect(b[0]).contains})


def _bounds(s: Signature, limits: Mapping[str, tuple[float, float]]) -> np.ndarray:
    """Return lower and upper bounds (2, k) of the coefficients; for a moment, of its over the magnitude's."""
    params, out = effect(s.probe.effect).params, []
    for m in s.names:
        p = params[m]
        low, high = limits.get(m, (p.low, p.high))
        reach = s.probe.params[m].value - p.null
        out.append(sorted(((low - p.null) / reach, (high - p.null) / reach)))
    for m in s.moments:
        p, value = params[m], s.probe.params[m].value
        out.append([(end - value) / (STEP * (p.high - p.low)) for end in (p.low, p.high)])
    return np.array(out).T


def _width(s: Signature) -> np.ndarray:
    """Return the standard deviations (k,) of the coefficients' priors."""
    kind = effect(s.probe.effect)
    sizes = [
        RULES.first_typical
        * abs((kind.params[m].start - kind.params[m].null) / (s.probe.params[m].value - kind.params[m].null))
        for m in s.names
    ]
    return np.array([*sizes, *[RULES.first_shape / STEP * max(sizes)] * len(s.moments)])


class _Sizes(Freedom):
    """Fit magnitudes and `moments` of a proposed effect; its other shape parameters keep their estimates."""

    def frees(self, kind: Effect, name: str) -> bool:
        return kind.params[name].scale != "log" and (name in kind.magnitudes or name in kind.moments)


def _fitted(side: _Side, placed: Sequence[EffectInstance], weight: np.ndarray) -> list[EffectInstance]:
    """Refine the sizes with the nonlinear laws, in which, unlike in the columns, a mass multiplies its centre.

    Takes up to `STEPS` Gauss-Newton steps on the negative log posterior, as long as they lower it. `side` has the
    fitted recordings, `placed` the effects with start values; `weight` (nj,) is the inverse variance of each joint's
    missing torque.
    """
    given = len(side.world.effects)
    start = side.world.add(*placed)
    space = Space(start, range(given, len(start.effects)), _Sizes())
    if not space.axes:
        return list(placed)
    low, high = space.bounds
    arm = compiled(side.drives.items[0].robot)
    for k, a in enumerate(space.axes):
        its = start.effects[a.index]
        for value, which in zip(effect(its.effect).limits(arm, its.where).get(a.name, ()), (low, high), strict=False):
            which[k] = space.forward(value, a)
    null = np.array([space.forward(a.param.start if a.param.shape else a.param.null, a) for a in space.axes])
    width = np.array(
        [
            RULES.first_shape * (a.param.high - a.param.low) / a.unit if a.param.shape else RULES.first_typical
            for a in space.axes
        ]
    )

    def cost(lacks: np.ndarray, u: np.ndarray) -> float:
        return float(np.sum(weight * lacks**2) + np.sum(((u - null) / width) ** 2))

    u = np.clip(space.start, low, high)
    lacks = side.lacks(space.at(u))
    for _ in range(STEPS):
        steps = space.steps(u)
        moved = side.lacks(*(space.at(u + step) for step in np.diag(steps))).reshape(len(u), *lacks.shape)
        slope = ((lacks - moved) / steps[:, None, None] * np.sqrt(weight)).reshape(len(u), -1)
        pull = slope @ (lacks * np.sqrt(weight)).ravel() - (u - null) / width**2
        new = np.clip(u + np.linalg.solve(slope @ slope.T + np.diag(width**-2.0), pull), low, high)
        after = side.lacks(space.at(new))
        if cost(after, new) >= cost(lacks, u):
            break
        u, lacks = new, after
    return list(space.at(u).effects[given:])


def _sums(side: _Side, variants: Sequence[EffectInstance], lead: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return X'X (nj, k, k), X'y (nj, k) and y'y (nj,) of the effects' columns, (N m)^2.

    They are summed recording by recording, to save memory. `lead` has an entry for each variant: -1 for a magnitude;
    for a moment the index of the unshifted variant, whose column is subtracted.
    """
    nj, k = side.y.shape[1], len(variants)
    gram, slope, total = np.zeros((nj, k, k)), np.zeros((nj, k)), np.zeros(nj)
    for drives in side.drives.each():
        one = _Side(side.world, drives)
        x = one.columns(variants)
        moments = lead >= 0
        x[moments] -= x[lead[moments]]
        for j in range(nj):
            rows = one.moves[:, j]
            column, y = x[:, rows, j].astype(float), one.y[rows, j]
            gram[j] += column @ column.T
            slope[j] += column @ y
            total[j] += y @ y
    return gram, slope, total


def _squared(c: np.ndarray, i: np.ndarray, gram: np.ndarray, slope: np.ndarray, total: float) -> float:
    """Return y'y - 2 c'X'y + c'X'X c, the squared residual with coefficients `c` for the columns `i`."""
    return float(total - 2.0 * c @ slope[i] + c @ gram[np.ix_(i, i)] @ c)
