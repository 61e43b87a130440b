"""Distractors: up to five objects on the table that cameras see and that nothing can touch.

They are built-in shapes, or the meshes that a world's `distractor_meshes` names, in the size that their files have.

Kinds follow from `seed` alone. A place that overlaps another object is drawn again, and whether it overlaps depends on
`size`, which scales the built-in shapes. Up to the first such place, proportions, turns, colours and places follow from
`seed` too. Built-in shapes are at most 6 cm high, and every object stays `KEEP_OUT` away from the goal, so the gripper
and the held part do not reach into them.

Native mechanism: `geom_pos`, `geom_quat`, `geom_size`, `geom_rgba` of geoms that the scene keeps invisible, and the
bounds that ray casting uses (`geom_rbound`, `geom_aabb`). `geom_sameframe` is cleared, or MuJoCo would ignore the
rotation.
"""

from __future__ import annotations

import mujoco
import numpy as np

from vispeg.core.params import Param, seed_param
from vispeg.core.seeds import stream
from vispeg.effects.common.appearance import SceneLook
from vispeg.effects.common.colour import rgb_of_hsv

KEEP_OUT = 0.09  # m, from the goal's axis to the nearest point of an object
AREA = np.array([[0.35, 0.90], [-0.35, 0.35]])  # m, range of the objects' centres: x and y in the base frame
TRIES = 50  # places drawn for an object before it is left out
LIFT = 1e-4  # m, height of a mesh above the table, so that a flat sheet and the table are not at the same depth
G = mujoco.mjtGeom


class Distractors(SceneLook):
    """Objects on the table that are not part of the task."""

    name = "distractors"
    params = {
        "count": Param(0.0, 0.0, 5.0, "1", start=3.0, doc="number of objects, rounded"),
        "size": Param(1.0, 0.4, 1.5, "1", start=1.0, shape=True, doc="scale of the built-in shapes"),
        "seed": seed_param("seed of kinds, sizes, colours and places", start=1.0),
    }
    writes = frozenset(f"geom_{x}" for x in ("pos", "quat", "size", "rgba", "rbound", "aabb", "sameframe"))

    def write(self, fields, p):
        model = fields.model
        geoms = [model.geom(name).id for name in fields.scene.parts["distractors"]]
        goal = model.body(fields.scene.fixture).pos[:2]
        count = np.rint(p["count"][:, 0]).astype(int)
        for row in np.flatnonzero(count):
            rng = stream(int(p["seed"][row, 0]), "distractors")
            taken: list[tuple[np.ndarray, float]] = [(goal, KEEP_OUT)]
            for g in rng.permutation(geoms)[: count[row]]:
                half = rng.uniform((0.012, 0.012, 0.008), (0.04, 0.04, 0.03)) * p["size"][row, 0]
                half[2] = min(half[2], 0.03)
                kind, yaw = int(model.geom_type[g]), rng.uniform(0, 2 * np.pi)
                if kind == G.mjGEOM_MESH:
                    centre, quat, reach = _mesh(model, int(model.geom_dataid[g]), yaw)
                else:
                    size, bounds, quat = _shape(kind, half, yaw)
                    centre, reach = np.array([0, 0, bounds[2]]), float(np.hypot(*bounds[:2]))
                    local = size_bounds(kind, size)
                place = _place(rng, taken, reach)
                colour = rgb_of_hsv(rng.uniform(), rng.uniform(), rng.uniform(0.15, 1))
                if place is None:  # no free place: the object stays invisible
                    continue
                taken.append((place, reach))
                fields["geom_pos"][row, g] = centre + [*place, 0]
                fields["geom_quat"][row, g] = quat
                fields["geom_rgba"][row, g] = (*colour, 1.0)
                fields["geom_sameframe"][row, g] = 0
                if kind != G.mjGEOM_MESH:
                    fields["geom_size"][row, g] = size
                    fields["geom_rbound"][row, g] = np.linalg.norm(local)
                    fields["geom_aabb"][row, g] = (0, 0, 0, *local)


def _shape(kind: int, half: np.ndarray, yaw: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `geom_size`, half extents (both (3,) m) and quaternion of a shape that rests on the table.

    The half extents are those along the shape's horizontal axes, then of its height.
    """
    turn = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    if kind == G.mjGEOM_SPHERE:
        return np.array([half[2], 0, 0]), np.full(3, half[2]), turn
    if kind == G.mjGEOM_CYLINDER:
        return np.array([half[0], half[2], 0]), np.array([half[0], half[0], half[2]]), turn
    if kind == G.mjGEOM_CAPSULE:  # lying: its axis turned from z to x
        radius, quat = min(half[2], 0.02), np.empty(4)
        mujoco.mju_mulQuat(quat, turn, np.array([np.sqrt(0.5), 0, np.sqrt(0.5), 0]))
        return np.array([radius, half[0], 0]), np.array([half[0] + radius, radius, radius]), quat
    return half.copy(), half, turn  # box, ellipsoid


def _mesh(model: mujoco.MjModel, mesh: int, yaw: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Return position (3,) m, quaternion (4,) and horizontal reach, m, of a mesh's geom on the table.

    The mesh is turned by `yaw` rad. Its origin, the middle of its bottom, is at x = y = 0, `LIFT` above the table;
    `write` moves it to its place. MuJoCo's compiler moved the vertices into the mesh's principal axes, by `mesh_pos`
    and `mesh_quat`, which is undone here.
    """
    turn = np.array([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    quat, pos, matrix = np.empty(4), np.empty(3), np.empty(9)
    mujoco.mju_mulQuat(quat, turn, model.mesh_quat[mesh])
    mujoco.mju_rotVecQuat(pos, model.mesh_pos[mesh], turn)
    mujoco.mju_quat2Mat(matrix, quat)
    start = model.mesh_vertadr[mesh]
    vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]] @ matrix.reshape(3, 3).T + pos
    return pos + [0, 0, LIFT], quat, float(np.hypot(vertices[:, 0], vertices[:, 1]).max())


def size_bounds(kind: int, size: np.ndarray) -> np.ndarray:
    """Return half extents (3,) in m of a shape along its own axes."""
    if kind == G.mjGEOM_SPHERE:
        return np.full(3, size[0])
    if kind == G.mjGEOM_CYLINDER:
        return np.array([size[0], size[0], size[1]])
    if kind == G.mjGEOM_CAPSULE:
        return np.array([size[0], size[0], size[0] + size[1]])
    return size


def _place(rng: np.random.Generator, taken: list[tuple[np.ndarray, float]], reach: float) -> np.ndarray | None:
    """Draw a place (2,) m for an object that reaches `reach` m from it; None after `TRIES` places that are taken."""
    for _ in range(TRIES):
        place = rng.uniform(AREA[:, 0], AREA[:, 1])
        if all(np.linalg.norm(place - other) > radius + reach for other, radius in taken):
            return place
    return None
