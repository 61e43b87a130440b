"""The clearance that contact geometry really leaves, by pushing, and by the mesh that the eye sees."""

import mujoco
import numpy as np
import pytest
from mujoco import batch as mjb
from scipy.spatial import ConvexHull

from vispeg.core.errors import UserError
from vispeg.effects.task.hole_clearance import HoleClearance
from vispeg.robots import hole
from vispeg.robots.scene import build
from vispeg.robots.scene_config import SceneConfig
from vispeg.sim.state import Fields


def freed(config: SceneConfig) -> mujoco.MjModel:
    """A peg of the cell's own shape on three slides inside its fixture: nothing else moves or is in the way."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep = (0, 0, 0), 5e-4
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    n = 4 if config.shape == "square" else hole.sides(config.apothem)
    fixture = spec.worldbody.add_body(name="fixture")
    hole.add_walls(spec, fixture, n, config.apothem, config.block, config.depth, config.chamfer)
    peg = spec.worldbody.add_body(name="peg", pos=(0, 0, -0.01))
    for axis in np.eye(3):
        peg.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, damping=5.0)
    square = config.shape == "square"
    kind = mujoco.mjtGeom.mjGEOM_BOX if square else mujoco.mjtGeom.mjGEOM_CYLINDER
    r = config.diameter / 2
    size = (r, r, 0.008) if square else (r, 0.008, 0)
    geom = peg.add_geom(type=kind, size=size, mass=0.1, contype=0, conaffinity=1, friction=(0, 0, 0))
    geom.solref, geom.solimp, geom.priority = (0.001, 1.0), (0.99, 0.999, 1e-5, 0.5, 2.0), 1
    return spec.compile()


def reach(model: mujoco.MjModel, angle: float) -> float:
    """How far the peg goes when pushed lightly towards `angle`, m along it."""
    data = mujoco.MjData(model)
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    data.qfrc_applied[:3] = 0.05 * way
    for _ in range(1500):
        mujoco.mj_step(model, data)
    return float(data.qpos[:3] @ way)


@pytest.mark.parametrize("clearance", [3.0, 1.0, 0.5, 0.2])
def test_a_round_peg_travels_half_the_clearance_each_way(clearance):
    """In every direction, to 0.02 mm, and never less than stated."""
    model = freed(SceneConfig(clearance_mm=clearance))
    n = hole.sides(SceneConfig(clearance_mm=clearance).apothem)
    angles = [0.0, np.pi / n, 0.7, 2.5, 4.0]  # at a wall's middle, at a corner, elsewhere
    travel = np.array([reach(model, a) for a in angles])
    assert np.all(travel > clearance / 2000 - 2e-6)
    assert np.all(travel < clearance / 2000 + hole.ROUND_ERROR + 3e-6)


def test_a_square_hole_is_exact():
    """Along both axes."""
    model = freed(SceneConfig(clearance_mm=0.5, shape="square"))
    for angle in (0.0, np.pi / 2, np.pi):
        assert reach(model, angle) == pytest.approx(0.25e-3, abs=3e-6)


@pytest.mark.parametrize("shape", ["round", "square"])
def test_what_is_seen_is_what_is_felt(shape):
    """The volume of the mesh is that of the block less the hole and its chamfer (a frustum)."""
    c = SceneConfig(shape=shape)
    n = 4 if shape == "square" else hole.sides(c.apothem)
    v, f = hole.visual(n, c.apothem, c.block, c.depth, c.chamfer)
    signed = np.einsum("fi,fi->f", v[f[:, 0]], np.cross(v[f[:, 1]], v[f[:, 2]])).sum() / 6
    # the mesh is open below: close it with the cone from the origin over its lower outline
    area = n * np.tan(np.pi / n)  # of a polygon with apothem 1
    bottom = area * c.block**2 * (c.depth + hole.FLOOR) / 3
    block = area * c.block**2 * (c.depth + hole.FLOOR)
    bore = area * c.apothem**2 * c.depth
    bevel = area * (
        ((c.apothem + c.chamfer) ** 3 - c.apothem**3) / 3 / c.chamfer * c.chamfer - c.apothem**2 * c.chamfer
    )
    assert abs(signed) + bottom == pytest.approx(block - bore - bevel, rel=1e-6)


@pytest.mark.parametrize("settings", [{}, {"shape": "square"}, {"clearance_mm": 0.2, "chamfer": 0.0}, {"block": 0.014}])
def test_pieces_fill_the_block_without_lying_upon_each_other(settings):
    """Their volumes add up to the block's less the hole's and the bevel's, and their top is flat and whole."""
    c = SceneConfig(**settings)
    n = 4 if c.shape == "square" else hole.sides(c.apothem)
    spec = mujoco.MjSpec()
    hole.add_walls(spec, spec.worldbody.add_body(name="fixture"), n, c.apothem, c.block, c.depth, c.chamfer)
    spec.delete(spec.geom(hole.TOP))  # a ray meets it, though no part does
    model = spec.compile()
    pieces = [g for g in range(model.ngeom) if model.geom(g).name != "hole_bottom"]
    volume = sum(_volume(model, int(model.geom_dataid[g])) for g in pieces)
    bevel = ((c.apothem + c.chamfer) ** 3 - c.apothem**3) / 3 - c.apothem**2 * c.chamfer
    whole = n * np.tan(np.pi / n) * (c.depth * (c.block**2 - c.apothem**2) - bevel)
    assert volume == pytest.approx(whole, rel=1e-6)
    assert np.ptp(heights(model, c.apothem + c.chamfer, c.block, n)) < 1e-7


@pytest.mark.parametrize("width", [-1e-3, 1e-3, 5e-3])
@pytest.mark.parametrize("shape", ["round", "square"])
def test_a_changed_clearance_changes_the_hole_and_leaves_no_gap_about_it(shape, width):
    """Walls move by half of it, and the top is flat from the bevel's edge on; walls that move apart leave seams."""
    c, scene = SceneConfig(shape=shape), build(SceneConfig(shape=shape))
    n = 4 if shape == "square" else hole.sides(c.apothem)
    spec = scene.spec()
    spec.delete(spec.geom(hole.TOP))
    model = spec.compile()
    batch = mjb.Batch(model, 1)
    HoleClearance().write(Fields(batch, scene), {"width": np.array([[width]])})
    model.geom_pos[:] = batch.expand("geom_pos")[0]
    deep = heights(model, c.apothem + c.chamfer + width / 2, c.block - abs(width), n)
    assert np.mean(deep > 1e-7) < (0.03 if width > 0 else 1e-9)
    across = [beam(model, np.array(c.fixture) + [0, 0, -0.01], way) for way in np.eye(3)[:2]]
    np.testing.assert_allclose(across, c.apothem + width / 2, atol=1e-6)


@pytest.mark.parametrize("angle", [0.0, 1.5, 3.2, 4.7])
def test_what_stands_beside_the_mouth_bears_on_one_piece_as_stiff_as_the_top_without_a_hole(angle):
    """Four contacts with one plate, 4.1e6 N/m; the untouched top, once touched, gives the same."""
    spec = mujoco.MjSpec()
    spec.option.gravity, spec.option.timestep, c = (0, 0, 0), 5e-4, SceneConfig()
    body = spec.worldbody.add_body(name="fixture")
    hole.add_walls(spec, body, hole.sides(c.apothem), c.apothem, c.block, c.depth, c.chamfer)
    peg = spec.worldbody.add_body(pos=(0.03 * np.cos(angle), 0.03 * np.sin(angle), 0.04))
    peg.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1), damping=50.0)
    part = peg.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(c.diameter / 2, 0.04, 0), mass=0.5, priority=1)
    part.contype, part.conaffinity, part.solref, part.solimp = 0, 1, c.solref, (0.95, 0.99, 2e-4, 0.5, 2.0)
    stiffness = []
    for touched in (lambda name: name != hole.TOP, lambda name: name == hole.TOP):
        for geom in body.geoms:
            geom.contype = hole.TOUCHED if touched(geom.name) else hole.UNTOUCHED
        model = spec.compile()
        data = mujoco.MjData(model)
        data.qfrc_applied[0] = -20.0
        mujoco.mj_step(model, data, 3000)
        assert data.ncon == 4 and len(set(data.contact.geom[:, 0])) == len(set(data.contact.geom[:, 1])) == 1
        stiffness.append(-20.0 / data.qpos[0])
    np.testing.assert_allclose(stiffness, 4.1e6, rtol=0.02)


def heights(model, inner, outer, n):
    """Metres below the mouth's level, seen from above at 400 places of a block of n sides between two apothems."""
    rng, at = np.random.default_rng(0), []
    middle = model.body("fixture").pos
    while len(at) < 400:
        spot = rng.uniform(-outer, outer, 2)
        side = 2 * np.pi / n * np.arange(n)
        reach = (spot[0] * np.cos(side) + spot[1] * np.sin(side)).max()
        if inner + 1e-5 < reach < outer - 1e-5:
            at.append(beam(model, middle + [*spot, 0.01], [0, 0, -1.0]) - 0.01)
    return np.array(at)


def beam(model, start, way):
    """Metres from a point along a way to the first of the fixture's shapes for contact."""
    data, group = mujoco.MjData(model), np.array([0, 0, 0, 1, 0, 0], np.uint8)
    mujoco.mj_forward(model, data)
    return mujoco.mj_ray(model, data, np.array(start), np.array(way), group, 1, -1, np.zeros(1, np.int32))


def _volume(model: mujoco.MjModel, mesh: int) -> float:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    return ConvexHull(model.mesh_vert[start : start + count]).volume


def test_impossible_geometry_is_refused():
    """Each with the key at fault."""
    for bad in (
        {"clearance_mm": 0.0},
        {"clearance_mm": -1.0},
        {"diameter": 0.05},
        {"diameter": 0.0123},
        {"fixture": (2.0, 0.0, 0.05)},
        {"fixture": (0.6, 0.0, 0.01)},
        {"shape": "star"},
        {"depth": 0.2},
        {"block": 0.005},
        {"block": 0.3},
        {"solref": (0.0, 1.0)},
        {"solref": (0.004,)},
        {"fixture": (0.6, 0.0)},
    ):
        with pytest.raises(UserError) as error:
            SceneConfig(**bad)
        assert next(iter(bad)).split("_")[0] in str(error.value) or "reach" in str(error.value)


def test_equal_cells_are_built_once():
    """The cache is by configuration."""
    assert build(SceneConfig(clearance_mm=0.7)) is build(SceneConfig(clearance_mm=0.7))
    assert build(SceneConfig(clearance_mm=0.7)) is not build(SceneConfig(clearance_mm=0.8))
