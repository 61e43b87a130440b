"""Residual and derivatives at the points of a least-squares fit, each computed once and stored compactly.

A point is a vector of optimizer coordinates (`Space`). A residual is rough if it chatters from point to point.
"""

from __future__ import annotations

import numpy as np

from vispeg.identify.checkpoint import Trace
from vispeg.identify.pool import Submit
from vispeg.identify.space import Space

REFUSED = 2  # steps in a row without gain that end a fit to a rough residual: a single one may just have been too long


class Settled(Exception):
    """Raised when the remaining gain is within the roughness of the residual; `u` is the best point."""

    def __init__(self, u: np.ndarray):
        super().__init__("settled")
        self.u = u


class Point:
    """Residuals and finite-difference Jacobians of the points of one fit.

    Both of a point are computed in one batch, because a few more rows cost less than another call. If the residual is
    rough, steps without gain are common, so derivatives are computed only at points that improve.

    Args:
        space: the coordinates.
        submit: simulates worlds.
        trace: records each point; points already in it are not computed again.
        columns: (m, k) derivatives to the first k coordinates, taken as constant; None to compute all.
        rough: change of the squared residual that means nothing, such as solver chatter; 0 if the residual is smooth.

    Attributes:
        evaluated: for the present and the best point its residual and its derivatives other than `columns`.
        answers: for each point its `answer`.
        asked: points that were asked for, so that each counts once in `refused`.
        best, least, refused: best point so far, its squared residual, and steps without gain since.
    """

    def __init__(
        self,
        space: Space,
        submit: Submit,
        trace: Trace | None = None,
        columns: np.ndarray | None = None,
        rough: float = 0.0,
    ):
        self.space, self.submit, self.trace, self.columns, self.rough = space, submit, trace, columns, rough
        self.evaluated: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
        points = [] if trace is None else trace.points
        self.answers = {np.array(u, float).tobytes(): np.array(answer, float) for u, answer in points}
        self.asked: set[bytes] = set()
        self.best, self.least, self.refused = np.zeros(0), np.inf, 0

    def at(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (m,) and Jacobian (m, n) of a point."""
        key = u.tobytes()
        if key not in self.evaluated:
            self._evaluate(u)
        r, jac = self.evaluated[key]
        return r, jac if self.columns is None else np.column_stack([self.columns, jac])

    def answer(self, u: np.ndarray) -> np.ndarray:
        """Return residual and Jacobian at a point in a compressed form for least squares: [R Q'r; 0 |r - QQ'r|].

        Here r (m,) is the residual and QR (m, n) the Jacobian. Products of the columns of these n + 1 rows are those of
        all m rows, hence the gradient, the steps and the decrease of the cost are the same, up to rounding. If the
        residual is rough and does not improve at the point, only |r| is computed, and all else is 0.

        Raises:
            Settled: no step from here promises a gain beyond roughness, or none of the last ones gained anything.
        """
        key = u.tobytes()
        if key not in self.answers:
            self.answers[key] = self._answer(u)
            if self.trace is not None:
                self.trace.point(u, self.answers[key])
        if key not in self.asked:
            self.asked.add(key)
            self._compare(u, self.answers[key])
        return self.answers[key]

    def _compare(self, u: np.ndarray, answer: np.ndarray) -> None:
        """Keep a point that improves; end the fit if only roughness is left."""
        cost, promised = float(np.sum(answer[:, -1] ** 2)), float(np.sum(answer[:-1, -1] ** 2))
        if cost >= self.least:
            self.refused += 1
        else:
            self.best, self.least, self.refused = u.copy(), cost, 0
        if self.rough and (self.refused >= REFUSED or (cost <= self.least and promised < self.rough)):
            raise Settled(self.best)

    def _answer(self, u: np.ndarray) -> np.ndarray:
        """Compute the `answer` of a point."""
        n = len(u)
        if self.rough and self.least < np.inf:
            (r,) = self.submit([self.space.at(u)])
            if float(r @ r) >= self.least:
                return np.pad([[np.linalg.norm(r)]], (n, 0))
            self._evaluate(u, r)
        r, jac = self.at(u)
        q, upper = np.linalg.qr(jac)
        along = q.T @ r
        last_row = np.append(np.zeros(n), np.linalg.norm(r - q @ along))
        return np.vstack([np.column_stack([upper, along]), last_row])

    def _evaluate(self, u: np.ndarray, r: np.ndarray | None = None) -> None:
        """Roll out one step from `u` along each coordinate, and `u` itself too if its residual `r` is not given.

        The result goes to `evaluated`, which keeps only one more point, the best.
        """
        steps, first = self.space.steps(u), 0 if self.columns is None else self.columns.shape[1]
        points = [u + np.eye(len(u))[i] * steps[i] for i in range(first, len(u))]
        r, *moved = self._simulated([u, *points]) if r is None else [r, *self._simulated(points)]
        slopes = [(m - r) / s for m, s in zip(moved, steps[first:], strict=True)]
        jac = np.stack(slopes, axis=1) if slopes else np.empty((len(r), 0))
        if self.evaluated:  # the solver ends at this point or at an earlier best one
            best = min(self.evaluated, key=lambda k: float(np.sum(self.evaluated[k][0] ** 2)))
            self.evaluated = {best: self.evaluated[best]}
        self.evaluated[u.tobytes()] = (r, jac)

    def _simulated(self, points: list[np.ndarray]) -> list[np.ndarray]:
        """Return the residuals at the points."""
        return self.submit([self.space.at(p) for p in points]) if points else []
