"""Makes the visual meshes of the iiwa14 in assets/iiwa14/: lofted tubes along each link, and a band at each joint.

They are drawn for this project from the arm's kinematic table; no maker's mesh is used. Visual only: masses are stated
in the robot's table.

Example: python scripts/make_meshes.py --out assets/iiwa14 --overwrite
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vispeg.core.files import write_bytes_atomic

AROUND = 20  # vertices around a tube
# link: (kind, distance to the next joint, reach of the bend sideways, tube radius at start and at end), m
# "up": the next joint lies along z and the bend is along y; "out": the next joint lies along y and the bend is along z
TUBES = {
    "link1": ("up", 0.2025, -0.118, 0.072, 0.070),
    "link2": ("out", 0.2045, 0.118, 0.070, 0.068),
    "link3": ("up", 0.2155, 0.118, 0.068, 0.066),
    "link4": ("out", 0.1845, 0.112, 0.066, 0.062),
    "link5": ("up", 0.2155, 0.100, 0.062, 0.052),
}


def loft(centres: np.ndarray, normals: np.ndarray, radii: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a closed surface through ellipses.

    Args:
        centres: (n, 3) m.
        normals: (n, 3) direction of travel; all in the y-z plane or along z, so that x spans one axis of every ellipse.
        radii: (n, 2) m, along x and across.

    Returns:
        Vertices (m, 3) and triangles (k, 3), outward.
    """
    angle = np.arange(AROUND) * 2 * np.pi / AROUND
    x = np.array([1.0, 0.0, 0.0])
    rings = []
    for c, n, (a, b) in zip(centres, normals, radii, strict=True):
        across = np.cross(n / np.linalg.norm(n), x)
        rings.append(c + a * np.cos(angle)[:, None] * x + b * np.sin(angle)[:, None] * across)
    vertices = np.vstack([*rings, centres[:1], centres[-1:]])
    first, last = len(vertices) - 2, len(vertices) - 1
    faces = []
    for i in range(len(rings) - 1):
        for j in range(AROUND):
            k = (j + 1) % AROUND
            a, b, c, d = i * AROUND + j, i * AROUND + k, (i + 1) * AROUND + k, (i + 1) * AROUND + j
            faces += [(a, b, c), (a, c, d)]
    top = (len(rings) - 1) * AROUND
    for j in range(AROUND):
        k = (j + 1) % AROUND
        faces += [(first, k, j), (last, top + j, top + k)]
    return vertices, np.array(faces)


def tube(kind: str, length: float, bulge: float, r0: float, r1: float) -> tuple[np.ndarray, np.ndarray]:
    """Draw an elbow that leaves the first joint's plane, swings sideways and meets the next joint's plane square."""
    if kind == "up":  # starts along z at the origin, ends along y at (0, 0, length)
        points = np.array([[0, 0, 0], [0, 0, 0.52 * length], [0, bulge, length], [0, 0, length]])
    else:  # starts along z at the origin, ends along y at (0, length, 0)
        points = np.array([[0, 0, 0], [0, 0, bulge], [0, 0.48 * length, 0], [0, length, 0]])
    t = np.linspace(0, 1, 10)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    slopes = np.hstack([3 * (1 - t) ** 2, 6 * t * (1 - t), 3 * t**2])
    path, heading = weights @ points, slopes @ np.diff(points, axis=0)
    radius = r0 + (r1 - r0) * t[:, 0] + 0.006 * np.sin(np.pi * t[:, 0])  # fuller between the joints
    return loft(path, heading, np.column_stack([radius, radius]))


def lathe(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Return a body of revolution about z from (radius, z) in m, bottom to top."""
    r, z = np.array(profile).T
    zero = np.zeros_like(z)
    return loft(np.column_stack([zero, zero, z]), np.tile([0.0, 0, 1], (len(z), 1)), np.column_stack([r, r]))


def band(radius: float, height: float = 0.014) -> tuple[np.ndarray, np.ndarray]:
    """Return the ring at a joint, which stands out from the tube."""
    h = height / 2
    return lathe([(radius, -h), (radius + 0.003, -0.7 * h), (radius + 0.003, 0.7 * h), (radius, h)])


def parts() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return every mesh by file stem, in the frame of its body."""
    shapes = {name: tube(*numbers) for name, numbers in TUBES.items()}
    table = [  # z, centre x, half length x, half width y: the foot with its connector panel behind
        (0.0, -0.045, 0.155, 0.108), (0.035, -0.045, 0.155, 0.108), (0.055, -0.040, 0.142, 0.100),
        (0.080, -0.018, 0.105, 0.088), (0.105, -0.004, 0.080, 0.078), (0.150, 0.0, 0.074, 0.074),
    ]  # fmt: skip
    z, cx, rx, ry = np.array(table).T
    centres = np.column_stack([cx, 0 * z, z])
    shapes["base"] = loft(centres, np.tile([0.0, 0, 1], (len(z), 1)), np.column_stack([rx, ry]))
    # the wrist's ball, turning about z of link6, with the neck of joint 7 along y
    t = np.linspace(-np.pi / 2, np.pi / 2, 9)[1:-1]
    ball = lathe([(0.058 * np.cos(s), 0.058 * np.sin(s)) for s in t])
    neck = loft(np.array([[0, 0.0, 0], [0, 0.045, 0], [0, 0.074, 0]]), np.tile([0.0, 1, 0], (3, 1)),
                np.array([[0.05, 0.05], [0.05, 0.05], [0.045, 0.045]]))  # fmt: skip
    shapes["link6"] = joined(ball, neck)
    shapes["link7"] = lathe([(0.044, -0.006), (0.047, 0.006), (0.047, 0.030), (0.0315, 0.034), (0.0315, 0.045)])
    for name, radius in zip(["link1", "link2", "link3", "link4", "link5", "link6", "link7"],
                            [0.073, 0.071, 0.069, 0.067, 0.064, 0.055, 0.046], strict=True):  # fmt: skip
        shapes[f"{name}_ring"] = band(radius)
    return shapes


def joined(*shapes: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return several closed surfaces as one mesh."""
    start = np.cumsum([0, *[len(v) for v, _ in shapes]])
    return np.vstack([v for v, _ in shapes]), np.vstack([f + s for (_, f), s in zip(shapes, start, strict=False)])


def main() -> None:
    """Write the STL files and say how large they are."""
    import trimesh

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).resolve().parents[1] / "assets" / "iiwa14")
    parser.add_argument("--overwrite", action="store_true", help="replace meshes that are there")
    args = parser.parse_args()
    triangles = size = 0
    for name, (vertices, faces) in parts().items():
        mesh = trimesh.Trimesh(vertices, faces, process=False)
        if not (mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0):
            raise SystemExit(f"{name}: not a closed surface that faces outwards")
        data = trimesh.exchange.stl.export_stl(mesh)
        write_bytes_atomic(args.out / f"{name}.stl", data, overwrite=args.overwrite)
        triangles, size = triangles + len(faces), size + len(data)
    print(f"{args.out}: {triangles} triangles, {size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
