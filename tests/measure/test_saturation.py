"""A drive's torque limit in simulated steps: found where it is, with intervals that hold, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest

from vispeg.measure import saturation
from vispeg.measure.steps import Step
from vispeg.measure.trace import Trace, steps
from vispeg.measure.uncertainty import propagate

RATE, FINE = 500.0, 4


def joints(sizes, inertia, wn, zeta, friction, stall=np.inf, no_load=np.inf):
    """Commands, angles and torques (nsize, n) of J q'' = clip(k (u - q) - d q') - c sign q'; steps u both ways."""
    u = np.outer(sizes, np.repeat([0.0, 1.0, 0.0, -1.0, 0.0], round(0.45 * RATE)))
    k, d, dt = inertia * wn**2, 2 * inertia * zeta * wn, 1 / RATE / FINE
    x, v, q, tau = np.zeros(len(sizes)), np.zeros(len(sizes)), np.zeros_like(u), np.zeros_like(u)
    for row in range(u.shape[1]):
        for part in range(FINE):
            asked = k * (u[:, row] - x) - d * v
            most, least = (stall * np.clip(1 + way * v / no_load, 0, 1) for way in (-1, 1))
            given = np.clip(asked, -least, most) if np.isfinite(stall) else asked
            if part == 0:
                q[:, row], tau[:, row] = x, given
            v = v + dt * given / inertia
            v = np.sign(v) * np.maximum(np.abs(v) - dt * friction / inertia, 0.0)
            x = x + dt * v
    return u, q, tau


def logged(seed, limited=None, sizes=(0.1, 0.03)):
    """Steps of a drawn joint, and its limit (N m, rad/s)."""
    r = np.random.default_rng(seed)
    of = {
        "inertia": r.uniform(0.2, 3),
        "wn": r.uniform(12, 40),
        "zeta": r.uniform(0.3, 1.3),
        "friction": r.uniform(0, 1),
    }
    peak = of["inertia"] * of["wn"] ** 2 * sizes[0]
    of |= {"stall": r.uniform(0.3, 0.6) * peak} if limited else {}
    of |= {"no_load": r.uniform(1.5, 4) * 0.1 * of["wn"]} if limited == "falls" else {}
    noise = r.choice([0.001, 0.003]) * peak
    traces = [
        Trace(
            str(n),
            np.arange(len(u)) / RATE,
            u,
            q + 2e-5 * r.standard_normal(len(u)),
            tau + noise * r.standard_normal(len(u)),
        )
        for n, (u, q, tau) in enumerate(zip(*joints(np.array(sizes), **of), strict=True))
    ]
    return (
        [Step(t, t.time[a], t.q_cmd[b - 1] - t.q_cmd[a - 1], None, 0.0) for t in traces for a, b in steps(t)],
        of,
    )


FEW, MANY = 3, pytest.param(30, marks=pytest.mark.slow)


@pytest.mark.parametrize("count", [FEW, MANY])
def test_a_loop_that_is_at_no_limit_shows_none(count):
    for seed in range(1, 1 + count):
        responses, _ = logged(seed)
        assert saturation.limit(responses) is None, seed


@pytest.mark.parametrize("count", [FEW, MANY])
@pytest.mark.parametrize("limited", ["flat", "falls"])
def test_a_limit_is_found_with_its_interval_and_falls_where_it_does(limited, count):
    found = fell = held = of = 0
    for seed in range(100, 100 + count):
        responses, truth = logged(seed, limited)
        got = saturation.limit(responses)
        if got is None:
            continue
        found += 1
        falls = bool(len(got.slope))
        fell += falls
        r = np.random.default_rng(0)
        pairs = [(truth["stall"], propagate("limit", "N m", lambda *x: sum(x), got.inputs(), r))]
        if falls and limited == "falls":
            inputs = got.inputs_of_slope()
            pairs.append((truth["no_load"], propagate("no_load_speed", "rad/s", lambda *x: 1 / sum(x), inputs, r)))
        for true, q in pairs if falls == (limited == "falls") else []:
            of += 1
            held += q.low <= true <= q.high
            assert q.value == pytest.approx(true, rel=0.15)
        assert {abs(round(s.size, 2)) for s in got.reached} == {0.1}
    assert found >= 0.8 * count
    assert fell <= 0.02 * found if limited == "flat" else fell >= 0.8 * found
    assert held >= 0.9 * of - 1


def test_what_a_law_asks_for_shows_no_limit():
    responses, _ = logged(101, "flat")
    assert saturation.limit(responses) is not None
    asked = [replace(s, trace=replace(s.trace, asked=True)) for s in responses]
    assert saturation.limit(asked) is None
