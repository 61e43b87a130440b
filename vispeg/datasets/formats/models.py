"""Meshes of the parts with labelled poses: PLY files in `meta/models`, in metres and in the frame of the label."""

from __future__ import annotations

import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, read_bytes

FOLDER = "meta/models"
Mesh = tuple[np.ndarray, np.ndarray]  # vertices (v, 3) and triangles (f, 3)
HEAD = """ply
format binary_little_endian 1.0
element vertex {}
property float x
property float y
property float z
element face {}
property list uchar int vertex_indices
end_header
"""
TURNS = 32  # a part counts as round if it is unchanged by 1/32 of a turn
MOST = 12  # greatest number of equal turns about z that are looked for
SAME = 1e-3  # tolerance of a turned vertex, as a share of the part's extent


def ply(mesh: Mesh, scale: float = 1.0) -> bytes:
    """Return a PLY file of a mesh, its vertices multiplied by `scale`."""
    vertices, faces = (scale * mesh[0]).astype("<f4"), np.zeros(len(mesh[1]), [("corners", "u1"), ("at", "<i4", 3)])
    faces["corners"], faces["at"] = 3, mesh[1]
    return HEAD.format(len(vertices), len(faces)).encode() + vertices.tobytes() + faces.tobytes()


def read_ply(path: Path) -> Mesh:
    """Read the mesh of a PLY file. Raises UserError: it is not a mesh."""
    import trimesh

    data = read_bytes(path, 64 * MB)
    try:
        mesh: Any = trimesh.load_mesh(io.BytesIO(data), file_type="ply", process=False)
        vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
    except Exception as error:  # trimesh may raise anything
        raise UserError("is not a PLY mesh", file=path, got=type(error).__name__) from None
    if not len(vertices) or not len(faces) or not np.isfinite(vertices).all() or faces.max() >= len(vertices):
        raise UserError("is not a PLY mesh", file=path, expected="finite vertices, and triangles of them")
    return vertices, faces


def read_models(folder: Path) -> dict[str, Mesh]:
    """Read the meshes of a dataset by part; empty for older datasets without meshes."""
    return {path.stem: read_ply(path) for path in sorted((folder / FOLDER).glob("*.ply"))}


def described(mesh: Mesh) -> Mapping[str, object]:
    """Return a mesh's entry in BOP's models_info.json: diameter, extent, symmetries about z, in the mesh's unit."""
    vertices = mesh[0]
    low, size = vertices.min(axis=0), np.ptp(vertices, axis=0)
    numbers = {"diameter": _diameter(vertices)}
    numbers |= {f"min_{axis}": v for axis, v in zip("xyz", low, strict=True)}
    numbers |= {f"size_{axis}": v for axis, v in zip("xyz", size, strict=True)}
    out: dict[str, object] = {key: round(float(value), 5) for key, value in numbers.items()}
    if _same_turned(vertices, 2 * np.pi / TURNS):
        return out | {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [0, 0, 0]}]}
    for n in range(MOST, 1, -1):
        if _same_turned(vertices, 2 * np.pi / n):
            turns = np.repeat(np.eye(4)[None], n - 1, axis=0)
            turns[:, :3, :3] = [_turn(2 * np.pi * k / n) for k in range(1, n)]
            return out | {
                "symmetries_discrete": [t.ravel().tolist() for t in np.round(turns, 12) + 0.0]
            }  # -0.0 becomes 0.0
    return out


def _diameter(vertices: np.ndarray) -> float:
    """Return the largest distance between two vertices."""
    from scipy.spatial import ConvexHull
    from scipy.spatial.distance import pdist

    return float(pdist(vertices[ConvexHull(vertices).vertices]).max())


def _turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])


def _same_turned(vertices: np.ndarray, angle: float) -> bool:
    """Return whether a turn about z maps every vertex to a vertex, within SAME."""
    from scipy.spatial import cKDTree

    away, _ = cKDTree(vertices).query(vertices @ _turn(angle).T)
    return bool(away.max() < SAME * np.ptp(vertices, axis=0).max())
