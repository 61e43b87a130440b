"""The uncertainty of a measured number: type A from repeats, type B from knowledge of the instrument.

Law of propagation, effective degrees of freedom and coverage factor: JCGM 100:2008 (GUM), 5.1.2, G.4.1 and G.3.2. If
the function is too nonlinear for this, the interval comes from a Monte Carlo propagation of distributions (JCGM
101:2008, clause 7), which replaces the linear one if they differ as in its clause 8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.worlds.measurement_file import LEVEL, BudgetRow, Quantity

GAUSSIAN_DOF = 1e6  # degrees of freedom above which Student's t counts as Gaussian
DRAWS = 200_000  # draws of a Monte Carlo propagation; the ends of a 95 % interval are then accurate to 0.5 % of u
AGREE = 0.05  # share of u within which the ends of two intervals agree (JCGM 101, 8.1: delta for two digits of u)


@dataclass(frozen=True)
class Input:
    """One input of a measured number.

    Attributes:
        name: the source, for the budget.
        value: its estimate.
        u: its standard uncertainty, in its unit.
        kind: A (from repeats) or B (from knowledge of the instrument).
        dof: degrees of freedom of `u`; infinite if `u` is known exactly.
        shape: the distribution: a Gaussian, Student's t with `dof`, or a rectangle of half width sqrt(3) u.
    """

    name: str
    value: float
    u: float
    kind: Literal["A", "B"]
    dof: float = np.inf
    shape: Literal["normal", "t", "rectangular"] = "normal"

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Draw values (count,) from the distribution that JCGM 101, table 1, assigns."""
        if self.shape == "rectangular":
            return self.value + np.sqrt(3.0) * self.u * rng.uniform(-1.0, 1.0, count)
        if self.shape == "t" and np.isfinite(self.dof):
            return self.value + self.u * rng.standard_t(self.dof, count)
        return self.value + self.u * rng.standard_normal(count)


def repeated(name: str, values: np.ndarray) -> Input:
    """Return the mean of repeats (n,): u = s / sqrt(n) with n - 1 degrees of freedom (GUM 4.2.3).

    Raises:
        UserError: fewer than two values.
    """
    x = np.asarray(values, float)
    if len(x) < 2:
        raise UserError("one value alone has no spread", key=name, expected="2 repeats or more", got=len(x))
    return Input(name, float(x.mean()), float(x.std(ddof=1) / np.sqrt(len(x))), "A", len(x) - 1.0, "t")


def rectangular(name: str, half: float, value: float = 0.0) -> Input:
    """Return an input with a uniform distribution within value +-half: u = half / sqrt(3) (GUM 4.3.7).

    For a resolution, `half` is half a digit.
    """
    return Input(name, value, half / np.sqrt(3.0), "B", np.inf, "rectangular")


def stated(name: str, u: float, value: float = 0.0, dof: float = np.inf) -> Input:
    """Return an input whose standard uncertainty u is known from a certificate or another measurement."""
    return Input(name, value, u, "B", dof, "normal" if np.isinf(dof) else "t")


def propagate(
    name: str,
    unit: str,
    function: Callable[..., np.ndarray | float],
    inputs: Sequence[Input],
    rng: np.random.Generator,
    *,
    repeats: int = 0,
    draws: int = DRAWS,
) -> Quantity:
    """Return the quantity `function(*inputs)` with its uncertainty budget and its 95 % interval.

    Args:
        name, unit: of the quantity.
        function: takes an argument for each input, all floats or all arrays (count,).
        inputs: independent of each other.
        rng: of the Monte Carlo propagation.
        repeats: number of readings behind the quantity, for the file.
        draws: number of draws of the Monte Carlo propagation.
    """
    best = [i.value for i in inputs]
    value = float(function(*best))
    rows = []
    for at, source in enumerate(inputs):
        slope = 0.0
        if source.u > 0:
            ends = [function(*(x + sign * source.u * (n == at) for n, x in enumerate(best))) for sign in (1.0, -1.0)]
            slope = float(ends[0] - ends[1]) / (2.0 * source.u)
        dof = None if np.isinf(source.dof) else float(source.dof)
        rows.append(BudgetRow(source.name, source.kind, source.u, dof, slope, abs(slope) * source.u))
    u = float(np.sqrt(sum(row.contribution**2 for row in rows)))
    dof = effective(rows)
    k = coverage(dof)
    low, high, method = value - k * u, value + k * u, "gum"
    if u > 0 and _bent(function, inputs, rows):
        with np.errstate(all="ignore"):  # draws far in the tails of Student's t may overflow
            drawn = np.asarray(function(*(i.draw(rng, draws) for i in inputs)), float)
        drawn = drawn[np.isfinite(drawn)]
        ends = np.quantile(drawn, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]) if len(drawn) > draws / 2 else (low, high)
        if max(abs(ends[0] - low), abs(ends[1] - high)) > AGREE * u:
            low, high, method = min(float(ends[0]), value), max(float(ends[1]), value), "monte carlo"
    return Quantity(name, value, unit, u, None if np.isinf(dof) else dof, k, low, high, method, tuple(rows), repeats)


def _bent(function: Callable[..., np.ndarray | float], inputs: Sequence[Input], rows: Sequence[BudgetRow]) -> bool:
    """Return whether second-order terms matter: more than 2 % of u at two standard uncertainties of an input."""
    best = [i.value for i in inputs]
    middle, u = float(function(*best)), float(np.sqrt(sum(r.contribution**2 for r in rows)))
    for at, source in enumerate(inputs):
        ends = [float(function(*(x + s * 2 * source.u * (n == at) for n, x in enumerate(best)))) for s in (1.0, -1.0)]
        if not np.isfinite(ends).all() or abs(ends[0] + ends[1] - 2 * middle) > 0.02 * u:
            return True
    return False


def effective(rows: Sequence[BudgetRow]) -> float:
    """Return the effective degrees of freedom by Welch and Satterthwaite (GUM G.2b); infinite if all inputs' are.

    They are not rounded down to a whole number, as Student's t is defined for any number.
    """
    total = sum(row.contribution**2 for row in rows)
    below = sum(row.contribution**4 / row.dof for row in rows if row.dof is not None)
    dof = total**2 / below if below > 0 else np.inf
    return dof if dof < GAUSSIAN_DOF else np.inf


def coverage(dof: float, level: float = LEVEL) -> float:
    """Return the coverage factor k of Student's t for `dof` degrees of freedom; 1.96 for infinitely many at 95 %.

    Source: GUM G.3.2.
    """
    return float(stats.t.ppf(0.5 + level / 2, dof) if np.isfinite(dof) else stats.norm.ppf(0.5 + level / 2))


def places(name: str, values: np.ndarray, place: np.ndarray | None) -> Input:
    """Return the mean over places of the mean at each place, with the uncertainty from the differences between places.

    With one place, or if `place` is None, it is the mean of all repeats. This is an analysis of variance as in GUM H.5.
    The spread between places includes the spread within them, so the two are never pooled.
    """
    if place is None or len(np.unique(place)) < 2:
        return repeated(f"repeats of {name}", values)
    means = np.array([values[place == label].mean() for label in np.unique(place)])
    return repeated(f"{name} at {len(means)} places", means)
