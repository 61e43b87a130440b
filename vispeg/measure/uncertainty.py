"""The uncertainty of a measured number: type A from repeats, type B from what is known of the instrument.

Law of propagation, effective degrees of freedom and coverage factor: JCGM 100:2008 (GUM), 5.1.2, G.4.1 and G.3.2. Where
the function is so bent that its linear form misses the interval, the interval is that of a propagation of
distributions: JCGM 101:2008, clause 7, compared with the linear one as its clause 8 compares them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

from vispeg.core.errors import UserError
from vispeg.worlds.measurement_file import LEVEL, BudgetRow, Quantity

MANY = 1e6  # degrees of freedom from which on Student's t is the Gaussian
DRAWS = 200_000  # of a propagation of distributions; the end of a 95 % interval is then good to 0.5 % of u
AGREE = 0.05  # of u: ends of both intervals this near count as the same (JCGM 101, 8.1: delta for two digits of u)


@dataclass(frozen=True)
class Input:
    """One input of a measured number.

    Attributes:
        name: the source, for the budget.
        value: its estimate.
        u: its standard uncertainty, in its unit.
        kind: A (from repeats) or B (from knowledge of the instrument).
        dof: degrees of freedom of `u`; infinite where it is known.
        shape: the distribution: a Gaussian, Student's t with `dof`, or a rectangle of half width sqrt(3) u.
    """

    name: str
    value: float
    u: float
    kind: Literal["A", "B"]
    dof: float = np.inf
    shape: Literal["normal", "t", "rectangular"] = "normal"

    def draw(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Values (count,) as JCGM 101, table 1, assigns them."""
        if self.shape == "rectangular":
            return self.value + np.sqrt(3.0) * self.u * rng.uniform(-1.0, 1.0, count)
        if self.shape == "t" and np.isfinite(self.dof):
            return self.value + self.u * rng.standard_t(self.dof, count)
        return self.value + self.u * rng.standard_normal(count)


def repeated(name: str, values: np.ndarray) -> Input:
    """Give the mean of repeats (n,), n >= 2: u = s / sqrt(n) with n - 1 degrees of freedom (GUM 4.2.3)."""
    x = np.asarray(values, float)
    if len(x) < 2:
        raise UserError("one value alone has no spread", key=name, expected="2 repeats or more", got=len(x))
    return Input(name, float(x.mean()), float(x.std(ddof=1) / np.sqrt(len(x))), "A", len(x) - 1.0, "t")


def rectangular(name: str, half: float, value: float = 0.0) -> Input:
    """Give the uncertainty within +-half: u = half / sqrt(3) (GUM 4.3.7). Of a resolution, half a digit."""
    return Input(name, value, half / np.sqrt(3.0), "B", np.inf, "rectangular")


def stated(name: str, u: float, value: float = 0.0, dof: float = np.inf) -> Input:
    """Give a standard uncertainty from a certificate or another measurement."""
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
    """Give the number `function(*inputs)` with its budget and its 95 % interval.

    Args:
        name, unit: of the number.
        function: of as many arguments as there are inputs, each a float or an array (count,).
        inputs: independent of each other.
        rng: of the propagation of distributions.
        repeats: how many readings stand behind it.
        draws: of that propagation.
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
        with np.errstate(all="ignore"):  # the far tail of few degrees of freedom
            drawn = np.asarray(function(*(i.draw(rng, draws) for i in inputs)), float)
        drawn = drawn[np.isfinite(drawn)]
        ends = np.quantile(drawn, [0.5 - LEVEL / 2, 0.5 + LEVEL / 2]) if len(drawn) > draws / 2 else (low, high)
        if max(abs(ends[0] - low), abs(ends[1] - high)) > AGREE * u:
            low, high, method = min(float(ends[0]), value), max(float(ends[1]), value), "monte carlo"
    return Quantity(name, value, unit, u, None if np.isinf(dof) else dof, k, low, high, method, tuple(rows), repeats)


def _bent(function: Callable[..., np.ndarray | float], inputs: Sequence[Input], rows: Sequence[BudgetRow]) -> bool:
    """Whether the second-order terms count: a hundredth of the linear ones at two standard uncertainties."""
    best = [i.value for i in inputs]
    middle, u = float(function(*best)), float(np.sqrt(sum(r.contribution**2 for r in rows)))
    for at, source in enumerate(inputs):
        ends = [float(function(*(x + s * 2 * source.u * (n == at) for n, x in enumerate(best)))) for s in (1.0, -1.0)]
        if not np.isfinite(ends).all() or abs(ends[0] + ends[1] - 2 * middle) > 0.02 * u:
            return True
    return False


def effective(rows: Sequence[BudgetRow]) -> float:
    """Effective degrees of freedom by Welch and Satterthwaite (GUM G.2b); infinite where all of them are.

    Not rounded down to a whole number: Student's t is defined in between.
    """
    total = sum(row.contribution**2 for row in rows)
    below = sum(row.contribution**4 / row.dof for row in rows if row.dof is not None)
    dof = total**2 / below if below > 0 else np.inf
    return dof if dof < MANY else np.inf


def coverage(dof: float, level: float = LEVEL) -> float:
    """Give the coverage factor k: Student's t for `dof`, 1.96 for very many at 95 % (GUM G.3.2)."""
    return float(stats.t.ppf(0.5 + level / 2, dof) if np.isfinite(dof) else stats.norm.ppf(0.5 + level / 2))


def places(name: str, values: np.ndarray, place: np.ndarray | None) -> Input:
    """Give the mean over places of the means at each: what differs between places is the uncertainty of that mean.

    With one place (or none named) the repeats themselves. An analysis of variance as in GUM H.5, whose mean square
    between groups holds the spread inside them too; never pooled, so that the interval holds either way.
    """
    if place is None or len(np.unique(place)) < 2:
        return repeated(f"repeats of {name}", values)
    means = np.array([values[place == label].mean() for label in np.unique(place)])
    return repeated(f"{name} at {len(means)} places", means)
