"""The environments: checkers, equality of one and many, seeds, episodes that begin anew row by row."""

import json
import pickle

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vispeg
from vispeg.core.effect import EffectInstance
from vispeg.core.errors import UserError
from vispeg.render.backends.backend import Renderer
from vispeg.sim.compiled import compiled
from vispeg.task.environments.replay import replay
from vispeg.task.environments.vector import episode_seed
from vispeg.task.peg.task import PegInHoleVec
from vispeg.task.start import Start
from vispeg.worlds.distribution import Uniform
from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld
from vispeg.worlds.world import World

VARIED = RandomizedWorld(
    ranges=(
        RandomizedEffect("command_delay", "all", {"delay": Uniform(0.0, 0.02)}),
        RandomizedEffect("viscous_friction", "each", {"damping": Uniform(0.0, 1.0)}),
        RandomizedEffect("hysteresis", "joint4", {"torque": Uniform(0.0, 0.5), "stiffness": 100.0}),
        RandomizedEffect("coulomb_friction", "each", {"torque": Uniform(0.0, 0.3)}),
        RandomizedEffect("link_mass", "link7", {"mass": Uniform(-0.1, 0.3)}),
        RandomizedEffect("hole_offset", "fixture", {"x": Uniform(-0.03, 0.03)}),
        RandomizedEffect("goal_imprecision", "hole", {"x": Uniform(-0.002, 0.002)}),
        RandomizedEffect("encoder_noise", "all", {"sd": Uniform(0.0, 0.001)}, chance=0.5),
    )
)


def actions(n, steps, seed=0):
    """Downward leaning random actions (steps, n, 3)."""
    out = np.random.default_rng(seed).uniform(-1, 1, (steps, n, 3))
    out[..., 2] -= 0.3
    return np.clip(out, -1, 1)


def test_gymnasium_and_sb3_accept_it():
    """Both checkers, by the registered name."""
    env = gym.make("vispeg:PegInHole-v0", world="nominal", steps=5)
    check_env(env.unwrapped, skip_render_check=True)
    sb3 = pytest.importorskip("stable_baselines3.common.env_checker")
    sb3.check_env(env.unwrapped)


@pytest.mark.parametrize("world", [World(), VARIED], ids=["nominal", "varied"])
def test_one_environment_is_a_row_of_many_bit_by_bit(world):
    """Over several episodes, with rows that begin anew at different times."""
    many, one = PegInHoleVec(3, world=world, steps=6), PegInHoleVec(1, world=world, steps=6)
    a, _ = many.reset(seed=4)
    b, _ = one.reset(seed=5)
    for action in actions(3, 20):
        for key in a:
            assert np.array_equal(a[key][1], b[key][0]), key
        a, r, te, tr, _ = many.step(action)
        b, s, ue, ur, _ = one.step(action[1:2])
        assert r[1] == s[0] and te[1] == ue[0] and tr[1] == ur[0]


@pytest.mark.parametrize(
    "world", [VARIED, "randomized", "noisy-encoders", "P"], ids=["varied", "randomized", "noisy-encoders", "P"]
)
def test_a_row_that_begins_anew_leaves_the_others_as_they_were(world):
    n, seeds = 4, [11, 12, 13, 14]
    quiet, busy = (PegInHoleVec(n, world=world, autoreset_mode="Disabled") for _ in range(2))
    for env in (quiet, busy):
        env.reset(seed=seeds)
    for k, action in enumerate(actions(n, 6)):
        if k in (2, 4):
            busy.reset(seed=[99 + k] * n, options={"reset_mask": np.arange(n) == 1})
        a, r, *_ = quiet.step(action)
        b, s, *_ = busy.step(action)
        others = np.arange(n) != 1
        assert np.array_equal(r[others], s[others])
        for key in a:
            assert np.array_equal(a[key][others], b[key][others]), key
        assert k < 2 or not np.array_equal(a["policy"][1], b["policy"][1])


def test_the_seed_decides_everything():
    """Same seed same episode, another seed another one; later episodes have seeds of their own."""
    env = gym.make("vispeg:PegInHole-v0", world=VARIED)
    runs = []
    for seed in (1, 1, 2):
        first, _ = env.reset(seed=seed)
        runs.append([first["policy"], *(env.step(a[0])[0]["policy"] for a in actions(1, 4))])
    assert all(np.array_equal(x, y) for x, y in zip(runs[0], runs[1], strict=True))
    assert not np.array_equal(runs[0][0], runs[2][0])
    assert episode_seed(3, 0) == 3 and len({episode_seed(3, k) for k in range(50)}) == 50
    _, info = env.reset()
    assert info["seed"] != 2 and 0 < info["world"]["command_delay(all)"]["delay"] <= 0.02


@pytest.mark.parametrize("made", [gym.make, gym.make_vec], ids=["one", "many"])
def test_it_travels_through_pickle(made):
    """As it was made, not as it stands."""
    env = made("vispeg:PegInHole-v0", world=VARIED, steps=7).unwrapped
    again = pickle.loads(pickle.dumps(env))
    (a, told), (b, same) = env.reset(seed=8), again.reset(seed=8)
    assert all(np.array_equal(a[k], b[k]) for k in a)
    assert again.observation_space == env.observation_space and str(told) == str(same)


def test_make_vec_is_gymnasiums_own_vector_of_single_ones_bit_by_bit():
    """Observations, rewards and ends, over episodes that end at different times, as gymnasium begins them anew."""
    one_by_one, batch = (
        gym.make_vec("vispeg:PegInHole-v0", 3, mode, world=VARIED, steps=5, force_abort=4.0, start_height=(0.002, 0.02))
        for mode in ("sync", "vector_entry_point")
    )
    assert batch.single_observation_space == one_by_one.single_observation_space
    assert batch.action_space == one_by_one.action_space and batch.metadata["autoreset_mode"].name == "NEXT_STEP"
    a, b = (env.reset(seed=3)[0] for env in (one_by_one, batch))
    ends = set()
    for k, action in enumerate(actions(3, 16, seed=2).astype(np.float32) - [0.0, 0.0, 0.4]):
        assert all(np.array_equal(a[key], b[key]) for key in b), k
        assert batch.observation_space.contains(b)
        a, *rest, _ = one_by_one.step(action)
        b, *same, _ = batch.step(action)
        assert all(np.array_equal(x, y) for x, y in zip(rest, same, strict=True)), k
        ends |= {(k, row) for row in np.flatnonzero(same[1] | same[2])}
    assert len({k for k, _ in ends}) > 3 and len(ends) > 5


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_autoreset_follows_gymnasium(mode):
    """After an end the row's next observation is a start; SAME_STEP hands out the end's observation beside it."""
    env = PegInHoleVec(2, world="nominal", steps=3, autoreset_mode=mode, privileged=True)
    start, _ = env.reset(seed=0)
    for _ in range(3):
        obs, _, _, truncated, info = env.step(np.zeros((2, 3)))
    assert truncated.all() and set(info["category"]) == {"approach"}
    if mode == "SameStep":
        assert np.abs(info["final_obs"]["privileged"] - obs["privileged"]).max() > 0.1
        assert env.sim.count.tolist() == [0, 0]
    else:
        assert env.sim.count.tolist() == [3, 3]
        obs, reward, _, truncated, _ = env.step(np.ones((2, 3)))
        assert env.sim.count.tolist() == [0, 0] and not truncated.any() and not reward.any()
    assert not np.array_equal(obs["policy"], start["policy"])


def test_records_tell_how_it_went():
    """Category, profile at every control tick, drawn world, seed: enough to play the episode again."""
    env = PegInHoleVec(1, world=VARIED, steps=4, autoreset_mode="SameStep")
    env.reset(seed=21)
    profiles = []
    for _ in range(2):
        env.reset(seed=21)
        for action in actions(1, 4):
            info = env.step(action)[4]
            if "_record" in info:
                record = info["record"][0]
                break
        profiles.append(record["force_profile"])
    assert record["seed"] == 21 and len(profiles[0]) % env.config.ticks == 0
    assert record["world"]["command_delay(all)"]["delay"] > 0
    assert np.array_equal(*profiles)


def test_a_policy_without_a_target_sees_nothing_of_the_hole():
    """Two holes 50 mm apart look the same to a blind policy, not to one that is told, and the critic knows."""
    shifted = [
        RandomizedWorld(ranges=(RandomizedEffect("hole_offset", "fixture", {"x": x}),)) for x in (-0.025, 0.025)
    ]  # fixed numbers: drawn the same for every seed
    told = {"privileged": True}
    seen = {
        m: [PegInHoleVec(1, world=w, obs_mode=m, **told).reset(seed=3)[0] for w in shifted]
        for m in ("proprio", "state")
    }
    assert np.array_equal(seen["proprio"][0]["policy"], seen["proprio"][1]["policy"])
    assert np.abs(seen["state"][0]["policy"] - seen["state"][1]["policy"]).max() > 1.0
    for a, b in seen.values():
        assert np.abs(a["privileged"] - b["privileged"]).max() > 1.0


def test_a_diverged_row_ends_alone():
    """NaN ends its episode with its category; its neighbour goes on as if nothing had happened."""
    env, calm = (PegInHoleVec(2, world="nominal", autoreset_mode="SameStep") for _ in range(2))
    env.reset(seed=0)
    calm.reset(seed=0)
    env.sim.cell.qvel[0, 3] = np.nan
    obs, reward, terminated, _, info = env.step(np.zeros((2, 3)))
    other, _, _, _, _ = calm.step(np.zeros((2, 3)))
    assert terminated.tolist() == [True, False] and info["category"][0] == "diverged"
    assert np.isfinite(reward).all() and all(np.isfinite(v).all() for v in obs.values())
    assert all(np.isfinite(v).all() for v in info["final_obs"].values())
    assert all(np.array_equal(obs[k][1], other[k][1]) for k in obs)


@pytest.mark.parametrize("world", [VARIED, "randomized"], ids=["varied", "randomized"])
def test_what_a_diverged_episode_leaves_plays_it_again_bit_by_bit(world, tmp_path):
    env = PegInHoleVec(3, world=world, autoreset_mode="Disabled", dump=tmp_path, clearance_mm=2.0, start_radius=0.01)
    env.set_level(0.7)
    env.reset(seed=[21, 22, 23])
    env.push([1], [30.0, 0.0, 0.0], 0.2, 0.2)
    given = actions(3, 5)
    for action in given[:4]:
        env.step(action)
    before = env.sim.cell.qpos[1].copy(), env.sim.cell.qvel[1].copy()
    env.sim.cell.qvel[1, 3] = np.nan
    *_, infos = env.step(given[4])
    assert infos["record"][1]["replay"] == str(tmp_path / "22") and [p.name for p in tmp_path.iterdir()] == ["22"]
    again, last = replay(tmp_path / "22")
    assert np.array_equal(again.sim.cell.qpos[0], before[0]) and np.array_equal(again.sim.cell.qvel[0], before[1])
    assert np.array_equal(last[0], np.clip(given[4][1], -1, 1))
    again.step(last)  # without the fault that was planted above
    assert not again.sim.diverged[0]
    (tmp_path / "22" / "episode.json").write_text("{}")
    with pytest.raises(UserError, match="episode.json: format: unknown format"):
        replay(tmp_path / "22")


def test_a_diverged_episode_that_began_in_a_stated_state_is_played_again_bit_by_bit(tmp_path):
    env = PegInHoleVec(2, world=VARIED, autoreset_mode="Disabled", dump=tmp_path)
    posture = env.sim.home[0] + [0.02, -0.01, 0.0, 0.03, 0.0, 0.01, 0.2]
    goal, told = (np.array(env.sim.scene.target) + d for d in ([0.004, 0.0, 0.0], [0.0, -0.002, 0.0]))
    bias = EffectInstance.of("joint_bias", "joint4", torque=1.0)
    start = Start(q=posture, goal=goal, believed=told, effects=(bias,))
    env.reset(seed=[21, 22], options={"start": [None, start]})
    env.disturb(1, np.random.default_rng(0).normal(0, 2.0, (7, 7)))
    given = actions(2, 4)
    for action in given[:3]:
        env.step(action)
    before = env.sim.cell.qpos[1].copy(), env.sim.observation()["policy"][1]
    env.sim.cell.qvel[1, 3] = np.nan
    env.step(given[3])
    again, _ = replay(tmp_path / "22")
    assert np.array_equal(again.sim.cell.qpos[0], before[0])
    assert np.array_equal(again.sim.observation()["policy"][0], before[1])


def test_a_diverged_episode_is_saved_once_though_its_row_waits_a_step_for_the_next(tmp_path):
    env = PegInHoleVec(2, world="nominal", dump=tmp_path)
    env.reset(seed=[21, 22])
    env.sim.cell.qvel[1, 3] = np.nan
    for action in actions(2, 3):
        env.step(action)
    saved = json.loads((tmp_path / "22" / "episode.json").read_text())
    assert len(saved["actions"]) == 1 and [p.name for p in tmp_path.iterdir()] == ["22"]


def test_seeds_are_one_for_each_row_in_any_sequence():
    env = PegInHoleVec(2, world=VARIED, autoreset_mode="Disabled")
    for seed in ([5, 6], (5, 6), np.array([5, 6]), np.array([5, 6], np.int32), 5, np.int64(5)):
        assert env.reset(seed=seed)[1]["seed"].tolist() == [5, 6]
        env.reset(seed=[50, 60])
    assert env.reset(seed=[5, None])[1]["seed"].tolist() == [5, episode_seed(60, 1)]
    for wrong in ([5], [5, 6, 7], "56", 1.5, np.array([0.5, 1.5])):
        with pytest.raises(UserError, match="seed: not seeds; expected an integer, or 2 of them"):
            env.reset(seed=wrong)


def test_a_rows_first_episode_is_its_first_seeds_whenever_it_begins():
    one, both = (PegInHoleVec(2, world="nominal", seed=10, autoreset_mode="Disabled") for _ in range(2))
    for k in range(2):
        seeds = one.reset(options={"reset_mask": np.arange(2) == k})[1]["seed"]
    assert seeds.tolist() == both.reset()[1]["seed"].tolist() == [10, 11]


def test_an_ended_row_that_waits_for_its_reset_has_one_record():
    env = PegInHoleVec(2, world="nominal", steps=2, autoreset_mode="Disabled")
    env.reset(seed=0)
    records = [env.step(np.zeros((2, 3)))[4].get("record") for _ in range(4)]
    assert [r is not None for r in records] == [False, True, False, False]
    env.reset(options={"reset_mask": [True, False]})
    again = [env.step(np.zeros((2, 3)))[4] for _ in range(3)]
    assert [i["_record"].tolist() if "record" in i else None for i in again] == [None, [True, False], None]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda env: env.step(np.zeros((2, 4))), r"actions: not actions; expected shape \(2, 3\); got \(2, 4\)"),
        (lambda env: env.step(np.zeros(6)), r"actions: not actions; expected shape \(2, 3\); got \(6,\)"),
        (lambda env: env.step([[0, 0, 0], [0, np.nan, 0]]), r"actions\[1\]: not finite; expected -1 to 1"),
        (lambda env: env.reset(options={"reset_mask": [True]}), "options.reset_mask: not a mask; expected 2 of"),
        (lambda env: env.reset(options={"reset_mask": [True] * 3}), "options.reset_mask: not a mask"),
        (lambda env: env.reset(options={"reset_mask": [0, 1]}), "options.reset_mask: not a mask"),
        (lambda env: env.reset(options={"mask": [True, True]}), "options: unknown option; got 'mask'.*reset_mask"),
        (lambda env: env.reset(seed=5, options={"start": "home"}), "options.start: not a start"),
        (lambda env: env.set_level(7.0), "level: impossible level; expected 0 to 1; got 7"),
        (lambda env: env.set_level({"encoder_noise(all)": -1.0}), r"encoder_noise\(all\): impossible level"),
        (lambda env: env.push([5], [1, 0, 0], 0, 1), "row: no such row; expected 0 to 1; got 5"),
        (lambda env: env.push([0], [1, 0], 0, 1), "force: not a force"),
        (lambda env: env.disturb(2, np.zeros((1, 7))), "row: no such row"),
        (lambda env: env.disturb(0, np.zeros(7)), r"torque: not torques; expected shape \(k, 7\)"),
    ],
)
def test_a_wrong_call_is_one_line_and_changes_nothing(wrong, words):
    env, other = (PegInHoleVec(2, world=VARIED, autoreset_mode="Disabled") for _ in range(2))
    for each in (env, other):
        each.reset(seed=3)
    with pytest.raises(UserError, match=words):
        wrong(env)
    for action in actions(2, 2):
        assert np.array_equal(env.step(action)[0]["policy"], other.step(action)[0]["policy"])
    again, same = env.reset(), other.reset()
    assert (
        np.array_equal(again[0]["policy"], same[0]["policy"]) and again[1]["seed"].tolist() == same[1]["seed"].tolist()
    )


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"modality": "depth"}, "no such setting of the task; got 'modality' (did you mean 'obs_mode'?)"),
        ({"clearance": 1.0}, "did you mean 'clearance_mm'?"),
        ({"n_envs": 4}, "did you mean 'num_envs'?"),
        ({"clearance_mm": "1"}, "clearance_mm: wrong type; expected a number"),
        ({"clearance_mm": -1.0}, "clearance_mm: impossible geometry; expected above 0 to 20 mm; got -1"),
        ({"mesh_concavity": 0.005}, "mesh_concavity: impossible geometry; expected 0.01 to 1; got 0.005"),
        ({"chamfer": -1e-10}, "chamfer: impossible geometry; expected 0 to 0.01 m; got -1e-10"),
        ({"start_height": [0.5, 0.6]}, "start_height: impossible start"),
        ({"obs_mode": "dpeth"}, "did you mean 'depth'?"),
        ({"autoreset_mode": "samestep"}, "did you mean 'SameStep'?"),
        ({"render_mode": "human"}, "choices: rgb_array"),
    ],
)
def test_a_wrong_argument_is_named_with_what_was_meant_and_no_file_is_blamed_that_the_caller_did_not_write(
    given, words
):
    with pytest.raises(UserError) as error:
        gym.make("vispeg:PegInHole-v0", **given) if "modality" in given else PegInHoleVec(2, **given)
    assert words in str(error.value) and ".yaml" not in str(error.value)
    assert "/" not in str(error.value), "no file, so no path"


def test_every_other_name_for_a_setting_leads_to_one_that_there_is():
    import inspect

    from vispeg.task.environments.vector import MEANT
    from vispeg.task.peg.config import PegConfig

    known = {*inspect.signature(PegInHoleVec.__init__).parameters, *PegConfig.__dataclass_fields__}
    assert set(MEANT.values()) <= known and not set(MEANT) & known


def test_a_mistake_in_a_world_file_still_names_the_file(tmp_path):
    (tmp_path / "w.yaml").write_text("format: vispeg-world/1\ntask: {clearance_mm: -1.0}\n")
    with pytest.raises(UserError, match=r"w\.yaml: .*clearance_mm"):
        PegInHoleVec(2, world=tmp_path / "w.yaml", steps=5)


def test_pictures_show_parts_where_their_springs_let_them():
    """A renderer's model lacks the springs' joints; in contact it put the parts 0.8 mm aside."""
    soft = World().add(
        EffectInstance.of("fixture_compliance", "fixture", x=5e-4, z=5e-4, roll=0.01, pitch=0.01),
        EffectInstance.of("peg_grasp_compliance", "peg", x=5e-4, y=5e-4, roll=0.02, pitch=0.02),
        EffectInstance.of("gripper_slip", "peg", grip=0.3),
    )
    env = PegInHoleVec(1, RandomizedWorld(base=soft))
    env.reset(seed=[1])
    scene, cell = env.sim.scene, env.sim.cell
    deflected = []
    with Renderer(scene, (), "raycast") as renderer:
        for action in actions(1, 40, 5):
            env.step(action)
            cell.batch.forward()  # sites of the present joints
            state = env.sim.snapshot(0)
            renderer.render(state.qpos, state.bodies)
            for site, name in ((scene.tip_site, "tip"), (scene.goal, "goal")):
                drawn = renderer.data.site(site)
                np.testing.assert_allclose(drawn.xpos, cell.site_position(name)[0], atol=1e-9)
                np.testing.assert_allclose(drawn.xmat.reshape(3, 3), cell.site_rotation(name)[0], atol=1e-9)
            deflected.append(np.abs(cell.qpos[0, compiled(scene).nq :]).max())
    assert max(deflected) > 3e-4, "it was pressed"


def test_the_ground_truth_is_only_there_where_it_is_asked_for():
    """By every way to make an environment: an actor of somebody's algorithm reads whatever key there is."""
    plain = gym.make("vispeg:PegInHole-v0", world="nominal")
    assert set(plain.observation_space.spaces) == {"policy"} and set(plain.reset(seed=0)[0]) == {"policy"}
    for env in (vispeg.make("nominal", privileged=True), vispeg.make_vec(2, "nominal", privileged=True)):
        first, told = env.reset(seed=0)[0], env.step(env.action_space.sample())[0]
        assert set(first) == set(told) == set(env.observation_space.spaces) == {"policy", "privileged"}


def test_environments_without_a_seed_play_episodes_of_their_own():
    """As gymnasium's do, and the info tells the seed by which one is played again."""
    seeds, first = [], []
    for _ in range(3):
        env = vispeg.make("S", "state")
        obs, info = env.reset()
        seeds.append(info["seed"])
        first.append(obs["policy"])
    assert len(set(seeds)) == 3 and not np.array_equal(first[0], first[1])
    again = vispeg.make("S", "state").reset(seed=seeds[1])[0]["policy"]
    assert np.array_equal(again, first[1])
    rows = gym.vector.SyncVectorEnv([lambda: vispeg.make("nominal")] * 3)
    assert len(set(rows.reset()[1]["seed"].tolist())) == 3
