"""The mesh of a geom is its surface: closed, each vertex once, with its extent and its volume."""

import io

import mujoco
import numpy as np
import pytest
import trimesh

from vispeg.datasets.formats.models import ply
from vispeg.render.part_mesh import SECTIONS, geom_mesh

GEOMS = {  # name -> size and volume, m3
    "box": ((0.1, 0.2, 0.3), 0.2 * 0.4 * 0.6),
    "cylinder": ((0.1, 0.2), np.pi * 0.01 * 0.4),
    "sphere": ((0.1,), 4 / 3 * np.pi * 0.001),
    "capsule": ((0.1, 0.2), 4 / 3 * np.pi * 0.001 + np.pi * 0.01 * 0.4),
}


def of_kind(kind: str) -> mujoco.MjModel:
    size = " ".join(map(str, GEOMS[kind][0])) if kind in GEOMS else "1 1 1"
    return mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody><geom type='{kind}' size='{size}'/></worldbody></mujoco>"
    )


@pytest.mark.parametrize("kind", GEOMS)
def test_a_surface_is_closed_and_holds_the_volume(kind):
    model = of_kind(kind)
    vertices, faces = geom_mesh(model, 0)
    solid = trimesh.Trimesh(vertices, faces, process=False)
    assert solid.is_watertight and solid.is_winding_consistent and len(np.unique(vertices, axis=0)) == len(vertices)
    # a polygon of n sides in a circle has 1 - (2 pi / n)^2 / 6 of its area, a ball twice that deficit and a bit more
    deficit = 0 if kind == "box" else (2 * np.pi / SECTIONS) ** 2 / 6
    assert 1 - 2.6 * deficit - 1e-12 <= solid.volume / GEOMS[kind][1] <= 1 - deficit + 1e-5
    np.testing.assert_allclose(solid.bounds[1], model.geom_aabb[0, 3:], atol=1e-12)
    np.testing.assert_allclose(solid.bounds[0], -model.geom_aabb[0, 3:], atol=1e-12)


def test_vertices_that_only_differ_in_their_normals_are_one():
    spec = mujoco.MjSpec()
    corners = trimesh.creation.box((0.2, 0.2, 0.2)).triangles.ravel()
    normals = np.repeat(trimesh.creation.box().face_normals, 3, axis=0).ravel()
    spec.add_mesh(name="cube", uservert=corners, usernormal=normals, userface=np.arange(36))
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="cube")
    model = spec.compile()
    assert model.nmeshvert > 8
    vertices, faces = geom_mesh(model, 0)
    assert len(vertices) == 8 and trimesh.Trimesh(vertices, faces, process=False).volume == pytest.approx(0.008)


def test_a_plane_has_no_mesh():
    with pytest.raises(ValueError, match="cannot be made a mesh"):
        geom_mesh(of_kind("plane"), 0)


def test_a_ply_file_holds_the_mesh():
    vertices, faces = geom_mesh(of_kind("capsule"), 0)
    read = trimesh.load(io.BytesIO(ply((vertices, faces), 1000.0)), file_type="ply", process=False)
    np.testing.assert_array_equal(read.faces, faces)
    np.testing.assert_allclose(read.vertices, 1000 * vertices, rtol=1e-6, atol=1e-6)
