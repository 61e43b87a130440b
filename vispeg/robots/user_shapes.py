"""Pegs, holes and distractors from mesh files: read, measured, and decomposed into convex pieces for contact.

Mesh files of peg and hole have the orientation of the assembled state, z up and out of the hole. A peg's axis is the z
axis of its file, and its tip is its lowest point. The centre of a hole's mouth is a stated origin, or the top centre of
the mesh's bounding box. A distractor stands on its lowest point, z up.
"""

# trimesh returns objects of many types; everything that is not a mesh is refused at run time.
# pyright: reportAttributeAccessIssue=false, reportAssignmentType=false, reportIndexIssue=false, reportGeneralTypeIssues=false, reportArgumentType=false

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.core.files import write_bytes_atomic
from vispeg.core.paths import expanded
from vispeg.formats.arrays import read_arrays

FLAT = 0.06  # m, greatest height of a distractor on the table, as the gripper moves over it
FAR = 0.02  # m: walls further from a peg are ignored, as the greatest clearance is 20 mm
CONCAVITY = 0.01, 1.0  # thresholds that CoACD takes, from fine to coarse
CONVEX = 1e-6  # greatest share of the hull's volume that a convex mesh may lack
MESH = mujoco.mjtGeom.mjGEOM_MESH


@dataclass(frozen=True, eq=False)
class UserShape:
    """A closed mesh; its origin is a peg's tip or the centre of a hole's mouth, its axes are those of the file.

    Attributes:
        vertices, faces: (v, 3) m, and vertex indices (f, 3).
        pieces: corners (k, 3) m of the convex pieces that fill the mesh; a single one for a convex mesh.
        volume: m^3.
        com: (3,) centre of mass, m.
        inertia: (3, 3) about the centre of mass for unit density, m^5.
    """

    vertices: np.ndarray
    faces: np.ndarray
    pieces: tuple[np.ndarray, ...]
    volume: float
    com: np.ndarray
    inertia: np.ndarray

    @property
    def extent(self) -> np.ndarray:
        """Size (3,) along the axes, m."""
        return np.ptp(self.vertices, axis=0)

    def section(self, z: float) -> np.ndarray:
        """Return the outline at height `z`, m: the x and y of the ends of n segments, (n, 2, 2) m."""
        import trimesh

        mesh = trimesh.Trimesh(self.vertices, self.faces, process=False)
        segments = trimesh.intersections.mesh_plane(mesh, np.array([0, 0, 1.0]), np.array([0, 0, z]))
        return np.asarray(segments)[..., :2]

    def add(self, spec: mujoco.MjSpec, body, name: str, place, contact: dict, visual: dict) -> None:
        """Add a visible geom `name`, and geoms `name`_piece0, ... for contact, to a body.

        Args:
            spec, body: the spec and its body.
            name: name of the visible geom.
            place: function that maps points (n, 3) to the body's frame.
            contact, visual: further attributes of the geoms for contact, and of the visible one.
        """
        add_seen(spec, body, name, place(self.vertices), self.faces, visual)
        for i, piece in enumerate(self.pieces):
            spec.add_mesh(name=f"{name}_piece{i}", uservert=place(piece).ravel().tolist())
            settings = {"group": 3, "mass": 0.0, **contact}
            body.add_geom(name=f"{name}_piece{i}", type=MESH, meshname=f"{name}_piece{i}", **settings)


@dataclass(frozen=True, eq=False)
class UserThing:
    """A mesh that is drawn but has no contact. Its origin is at the middle of its bottom, z up.

    Attributes:
        vertices, faces: (v, 3) m, and vertex indices (f, 3).
    """

    vertices: np.ndarray
    faces: np.ndarray


def add_seen(
    spec: mujoco.MjSpec, body: Any, name: str, vertices: np.ndarray, faces: np.ndarray, visual: Mapping[str, Any]
) -> None:
    """Add a geom `name` to a body: a mesh (v, 3) m with faces (f, 3) that is drawn but has no contact."""
    corners = vertices[faces].reshape(-1, 3)  # faces share no vertices, so that edges stay sharp
    spec.add_mesh(
        name=name,
        uservert=corners.ravel().tolist(),
        userface=np.arange(len(corners)).tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body.add_geom(name=name, type=MESH, meshname=name, contype=0, conaffinity=0, mass=0.0, **visual)


def thing(file: str, key: str, scale: float) -> UserThing:
    """Read the mesh of a distractor, whose surface may have gaps. The arguments are as for `read`.

    Raises:
        UserError: the file is missing or not a mesh, or the mesh has an impossible size or is so high that the gripper
            would hit it.
    """
    return _thing(*_found(file, key), key, scale)


@lru_cache(maxsize=64)
def _thing(file: str, data: bytes, key: str, scale: float) -> UserThing:
    mesh = _mesh(file, data, key, scale, closed=False)
    low, high = mesh.bounds
    if high[2] - low[2] > FLAT:
        expected = f"at most {1e3 * FLAT:g} mm along z, so that the gripper moves over it"
        got = f"{1e3 * (high[2] - low[2]):.3g} mm"
        raise UserError("too high for a distractor", file=file, key=key, expected=expected, got=got)
    foot = np.array([*(low + high)[:2] / 2, low[2]])
    return UserThing(np.array(mesh.vertices) - foot, np.array(mesh.faces))


def read(
    file: str, key: str, scale: float, concavity: float, origin: tuple[float, ...] = (), tip: bool = False
) -> UserShape:
    """Read a peg or a hole from a mesh file (STL, OBJ, PLY, OFF, GLB).

    Args:
        file: path of the file.
        key: key under which the user stated it, for error messages.
        scale: m per unit of the file.
        concavity: threshold of CoACD (Wei et al., ACM Trans. Graphics 41(4), 2022), 0.01 (fine) to 1.
        origin: (3,) origin of the shape in the file's units; if empty, the top centre of a hole, the tip of a peg.
        tip: whether the mesh is a peg.

    Raises:
        UserError: the file is missing or not a mesh, or the mesh is not watertight or has an impossible size.
    """
    return _read(*_found(file, key), key, scale, concavity, origin, tip)


def size(file: str, key: str, scale: float) -> np.ndarray:
    """Return the size (3,) of a mesh in a file along its axes, m. Raises UserError as `read` does."""
    low, high = _mesh(*_found(file, key), key, scale).bounds
    return high - low


def _found(file: str, key: str) -> tuple[str, bytes]:
    """Return a file's path and content. Caches go by the content: a copy may keep the time of the file it replaces."""
    path = expanded(file)
    if not path.is_file():
        raise UserError("no such mesh", file=file, key=key)
    return str(path.resolve()), path.read_bytes()


@lru_cache(maxsize=16)
def _mesh(file: str, data: bytes, key: str, scale: float, closed: bool = True) -> Any:
    """Return the mesh in a file, in m; with `closed`, raise UserError for a surface with gaps."""
    import trimesh

    try:
        mesh = trimesh.load(io.BytesIO(data), file_type=Path(file).suffix.lstrip(".").lower(), force="mesh")
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
    except Exception as error:  # readers of the formats raise all kinds of errors
        raise UserError("cannot be read as a mesh", file=file, key=key, got=str(error)[:80]) from error
    if not len(mesh.faces):
        raise UserError("holds no triangles", file=file, key=key)
    if closed and not (mesh.is_watertight and mesh.is_winding_consistent):
        raise UserError("the mesh is not watertight", file=file, key=key, expected="a closed surface without gaps")
    if closed and mesh.volume < 0:
        mesh.invert()
    mesh.apply_scale(scale)
    low, high = mesh.bounds
    if not 0.002 <= (high - low).max() <= 0.4:
        hint = "2 to 400 mm at its longest (mesh_scale is m per unit of the file: 0.001 for mm)"
        got = " x ".join(f"{1e3 * side:.4g}" for side in high - low) + " mm"
        raise UserError("impossible size of a part of the cell", file=file, key=key, expected=hint, got=got)
    return mesh


@lru_cache(maxsize=16)
def _read(
    file: str, data: bytes, key: str, scale: float, concavity: float, origin: tuple[float, ...], tip: bool
) -> UserShape:
    mesh = _mesh(file, data, key, scale).copy()
    low, high = mesh.bounds
    start = np.array([0.0, 0.0, low[2]]) if tip else np.array([*(low + high)[:2] / 2, high[2]])
    if origin:
        start = scale * np.array(origin, float)
    if mesh.volume >= (1 - CONVEX) * mesh.convex_hull.volume:
        pieces: tuple[np.ndarray, ...] = (np.array(mesh.vertices),)
    else:
        # 1 is the version of cached pieces: a change of it makes them invalid
        digest = hashlib.sha256(data + repr((1, scale, concavity)).encode()).hexdigest()
        pieces = _pieces(np.array(mesh.vertices), np.array(mesh.faces), concavity, digest, key)
    mesh.apply_translation(-start)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    pieces = tuple(p - start for p in pieces)
    volume, com, inertia = float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia)
    return UserShape(vertices, faces, pieces, volume, com, inertia)


def _pieces(vertices: np.ndarray, faces: np.ndarray, concavity: float, digest: str, key: str) -> tuple[np.ndarray, ...]:
    """Decompose a mesh, vertices (v, 3) m and faces (f, 3), into convex pieces by CoACD.

    The pieces are kept in the user's cache under `digest`, and read from there the next time.

    Args:
        vertices, faces: the mesh, in the frame and with the origin of its file.
        concavity: see `read`.
        digest: name of the file in the cache: a hash of all that the pieces depend on.
        key: key under which the user stated the file, for error messages.

    Returns:
        Corners (k, 3) m of each piece.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vispeg" / "pieces" / f"{digest}.npz"
    if cache.is_file():
        try:
            cached = read_arrays(cache)
            return tuple(cached[f"piece{i}"] for i in range(len(cached)))
        except (UserError, KeyError):  # a damaged file is written again
            pass
    try:
        import coacd
    except ImportError as error:
        raise missing("coacd", "a mesh that is not convex", key=key) from error
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(vertices, faces), threshold=concavity, preprocess_mode="off", seed=0)
    pieces = tuple(np.asarray(corners, float) for corners, _ in parts)
    buffer = io.BytesIO()
    np.savez(buffer, **{f"piece{i}": p for i, p in enumerate(pieces)})
    write_bytes_atomic(cache, buffer.getvalue(), overwrite=True)
    return pieces


def play(peg: np.ndarray, block: np.ndarray) -> float:
    """Return the least distance of corners from segments between the outlines of peg and block, m.

    It is negative if the areas overlap, but then its size is not the depth of overlap. It is `FAR` if no segment of the
    block is within about `FAR` of the peg, and infinite if an outline is empty.

    Args:
        peg, block: x and y of the ends of the outlines' segments in the same frame, (n, 2, 2) and (m, 2, 2) m.
    """
    if not len(peg) or not len(block):
        return np.inf
    low, high = block.min(axis=1), block.max(axis=1)
    near = ((low <= peg.max((0, 1)) + FAR) & (high >= peg.min((0, 1)) - FAR)).all(axis=1)
    if not near.any():
        return FAR
    walls = block[near]
    least = min(_distance(peg.reshape(-1, 2), walls), _distance(walls.reshape(-1, 2), peg))
    overlap = _inside(peg[:, 0], block).any() or _inside(walls[:, 0], peg).any() or _cross(peg, walls)
    return -least if overlap else least


def _distance(points: np.ndarray, segments: np.ndarray) -> float:
    """Return the least distance of points (n, 2) from segments (m, 2, 2)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-24)
    least = np.inf
    for block in np.array_split(points, max(1, len(points) * len(segments) // 1_000_000)):  # to save memory
        to = block[:, None] - start  # (n, m, 2)
        share = np.clip((to * along).sum(axis=2) / length, 0.0, 1.0)
        least = min(least, float(np.linalg.norm(to - share[..., None] * along, axis=2).min()))
    return least


def _cross(first: np.ndarray, second: np.ndarray) -> bool:
    """Return whether any segment of `first` (n, 2, 2) crosses any of `second` (m, 2, 2).

    Two segments cross if the ends of each are on different sides of the other's line.
    """
    across = [np.array([-1.0, 1.0]) * (s[:, 1] - s[:, 0])[:, ::-1] for s in (first, second)]  # normals (n, 2), (m, 2)
    level = [(s[:, 0] * normal).sum(axis=1) for s, normal in zip((first, second), across, strict=True)]
    for rows in np.array_split(np.arange(len(first)), max(1, len(first) * len(second) // 1_000_000)):
        beyond = first[rows] @ across[1].T - level[1]  # (n, 2, m): ends of the first, from the lines of the second
        behind = second @ across[0][rows].T - level[0][rows]  # (m, 2, n)
        if ((beyond[:, 0] * beyond[:, 1] < 0) & (behind[:, 0] * behind[:, 1] < 0).T).any():
            return True
    return False


def _inside(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """Return whether points (n, 2) are inside the area that segments (m, 2, 2) enclose, (n,) bool.

    A ray from a point inside crosses an odd number of segments.
    """
    (x0, y0), (x1, y1) = outline[:, 0].T, outline[:, 1].T
    odd = np.zeros(len(points), bool)
    for k, (x, y) in enumerate(points):
        cross = (y0 > y) != (y1 > y)
        odd[k] = (x0[cross] + (y - y0[cross]) / (y1[cross] - y0[cross]) * (x1[cross] - x0[cross]) > x).sum() % 2
    return odd


def gap(model: mujoco.MjModel, flange: np.ndarray) -> float:
    """Return the least distance, m, between the contact shapes of the bodies `peg` and `fixture`, 0.05 at most.

    It is negative if they overlap. Only shapes whose contact flags let them touch count.

    Args:
        model: a compiled model with these bodies, which stays as it is; its fixture is where the nominal pose puts it.
        flange: (3,) position of the flange, world frame, m; its z axis points straight down, its x axis along the
            world's. The peg is placed by it alone, not by the arm's joints.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    pegs, blocks = (np.flatnonzero(model.geom_bodyid == model.body(b).id) for b in ("peg", "fixture"))
    kind, other = model.geom_contype, model.geom_conaffinity
    meet = [(a, b) for a in pegs for b in blocks if kind[a] & other[b] or kind[b] & other[a]]
    down, turn = np.diag([1.0, -1.0, -1.0]), np.empty(9)
    for g in pegs:
        mujoco.mju_quat2Mat(turn, model.geom_quat[g])
        data.geom_xpos[g], data.geom_xmat[g] = flange + down @ model.geom_pos[g], (down @ turn.reshape(3, 3)).ravel()
    return min((mujoco.mj_geomDistance(model, data, int(a), int(b), 0.05, None) for a, b in meet), default=0.05)
