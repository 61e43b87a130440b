"""Pegs, holes and things on the table given as mesh files: read, measured, taken apart into convex pieces for contact.

Frames: files of peg and hole are drawn as assembled, z up and out of the hole. A peg's axis is its file's z axis, its
tip its lowest point; the centre of a hole's mouth is the middle of its mesh's bounding box at the top, or a stated
origin. A thing on the table stands on its lowest point, z up.
"""

# trimesh loads anything; what is not a mesh is refused before these lines.
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

FLAT = 0.06  # m, height of a thing on the table, which the gripper moves over
FAR = 0.02  # m: what lies further from a peg is no wall of its hole; the greatest clearance is 20 mm
CONVEX = 1e-6  # share of its hull's volume that a convex mesh may lack
MESH = mujoco.mjtGeom.mjGEOM_MESH


@dataclass(frozen=True, eq=False)
class UserShape:
    """A closed mesh in m about its own origin (a peg's tip, a hole's mouth), axes as in its file.

    Attributes:
        vertices, faces: (v, 3) m and (f, 3).
        pieces: corners (k, 3) m of convex pieces that fill it; one if it is convex itself.
        volume, com, inertia: m^3, (3,) m, and (3, 3) about the centre for unit density, m^5.
    """

    vertices: np.ndarray
    faces: np.ndarray
    pieces: tuple[np.ndarray, ...]
    volume: float
    com: np.ndarray
    inertia: np.ndarray

    @property
    def extent(self) -> np.ndarray:
        """Size (3,) along its axes, m."""
        return np.ptp(self.vertices, axis=0)

    def section(self, z: float) -> np.ndarray:
        """Its outline at a height in m: the ends (n, 2, 2) of segments, m."""
        import trimesh

        mesh = trimesh.Trimesh(self.vertices, self.faces, process=False)
        segments = trimesh.intersections.mesh_plane(mesh, np.array([0, 0, 1.0]), np.array([0, 0, z]))
        return np.asarray(segments)[..., :2]

    def add(self, spec: mujoco.MjSpec, body, name: str, place, contact: dict, visual: dict) -> None:
        """Add geom `name` to be seen and `name`_piece0.. for contact; `place` maps (n, 3) into the body's frame."""
        add_seen(spec, body, name, place(self.vertices), self.faces, visual)
        for i, piece in enumerate(self.pieces):
            spec.add_mesh(name=f"{name}_piece{i}", uservert=place(piece).ravel().tolist())
            settings = {"group": 3, "mass": 0.0, **contact}
            body.add_geom(name=f"{name}_piece{i}", type=MESH, meshname=f"{name}_piece{i}", **settings)


@dataclass(frozen=True, eq=False)
class UserThing:
    """A mesh that is seen and not touched: the middle of its bottom is the origin, z up, m.

    Attributes:
        vertices, faces: (v, 3) m and (f, 3).
    """

    vertices: np.ndarray
    faces: np.ndarray


def add_seen(
    spec: mujoco.MjSpec, body: Any, name: str, vertices: np.ndarray, faces: np.ndarray, visual: Mapping[str, Any]
) -> None:
    """Add geom `name`, a mesh (v, 3) m with faces (f, 3) that is seen and touches nothing."""
    corners = vertices[faces].reshape(-1, 3)  # faces apart, so that edges stay sharp
    spec.add_mesh(
        name=name,
        uservert=corners.ravel().tolist(),
        userface=np.arange(len(corners)).tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    body.add_geom(name=name, type=MESH, meshname=name, contype=0, conaffinity=0, mass=0.0, **visual)


def thing(file: str, key: str, scale: float) -> UserThing:
    """Read a mesh that stands about, whose surface may have gaps.

    Raises:
        UserError: not a mesh, or too large for a thing that the gripper moves over.
    """
    return _thing(*_found(file, key), key, scale)


@lru_cache(maxsize=64)
def _thing(file: str, stamp: int, key: str, scale: float) -> UserThing:
    mesh = _mesh(file, stamp, key, scale, closed=False)
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
    """Give the shape in a mesh file (STL, OBJ, PLY, OFF, GLB).

    Args:
        file: its path.
        key: under which a user gave it, for errors.
        scale: m per unit of the file.
        concavity: threshold of CoACD (Wei et al., ACM Trans. Graphics 41(4), 2022), 0.01 (fine) to 1.
        origin: (3,) in the file's units; if empty, the top centre, or the tip.
        tip: whether it is a peg.

    Raises:
        UserError: not a mesh, not watertight, or of a size that no peg or fixture has.
    """
    return _read(*_found(file, key), key, scale, concavity, origin, tip)


def size(file: str, key: str, scale: float) -> np.ndarray:
    """Size (3,) along its axes of a mesh in a file, m, before it is taken apart. Raises UserError: as `read`."""
    low, high = _mesh(*_found(file, key), key, scale).bounds
    return high - low


def _found(file: str, key: str) -> tuple[str, int]:
    """Path of a file, and when it was written: an edited file is read again."""
    path = Path(file).expanduser()
    if not path.is_file():
        raise UserError("no such mesh", file=file, key=key)
    return str(path.resolve()), path.stat().st_mtime_ns


@lru_cache(maxsize=16)
def _mesh(file: str, stamp: int, key: str, scale: float, closed: bool = True) -> Any:
    """Give the mesh of a file, in m; `closed` refuses one with gaps."""
    import trimesh

    data = Path(file).read_bytes()
    try:
        mesh = trimesh.load(io.BytesIO(data), file_type=Path(file).suffix.lstrip(".").lower(), force="mesh")
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
    except Exception as error:  # whatever the reader of that format raises
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
        raise UserError("no size for a part of the cell", file=file, key=key, expected=hint, got=(high - low).round(6))
    return mesh


@lru_cache(maxsize=16)
def _read(
    file: str, stamp: int, key: str, scale: float, concavity: float, origin: tuple[float, ...], tip: bool
) -> UserShape:
    mesh = _mesh(file, stamp, key, scale).copy()
    low, high = mesh.bounds
    start = np.array([0.0, 0.0, low[2]]) if tip else np.array([*(low + high)[:2] / 2, high[2]])
    if origin:
        start = scale * np.array(origin, float)
    if mesh.volume >= (1 - CONVEX) * mesh.convex_hull.volume:
        pieces: tuple[np.ndarray, ...] = (np.array(mesh.vertices),)
    else:
        digest = hashlib.sha256(Path(file).read_bytes() + repr((1, scale, concavity)).encode()).hexdigest()
        pieces = _pieces(np.array(mesh.vertices), np.array(mesh.faces), concavity, digest, key)
    mesh.apply_translation(-start)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    pieces = tuple(p - start for p in pieces)
    volume, com, inertia = float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia)
    return UserShape(vertices, faces, pieces, volume, com, inertia)


def _pieces(vertices: np.ndarray, faces: np.ndarray, concavity: float, digest: str, key: str) -> tuple[np.ndarray, ...]:
    """Convex pieces by CoACD, kept in the user's cache."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "vispeg" / "pieces" / f"{digest}.npz"
    if cache.is_file():
        try:
            with np.load(cache, allow_pickle=False) as cached:
                return tuple(cached[f"piece{i}"] for i in range(len(cached.files)))
        except (OSError, ValueError, KeyError):  # a damaged file is made anew
            pass
    try:
        import coacd
    except ImportError as error:
        raise missing("coacd", "a mesh that is not convex", key=key) from error
    coacd.set_log_level("error")
    parts = coacd.run_coacd(coacd.Mesh(vertices, faces), threshold=concavity, preprocess_mode="off", seed=0)
    pieces = tuple(np.asarray(corners, float) for corners, _ in parts)
    buffer = io.BytesIO()
    np.savez(buffer, **{f"piece{i}": p for i, p in enumerate(pieces)})  # type: ignore[arg-type]
    write_bytes_atomic(cache, buffer.getvalue(), overwrite=True)
    return pieces


def play(peg: np.ndarray, block: np.ndarray) -> float:
    """Least distance between two outlines, segments (n, 2, 2) and (m, 2, 2) in m; negative where they overlap."""
    if not len(peg) or not len(block):
        return np.inf
    low, high = block.min(axis=1), block.max(axis=1)
    near = ((low <= peg.max((0, 1)) + FAR) & (high >= peg.min((0, 1)) - FAR)).all(axis=1)
    if not near.any():
        return FAR
    least = min(_apart(peg.reshape(-1, 2), block[near]), _apart(block[near].reshape(-1, 2), peg))
    overlap = _within(peg[:, 0], block).any() or _within(block[near][:, 0], peg).any()
    return -least if overlap else least


def _apart(points: np.ndarray, segments: np.ndarray) -> float:
    """Least distance of points (n, 2) to segments (m, 2, 2)."""
    start, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.maximum((along**2).sum(axis=1), 1e-24)
    least = np.inf
    for some in np.array_split(points, max(1, len(points) * len(segments) // 1_000_000)):
        to = some[:, None] - start  # (n, m, 2)
        share = np.clip((to * along).sum(axis=2) / length, 0.0, 1.0)
        least = min(least, float(np.linalg.norm(to - share[..., None] * along, axis=2).min()))
    return least


def _within(points: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """(n,) whether points (n, 2) lie within the area that segments (m, 2, 2) enclose: a ray crosses an odd number."""
    (x0, y0), (x1, y1) = outline[:, 0].T, outline[:, 1].T
    odd = np.zeros(len(points), bool)
    for k, (x, y) in enumerate(points):
        cross = (y0 > y) != (y1 > y)
        odd[k] = (x0[cross] + (y - y0[cross]) / (y1[cross] - y0[cross]) * (x1[cross] - x0[cross]) > x).sum() % 2
    return odd


def gap(model: mujoco.MjModel, flange: np.ndarray) -> float:
    """Least distance (m, negative if they overlap) between the contact shapes of the bodies `peg` and `fixture`.

    Args:
        model: a compiled cell.
        flange: (3,) where a flange that looks straight down holds the peg, world frame, m.
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
    return min(mujoco.mj_geomDistance(model, data, int(a), int(b), 0.05, None) for a, b in meet)
