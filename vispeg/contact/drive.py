"""Simulate the hands of many worlds along one measured path under the measured wrench, in one MuJoCo batch.

A hand is the cell without its arm, held to the path by springs (`vispeg.contact.hand`). Driving it is simulating it so.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import batch as mjb
from scipy.spatial.transform import Rotation

from vispeg.contact.path import Path
from vispeg.contact.pieces import Pieces, stretches, tip_places
from vispeg.core.effect import effect
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.sim.physics import derive, exact, firm
from vispeg.sim.placement import activate
from vispeg.sim.state import Fields
from vispeg.worlds.world import World

STATE = mujoco.mjtState
CONTROL = int(STATE.mjSTATE_CTRL | STATE.mjSTATE_QFRC_APPLIED)


@dataclass(frozen=True)
class Driven:
    """Result of driving hands along a path, in true newtons.

    Attributes:
        correction: (nworld, n, 6) additional wrench, flange axes, that held the hand on its path; NaN outside the
            windows.
        zero: (nworld, 6) zero of the sensor: its reading at rest in free air minus the tool's weight.
        place: (nworld, n, 6) paths of the hands, m and rad as `Path.place`; outside the windows, where they were to go.
    """

    correction: np.ndarray
    zero: np.ndarray
    place: np.ndarray


def drive(
    scene: Scene,
    cell: Scene,
    path: Path,
    worlds: Sequence[World],
    wrench: np.ndarray,
    rest: slice,
    windows: Sequence[slice],
    nthread: int,
    shift: np.ndarray | None = None,
    deviation: Callable[[np.ndarray], np.ndarray | None] = lambda wrench: None,
    per_read: np.ndarray | None = None,
) -> Driven:
    """Drive the hands of `worlds` (all with the same springs built in) through windows of a path.

    The spring that holds a hand to its path weighs path errors against force errors, in newtons as read per metre. In a
    world whose sensor reads less than the true force, the spring is stiffer by the same factor; otherwise path errors
    would cost less there.

    Args:
        scene: a hand, see `vispeg.contact.hand`.
        cell: the cell with its arm, from which the softness of contacts is taken.
        path: the measured path.
        worlds: worlds with effects of contact and tool alone.
        wrench: (nworld, n, 6) the wrench on the tool according to each world's sensor, flange axes.
        rest: samples of the path in free air at its start, from which the sensor's zero is taken.
        windows: ranges of the path's samples that are simulated, in order.
        nthread: threads of the batch.
        shift: (nworld, 6) m and rad, constant offset of each hand from the path, in the axes of the hand's start pose.
        deviation: returns the offset (nworld, 2, n, 6) of each hand's coordinates and rates from those of the path, per
            sample, or None; its argument is `wrench` without the sensor's zero.
        per_read: (nworld,) true force change per newton read; 1 by default.
    """
    batch = hands(scene, cell, path, worlds, nthread)
    per_read = np.ones(len(worlds)) if per_read is None else per_read
    for name in ("actuator_gainprm", "actuator_biasprm"):
        batch.expand(name)[:] *= per_read[:, None, None]
    if shift is not None:
        body, turn = compiled(scene).body(scene.base).id, Rotation.from_quat(path.frame, scalar_first=True)
        batch.expand("body_pos")[:, body] = path.origin + turn.apply(shift[:, :3])
        batch.expand("body_quat")[:, body] = (turn * Rotation.from_rotvec(shift[:, 3:])).as_quat(scalar_first=True)
    qpos, qvel, bias = batch.bind("qpos"), batch.bind("qvel"), batch.bind("qfrc_bias")
    qpos[:, :6], qvel[:, :6] = path.place[rest.start], path.rate[rest.start]
    batch.forward(stage=mujoco.mjtStage.mjSTAGE_VEL.value)
    weight = np.linalg.solve(path.jacobian[rest.start], bias[:, :6].T).T
    zero = wrench[:, rest].mean(axis=1) - weight
    exerted = wrench - zero[:, None]
    off = deviation(exerted)
    place = np.tile(path.place, (len(worlds), 1, 1)) + (0 if off is None else off[:, 0])
    rate = np.tile(path.rate, (len(worlds), 1, 1)) + (0 if off is None else off[:, 1])
    damping = -batch.expand("actuator_biasprm")[:, None, 6:12, 2]
    applied = np.einsum("nij,wnj->wni", path.jacobian, exerted)
    correction, went = np.full(wrench.shape, np.nan), place.copy()
    pieces, where = Pieces(batch, batch.model, scene), tip_places(path, cell)
    for window in windows:  # joints other than the hand's stay where the last window ended, at rest
        qpos[:, :6], qvel[:] = place[:, window.start], 0.0
        qvel[:, :6] = rate[:, window.start]
        for part in stretches(where, window):
            pieces.at(int(where[part.start]))
            begin, n = qvel[:, None, :6].copy(), part.stop - part.start
            control = np.zeros((len(worlds), n, 12 + qvel.shape[1]))  # six goals, six rates, forces on all joints
            control[:, :, :6] = place[:, part]
            control[:, :, 6:12] = rate[:, np.minimum(np.arange(part.start, part.stop) + 1, len(path.rate) - 1)]
            control[:, :, 12:18] = applied[:, part]
            out = batch.rollout(n, control, CONTROL, record=["actuator_force", "qpos", "qvel"])
            # dampers act on the speed at the end of a step, but `actuator_force` refers to the one at its start
            gained = np.diff(out["qvel"][:, :, :6], axis=1, prepend=begin)
            force = out["actuator_force"][:, :, :6] + out["actuator_force"][:, :, 6:12] - damping * gained
            correction[:, part] = np.linalg.solve(path.jacobian[None, part], force[..., None])[..., 0]
            went[:, part] = out["qpos"][:, :, :6]
    return Driven(correction, zero, went)


def hands(scene: Scene, cell: Scene, path: Path, worlds: Sequence[World], nthread: int = 1) -> mjb.Batch:
    """Return a batch of hands, one per world, in the frame of a path's start; arguments as for `drive`.

    MuJoCo regularizes a contact by the inverse weights of its bodies. Without the arm behind it, a tool would therefore
    sink in deeper and creep faster, so its bodies get the inverse weights that they have on the arm. Source: MuJoCo 4.0
    manual, Computation, Constraint solver, Parameters.
    """
    # an arm that yields enters by `deviation`: a hand has no arm
    active = activate(scene, [w.only(lambda e: not effect(e.effect).overrides("yields")) for w in worlds])
    parts = [a.effect.name for a in active]
    model, whole_cell = compiled(scene, parts), compiled(cell, parts)
    batch = mjb.Batch(model, len(worlds), nthread=nthread)
    fields = Fields(batch, scene)
    for a in active:
        a.effect.write(fields, a.p)
    batch.expand("opt.timestep")[:] = path.step
    exact(batch)
    body = model.body(scene.base).id
    batch.expand("body_pos")[:, body], batch.expand("body_quat")[:, body] = path.origin, path.frame
    derive(batch, fields)
    if scene.slip:
        firm(batch, model, scene.slip)
    inverse, in_cell = batch.expand("body_invweight0"), {whole_cell.body(b).name: b for b in range(whole_cell.nbody)}
    for b in range(1, model.nbody):
        of_hand, at = model.body_invweight0[b], in_cell.get(model.body(b).name)
        if at is not None:
            inverse[:, b] *= np.divide(whole_cell.body_invweight0[at], of_hand, out=np.ones(2), where=of_hand > 0)
    return batch


def built_alike(worlds: Sequence[World]) -> list[np.ndarray]:
    """Group the indices of worlds by the effects that change the compiled model."""
    groups: dict[tuple[str, ...], list[int]] = {}
    for i, w in enumerate(worlds):
        building = {e.effect for e in w.effects if effect(e.effect).overrides("build")}
        groups.setdefault(tuple(sorted(building)), []).append(i)
    return [np.array(rows) for rows in groups.values()]
