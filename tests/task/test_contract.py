"""Every task keeps the contract: the package's own, and one of a user's own that the package knows nothing of."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.task.environments.vector import TaskVec
from vispeg.task.registry import config_of, task, task_of
from vispeg.task.standard_terms import TIP_IN_GOAL
from vispeg.task.terms import Observation
from vispeg.task.world_file import load_world, world_text

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "snap_fit"
WORLDS = ("randomized", str(EXAMPLE / "snap-varied.yaml"))


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    monkeypatch.syspath_prepend(str(EXAMPLE))


@pytest.fixture(params=WORLDS, ids=["peg", "snap_fit"])
def world(request):
    return request.param


def made(world, mode="state", rows=2, **settings):
    return TaskVec(rows, world, mode, autoreset_mode="Disabled", privileged=True, **settings)


def test_what_is_observed_is_what_its_terms_say(world):
    """Each term stands where the table says, in its scale, and the space holds them all."""
    env = made(world)
    obs, _ = env.reset(seed=3)
    for k in range(3):
        obs = env.step(np.full((2, 3), 0.2 * k))[0]
    sim, table = env.sim, env.observed
    assert obs["policy"].shape == (2, env.config.stack * table.policy_size) and obs["privileged"].shape[1] == (
        table.truth_size
    )
    assert table.truth[0] is TIP_IN_GOAL, "what policies that see estimate"
    for group, values in ((table.policy, obs["policy"][:, : table.policy_size]), (table.truth, obs["privileged"])):
        for term in group:
            seen, true = values[:, table[term.name]], term.read(sim.seen if term.to == "policy" else sim) / term.scale
            np.testing.assert_allclose(seen, np.clip(true, -20, 20), atol=1e-6, err_msg=term.name)
            assert term.unit and term.about and term.scale > 0
    assert {i for i in table.for_teachers} == {
        i for t in table.truth if t.to == "teacher" for i in range(table.truth_size)[table[t.name]]
    }


def test_the_same_seed_is_the_same_episode_and_its_end_has_a_category(world):
    played = []
    for _ in range(2):
        env = made(world, steps=12)
        env.reset(seed=5)
        rng, gains, record = stream(1, "actions"), [], None
        while record is None:
            *out, info = env.step(rng.uniform(-1, 1, (2, 3)) - [0, 0, 0.4])
            gains.append(out[1].tolist())
            record = next((r for r in info.get("record", ()) if r is not None), None)
        played.append((gains, record))
        assert record["category"] in env.sim.task.categories
        assert record["success"] == (record["category"] == "success") and record["peak_force"] >= 0
    assert played[0] == played[1]


def test_its_expert_gets_there_and_is_paid_for_it(world):
    env = made(world, rows=4)
    obs, _ = env.reset(seed=2)
    expert = env.sim.task.expert(env.config, 4)
    over, gains = np.zeros(4, bool), np.zeros(4)
    ends = [None] * 4
    while not over.all():
        obs, gain, terminated, truncated, info = env.step(expert.act(obs))
        for i, record in enumerate(info.get("record", ())):
            if record is not None and not over[i]:
                ends[i], gains[i] = record["category"], gain[i]
        over |= terminated | truncated
    assert ends.count("success") >= 3
    assert all(g > 4 for g, e in zip(gains, ends, strict=True) if e == "success"), "the bonus is in the last reward"


def test_a_teacher_is_shown_what_a_state_policy_would_see(world):
    """Whoever believes another place of the goal, and is shown his mistake, sees as one who is told the truth."""
    pytest.importorskip("torch")
    from vispeg.learn.teacher import knowing

    told, blind = made(world, "state"), made(world, "proprio")
    a, b = (env.reset(seed=4)[0] for env in (told, blind))
    table, belief = told.observed, told.observed.term("mistake")
    mistake = belief.scale * a["privileged"][:, table["mistake"]] / table.term("tip").scale
    expected = a["policy"].reshape(2, -1, table.policy_size).copy()
    expected[:, :, table["tip"]] += mistake[:, None]
    shown = knowing(b, table)
    np.testing.assert_allclose(shown["policy"].reshape(expected.shape), expected, atol=2e-5)
    assert not shown["privileged"][:, table["mistake"]].any()
    np.testing.assert_allclose(knowing(a, table)["policy"].reshape(expected.shape), expected, atol=2e-5)


def test_noise_of_a_term_is_white_with_its_standard_deviation_and_follows_the_seed():
    env = made("nominal", rows=64)
    env.reset(seed=0)
    table = Observation(env.sim.task.terms, env.config)
    quiet = table.term("force")
    from dataclasses import replace

    loud = replace(quiet, noise=2.0)
    drawn = table.read(env.sim, [loud]) - table.read(env.sim, [quiet])
    assert np.std(drawn) * quiet.scale == pytest.approx(2.0, rel=4 / np.sqrt(2 * drawn.size))
    np.testing.assert_array_equal(drawn, table.read(env.sim, [loud]) - table.read(env.sim, [quiet]))
    env.sim.count += 1
    assert not np.allclose(drawn, table.read(env.sim, [loud]) - table.read(env.sim, [quiet]))


def test_a_world_of_a_users_own_task_knows_its_task_again_from_its_own_text(tmp_path):
    file = load_world(EXAMPLE / "snap-varied.yaml")
    (tmp_path / "again.yaml").write_text(world_text(file))
    assert load_world(tmp_path / "again.yaml").hash == file.hash != load_world("nominal").hash


def test_its_code_is_in_the_worlds_hash(tmp_path, monkeypatch):
    """Another latch in the same file is another world."""
    text = (EXAMPLE / "snap_fit.py").read_text()
    hashes = []
    for name, own in (("one_fit", text), ("same_fit", text), ("other_fit", text.replace("LIP = 0.016", "LIP = 0.017"))):
        (tmp_path / f"{name}.py").write_text(own)
    (tmp_path / "other_fit.py").write_text(text.replace("0.016, 0.020, 0.006", "0.016, 0.020, 0.005"))
    monkeypatch.syspath_prepend(str(tmp_path))
    from vispeg.task.registry import digest_of

    hashes = [digest_of(f"{name}:SnapFit") for name in ("one_fit", "same_fit", "other_fit")]
    assert hashes[0] == hashes[1] != hashes[2] and digest_of("peg") is None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pge", "no such task.*MODULE:CLASS.*'pge'.*'peg'"),
        ("no_such_module:Task", "no such task.*no_such_module"),
        ("snap_fit:Nothing", "no such task.*Nothing"),
        (".snap_fit:SnapFit", "no such task.*PYTHONPATH"),
        ("snap_fit:SnapConfig", "not a task.*vispeg.task.contract.Task"),
        (3, "task.name: wrong type"),
    ],
)
def test_a_task_that_is_none_is_refused_in_one_line(name, message, tmp_path):
    with pytest.raises(UserError, match=message) as error:
        config_of({"name": name}, "w.yaml")
    assert "\n" not in str(error.value) and "w.yaml" in str(error.value)


def test_settings_of_another_task_are_refused():
    with pytest.raises(UserError, match="task.peg_mesh: unknown key"):
        config_of({"name": "snap_fit:SnapFit", "peg_mesh": "a.stl"}, "w.yaml")
    config = config_of({"name": "snap_fit:SnapFit", "spring": 1000})
    assert task_of(config) is task("snap_fit:SnapFit") and config.spring == 1000


def test_the_latch_takes_the_force_that_its_spring_says_and_springs_back():
    """Held still, the nose pushed back by d carries spring * d; let go, it is out again."""
    import mujoco

    scene = task("snap_fit:SnapFit").cell(config_of({"name": "snap_fit:SnapFit", "spring": 2000.0}))
    model = scene.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    latch = model.joint("latch")
    data.qpos[latch.qposadr[0]] = -0.001
    mujoco.mj_forward(model, data)
    assert data.qfrc_spring[latch.dofadr[0]] == pytest.approx(2000.0 * 0.001)


def test_nothing_in_the_package_knows_the_example():
    package = EXAMPLE.parents[2] / "vispeg"
    assert not [p for p in package.rglob("*.py") if "snap_fit" in p.read_text() or "snap-fit" in p.read_text()]


@pytest.mark.slow
def test_a_policy_is_trained_in_it_by_the_same_command(tmp_path):
    pytest.importorskip("torch")
    small = ["--steps", "160", "--every", "160", "--envs", "8", "--episodes", "4", "--utd", "0.1"]
    command = [sys.executable, "-m", "vispeg", "train", "snap_fit-privileged", "--world", str(EXAMPLE / "snap.yaml")]
    path = {"PYTHONPATH": f"{EXAMPLE}:{EXAMPLE.parents[2]}"}
    import os

    done = subprocess.run(
        [*command, *small, "--out", str(tmp_path / "run")],
        env={**os.environ, **path},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    from vispeg.learn.policy import load

    policy = load(tmp_path / "run" / "checkpoints" / "last")
    assert policy.meta["task"]["name"] == "snap_fit:SnapFit"
    env = made(str(EXAMPLE / "snap.yaml"))
    assert len(policy.layout.reads) == len(env.observed.for_teachers) == 4  # contact force and latch
    policy.reset(2)
    action = policy.act(env.reset(seed=1)[0])
    assert action.shape == (2, 3) and np.isfinite(env.step(action)[1]).all()


@pytest.mark.parametrize("where", ["peg", "each"])
def test_what_was_drawn_is_shown_as_it_was_drawn(where):
    """Whatever place the world draws at: surfaces, the held part and joints that it does not name do not count."""
    from vispeg.task.environments.vector import TaskVec
    from vispeg.worlds.distribution import Uniform
    from vispeg.worlds.randomized import RandomizedEffect, RandomizedWorld

    drawn = {"friction": ("contact_friction", "scale", where), "latency": ("command_delay", "delay", "joint1")}
    world = RandomizedWorld(tuple(RandomizedEffect(e, at, {k: Uniform(0.005, 0.02)}) for e, k, at in drawn.values()))
    env = TaskVec(3, world, privileged=True)
    truth = env.reset(seed=0)[0]["privileged"]
    for term, (name, key, _) in drawn.items():
        for row in range(3):
            values = [v[key] for label, v in env.drawn(row).values.items() if label.startswith(f"{name}(")]
            shown = truth[row, env.observed[term]] * env.observed.term(term).scale
            assert shown == pytest.approx(np.mean(values), rel=1e-5), term
    assert (truth[:, env.observed["mass"]] == 0).all(), "the world draws none"
    env.close()
