"""Evaluations resume, pair seeds, refuse what would be no evaluation; controls take away what they say."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest

from vispeg.core.errors import UserError
from vispeg.core.seeds import stream
from vispeg.core.workers import one_thread
from vispeg.evaluation.controls import Controlled
from vispeg.evaluation.entrants import entrant, entrants, refuse_trained_on
from vispeg.evaluation.folder import EPISODES
from vispeg.evaluation.jobs import FIRST_SEED, STATE_ROWS, Job, Pushes, Setting, make_jobs, seeds_of
from vispeg.evaluation.overlay import HELD, Change, overlay
from vispeg.evaluation.records import Episode, read
from vispeg.evaluation.runner import each, failures, run
from vispeg.learn.envs import HELD_OUT
from vispeg.task.world_file import load_world, parts


@pytest.fixture
def policy(tmp_path):
    """Writes a policy's folder without weights; nothing here needs them."""

    def write(name, modality="state", seed=0, **meta):
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        layout = {"vector": 30, "images": {}, "action": 3}
        record = {"format": "vispeg-policy/1", "modality": modality, "layout": layout, "meta": {"seed": seed, **meta}}
        (folder / "policy.json").write_text(json.dumps(record))
        return str(folder)

    return write


def coin(job: Job) -> list[Episode]:
    """Succeeds by the toss of a coin that depends on the seed alone."""
    e = job.entrant
    found = []
    for s in job.seeds:
        ok = bool(stream(s, "coin").uniform() < 0.7)
        head = (e.name, e.modality, e.train_seed, job.world_name, job.world_hash, s, ok, "success" if ok else "jam")
        found.append(Episode(*head, time=1.0, control=job.control, configuration=job.configuration))
    return found


def test_a_stopped_run_goes_on_and_ends_as_if_it_had_not_been_stopped(policy, tmp_path):
    who = entrants([policy("a_s0"), policy("b_s0")])
    jobs = make_jobs(who, [Setting("nominal", "S")], range(120), tmp_path)
    whole = run(jobs, tmp_path / "whole", arena=coin)
    calls = []

    def dies(job):
        calls.append(job)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return coin(job)

    with pytest.raises(KeyboardInterrupt):
        run(jobs, tmp_path / "stopped", arena=dies)
    left = len(read(tmp_path / "stopped" / EPISODES))
    assert 0 < left < len(whole)
    played = []
    again = run(jobs, tmp_path / "stopped", arena=lambda job: played.extend(job.seeds) or coin(job))
    assert again == whole and len(played) == len(whole) - left
    assert run(jobs, tmp_path / "stopped", arena=lambda job: pytest.fail("nothing was left to do")) == whole


def test_workers_give_what_one_process_gives(policy, tmp_path):
    jobs = make_jobs(entrants([policy("a_s0")]), [Setting("nominal", "S")], range(100), tmp_path)
    assert len(jobs[0].split(50)) == 2
    import tests.evaluation.fake_arena as fake

    two, one = run(jobs, tmp_path / "two", workers=2, arena=fake.toss), run(jobs, tmp_path / "one", arena=fake.toss)
    assert [e.to_json() for e in two] == [e.to_json() for e in one]


@pytest.mark.slow
def test_a_world_that_filament_draws_is_played_by_processes_that_end_with_their_job(policy, tmp_path):
    import tests.evaluation.fake_arena as fake

    for world, processes in (("S", 1), ("V", 2)):
        jobs = make_jobs(entrants([policy("a_s0")]), [Setting("nominal", "T")], range(2 * STATE_ROWS), tmp_path)
        jobs = [replace(job, world=world) for job in jobs]
        where = {e.time for e in run(jobs, tmp_path / world, workers=1, arena=fake.where)}
        assert len(where) == processes and (os.getpid() in where) == (world == "S")


def test_a_policy_that_cannot_be_sent_is_told_what_helps(tmp_path):
    """In a world that Filament renders even one worker is another process."""

    class Local:
        def reset(self, n):
            pass

        def act(self, obs):
            return np.zeros((len(obs["state"]), 6))

    for world, workers, helps in (("S", 2, True), ("V", 1, False)):
        jobs = make_jobs(entrants([Local()]), [Setting(world, world)], range(2 * STATE_ROWS), tmp_path)
        jobs = [part for job in jobs for part in replace(job, world=world).split(STATE_ROWS)]
        with pytest.raises(UserError, match="cannot be sent to another process") as error:
            [*each(jobs, workers, coin)]
        assert ("workers=1" in str(error.value)) is helps


def test_a_policy_that_cannot_be_played_leaves_no_record_so_that_the_repaired_one_is_not_another(policy, tmp_path):
    def refuses(job):
        raise UserError("cannot be played")

    jobs = make_jobs(entrants([policy("a_s0")]), [Setting("nominal", "S")], range(4), tmp_path)
    with pytest.raises(UserError, match="cannot be played"):
        run(jobs, tmp_path / "out", arena=refuses)
    assert not (tmp_path / "out").exists()
    mended = make_jobs(entrants([policy("a_s0", note="repaired")]), [Setting("nominal", "S")], range(4), tmp_path)
    assert len(run(mended, tmp_path / "out", arena=coin)) == 4


def test_a_folder_of_another_policy_or_world_is_not_continued(policy, tmp_path):
    who = entrants([policy("a_s0")])
    run(make_jobs(who, [Setting("nominal", "S")], range(5), tmp_path), tmp_path / "out", arena=coin)
    other = make_jobs(who, [Setting("nominal", "S", task={"clearance_mm": 1.0})], range(9), tmp_path)
    with pytest.raises(UserError, match="S stood for another one when this folder was begun"):
        run(other, tmp_path / "out", arena=coin)
    (tmp_path / "a_s0" / "judged").mkdir()  # results and notes in its folder do not make it another policy
    (tmp_path / "a_s0" / "judged" / "evaluate.json").write_text("{}")
    run(
        make_jobs(entrants([str(tmp_path / "a_s0")]), [Setting("nominal", "S")], range(6), tmp_path),
        tmp_path / "out",
        arena=coin,
    )
    changed = entrants([policy("a_s0", note="trained longer")])
    with pytest.raises(UserError, match="a/s0 stood for another one"):
        run(make_jobs(changed, [Setting("nominal", "S")], range(9), tmp_path), tmp_path / "out", arena=coin)


def test_two_worlds_or_policies_of_one_name_are_refused(policy, tmp_path):
    who = entrants([policy("a_s0")])
    one, two = (Setting("nominal", "S", "c", task={"clearance_mm": mm}) for mm in (0.5, 1.0))
    jobs = make_jobs(who, [one, two], range(3), tmp_path)
    with pytest.raises(UserError, match="worlds: two of one name.*S/c"):
        run(jobs, tmp_path / "out", arena=coin)
    changed = entrants([policy("a_s0", note="trained longer")])
    with pytest.raises(UserError, match="policies: two of one name.*a/s0"):
        run([jobs[0], replace(jobs[0], entrant=changed[0])], tmp_path / "out", arena=coin)
    assert not (tmp_path / "out").exists()


def test_worlds_whose_names_differ_in_signs_alone_have_files_of_their_own(policy, tmp_path):
    settings = [Setting("nominal", "S", f"friction {sign} 1", (Change("contact_friction", {"scale": scale}, HELD),))
                for sign, scale in (("<", 0.5), (">", 2.0))]  # fmt: skip
    low, high = make_jobs(entrants([policy("a_s0")]), settings, range(3), tmp_path)
    assert [load_world(j.world).hash for j in (low, high)] == [low.world_hash, high.world_hash]
    assert low.world_hash != high.world_hash and low.world != high.world


def test_names_and_training_seeds_of_policies(policy, tmp_path):
    assert [(e.name, e.train_seed) for e in entrants([policy("depth_s0"), policy("depth_s2", seed=2)])] == [
        ("depth", 0),
        ("depth", 2),
    ]
    assert entrant(f"mine={policy('x')}").name == "mine"
    assert entrant(policy("steps", seed=7)).name == "steps"
    kept = tmp_path / "peg-depth" / "20261121-090000_s0" / "checkpoints" / "steps-8000"
    shutil.copytree(policy("y"), kept)
    assert (
        entrant(str(kept)).name == "peg-depth@8000"
        and entrant(str(kept.rename(kept.with_name("best")))).name == "peg-depth"
    )
    for name, told in (("steps-8000", "peg-depth@8000"), ("updates-8000", "peg-depth@updates-8000")):
        assert entrant(str(shutil.copytree(kept.with_name("best"), kept.with_name(name)))).name == told
    with pytest.raises(UserError, match="two policies called depth with training seed 0.*NAME=FOLDER"):
        entrants([policy("depth_s0"), policy("depth-s0")])
    with pytest.raises(UserError, match="no such policy"):
        entrant(str(tmp_path / "nowhere"))
    with pytest.raises(UserError, match="no policy given"):
        entrants([])
    (tmp_path / "empty").mkdir()
    with pytest.raises(UserError, match="not a policy's folder"):
        entrant(str(tmp_path / "empty"))


def test_a_policy_is_refused_in_its_own_world_only(policy):
    here, there = load_world("nominal").hash, load_world("unknown_hole").hash
    who = entrants([policy("a_s0", world_hash=there)])
    refuse_trained_on(who, "nominal", here)
    with pytest.raises(UserError, match="a was trained in unknown_hole.*no transfer"):
        refuse_trained_on(who, "unknown_hole", there)


@pytest.mark.parametrize(
    ("home", "target", "part"),
    [("V", "VNP", "looks-unseen"), ("P", "VNP", "plant"), ("VNP", "N", "sensor-unseen"), ("VNP", "P", "plant")],
)
def test_a_policy_is_refused_where_a_part_is_of_its_own_world_and_held_out_from_others(policy, home, target, part):
    """Whether its record names the parts, as today's do, or only the world, as old ones."""
    told = [policy("a_s0", world_parts=parts(home)), policy("b_s0", world=home), policy("c_s0", world_file=home)]
    for e in entrants(told):
        with pytest.raises(UserError, match=f"{e.name} was trained with .*{part}.*which {target} has too.*fine.tuned"):
            refuse_trained_on([e], target, load_world(target).hash)


def test_policies_of_the_training_world_are_judged_in_every_target(policy):
    who = entrants(["expert", *(policy(f"{home}_s0", world=home) for home in ("S", "randomized", "searching", "dev"))])
    for target in ("V", "N", "P", "VNP"):
        refuse_trained_on(who, target, load_world(target).hash)


def test_worlds_of_ones_own_share_what_their_bases_say(policy, tmp_path):
    def world(name, base, scale):
        effects = [{"effect": "contact_friction", "where": "peg", "params": {"scale": scale}}]
        path = tmp_path / f"{name}.yaml"
        path.write_text(json.dumps({"format": "vispeg-world/1", "name": name, "base": base, "effects": effects}))
        return load_world(path)

    near, cell = world("near", "VNP", 1.1), world("cell", "S", 1.2)
    dark = world("dark", str(cell.path), 1.3)
    (knows,) = entrants([policy("a_s0", world_parts=parts(near.path))])
    with pytest.raises(UserError, match="which VNP has too"):
        refuse_trained_on([knows], "VNP", load_world("VNP").hash)
    (tuned,) = entrants([policy("a_s0", world="VNP")])
    with pytest.raises(UserError, match="which near has too"):
        refuse_trained_on([tuned], near.name, near.hash, near.path)
    (own,) = entrants([policy("a_s0", world_parts=parts(cell.path))])
    with pytest.raises(UserError, match="trained with cell, which dark has too"):
        refuse_trained_on([own], dark.name, dark.hash, dark.path)
    refuse_trained_on([own], dark.name, dark.hash, dark.path, training=cell.path)
    refuse_trained_on([own], near.name, near.hash, near.path)


def test_evaluation_seeds_are_held_out_and_draws_share_none():
    assert min(seeds_of(500)) == FIRST_SEED and not set(seeds_of(500)) & set(seeds_of(500, seed=1))
    with pytest.raises(UserError, match=r"not a seed of an evaluation.*got -1"):  # below are training's
        seeds_of(500, seed=-1)
    assert seeds_of(100) == seeds_of(500)[:100]
    assert 500 * 2000 / HELD_OUT == pytest.approx(1 / 2000, rel=0.1), "one of them in so many training runs"


def test_an_overlay_changes_what_it_says_and_has_a_hash_of_its_own(tmp_path):
    base = load_world("unknown_hole")
    same = overlay("unknown_hole", "x", tmp_path)
    assert same.hash == base.hash and not list(tmp_path.iterdir())
    fixed = overlay("unknown_hole", "fixed/1", tmp_path, [Change("hole_offset", {"x": 0.01, "y": 0.0})])
    (r,) = fixed.world.ranges
    assert dict(r.params) == {"x": 0.01, "y": 0.0} and fixed.hash != base.hash
    assert (
        fixed.hash == overlay("unknown_hole", "other name", tmp_path, [Change("hole_offset", {"x": 0.01, "y": 0})]).hash
    )
    tight = overlay("nominal", "tight", tmp_path, task={"clearance_mm": 0.5})
    assert tight.task == {"clearance_mm": 0.5}
    with pytest.raises(UserError, match="out of bounds"):
        overlay("nominal", "far", tmp_path, [Change("hole_offset", {"x": 9.0})])


class Seer:
    """Acts on the mean of its image."""

    modality, meta = "depth", {}

    def reset(self, n, rows=None):
        self.n = n

    def act(self, obs):
        return np.repeat(obs["depth_a"].mean(axis=(1, 2, 3))[:, None], 3, axis=1)


def look(values):
    return {"policy": np.zeros((len(values), 2)), "depth_a": np.ones((1, 1, 4, 4)) * np.reshape(values, (-1, 1, 1, 1))}


def test_frozen_keeps_the_first_image_of_each_episode_row_by_row():
    c = Controlled(Seer(), "frozen", 3)
    c.reset(3)
    assert c.act(look([1.0, 2.0, 3.0]))[:, 0].tolist() == [1, 2, 3]
    assert c.act(look([4.0, 5.0, 6.0]))[:, 0].tolist() == [1, 2, 3]
    c.reset(3, np.array([False, True, False]))
    assert c.act(look([7.0, 8.0, 9.0]))[:, 0].tolist() == [1, 8, 3]


def test_shuffled_gives_everybody_anothers_image_and_touches_nothing_else():
    c = Controlled(Seer(), "shuffled", 4)
    c.reset(4)
    obs = look([1.0, 2.0, 3.0, 4.0])
    seen = c.act(obs)[:, 0]
    assert sorted(seen) == [1, 2, 3, 4] and not np.any(seen == [1, 2, 3, 4])
    assert obs["depth_a"][:, 0, 0, 0].tolist() == [1, 2, 3, 4]
    with pytest.raises(UserError, match="two or more rows"):
        c.act(look([1.0]))
    assert c.spare == 0
    alone = Controlled(Seer(), "shuffled", 1)
    assert alone.spare == 1, "the first episode below, which is shown its own images"
    for number, shown in ((0, [1, 2, 3]), (10, [1, 2]), (20, [11, 12, 12])):
        alone.reset(1)
        assert [alone.act(look([number + k + 1.0]))[0, 0] for k in range(len(shown))] == shown
    with pytest.raises(UserError, match="did you mean 'frozen'"):
        Controlled(Seer(), "frosen", 1)


def test_controls_on_images_are_not_asked_of_policies_that_see_none(policy, tmp_path):
    who = entrants([policy("a_s0"), policy("d_s0", modality="depth")])
    settings = [Setting("unknown_hole", "S", control=c) for c in ("", "shuffled", "hole_fixed")]
    jobs = make_jobs(who, settings, range(10), tmp_path)
    assert [(j.entrant.name, j.control) for j in jobs] == [
        ("a", ""),
        ("d", ""),
        ("d", "shuffled"),
        ("a", "hole_fixed"),
        ("d", "hole_fixed"),
    ]
    assert jobs[0].world_hash != jobs[-1].world_hash


def test_pushes_are_of_the_seed_horizontal_and_of_the_stated_size():
    drawn = [Pushes().draw(s) for s in range(200)]
    size = [np.hypot(f[0], f[1]) for f, _, _ in drawn]
    assert 20 <= min(size) < 25 and 55 < max(size) <= 60 and all(f[2] == 0 for f, _, _ in drawn)
    assert drawn[3] == Pushes().draw(3) and {d for _, _, d in drawn} == {0.2}


def test_rare_failures_are_among_those_shown():
    e = Episode("p", "state", 0, "S", "h", 0, False, "jam")
    episodes = [replace(e, seed=i) for i in range(50)] + [replace(e, seed=99, category="slip")]
    assert {f.category for f in failures(episodes, 3)} == {"jam", "slip"} and len(failures(episodes, 3)) == 3
    assert failures([replace(e, success=True, category="success")], 3) == []


def test_threads_are_one_meanwhile_and_as_before_afterwards(monkeypatch):
    import os

    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with one_thread():
        assert os.environ["OMP_NUM_THREADS"] == os.environ["MKL_NUM_THREADS"] == "1"
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ


def test_a_film_shows_the_episode_that_was_recorded(tmp_path):
    from vispeg.evaluation.arena import play
    from vispeg.evaluation.films.media import film

    (job,) = make_jobs(entrants(["expert"]), [Setting("nominal", "nominal")], seeds_of(3), tmp_path)
    (recorded,) = [e for e in play(replace(job, rows=3)) if e.seed == job.seeds[1]]
    clip = film(job, recorded.seed)
    assert (clip.category, clip.time) == (recorded.category, recorded.time)
    assert len(clip.frames) == round(recorded.time / 0.16) + 1 and clip.frames.dtype == np.uint8
    assert clip.frames[0].std() > 5 and np.any(clip.frames[0] != clip.frames[-1])


def test_a_film_plays_in_real_time_whatever_the_policys_period(tmp_path):
    import cv2

    from vispeg.evaluation.films.media import film, side

    world = tmp_path / "quick.yaml"
    world.write_text("format: vispeg-world/1\nname: quick\ntask: {policy_period: 0.08, steps: 5}\n")
    (job,) = make_jobs(entrants(["expert"]), [Setting(str(world), "quick")], seeds_of(1), tmp_path)
    clip = film(job, job.seeds[0])
    assert clip.time == pytest.approx(0.4)
    video = side(clip, "quick", tmp_path / "media", "clip", 0)["video"]
    assert cv2.VideoCapture(str(tmp_path / str(video))).get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)


def test_every_pushed_episode_is_pushed_by_its_own_seeds_push():
    from vispeg.evaluation.arena import Pushed
    from vispeg.task.peg.task import PegInHoleVec

    env, seeds = PegInHoleVec(2, "nominal", "state"), (5, 6, 7)
    pushed, pushes = Pushed(env, Pushes()), []
    pushed.reset(seed=[5, 6])
    pushes += [env.sim.push[0], env.sim.push[1]]
    pushed.reset(seed=[7, 6], options={"reset_mask": np.array([True, False])})
    assert env.sim.push[1] is pushes[1], "its episode goes on"
    for push, seed in zip((*pushes, env.sim.push[0]), seeds, strict=True):
        force, start, duration = Pushes().draw(seed)
        assert (tuple(push.force), push.start, push.duration) == (tuple(force), start, duration)
    env.close()
