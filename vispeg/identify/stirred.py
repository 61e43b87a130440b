"""What noise alone does to a loop: readings that are fed back move the arm, and the right model cannot say which way.

Operational space control feeds back velocities through the task-space inertia and holds its null space softly, so a
milliradian a second of noise moves the arm by more than its encoders' noise. In joint servos the same is small.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.seeds import stream
from vispeg.identify.evidence import SOFT_STEP, Evidence
from vispeg.recordings.noise import highpass_sigma, noise_of
from vispeg.recordings.recording import Recording
from vispeg.sim.rollout import ReadingNoise, simulate
from vispeg.worlds.world import World

DRAWS, SHARE = 16, 0.9


def stirred(evidence: Evidence, world: World) -> float:
    """Mean squared motion, in noise variances, that noise in its feedback stirs up in `world`: 0 but under OSC.

    It comes on top of the 1 that the readings' own noise leaves. Draws of noise as large as the recordings state or
    show differ widely, as a null space wanders slowly: what one in ten exceeds is given.
    """
    total, count = np.zeros(DRAWS), 0
    for item in evidence.items:
        count += int(item.valid.sum())
        if item.recording.control.mode != "osc":
            continue
        scale = np.r_[0.0, np.ones(DRAWS)][:, None]
        noise = ReadingNoise(
            scale * noise_of(item.recording)["q"], scale * _velocity_noise(item.recording), stream(0, "stirred")
        )
        h_max = evidence.h_max * SOFT_STEP
        response = simulate(
            item.robot, [world] * (1 + DRAWS), [item.segment], h_max=h_max, along=True, reading_noise=noise
        )[0]
        moved = (response.q[1:] - response.q[:1]) / item.sigma[: item.nj]
        total += np.where(item.valid[:, : item.nj], moved**2, 0.0).sum(axis=(1, 2))
    total = total[np.isfinite(total)]  # a draw that throws the arm away is no measure of the rest
    return float(np.quantile(total, SHARE)) / max(count, 1) if len(total) else 0.0


def _velocity_noise(rec: Recording) -> np.ndarray:
    """(nj,) rad/s of a recording's velocities; 0 where there are none, which means that they follow from angles."""
    if "dq" in rec.noise:
        return np.full(len(rec.joints), float(rec.noise["dq"]))
    return np.zeros(len(rec.joints)) if rec.dq is None else highpass_sigma(rec.dq)
