"""The peg task on arms of seven joints and six, each by one world file; their guards; their null space."""

import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml
from robots.arms import PANDA, SPEED, UR5E, write

from vispeg.control.laws import ZONE, away, osc, singular, task_inertia
from vispeg.core.errors import UserError
from vispeg.report.live.shapes import visible
from vispeg.robots.declare import RobotConfig
from vispeg.robots.menagerie import available, find
from vispeg.robots.model import load
from vispeg.robots.scene import build
from vispeg.robots.scene_config import SceneConfig
from vispeg.sim.compiled import nominal_of
from vispeg.sim.home import bounds, home_of
from vispeg.task.guards import CATEGORIES, Guards
from vispeg.task.peg.config import PegConfig
from vispeg.task.peg.expert import Expert
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.world_file import load_world, world_text
from vispeg.worlds.world import World

CHAINS = {"panda": PANDA, "ur5e": UR5E}
GUARDED = {"avoid_limits": 200.0, "guard_velocity": 1.0, "guard_limit": 0.02, "guard_singularity": 0.03}


@pytest.fixture(scope="module", params=("iiwa14", *CHAINS))
def world(request, tmp_path_factory):
    """A world file of each arm."""
    folder, name = tmp_path_factory.mktemp(request.param), request.param
    robot = {"model": name}
    if name in CHAINS:
        write(folder, name, CHAINS[name])
        robot = {"model": f"{name}.xml", "velocity_limit": list(SPEED[name])}
    told = {"format": "vispeg-world/1", "name": name, "base": ["goal", "physics"], "robot": robot, "task": GUARDED}
    (folder / "world.yaml").write_text(yaml.safe_dump(told))
    return folder / "world.yaml"


def test_the_expert_inserts_on_every_arm_with_its_guards_on(world):
    env = PegInHoleVec(12, world, "state", autoreset_mode="Disabled")
    expert, ends = Expert(env.config, 12), {}
    seen, _ = env.reset(seed=0)
    for _ in range(env.config.steps):
        seen, _, ended, late, infos = env.step(expert.act(seen))
        for i in set(np.flatnonzero(ended | late).tolist()) - set(ends):
            ends[i] = infos["record"][i]["category"]
    assert sum(end == "success" for end in ends.values()) >= 9 and not set(ends.values()) & set(CATEGORIES), ends


def test_a_world_says_its_robot_and_reads_back(world, tmp_path):
    file = load_world(world)
    again = tmp_path / "again.yaml"
    again.write_text(world_text(file))
    assert load_world(again).hash == file.hash and file.hash != load_world("nominal").hash


@pytest.mark.parametrize("name", CHAINS)
def test_an_arm_of_the_users_own_stands_on_the_world_of_its_name(tmp_path, monkeypatch, name):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # not installed
    write(tmp_path, "arm", CHAINS[name])
    robot = {"model": "arm.xml", "flange": "attachment_site", "flange_pos": [0, 0, 0], "flange_quat": [1, 0, 0, 0]}
    (tmp_path / "own.yaml").write_text(yaml.safe_dump({"format": "vispeg-world/1", "base": name, "robot": robot}))
    task = load_world(tmp_path / "own.yaml").task  # without an arm of that name at hand
    assert task["guard_velocity"] == 1.0 and task["robot"]["velocity_limit"] == pytest.approx(SPEED[name], rel=1e-3)
    other = {"format": "vispeg-world/1", "base": "own.yaml", "robot": "iiwa14"}
    (tmp_path / "other.yaml").write_text(yaml.safe_dump(other))
    assert load_world(tmp_path / "other.yaml").task["robot"] == {}  # a name alone is another robot, with its own limits
    home = home_of(arm(tmp_path, name), (0.6, 0.0, 0.265), (0.0, 1.0, 0.0, 0.0)).tolist()
    below = {"format": "vispeg-world/1", "base": "own.yaml", "robot": {"home": home}}
    (tmp_path / "home.yaml").write_text(yaml.safe_dump(below))
    placed = load_world(tmp_path / "home.yaml").task["robot"]
    assert placed["model"] == task["robot"]["model"] and placed["home"] == home


def test_a_name_that_nobody_knows_is_refused_where_the_world_is_made():
    with pytest.raises(UserError, match=r"unknown robot.*'iwa14' \(did you mean 'iiwa14'\?\); choices"):
        World("iwa14")
    assert World("panda").robot == "panda", "a robot to be downloaded is known"


def arm(tmp_path, name):
    return load(write(tmp_path, name, CHAINS[name]), "meg50+peg16")


@pytest.mark.parametrize("name", CHAINS)
def test_a_solved_home_holds_the_pose_within_limits_and_away_from_singularities(tmp_path, name):
    robot, pos, down = arm(tmp_path, name), (0.6, 0.0, 0.265), (0.0, 1.0, 0.0, 0.0)
    home = home_of(robot, pos, down)
    _, jac, flange, quat, _ = nominal_of(robot, 1).operational(home[None])
    np.testing.assert_allclose(flange[0], pos, atol=3e-3)  # angles are rounded to a milliradian
    assert abs(quat[0] @ down) > 1 - 1e-5 and singular(jac)[0] > 0.1
    assert (home > robot.range[:, 0]).all() and (home < robot.range[:, 1]).all()
    np.testing.assert_array_equal(home, home_of(robot, pos, down))
    said = r"no posture .*at \[1.8, 0.0, 0.2\] m.*\[0.0, 1.0, 0.0, 0.0\] \(w x y z.*task.fixture.*flange_quat"
    with pytest.raises(UserError, match=said):
        home_of(robot, (1.8, 0.0, 0.2), down)


def test_a_home_above_the_base_is_within_the_limits_too():
    """There every vertical plane through the base's axis contains the flange."""
    robot = replace(load("iiwa14"), home=())
    pos, up = (0.0, 0.0, 0.9), (1.0, 0.0, 0.0, 0.0)
    home = home_of(robot, pos, up)
    np.testing.assert_allclose(nominal_of(robot, 1).operational(home[None])[2][0], pos, atol=3e-3)
    assert (home > robot.range[:, 0]).all() and (home < robot.range[:, 1]).all()


def test_a_joint_whose_range_lies_beyond_a_turn_is_solved_within_it(tmp_path):
    """A turn more or less is the same posture: it holds the tool as the arm with the range about zero does."""
    *inner, last = PANDA
    far = load(write(tmp_path, "far", (*inner, (*last[:2], (3.5, 9.9), *last[3:]))), "meg50+peg16")
    home = home_of(far, (0.6, 0.0, 0.265), (0.0, 1.0, 0.0, 0.0))
    assert 3.5 < home[6] < 9.9
    flange = nominal_of(far, 1).operational(home[None])[2]
    np.testing.assert_allclose(flange[0], (0.6, 0.0, 0.265), atol=3e-3)


def test_a_first_joint_close_to_the_table_keeps_no_arm_from_standing(tmp_path, monkeypatch):
    robot = arm(tmp_path, "panda")
    first = min(float(height) for height in robot.compile().body_pos[1:3, 2] if height > 0)
    monkeypatch.setattr("vispeg.sim.home.CLEAR", first + 0.01)  # where that joint stands, no posture changes
    assert len(home_of(robot, (0.6, 0.0, 0.265), (0.0, 1.0, 0.0, 0.0))) == 7


@pytest.mark.parametrize("name", CHAINS)
def test_null_space_torque_does_not_accelerate_the_flange_and_six_joints_have_none(tmp_path, name):
    robot = arm(tmp_path, name)
    rng, still = np.random.default_rng(1), np.zeros((1, 6))
    q = home_of(robot, (0.6, 0.0, 0.265), (0.0, 1.0, 0.0, 0.0))[None]
    mass, jac, *_ = nominal_of(robot, 1).operational(q)
    posture = rng.standard_normal(q.shape)
    tau = osc(still, still, mass, jac, still, still, posture)
    acceleration = (jac @ np.linalg.solve(mass, tau[..., None]))[0, :, 0]  # J M^-1 N' tau_0 = 0
    np.testing.assert_allclose(acceleration, 0.0, atol=1e-9)
    lam, minv_jt = task_inertia(mass, jac)
    project = np.eye(q.shape[1]) - jac[0].T @ lam[0] @ minv_jt[0].T
    np.testing.assert_allclose(project @ project, project, atol=1e-9)
    assert round(float(np.trace(project)), 6) == q.shape[1] - 6  # its rank
    assert (np.abs(tau).max() < 1e-8) == (q.shape[1] == 6)


def test_the_pull_away_from_limits_is_the_gradient_of_its_potential():
    limits = np.array([[-1.0, 2.0], [-np.inf, np.inf], [0.0, 1.0]])
    q, step = np.random.default_rng(0).uniform(-1.2, 2.2, (200, 3)), 1e-6

    def potential(q):
        """Half the stiffness times the squared depth in the zones, joint by joint."""
        low, high = limits[[0, 2]].T
        zone, at = ZONE * (high - low), q[:, [0, 2]]
        return 25.0 * (np.maximum(low + zone - at, 0.0) ** 2 + np.maximum(at - high + zone, 0.0) ** 2).sum(axis=1)

    for j in range(3):
        by = np.eye(3)[j] * step
        slope = (potential(q + by) - potential(q - by)) / (2 * step)
        np.testing.assert_allclose(away(q, limits, 50.0)[:, j], -slope, atol=1e-6)
    inside = np.array([[0.5, 9.0, 0.5]])
    assert not away(inside, limits, 50.0).any()


def test_each_guard_ends_an_episode_with_its_own_category(tmp_path):
    robot = load("iiwa14")
    config = PegConfig(guard_velocity=0.5, guard_limit=0.1, guard_singularity=0.05)
    q = np.tile([0.0, 0.6, 0.0, -1.6, 0.0, 0.95, 0.0], (4, 1))
    dq = np.zeros_like(q)
    guards = Guards(config, robot, 4)
    guards.tick(q, dq)
    assert guards.stopped == [None] * 4
    dq[1, 0], q[2, 3] = 0.51 * robot.velocity_limit[0], robot.range[3, 0] + 0.09
    guards.tick(q, dq)
    jac = nominal_of(robot, 4).operational(np.where(np.arange(4)[:, None] == 3, 0.0, q))[1]  # stretched: singular
    guards.pose(jac)
    assert guards.stopped == [None, *CATEGORIES]
    guards.reset(np.array([1, 3]))
    assert guards.stopped == [None, None, CATEGORIES[1], None]
    assert not Guards(PegConfig(), robot, 4).on
    with pytest.raises(UserError, match="a guard without limits"):
        Guards(config, load(write(tmp_path, "panda", PANDA)), 1)


def test_an_arm_that_is_not_installed_is_refused_in_one_line(monkeypatch):
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # not installed
    with pytest.raises(UserError, match="'ur5e' is not here.*pip install.*menagerie.*MENAGERIE_ROOT"):
        load_world("ur5e")


def test_a_folder_of_scenes_alone_is_no_robot(tmp_path, monkeypatch):
    (tmp_path / "empty_bot").mkdir()
    (tmp_path / "empty_bot" / "scene.xml").write_text("<mujoco/>")
    write(tmp_path, "panda", PANDA)
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)  # not installed
    assert find("empty_bot") is None and available() == []


def test_a_declared_flange_limits_and_bodies_without(tmp_path):
    path = write(tmp_path, "ur5e", UR5E)
    told = RobotConfig(path, flange="part5", flange_pos=(0, 0, 0.05), velocity_limit=(1.0,) * 6, damping=(3.0,) * 6)
    robot = load(path, declared=told)
    model = robot.compile()
    np.testing.assert_allclose(model.site("flange").pos, [0, 0, 0.05])
    np.testing.assert_array_equal(model.dof_damping, 3.0)
    np.testing.assert_array_equal(robot.velocity_limit, 1.0)
    assert load(path, declared=RobotConfig(path, without=("part5",))).joints == robot.joints[:5]
    for wrong in ({"flange": "elsewhere"}, {"home": (0.0,) * 7}, {"without": ("hand",)}):
        with pytest.raises(UserError):
            load(path, declared=RobotConfig(path, **wrong))


def test_shapes_for_contact_are_not_drawn_over_those_for_the_eye(tmp_path):
    """Files differ in the groups of their geoms: robosuite's for contact are in group 0, Menagerie's in group 3."""
    write(tmp_path, "ur5e", UR5E)
    spec = mujoco.MjSpec.from_file(str(tmp_path / "ur5e.xml"))
    shapes = [geom for geom in spec.geoms if geom.parent.name != "world"]
    for geom in shapes:
        geom.group, geom.name, geom.contype = 0, f"{geom.parent.name}-contact", 1
        kind = {"contype": 0, "conaffinity": 0, "group": 1, "mass": 0.0}
        geom.parent.add_geom(name=f"{geom.parent.name}-eye", size=(0.02, 0.02, 0.02), **kind)
    model = spec.compile()
    assert {model.geom(g).name for g in visible(model)} == {f"{geom.parent.name}-eye" for geom in shapes}
    (tmp_path / "dressed.xml").write_text(spec.to_xml())
    robot = RobotConfig(str(tmp_path / "dressed.xml"), velocity_limit=SPEED["ur5e"])
    scene = build(SceneConfig(robot=robot))
    assert all(name.endswith("-eye") for name in scene.parts["arm"]) and len(scene.parts["arm"]) == len(shapes)
    cell = scene.spec().compile()
    collides = [cell.geom(f"{geom.parent.name}-contact") for geom in shapes]
    assert all(geom.group[0] == 3 and geom.conaffinity[0] for geom in collides), "they touch all the same"


def test_joints_without_limits_are_bounded_by_a_turn():
    arm = load("iiwa14")
    some = np.array([[-np.inf, np.inf], [-1.0, 2.0], [-9.0, 9.0], *arm.range[3:]])
    with np.errstate(all="raise"):
        low, high = bounds(replace(arm, range=some))
    assert low[:3] == pytest.approx([-np.pi, -1.0, -np.pi]) and high[:3] == pytest.approx([np.pi, 2.0, np.pi])
    assert np.array_equal(np.transpose([low, high])[3:], arm.range[3:])


def test_a_tool_in_the_last_links_origin_is_noted_where_the_file_has_frames_further_out(tmp_path, recwarn):
    file = Path(write(tmp_path, "mine", PANDA))
    build(SceneConfig(robot=RobotConfig(str(file))))
    assert not recwarn.list, "attachment_site is a flange"
    file.write_text(file.read_text().replace("attachment_site", "right_hand"))
    with pytest.warns(UserWarning, match="origin of part6; `flange` in the world's `robot` .*: right_hand"):
        build(SceneConfig(robot=RobotConfig(str(file), home=(0, 0, 0, -2, 0, 2, 0))))
    recwarn.clear()
    build(SceneConfig(robot=RobotConfig(str(file), flange="right_hand")))
    assert not recwarn.list
