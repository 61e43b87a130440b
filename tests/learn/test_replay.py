"""The replay gives back exactly what was lived through, each frame stored once."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from vispeg.core.errors import UserError
from vispeg.core.memory import available
from vispeg.core.seeds import stream
from vispeg.learn.experience.replay import Replay, afford, mixed
from vispeg.render.image_kinds import STEP

SPACE = spaces.Dict(
    {
        "policy": spaces.Box(-9, 9, (2,), np.float32),
        "depth_a": spaces.Box(0, 4, (1, 3, 3), np.float32),
        "rgb_a": spaces.Box(0, 255, (3, 3, 3), np.uint8),
    }
)
ACTION = spaces.Box(-1, 1, (1,), np.float32)
N = 3


def observation(rng, n=N):
    return {
        "policy": rng.standard_normal((n, 2)).astype(np.float32),
        "depth_a": rng.uniform(0, 1, (n, 1, 3, 3)).astype(np.float32),
        "rgb_a": rng.integers(0, 256, (n, 3, 3, 3), dtype=np.uint8),
    }


def live(ring, steps, seed=0, spoil=None, begun=None):
    """Plays random episodes into the ring; returns every transition that must be in it, oldest first, by row.

    Their first observations go into the list `begun`.
    """
    rng, lived = stream(seed, "live"), [[] for _ in range(N)]
    obs, begun = observation(rng), [] if begun is None else begun
    begun += obs["policy"].tolist()
    for k in range(steps):
        after, action = observation(rng), rng.uniform(-1, 1, (N, 1)).astype(np.float32)
        reward, done = rng.standard_normal(N).astype(np.float32), rng.uniform(size=N) < 0.2
        infos = [{"TimeLimit.truncated": bool(rng.uniform() < 0.5)} if d else {} for d in done]
        if spoil is not None and k in spoil:
            reward[spoil[k]] = np.nan
        ring.add(obs, after, action, reward, done, infos)
        for i in range(N):
            cut = infos[i].get("TimeLimit.truncated", False)
            if np.isfinite(reward[i]):
                lived[i].append(
                    (obs["policy"][i], action[i], reward[i], float(done[i] and not cut), after["policy"][i], k)
                )
        fresh = observation(rng)
        begun += fresh["policy"][done].tolist()
        obs = {key: np.where(done.reshape(N, *[1] * (v.ndim - 1)), fresh[key], v) for key, v in after.items()}
    return lived


def all_of(ring):
    at, env = np.nonzero(ring.starts)
    return ring._batch(at, env)


def rows(batch):
    parts = (batch.obs["policy"], batch.action, batch.reward[:, None], batch.done[:, None], batch.next_obs["policy"])
    return {tuple(row) for row in torch.cat(parts, 1).numpy().tolist()}


def as_rows(lived):
    return {tuple(np.hstack(t[:5]).astype(np.float32).tolist()) for one in lived for t in one}


def test_every_transition_is_kept_and_nothing_else_is():
    ring = Replay(400 * N, SPACE, ACTION, n_envs=N)
    lived = live(ring, 100)
    newest = {tuple(np.hstack(t[:5]).astype(np.float32).tolist()) for one in lived for t in one[-1:]}
    kept = rows(all_of(ring))
    assert kept <= as_rows(lived)
    assert as_rows(lived) - kept <= newest  # only the newest of a row may still wait for its successor


def test_a_full_ring_forgets_the_oldest_only():
    ring = Replay(40 * N, SPACE, ACTION, n_envs=N)
    lived = live(ring, 300)
    kept = rows(all_of(ring))
    assert kept <= as_rows(lived)
    oldest = as_rows([[t for t in one if t[5] < 250] for one in lived])
    assert not kept & oldest
    assert len(kept) >= N * 25


def test_frames_take_their_own_room_once():
    ring = Replay(1000, SPACE, ACTION, n_envs=N)
    assert ring.obs["depth_a"].dtype == np.uint16 and ring.obs["rgb_a"].dtype == np.uint8
    assert ring.obs["depth_a"].nbytes == ring.length * N * 9 * 2


def test_depth_is_kept_to_half_a_twentieth_of_a_millimetre_and_no_reading_stays_none():
    ring, rng = Replay(30, SPACE, ACTION, n_envs=N), stream(0, "depth")
    first, second = observation(rng), observation(rng)
    first["depth_a"][0, 0, 0] = [0.0, np.nan, 3.0]
    for obs, after in ((first, second), (second, first)):
        ring.add(obs, after, np.zeros((N, 1)), np.zeros(N), np.zeros(N, bool), [{}] * N)
    back = ring._batch(np.array([0]), np.array([0])).obs["depth_a"][0, 0].numpy()
    assert back[0, 0] == 0.0 and back[0, 1] == 0.0
    expected = np.nan_to_num(first["depth_a"][0, 0])
    assert np.abs(back - expected).max() <= 0.5 * STEP + 1e-6


def test_what_is_not_finite_is_refused_and_its_neighbours_are_kept():
    ring = Replay(400 * N, SPACE, ACTION, n_envs=N)
    lived = live(ring, 50, spoil={10: 1, 20: 2})
    assert ring.refused == 2
    batch = all_of(ring)
    assert torch.isfinite(batch.reward).all()
    assert rows(batch) <= as_rows(lived) and len(ring) >= sum(map(len, lived)) - N


def test_a_step_into_a_diverged_simulation_is_refused_however_its_numbers_look():
    ring, rng = Replay(60, SPACE, ACTION, n_envs=N), stream(0, "diverged")
    infos = [{"category": "diverged"}, {"category": "success"}, {}]
    ring.add(observation(rng), observation(rng), np.zeros((N, 1)), np.zeros(N), np.array([1, 1, 0], bool), infos)
    assert ring.starts.sum(axis=0).tolist() == [0, 1, 0]


def test_an_episode_that_is_not_kept_leaves_no_trace_and_others_stay():
    ring, rng = Replay(60, SPACE, ACTION, n_envs=N), stream(0, "drop")
    for k in range(4):
        ends = np.array([k == 3] * N)
        keep = np.array([True, False, True])
        ring.add(observation(rng), observation(rng), np.zeros((N, 1)), np.zeros(N), ends, [{}] * N, keep)
    assert ring.starts.sum(axis=0).tolist() == [4, 0, 4]


def test_draws_are_uniform_over_transitions():
    ring = Replay(40 * N, SPACE, ACTION, n_envs=N)
    live(ring, 30)
    n, draws = len(ring), 20_000
    found = ring.sample(draws, stream(1, "draws")).obs["policy"].numpy()[:, 0]
    counts = np.unique(found, return_counts=True)[1]
    assert len(counts) == n
    chi2 = ((counts - draws / n) ** 2 / (draws / n)).sum()
    assert chi2 < n + 5 * np.sqrt(2 * n)  # five sigma of a chi-squared variable with n - 1 degrees of freedom


def test_sequences_are_episodes_from_their_beginning_and_weigh_nothing_after_their_end():
    ring = Replay(400 * N, SPACE, ACTION, n_envs=N)
    live(ring, 100)
    batch = ring.sequences(32, 12, stream(0, "sequences"))
    weight = batch.weight.numpy()
    assert weight.shape == (12, 32) and (weight[0] == 1).all()
    assert (np.diff(weight, axis=0) <= 0).all()
    on = (weight[1:] > 0)[..., None]
    first = {tuple(row) for row in ring.obs["policy"][ring.starts & ring.first].tolist()}
    assert {tuple(row) for row in batch.obs["policy"][0].numpy().tolist()} <= first
    assert len(first) < len(ring) / 2
    assert np.array_equal(batch.obs["policy"].numpy()[1:] * on, batch.next_obs["policy"].numpy()[:-1] * on)


@pytest.mark.parametrize(("steps", "spoil"), [(300, {}), (35, {10: 1, 20: 2, 21: 0})])
def test_sequences_begin_where_episodes_do_in_a_full_ring_and_around_refused_steps(steps, spoil):
    ring = Replay(40 * N, SPACE, ACTION, n_envs=N)
    begun: list[list[float]] = []
    live(ring, steps, spoil=spoil, begun=begun)
    firsts = ring.sequences(200, 5, stream(0, "s")).obs["policy"][0].numpy().tolist()
    assert all(first in begun for first in firsts)


def test_saving_keeps_everything(tmp_path):
    ring = Replay(40 * N, SPACE, ACTION, n_envs=N)
    live(ring, 60)
    ring.save(tmp_path)
    other = Replay(40 * N, SPACE, ACTION, n_envs=N)
    other.load(tmp_path)
    first, second = ring.sample(50, stream(3, "x")), other.sample(50, stream(3, "x"))
    for key in SPACE.spaces:
        assert torch.equal(first.obs[key], second.obs[key]) and torch.equal(first.next_obs[key], second.next_obs[key])
    with pytest.raises(UserError, match="another shape"):
        Replay(40 * N, SPACE, spaces.Box(-1, 1, (2,), np.float32), n_envs=N).load(tmp_path)


@pytest.mark.parametrize(("images", "before", "after"), [("before", 1, 0), ("after", 0, 1), ("none", 0, 0)])
def test_only_the_images_that_are_asked_for_are_fetched_and_vectors_always(images, before, after):
    ring = Replay(40 * N, SPACE, ACTION, n_envs=N)
    live(ring, 30)
    some, whole = ring.sample(20, stream(2, "s"), images), ring.sample(20, stream(2, "s"))
    assert ("rgb_a" in some.obs, "depth_a" in some.next_obs) == (bool(before), bool(after))
    for part, full in ((some.obs, whole.obs), (some.next_obs, whole.next_obs)):
        assert all(torch.equal(value, full[key]) for key, value in part.items()) and "policy" in part


def test_nothing_to_draw_is_said():
    with pytest.raises(UserError, match="no transition"):
        Replay(40, SPACE, ACTION, n_envs=N).sample(1)


def test_mixing_appends_along_transitions():
    ring = Replay(400 * N, SPACE, ACTION, n_envs=N)
    live(ring, 100)
    a, b = ring.sequences(4, 5, stream(0, "a")), ring.sequences(3, 5, stream(0, "b"))
    both = mixed(a, b)
    assert both.action.shape == (5, 7, 1)
    assert torch.equal(both.obs["policy"][:, 4:], b.obs["policy"])


def test_the_memory_of_a_ring_is_known_before_it_is_taken(tmp_path):
    """As its arrays have it; above what is free, the number that fits is said."""
    space = spaces.Dict(
        {
            "policy": spaces.Box(-1, 1, (7,), np.float32),
            "depth_a": spaces.Box(0, 4, (1, 9, 8), np.float32),
            "rgb_a": spaces.Box(0, 255, (3, 9, 8), np.uint8),
        }
    )
    action = spaces.Box(-1, 1, (3,), np.float32)
    ring = Replay(40, space, action, n_envs=4)
    held = [*ring.obs.values(), ring.action, ring.reward, ring.done, ring.starts, ring.first]
    need = Replay.size(40, space, action)
    assert need == sum(a.nbytes for a in held)
    (tmp_path / "proc/self").mkdir(parents=True)
    group = tmp_path / "sys/fs/cgroup/box/inner"
    group.mkdir(parents=True)
    (tmp_path / "proc/meminfo").write_text("MemTotal: 9000000 kB\nMemAvailable: 4000 kB\n")
    assert available(tmp_path) == 4000 * 1024
    (tmp_path / "proc/self/cgroup").write_text("0::/box/inner\n")
    (group / "memory.max").write_text("max\n")
    for name, value in (("max", "3000000"), ("current", "2900000"), ("stat", "anon 1\ninactive_file 50000")):
        (group.parent / f"memory.{name}").write_text(value)
    assert available(tmp_path) == 150_000  # of the group above, whose files' pages would go
    assert "iB that are free" in afford(40, space, action, "--replay", "replay")
    many = 2 * 40 * available() // need  # twice what is free
    with pytest.raises(UserError, match=rf"replay: replay of {many} entries: .* free; expected \d+ or less"):
        afford(many, space, action, "--replay", "replay")
