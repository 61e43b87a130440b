"""Surfaces of geoms are those of trimesh: closed, turned outwards, of the same size."""

import mujoco
import numpy as np
import pytest
import trimesh
from trimesh import creation

from vispeg.robots.solids import solid

SECTIONS = 64
ELLIPSOID = creation.icosphere(5).apply_scale((0.1, 0.2, 0.3))
OURS = {
    "box": ("0.1 0.2 0.3", creation.box((0.2, 0.4, 0.6)), 1e-12),
    "cylinder": ("0.1 0.3", creation.cylinder(0.1, 0.6, sections=SECTIONS), 1e-12),
    "capsule": ("0.1 0.3", creation.capsule(0.6, 0.1, count=(SECTIONS, SECTIONS)), 2e-3),
    "sphere": ("0.1", creation.icosphere(5, 0.1), 5e-3),
    "ellipsoid": ("0.1 0.2 0.3", ELLIPSOID, 5e-3),
}


@pytest.mark.parametrize("kind", OURS)
def test_a_solid_is_that_of_trimesh(kind):
    size, theirs, off = OURS[kind]
    xml = f"<mujoco><worldbody><geom type='{kind}' size='{size}'/></worldbody></mujoco>"
    ours = trimesh.Trimesh(*solid(mujoco.MjModel.from_xml_string(xml), 0, SECTIONS), process=False)
    theirs = theirs.copy().apply_translation(-theirs.bounds.mean(axis=0))
    assert ours.is_watertight and ours.is_winding_consistent
    assert ours.volume == pytest.approx(theirs.volume, rel=off) and ours.area == pytest.approx(theirs.area, rel=off)
    np.testing.assert_allclose(ours.bounds, theirs.bounds, atol=1e-4)


def test_a_mesh_keeps_its_triangles_and_a_plane_has_no_inside():
    spec = mujoco.MjSpec()
    theirs = creation.annulus(0.1, 0.3, 0.2)
    spec.add_mesh(name="ring", uservert=theirs.vertices.ravel(), userface=theirs.faces.ravel())
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="ring")
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=(1, 1, 1))
    model = spec.compile()
    ours = trimesh.Trimesh(*solid(model, 0, SECTIONS))
    assert ours.volume == pytest.approx(theirs.volume, rel=1e-5) and len(ours.faces) == len(theirs.faces)
    assert solid(model, 1, SECTIONS) is None
