"""What every task promises. For a task of your own, copy this file and name worlds of it in WORLDS."""

from pathlib import Path

import numpy as np
import pytest

from vispeg.core.seeds import stream
from vispeg.task.environments.vector import TaskVec
from vispeg.task.standard_terms import TIP_IN_GOAL
from vispeg.task.world_file import load_world, world_text

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "snap_fit"
WORLDS = ("randomized", EXAMPLE / "snap-varied.yaml")


@pytest.fixture(params=WORLDS, ids=lambda world: Path(world).stem)
def world(request, monkeypatch):
    """Each world, with the folder of its file on the path, where its task's module is."""
    if isinstance(request.param, Path):
        monkeypatch.syspath_prepend(str(request.param.parent))
    return request.param


def made(world, mode="state", rows=2, **settings):
    return TaskVec(rows, world, mode, autoreset_mode="Disabled", privileged=True, **settings)


def test_what_is_observed_is_what_its_terms_say(world):
    """Each term stands where the table says, in its scale, and the space holds them all."""
    env = made(world)
    obs, _ = env.reset(seed=3)
    for k in range(3):
        obs = env.step(np.full((2, len(env.config.dof)), 0.2 * k))[0]
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
            *out, info = env.step(rng.uniform(-1, 1, (2, len(env.config.dof))))
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
    bonus = env.config.rewards.of(env.config.reward).success
    assert all(g > 0.8 * bonus for g, e in zip(gains, ends, strict=True) if e == "success"), "it is in the last reward"


def test_a_teacher_is_shown_what_a_state_policy_would_see(world):
    """Whoever believes another place of the goal, and is shown his mistake, sees as one who is told the truth."""
    pytest.importorskip("torch")
    from vispeg.learn.teacher import knowing

    told, blind = made(world, "state"), made(world, "proprio")
    a, b = (env.reset(seed=4)[0] for env in (told, blind))
    table = told.observed
    if not {"tip", "mistake", "goal_away"} <= {term.name for term in table.terms}:
        pytest.skip("`--recipe distill` needs these terms")
    belief = table.term("mistake")
    mistake = belief.scale * a["privileged"][:, table["mistake"]] / table.term("tip").scale
    expected = a["policy"].reshape(2, -1, table.policy_size).copy()
    expected[:, :, table["tip"]] += mistake[:, None]
    shown = knowing(b, table)
    np.testing.assert_allclose(shown["policy"].reshape(expected.shape), expected, atol=2e-5)
    assert not shown["privileged"][:, table["mistake"]].any()
    np.testing.assert_allclose(knowing(a, table)["policy"].reshape(expected.shape), expected, atol=2e-5)


def test_a_world_is_known_again_from_its_own_text(world, tmp_path):
    file = load_world(world)
    (tmp_path / "again.yaml").write_text(world_text(file), encoding="utf-8")
    assert load_world(tmp_path / "again.yaml").hash == file.hash
