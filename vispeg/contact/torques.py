"""Contact without a wrist force sensor: the wrench estimated from joint torques, and its uncertainty.

A joint torque error that lasts longer than a block (see `vispeg.sim.external`) is a wrench error in a direction given
by the posture. It enters as a nuisance parameter per joint and second, so that a verdict rests only on what joint
errors cannot explain. A direction of the wrench that the torques do not show gets a nuisance parameter per block, as
wide as any plausible wrench (`vispeg.contact.errors.nuisance`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vispeg.contact.touch import refuse_without_torques
from vispeg.core.errors import UserError
from vispeg.recordings.cell import WrenchSensor
from vispeg.recordings.differentiate import episodes
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.external import PRIOR, STILL, External, external

AXES = ("x", "y", "z")


def sensed(rec: Recording) -> bool:
    """Return whether a wrench was recorded."""
    return rec.ft is not None and bool(np.isfinite(rec.ft).any())


def estimated(rec: Recording, scene: Scene) -> tuple[Recording, External]:
    """Return the recording with a wrench estimated from its joint torques, as a sensor at the flange would read it.

    Raises:
        UserError: no joint torques.
    """
    refuse_without_torques(rec)
    estimate = external(rec, scene.nominal)
    force, torque = estimate.noise
    noise = {**rec.noise, "ft": force, "ft_torque": torque}
    return replace(rec, ft=estimate.wrench, wrench=WrenchSensor(), noise=noise), estimate


def calm(rec: Recording, estimate: External) -> Recording:
    """Return the recording with the noise of the estimated wrench per sample as stated noise, for detecting contact.

    Raises:
        UserError: no episode has torques at its start, where the arm rests.
    """
    read = np.isfinite(estimate.wrench.sum(axis=1))
    runs = episodes(rec.time, rec.episode)
    starts = [rows[(rec.time[rows] <= rec.time[rows[0]] + STILL) & read[rows]] for rows in runs]
    scatter = [estimate.wrench[start].var(axis=0) for start in starts if len(start) > 1]
    if not scatter:
        expected = f"joint torques in the first {STILL:g} s of an episode, in which the arm rests"
        raise UserError("no joint torques at the start", file=rec.path, key="tau.*", expected=expected)
    sigma = np.sqrt(np.mean(scatter, axis=0))
    force, torque = (float(sigma[part].mean()) for part in (slice(0, 3), slice(3, 6)))
    return replace(rec, noise={**rec.noise, "ft": force, "ft_torque": torque})


def said(rec: Recording, estimate: External) -> str:
    """Return a note for the user: accuracy of the forces along each flange axis, and which are not observable."""
    sigma = np.sqrt(np.mean(estimate.sigma**2, axis=0))
    complete = ~np.any(estimate.blind != 0, axis=(1, 2))
    level = np.sqrt(np.mean(estimate.sigma[complete] ** 2, axis=0)) if complete.any() else sigma
    accuracy = ", ".join(f"{axis} {v:.2g}" for axis, v in zip(AXES, level[:3], strict=True))
    text = f"{rec.name}: no force sensor; the wrench is estimated from joint torques. Friction and hysteresis make it"
    text += f" uncertain by {accuracy} N along the flange's axes: intervals are wider, and joints are not diagnosed"
    if complete.all():
        return text
    worst = estimate.blind[int(np.argmax(np.abs(estimate.blind).sum(axis=(1, 2))))]
    return f"{text}; {_blind(worst)} in {100 * float(np.mean(~complete)):.0f} % of the samples"


def _blind(columns: np.ndarray) -> str:
    """Return which directions (6, k), N and N m, are unobservable, in words."""
    words = []
    for column in columns.T[np.abs(columns).max(axis=0) > 0]:
        k = int(np.argmax(np.abs(column / PRIOR)))
        words.append(f"the {'force along' if k < 3 else 'torque about'} {AXES[k % 3]}")
    return f"{' and '.join(dict.fromkeys(words))} cannot be observed (the arm is near a singularity)"


def notes(pairs: Sequence[tuple[Recording, External | None]]) -> list[str]:
    """Return the notes on recordings without a wrench."""
    return [said(rec, estimate) for rec, estimate in pairs if estimate is not None]
