"""Pegs and holes given as mesh files: read, measured, taken apart into convex pieces for contact.

Frames: both files are drawn as assembled, z up and out of the hole. A peg's axis is its file's z axis, its tip its
lowest point; the centre of a hole's mouth is the middle of its mesh's bounding box at the top, or a stated origin.
"""

# trimesh loads anything; what is not a mesh is refused before these lines.
# pyright: reportAttributeAccessIssue=false, reportAssignmentType=false, reportIndexIssue=false, reportGeneralTypeIssues=false, reportArgumentType=false

from __future__ import annotations

import hashlib
import io
import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import missing
from vispeg.core.files import write_bytes_atomic
from vispeg.core.seeds import stream

SAMPLES = 20000  # points on a mesh at which its pieces are checked
CONVEX = 1e-6  # share of its hull's volume that a convex mesh may lack
MESH = mujoco.mjtGeom.mjGEOM_MESH


@dataclass(frozen=True, eq=False)
class UserShape:
    """A closed mesh in m about its own origin (a peg's tip, a hole's mouth), axes as in its file.

    Attributes:
        vertices, faces: (v, 3) m and (f, 3).
        pieces: corners (k, 3) m of convex pieces that fill it; one if it is convex itself.
        error: greatest distance found between its surface and that of its pieces, m.
        volume, com, inertia: m^3, (3,) m, and (3, 3) about the centre for unit density, m^5.
    """

    vertices: np.ndarray
    faces: np.ndarray
    pieces: tuple[np.ndarray, ...]
    error: float
    volume: float
    com: np.ndarray
    inertia: np.ndarray

    @property
    def extent(self) -> np.ndarray:
        """Size (3,) along its axes, m."""
        return np.ptp(self.vertices, axis=0)

    def add(self, spec: mujoco.MjSpec, body, name: str, place, contact: dict, visual: dict) -> None:
        """Adds geom `name` to be seen and `name`_piece0.. for contact; `place` maps (n, 3) into the body's frame."""
        corners = place(self.vertices)[self.faces].reshape(-1, 3)  # faces apart, so that edges stay sharp
        indices = np.arange(len(corners))
        spec.add_mesh(
            name=name,
            uservert=corners.ravel().tolist(),
            userface=indices.tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        body.add_geom(name=name, type=MESH, meshname=name, contype=0, conaffinity=0, mass=0.0, **visual)
        for i, piece in enumerate(self.pieces):
            spec.add_mesh(name=f"{name}_piece{i}", uservert=place(piece).ravel().tolist())
            settings = {"group": 3, "mass": 0.0, **contact}
            body.add_geom(name=f"{name}_piece{i}", type=MESH, meshname=f"{name}_piece{i}", **settings)


def read(
    file: str, key: str, scale: float, concavity: float, origin: tuple[float, ...] = (), tip: bool = False
) -> UserShape:
    """The shape in a mesh file (STL, OBJ, PLY, OFF, GLB).

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
    path = Path(file).expanduser()
    if not path.is_file():
        raise UserError("no such mesh", file=file, key=key)
    return _read(str(path.resolve()), path.stat().st_mtime_ns, key, scale, concavity, origin, tip)


@lru_cache(maxsize=16)
def _read(
    file: str, stamp: int, key: str, scale: float, concavity: float, origin: tuple[float, ...], tip: bool
) -> UserShape:
    import trimesh

    data = Path(file).read_bytes()
    try:
        mesh = trimesh.load(io.BytesIO(data), file_type=Path(file).suffix.lstrip(".").lower(), force="mesh")
        mesh.merge_vertices(merge_norm=True, merge_tex=True)
    except Exception as error:  # whatever the reader of that format raises
        raise UserError("cannot be read as a mesh", file=file, key=key, got=str(error)[:80]) from error
    if not len(mesh.faces):
        raise UserError("holds no triangles", file=file, key=key)
    if not mesh.is_watertight or not mesh.is_winding_consistent:
        raise UserError("the mesh is not watertight", file=file, key=key, expected="a closed surface without gaps")
    if mesh.volume < 0:
        mesh.invert()
    mesh.apply_scale(scale)
    low, high = mesh.bounds
    if not 0.002 <= (high - low).max() <= 0.4:
        hint = "2 to 400 mm at its longest (mesh_scale is m per unit of the file: 0.001 for mm)"
        raise UserError("no size for a peg or a hole", file=file, key=key, expected=hint, got=(high - low).round(6))
    start = np.array([0.0, 0.0, low[2]]) if tip else np.array([*(low + high)[:2] / 2, high[2]])
    if origin:
        start = scale * np.array(origin, float)
    if mesh.volume >= (1 - CONVEX) * mesh.convex_hull.volume:
        pieces, error = (np.array(mesh.vertices),), 0.0
    else:
        digest = hashlib.sha256(data + repr((1, scale, concavity)).encode()).hexdigest()
        pieces = _pieces(np.array(mesh.vertices), np.array(mesh.faces), concavity, digest, key)
        points, _ = trimesh.sample.sample_surface(mesh, SAMPLES, seed=int(stream(0, "mesh").integers(2**31)))
        error = distance(np.concatenate([mesh.vertices, points]), pieces)
    mesh.apply_translation(-start)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    pieces = tuple(p - start for p in pieces)
    return UserShape(
        vertices, faces, pieces, error, float(mesh.volume), np.array(mesh.center_mass), np.array(mesh.moment_inertia)
    )


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


def distance(points: np.ndarray, pieces: tuple[np.ndarray, ...]) -> float:
    """How far the furthest of the points (n, 3) on a surface lies outside all pieces, or inside one of them, m.

    Inside a convex body the distance to its surface is the least one to its faces' planes; outside, the greatest one
    is a lower bound that is exact in front of a face.
    """
    from scipy.spatial import ConvexHull

    nearest = np.full(len(points), np.inf)
    for piece in pieces:
        planes = ConvexHull(piece).equations
        for some in np.array_split(np.arange(len(points)), max(1, len(points) * len(planes) // 4_000_000)):
            out = (points[some] @ planes[:, :3].T + planes[:, 3]).max(axis=1)
            nearest[some] = np.minimum(nearest[some], out)
    return float(np.abs(nearest).max())


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
