"""The floor of the comparison, phase by phase: what the right model leaves, from simulated repeats.

A drive of the nominal hand leaves a path and a wrench that agree exactly. With the recording's noise put on both they
are driven again: what then is corrected is noise, not the model. To it comes `floor_form`, what another integrator and
another law of contact leave of the right model, and a share of how a contact chatters: blows that a path does not show
push one way on the average. What sensors leave open beyond that is in `vispeg.contact.errors.nuisance`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.contact.drive import Driven, drive
from vispeg.contact.errors.noise import noise
from vispeg.contact.path import PATH_HZ, Path
from vispeg.contact.phases import NAMES
from vispeg.contact.sensor import REACH, hand_world, readings
from vispeg.core.rules import RULES
from vispeg.core.seeds import stream
from vispeg.recordings.differentiate import smooth
from vispeg.recordings.noise import noise_of
from vispeg.recordings.regimes import INSIDE
from vispeg.worlds.world import World

if TYPE_CHECKING:
    from vispeg.contact.items import ContactItem

LEVER = 0.1  # m, of a torque against a force


def floors(item: ContactItem, once: Driven, nthread: int) -> np.ndarray:
    """(m, 6) N and N m: expected RMS residual of a correct model in each block; `once` is how the believed one went."""
    path, phase, rec = item.path, item.phase, item.recording
    world = hand_world(item.source.believed, World())
    wrench = readings(path, item.hand, world)[None]
    rng = stream(0, "contact floor")
    place, rate = _noisy(once.place[0], path.time, path.clock, float(np.mean(noise_of(rec)["q"])) * REACH, rng)
    read = wrench[0] - once.zero + np.nan_to_num(once.correction[0])
    sigma = noise(item)
    read = read + _on_steps(sigma * rng.standard_normal((len(path.clock), 6)), path)
    again = replace(path, place=place, rate=rate)
    residual = phase.means(
        drive(item.hand, item.source.scene, again, [world], read[None], phase.rest, phase.windows, nthread).correction
    )[0]
    out = np.empty_like(residual)
    ends = np.convolve(phase.of("slide"), np.ones(2 * RULES.floor_loose + 1), "same") > 0
    unit = np.repeat([1.0, LEVER], 3)
    forms: dict[str, float] = dict(zip(NAMES, RULES.floor_form, strict=True))
    shares: dict[str, float] = dict(zip(NAMES, RULES.floor_share, strict=True))
    for name in NAMES:
        rows, used = phase.of(name), phase.of(name) & phase.valid & ~phase.resting
        if rows.any():
            rms = np.sqrt(np.mean(residual[used] ** 2, axis=0)) if used.any() else 0.0
            breaks = rows & ends
            for some, law in ((rows & ~ends, name), (breaks, name if name == "impact" else "slide")):
                wedge = RULES.floor_wedged if law == INSIDE else 0.0
                share = shares[law] + wedge * wedged(item)[some]
                form = np.hypot(forms[law], share * phase.force[some])
                out[some] = np.hypot(rms, form[:, None] * unit)
    chatter = np.sqrt(np.maximum(phase.scatter(path.wrench) ** 2 - sigma**2, 0.0))
    out = np.hypot(out, chatter / np.sqrt(phase.size))
    out[phase.resting] = np.repeat([RULES.zero_between, RULES.zero_between * LEVER], 3)
    return out


def wedged(item: ContactItem) -> np.ndarray:
    """(m,) from 0 to 1: square of how far the hand is rocked against the goal's axis, the base's z."""
    path = item.path
    turn = Rotation.from_quat(path.frame, scalar_first=True)
    axis = (turn * Rotation.from_euler("XYZ", path.place[item.phase.rows(path.time), 3:])).apply([0.0, 0.0, 1.0])
    return np.minimum(1.0, (axis[:, 0] ** 2 + axis[:, 1] ** 2) / RULES.floor_rocked**2)


def _noisy(place: np.ndarray, time: np.ndarray, clock: np.ndarray, sigma: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """Give a path (n, 6) on the steps as it would have been read at the samples `clock`, and its rate."""
    sampled = np.stack([np.interp(clock, time, p) for p in place.T], axis=1)
    calm, rate, _ = smooth(clock, sampled + sigma * rng.standard_normal(sampled.shape), PATH_HZ)
    grid = [np.stack([np.interp(time, clock, v) for v in values.T], axis=1) for values in (calm, rate)]
    return grid[0], grid[1]


def _on_steps(values: np.ndarray, path: Path) -> np.ndarray:
    """Resample readings (len(path.clock), k) to the steps of a path, (n, k), so that block noise is that of the
    readings.
    """
    return np.stack([np.interp(path.time, path.clock, v) for v in values.T], axis=1)
