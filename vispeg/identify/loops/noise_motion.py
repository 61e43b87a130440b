"""Motion due to sensor noise in the feedback of a loop, which even the right model cannot predict.

Operational space control feeds back velocities through the task-space inertia and holds its null space softly, so a
milliradian a second of noise moves the arm by more than its encoders' noise. In joint servos this is small, except with
encoders whose steps exceed their noise: noise decides when a reading switches to the next step, and the start position
within a step is unknown, so that under torque control, without correction, the arm takes another path.
"""

from __future__ import annotations

import numpy as np

from vispeg.core.effect import EffectInstance, effect
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.identify.channels import Item
from vispeg.identify.evidence import Evidence
from vispeg.recordings.noise import highpass_sigma, noise_of
from vispeg.recordings.recording import Recording
from vispeg.sim.rollout import ReadingNoise, simulate
from vispeg.worlds import places
from vispeg.worlds.world import World

DRAWS = 16  # number of draws of the noise


def noise_motion(evidence: Evidence, world: World) -> float:
    """Return the mean squared motion of `world` due to noise in its feedback, over the variance of the readings' noise.

    It adds to the noise of the readings themselves (`reading_floor`), and is 0 except under OSC or if `world` has an
    encoder coarser than its noise. It is simulated with draws of the stated or measured noise. The draws differ
    widely, because a null space drifts slowly, so a high quantile over them is returned (`noise_quantile`). If an
    encoder is coarse, each draw starts elsewhere within a step, and the quantile is lower (`noise_quantile_coarse`), so
    that a wide floor does not hide missing effects.
    """
    total, count, quantile = np.zeros(DRAWS), 0, RULES.noise_quantile
    for item in evidence.items if evidence.unit == "rad" else ():
        count += int(item.valid.sum())
        sigma = item.sigma[: item.nj]
        plain = reading_noise(item, world) / sigma
        soft, coarse = item.recording.control.mode == "osc", _coarse(item, world)
        if not soft and not coarse:
            continue
        scale = np.r_[0.0, np.ones(DRAWS)][:, None]  # the first rollout has no noise
        noise = ReadingNoise(
            scale * noise_of(item.recording)["q"],
            scale * _velocity_noise(item.recording),
            stream(0, "stirred"),
            sensed=coarse,
        )
        h_max = evidence.step_of(item.segment.control.mode, world)
        draws = [_begun(item, world, k) if coarse else world for k in range(DRAWS)]
        quantile = RULES.noise_quantile_coarse if coarse else quantile
        options = {"h_max": h_max, "along": True, "reading_noise": noise}
        (response,) = simulate(item.robot, [world, *draws], [item.segment], **options)
        moved = (response.q[1:] - response.q[:1]) / sigma
        floor = plain**2 if coarse else 0.0  # the sensed angles contain the readings' own noise
        total += np.where(item.valid[:, : item.nj], moved**2 - floor, 0.0).sum(axis=(1, 2))
    total = total[np.isfinite(total)]  # a draw that diverges says nothing about the others
    return max(float(np.quantile(total, quantile)), 0.0) / max(count, 1) if len(total) else 0.0


def reading_floor(evidence: Evidence, world: World) -> float:
    """Return the mean squared whitened residual of a correct model: 1, or more if its encoders are coarse."""
    excess = 0.0
    for item in evidence.items if evidence.unit == "rad" else ():
        ratio = reading_noise(item, world) / item.sigma[: item.nj]
        excess += float(((ratio**2 - 1.0) * item.valid[:, : item.nj].sum(axis=0)).sum())
    return 1.0 + excess / max(evidence.count, 1)


def within_noise(evidence: Evidence, world: World) -> bool:
    """Return whether the error of a world under OSC is no larger than what noise in its feedback, amplified, makes.

    Near a singular posture a loop amplifies noise by a factor of thousands. Any small effect then moves the arm as far,
    and whether it lowers the error is chance. False if any recording has another loop or a coarse encoder.
    """
    if evidence.unit != "rad" or any(i.recording.control.mode != "osc" or _coarse(i, world) for i in evidence.items):
        return False
    residual, magnified = evidence.residuals([world])[0], noise_motion(evidence, world)
    return magnified > RULES.noise_magnified and float(residual @ residual) <= (1.0 + magnified) * evidence.count


def _coarse(item: Item, world: World) -> bool:
    """Return whether in a world the encoder of some joint has steps much wider than its noise."""
    return bool(np.any(reading_noise(item, world) > RULES.coarse * item.sigma[: item.nj]))


def _begun(item: Item, world: World, draw: int) -> World:
    """Return the world with each stepped encoder's zero shifted at random within a step; `draw` seeds it.

    So the arm starts somewhere within the step that is read.
    """
    rng = stream(draw, "begun")
    offsets = places.values(effect("encoder_offset"), [world.effects], item.robot)["offset"][0]
    for joint, zero in zip(item.robot.joints, offsets, strict=True):
        steps = [
            effect(e.effect).resolution({name: value.value for name, value in e.params.items()})
            for e in world.effects
            if e.where in (joint, "all")
        ]
        width = max(steps, default=0.0)
        if width:
            offset = zero + width * rng.uniform(-0.5, 0.5)
            # last, so that it counts beside one of all joints
            world = world.without("encoder_offset", joint).add(
                EffectInstance.of("encoder_offset", joint, offset=offset)
            )
    return world


def reading_noise(item: Item, world: World) -> np.ndarray:
    """Return the standard deviation (nj,) rad of angles as a world's encoders read them: noise plus quantisation."""
    sigma = item.sigma[: item.nj]
    squared = sigma**2  # a copy
    for j, joint in enumerate(item.recording.joints):
        for e in world.effects:
            if e.where in (joint, "all"):
                values = {name: value.value for name, value in e.params.items()}
                squared[j] += effect(e.effect).reading_noise(float(sigma[j]), values) ** 2 - sigma[j] ** 2
    return np.sqrt(squared)


def _velocity_noise(rec: Recording) -> np.ndarray:
    """Return the velocity noise (nj,) rad/s of a recording; 0 if it has neither velocities nor a statement of it."""
    if "dq" in rec.noise:
        return np.full(len(rec.joints), float(rec.noise["dq"]))
    return np.zeros(len(rec.joints)) if rec.dq is None else highpass_sigma(rec.dq)
