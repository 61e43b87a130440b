"""Actions in joints and in metres move the arm to where the same actions as offsets move it."""

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

import vispeg
from vispeg.cli.main import main
from vispeg.control.laws import rotation_vector
from vispeg.core.errors import UserError
from vispeg.evaluation.entrants import entrant
from vispeg.evaluation.players import player
from vispeg.interface.actions import KINDS, Actions
from vispeg.interface.builder import Builder
from vispeg.interface.exported import Exported
from vispeg.interface.interface import KEY
from vispeg.interface.observer import Observer
from vispeg.learn.interface import interface_of_policy
from vispeg.learn.policy import load
from vispeg.task.environments.vector import TaskVec
from vispeg.task.kinematics import chain_of
from vispeg.task.peg.config import PegConfig
from vispeg.task.registry import task_of
from vispeg.task.scripted import Scripted
from vispeg.trials.trial import folders, read_trial

SI = [kind for kind in KINDS if kind != "offset"]


def arm_of(config):
    scene = task_of(config).cell(config)
    return chain_of(scene.nominal), scene.tip, scene.nominal.joints


def reached(chain, q, pos, rot):
    """Joint angles (n, nj) with the flange at pos, rot; Gauss-Newton from q."""
    for _ in range(20):
        at, turn, _, jac = chain.pose(q, np.zeros_like(q))
        error = np.concatenate([pos - at, rotation_vector(turn, rot)], axis=1)
        q = q + np.einsum("nij,nj->ni", np.linalg.pinv(jac), error)
    return q


class Expert:
    """The scripted expert, its actions of another kind."""

    obs_mode, measured = "state", True

    def __init__(self, kind="offset", dof=("x", "y", "z")):
        config = TaskVec(1, "nominal", dof=dof).config
        self.action, self.task, self.expert, self.config = kind, {"dof": dof}, Scripted(config), config
        self.chain, self.tip, self.joints = arm_of(config)

    def reset(self, n, rows=None):
        self.expert.reset(n, rows)

    def act(self, obs):
        offset, q = self.expert.act(obs).astype(float), obs["measured"][:, : len(self.joints)].astype(float)
        return stated(self.action, offset, q, self.config, self.chain, self.tip)


def stated(kind, offset, q, config, chain, tip):
    """The same action in another kind; the target that it asks for is the observer's own."""
    o = Observer(config, chain, tip, np.zeros(3), 0, len(q))
    o.see(q, np.zeros_like(q))
    o.begin(np.arange(len(q)), o.flange)
    o.hold(*o.offset_by(o.asked(offset)))
    place = o.held if o.turns else o.goal - [0, 0, tip]
    pose, step = np.concatenate([place, o.rot], axis=1), (place - o.tip())
    if kind == "offset":
        return offset
    if kind == "tip_goal":
        return pose if o.turns else place
    if kind == "tip_delta":
        turn = rotation_vector(o.straight, o.rot) - rotation_vector(o.straight, o.turn)
        return np.concatenate([step, turn], axis=1) if o.turns else step
    goal = reached(chain, q, o.goal, o.rot)
    return goal if kind == "joint_goal" else goal - q


@pytest.mark.parametrize("kind", SI)
@pytest.mark.parametrize("dof", [("x", "y", "z"), ("x", "z"), ("x", "y", "z", "rx", "ry", "rz")])
def test_an_action_of_any_kind_is_the_offset_that_asks_for_the_same_pose(kind, dof):
    """The target of an offset, said as a pose or in joints by an inverse kinematics of its own, gives the offset."""
    config = PegConfig(name="peg", dof=dof)
    chain, tip, joints = arm_of(config)
    rng = np.random.default_rng(0)
    home = np.array([0.0, 0.6, 0.0, -1.6, 0.0, 0.9, 0.0])
    q = reached(chain, home + rng.uniform(-0.1, 0.1, (20, 7)), rng.uniform(-0.05, 0.05, (20, 3)) + [0.6, 0, 0.3], DOWN)
    q += rng.normal(0, 0.01, q.shape)  # as an arm stands: not straight down
    offset = rng.uniform(-1, 1, (20, len(dof)))
    actions = Actions(kind, config, chain, tip, joints)
    got = actions.offset(stated(kind, offset, q, config, chain, tip), actions.seen(q))
    np.testing.assert_allclose(got, offset, atol=1e-7)


DOWN = np.tile([0.0, 1.0, 0.0, 0.0], (20, 1))


@pytest.mark.parametrize("dof", [("x", "y", "z"), ("x", "y", "z", "rx", "ry")])
def test_the_expert_moves_the_arm_to_the_same_places_in_every_kind(dof):
    """Within 1 um at each step before contact, by readings in float32; and no action of it is cut. (In a world whose
    encoders count in steps, such as S, the same rounding becomes a step now and then: 30 um.)
    """
    paths = {}
    for kind in KINDS:
        env = TaskVec(2, "nominal", "state", privileged=True, measured=True, autoreset_mode="Disabled", dof=dof)
        policy = player(entrant_of(Expert(kind, dof)), env.config)
        obs, paths[kind] = env.reset(seed=[3, 4])[0], []
        policy.reset(2)
        for _ in range(8):
            obs = env.step(policy.act(obs))[0]
            paths[kind].append(env.sim.seen.tip().copy())
        assert not env.sim.seen.clipped.any()
        env.close()
    moved = np.ptp(paths["offset"], axis=0).max()
    assert moved > 0.01
    for kind in SI:
        np.testing.assert_allclose(paths[kind], paths["offset"], atol=1e-6)


def entrant_of(policy):
    from vispeg.evaluation.entrants import entrants

    return entrants(policy)[0]


def test_episodes_are_the_same_and_what_is_cut_is_said():
    """To their ends, in every kind; a policy that asks for twice as far is cut, and its page and episodes say so."""
    told = [vispeg.evaluate({"mine": Expert(kind)}, "nominal", episodes=2) for kind in ("offset", *SI)]
    for result in told:
        assert [e.category for e in result.episodes] == ["success"] * 2 and all(e.clipped == 0 for e in result.episodes)
        assert [e.time for e in result.episodes] == [e.time for e in told[0].episodes]
        assert not [note for note in result.record["notes"] if "more than the controller takes" in note]

    class Far(Expert):
        def act(self, obs):
            return np.tile([0.0, 0.0, -0.02], (len(obs["policy"]), 1))

    result = vispeg.evaluate({"far": Far("tip_delta")}, "nominal", episodes=1, task={"steps": 4})
    assert result.episodes[0].clipped == 1
    said = "far asked for more than the controller takes in 100.0% of an episode's steps"
    assert said in result.record["notes"]


CODE = """
import numpy as np

class Sink:
    obs_mode, action = "state", "tip_delta"
    task = {"name": "peg", "stack": 2}

    def act(self, obs):
        return -0.2 * 0.03 * obs["policy"][:, :3]

def degrees(obs):
    return np.full((len(obs["policy"]), 7), 40.0)

def still(obs):
    return np.zeros((len(obs["policy"]), 7))
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    (tmp_path / "acting_policy_of_test.py").write_text(CODE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.chdir(tmp_path)


def exported(file, kind, width=3):
    """The same as `Sink` in ONNX."""
    meaning = interface_of_policy(load("state-3mm")).model_copy(update={"action": kind})
    size = meaning.stack * sum(t.size for t in meaning.told)
    weight = np.zeros((size, width), np.float32)
    weight[:3, :3] = -0.2 * 0.03 * np.eye(3)
    shape = {name: helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", k]) for name, k in SIZES(size, width)}
    node = helper.make_node("MatMul", ["policy", "weight"], ["action"])
    constant = helper.make_tensor("weight", TensorProto.FLOAT, weight.shape, weight.ravel())
    graph = helper.make_graph([node], "sink", [shape["policy"]], [shape["action"]], [constant])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, {KEY: meaning.text()})
    onnx.save(model, file)
    return str(file)


def SIZES(size, width):
    return (("policy", size), ("action", width))


def test_an_onnx_file_that_states_its_kind_does_what_the_python_object_does(module, tmp_path):
    """In an evaluation, step by step off the simulator, and on a robot."""
    file = exported(tmp_path / "sink.onnx", "tip_delta")
    both = {"a": file, "b": "acting_policy_of_test:Sink"}
    result = vispeg.evaluate(both, "nominal", episodes=2, task={"steps": 12})
    first, second = ([e for e in result.episodes if e.policy == name] for name in both)
    for a, b in zip(first, second, strict=True):
        assert (a.seed, a.category, a.time) == (b.seed, b.category, b.time)
        assert a.lateral_error == pytest.approx(b.lateral_error, abs=2e-5)
    policy, who = Exported(file), entrant("acting_policy_of_test:Sink")
    env = TaskVec(1, "nominal", "state", measured=True)
    obs, _ = env.reset(seed=3)
    offset = policy.act(obs)
    np.testing.assert_allclose(offset, player(who, env.config).act(obs), atol=1e-5)
    builder, q = Builder(policy.interface), env.sim.seen.measured[0][0]
    builder.begin(q, np.zeros(7), env.sim.seen.believed[0])
    seen = builder.observe(q, np.zeros(7))
    target = builder.act(policy.act(seen))
    asked = env.sim.seen.flange[0] - 0.2 * 0.03 * seen["policy"][0, :3]
    np.testing.assert_allclose(target[:3], asked, atol=1e-6)
    run = ["run", file, "--robot", "sim:nominal", "--seed", "3", "--quiet", "--out", str(tmp_path / "trials")]
    assert main(run) == 0
    (folder,) = folders(tmp_path / "trials")
    steps = read_trial(folder).steps
    np.testing.assert_allclose(steps.action[:, :3], -0.2 * 3 * steps.seen[:, :3], atol=1e-3)  # of 10 mm a step


def test_what_means_nothing_is_one_line(module, tmp_path, capsys):
    """Kinds that there are not, widths that a kind has not, kinds of policies that state their own."""
    cases = {
        "acting_policy_of_test:Sink?action=knees": "no such kind of action",
        "acting_policy_of_test:still": "gives no actions; expected finite numbers of shape (2, 3)",
        "acting_policy_of_test:still?action=tip_goal": "a quaternion of length 0",
        "acting_policy_of_test:degrees?action=joint_goal": "angles of more than two turns; expected rad",
        "acting_policy_of_test:Sink?action=joint_goal": "expected finite numbers of shape (2, 7)",
        f"{exported(tmp_path / 'a.onnx', 'knees')}": "unknown kind 'knees'",
        f"{exported(tmp_path / 'b.onnx', 'joint_goal')}": "no joint_goal; expected 7 numbers: angles of the joints",
        f"{exported(tmp_path / 'c.onnx', 'tip_delta')}?action=tip_goal": "is stated by the exported policy itself",
        "state-3mm?action=tip_goal": "only for a policy of your own",
    }
    for policy, said in cases.items():
        argv = ["evaluate", policy, "--world", "nominal", "--episodes", "1", "--videos", "0", "--out", "out"]
        status = main([*argv, "--quiet"])
        err = capsys.readouterr().err.strip()
        assert status == 2 and said in err and "\n" not in err, (policy, err)
        assert not (tmp_path / "out" / "evaluate.json").exists()


def test_names_of_an_action_say_what_it_is():
    """In any order, with a gripper behind them, or by LeRobot's own names of motors."""
    config = PegConfig(name="peg")
    arm = config, *arm_of(config)
    joints = arm[-1]
    shuffled = [f"{name}.pos" for name in (*joints[::-1], "gripper")]
    actions = Actions(None, *arm, names=shuffled, width=8)
    plain = Actions("joint_goal", *arm)
    q, goal = np.zeros((1, 7)), np.linspace(-0.1, 0.1, 7)[None]
    assert actions.kind == "joint_goal"
    given = np.concatenate([goal[:, ::-1], [[5.0]]], axis=1)
    np.testing.assert_array_equal(actions.offset(given, plain.seen(q)), plain.offset(goal, plain.seen(q)))
    assert Actions(None, *arm, names=[f"motor_{i}.pos" for i in range(7)], width=7).kind == "joint_goal"
    assert Actions(None, *arm, names=("tip_x", "tip_y", "tip_z"), width=3).kind == "tip_goal"
    assert Actions(None, *arm, names=("x", "y", "z"), width=3).kind == Actions(None, *arm, width=3).kind == "offset"
    for told in ({"width": 7}, {"names": ("a", "b", "c"), "width": 3}):
        with pytest.raises(UserError, match="the meaning of its actions is not stated"):
            Actions(None, *arm, **told)
