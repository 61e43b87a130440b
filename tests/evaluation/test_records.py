"""Records survive their file, a killed run, and a careless person's CSV."""

import json
import signal
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import pytest
import yaml

from vispeg.core.errors import UserError
from vispeg.core.lock import LOCK
from vispeg.core.marker import MARKER
from vispeg.evaluation.folder import workplace
from vispeg.evaluation.measured import read_csv, read_measured
from vispeg.evaluation.records import Episode, append, read, read_all
from vispeg.trials.trial import FILE

ONE = Episode("p", "depth", 0, "S", "abc", 7, True, "success", 3.2, 21.5, 0.0004, 0.02, force_profile=(0.0, 10 / 3))


def test_what_is_written_is_read_again(tmp_path):
    nan = replace(ONE, seed=8, time=float("nan"), force_profile=None)
    append(tmp_path / "e.jsonl", [ONE])
    append(tmp_path / "e.jsonl", [nan])
    back = read(tmp_path / "e.jsonl")
    assert back[0] == ONE and back[1].time != back[1].time and back[1].key == nan.key
    assert len((tmp_path / "e.jsonl").read_text().splitlines()) == 2


def test_a_half_written_line_is_neither_read_nor_kept(tmp_path):
    path = tmp_path / "e.jsonl"
    append(path, [ONE])
    with path.open("a") as file:
        file.write('{"policy": "p", "moda')
    assert read(path) == [ONE]
    append(path, [replace(ONE, seed=8)])
    assert [e.seed for e in read(path)] == [7, 8]


def test_an_episode_is_appended_to_a_large_file_without_reading_it(tmp_path):
    path = tmp_path / "e.jsonl"
    with path.open("wb") as file:
        file.seek(50_000_000)  # a hole, which takes no room
        file.write(b"\n" + b"x" * 200_000)  # and a half-written line
    tracemalloc.start()
    append(path, [ONE])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1_000_000
    with path.open("rb") as file:
        file.seek(50_000_000)
        assert file.read() == b"\n" + ONE.to_json().encode() + b"\n"


def test_one_file_may_repeat_another_but_not_contradict_it(tmp_path):
    append(tmp_path / "a.jsonl", [ONE])
    append(tmp_path / "b.jsonl", [ONE, replace(ONE, seed=9)])
    assert len(read_all([tmp_path / "a.jsonl", tmp_path / "b.jsonl"])) == 2
    append(tmp_path / "other.jsonl", [replace(ONE, success=False, category="jam")])
    with pytest.raises(
        UserError, match="other.jsonl: p .training seed 0. in S, seed 7: .*differently.*success as in.*a.jsonl"
    ):
        read_all([tmp_path / "a.jsonl", tmp_path / "other.jsonl"])
    append(tmp_path / "a.jsonl", [replace(ONE, success=False, category="jam")])
    with pytest.raises(UserError, match="twice with different outcomes"):
        read(tmp_path / "a.jsonl")
    append(tmp_path / "d.jsonl", [ONE, replace(ONE, world_hash="one place", control="hole_fixed")])
    assert len(read_all([tmp_path / "d.jsonl"])) == 2, "a control may be a world of its own"
    append(tmp_path / "c.jsonl", [replace(ONE, seed=10, world_hash="other")])
    with pytest.raises(UserError, match="S: two different worlds under one name"):
        read_all([tmp_path / "b.jsonl", tmp_path / "c.jsonl"])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"succes": True}, "did you mean 'success'"),
        ({"seed": "1"}, "seed: no such seed"),
        ({"seed": 10**30}, "seed: no such seed"),
        ({"train_seed": -1}, "train_seed: no such seed"),
        ({"success": 1}, "success is missing"),
        ({"category": "jam"}, "contradict"),
        ({"time": "long"}, "time is not a number"),
    ],
)
def test_a_bad_line_is_named(tmp_path, change, words):
    row = json.loads(ONE.to_json()) | change
    (tmp_path / "e.jsonl").write_text(ONE.to_json() + "\n" + json.dumps(row) + "\n")
    with pytest.raises(UserError, match=f"line 2.*{words}"):
        read(tmp_path / "e.jsonl")


def test_a_robots_csv(tmp_path):
    (tmp_path / "r.csv").write_text(
        "policy,seed,outcome,category,configuration\nA,1,success,,c1\nA,2,0,jam,c1\nB,1,Yes,,c2\n"
    )
    trials = read_csv(tmp_path / "r.csv", policies={"A": {0}, "B": {0}}).episodes
    assert [(e.policy, e.seed, e.success, e.category) for e in trials] == [
        ("A", 1, True, "success"),
        ("A", 2, False, "jam"),
        ("B", 1, True, "success"),
    ]
    assert {e.world for e in trials} == {"robot"} and trials[2].configuration == "c2"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("policy,seed\nA,1\n", "a column is missing; expected 'outcome'|a column is missing; expected outcome"),
        ("policy,seed,outcome,catgory\nA,1,1,\n", "did you mean 'category'"),
        ("policy,seed,outcome\nC,1,1\n", "line 2: unknown policy"),
        ("policy,seed,outcome\nA,1,maybe\n", "unknown outcome.*maybe"),
        ("policy,seed,outcome\nA,one,1\n", "line 2: seed: no such seed.*got 'one'"),
        (f"policy,seed,outcome\nA,{10**30},1\n", "line 2: seed: no such seed"),
        ("policy,seed,outcome\nA,1,1\nA,1,0\n", "line 3: the same trial twice"),
        ("policy,seed,outcome,train_seed\nA,1,1,99\n", "line 2: train_seed: unknown training seed; got 99; choices: 0"),
        ("policy,seed,outcome,category\nA,1,1,jam\n", "contradict"),
        ("policy,seed,outcome,configuration\nA,1,0,far\nA,1,1,c1\nA,2,1,\n", "does not know .*'', 'far'.*choices: c1"),
        ("policy,seed,outcome\nA,1\n", "another number of cells than there are columns"),
        ("policy,seed,outcome\n", "no trials"),
    ],
)
def test_a_bad_csv_is_one_clear_line(tmp_path, text, words):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(UserError, match=words):
        read_csv(tmp_path / "r.csv", policies={"A": {0}}, configurations=["c1"] if "configuration" in text else [])


def test_a_robots_failure_may_have_a_word_of_its_own(tmp_path):
    (tmp_path / "r.csv").write_text(
        "policy,seed,outcome,category\nA,1,0,cable caught\nA,2,0,Jam\nA,3,0,\nA,4,1,Success\n"
    )
    trials = read_csv(tmp_path / "r.csv").episodes
    assert [e.category for e in trials] == ["cable caught", "jam", "failure", "success"]
    append(tmp_path / "e.jsonl", trials)
    assert [e.category for e in read(tmp_path / "e.jsonl")] == [e.category for e in trials]


def test_an_untold_training_seed_is_the_policys_only_one_else_a_note_says_so(tmp_path):
    (tmp_path / "r.csv").write_text("policy,seed,outcome\nA,1,1\nB,1,1\nB,2,0\n")
    found = read_csv(tmp_path / "r.csv", policies={"A": {1}, "B": {3, 2}})
    assert [e.train_seed for e in found.episodes] == [1, 2, 2]
    assert found.notes == ["r.csv does not tell which training seed of B (2, 3) was tried; 2 is assumed"]
    (tmp_path / "r.csv").write_text("policy,seed,outcome,train_seed\nA,1,1,\nB,1,1,3\n")
    found = read_csv(tmp_path / "r.csv", policies={"A": {1}, "B": {3, 2}})
    assert [e.train_seed for e in found.episodes] == [1, 3] and found.notes == []


def tried(place, name, seed=None, category="jam", **policy):
    """A failed trial as another program may write it."""
    start = {"q_rad": [0.0] * 7, "goal_m": [0.6, 0.0, 0.0], "believed_m": [0.6, 0.0, 0.0]}
    said = {"format": "vispeg-trial/1", "policy": {"name": "A", "digest": "0" * 64, **policy}, "start": start}
    said["outcome"] = {"success": False, "category": category, "by": "person", "time_s": 2.0}
    (place / name).mkdir(parents=True, exist_ok=True)
    (place / name / FILE).write_text(yaml.safe_dump(said | ({} if seed is None else {"seed": seed})))


def test_trials_in_a_folder_follow_the_rules_of_a_csv(tmp_path):
    """Of training seeds and of categories."""
    policies, place = {"A": [5, 4]}, tmp_path / "trials"
    tried(place, "a", category="Jam")
    tried(place, "b", category="Cable caught", train_seed=5)
    found = read_measured(place, policies=policies)
    assert [(e.train_seed, e.category) for e in found.episodes] == [(4, "jam"), (5, "Cable caught")]
    assert found.notes == ["trials does not tell which training seed of A (4, 5) was tried; 4 is assumed"]
    tried(place, "c", train_seed=0)
    with pytest.raises(UserError, match=r"trial.yaml: policy.train_seed: unknown training seed; got 0; choices: 4, 5"):
        read_measured(place, policies=policies)
    tried(place, "c", category="Success")
    with pytest.raises(UserError, match=r"outcome.category: outcome and category contradict each other"):
        read_measured(place, policies=policies)


def test_trials_without_a_number_are_different_trials(tmp_path):
    (tmp_path / "r.csv").write_text("policy,seed,outcome\nA,,1\nA,1,0\nA,,0\n")
    assert [(e.seed, e.success) for e in read_csv(tmp_path / "r.csv").episodes] == [(0, True), (1, False), (2, False)]
    for name, seed in (("a", None), ("b", None), ("c", 0)):
        tried(tmp_path / "trials", name, seed)
    assert [e.seed for e in read_measured(tmp_path / "trials").episodes] == [1, 2, 0]
    tried(tmp_path / "trials", "a", 0)
    with pytest.raises(UserError, match="the same trial twice"):
        read_measured(tmp_path / "trials")


def test_a_folder_with_its_lock_alone_is_a_new_one(tmp_path):
    """As in a container: OUT is mounted, the folder above is not writable, and so the lock lies in OUT."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LOCK).write_text("{}")
    with workplace(tmp_path / "out", "evaluate.json") as place:
        assert place == tmp_path / "out"
    (tmp_path / "out2").mkdir()
    (tmp_path / "out2" / "mine.txt").write_text("")
    with pytest.raises(UserError, match="not a folder of such results"), workplace(tmp_path / "out2", "evaluate.json"):
        pass


@pytest.mark.parametrize("before", [None, "empty", "marked"])
def test_a_run_refused_before_its_first_episode_leaves_its_folder_as_it_was(tmp_path, before):
    out = tmp_path / "out"
    if before is not None:
        out.mkdir()
    if before == "marked":  # by a run that was interrupted
        with workplace(out, "evaluate.json"):
            pass
    with pytest.raises(UserError, match="unfit"), workplace(out, "evaluate.json") as place:
        (place / "worlds").mkdir()
        (place / "worlds" / "a.yaml").write_text("")
        raise UserError("unfit")
    assert out.exists() == (before is not None) and (before == "marked" or not [*out.glob("**/*")])
    with pytest.raises(UserError, match="later"), workplace(tmp_path / "played", "evaluate.json") as place:
        append(place / "episodes.jsonl", [ONE])
        raise UserError("later")
    assert read(tmp_path / "played" / "episodes.jsonl") == [ONE]


def test_a_run_refused_before_its_first_episode_leaves_the_result_that_it_was_to_replace(tmp_path):
    def made(words, episodes=()):
        with workplace(tmp_path / "out", "evaluate.json", overwrite=True) as place:
            append(place / "episodes.jsonl", episodes) if episodes else None
            if not words:
                raise UserError("unfit")
            for name in ("evaluate.json", "evaluate.html"):
                (place / name).write_text(words)

    made("old", [ONE])
    for episodes, left in (((), "old"), ([ONE], None)):
        with pytest.raises(UserError, match="unfit"):
            made("", episodes)
        file = tmp_path / "out" / "evaluate.json"
        assert (file.read_text() if file.exists() else None) == left and not (tmp_path / "out" / ".before").exists()
        assert read(tmp_path / "out" / "episodes.jsonl") == [ONE]


KILLED = """
import os, signal, sys
from vispeg.evaluation.folder import workplace
with workplace(sys.argv[1], "evaluate.json", overwrite=True):
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("how", ["killed", "disk"])
def test_a_run_that_ends_at_its_start_leaves_the_result_that_it_was_to_replace(tmp_path, how):
    """It is killed before its first episode, or the folder cannot be marked after the old result was put aside."""
    out = tmp_path / "out"
    with workplace(out, "evaluate.json") as place:
        append(place / "episodes.jsonl", [ONE])
        for name in ("evaluate.json", "evaluate.html"):
            (place / name).write_text("old")
        (place / "run.json").write_text('{"policies": {}, "worlds": {}}')
    if how == "killed":
        killed = subprocess.run([sys.executable, "-c", KILLED, str(out)], check=False)
        assert killed.returncode == -signal.SIGKILL and not (out / "evaluate.json").exists()
    else:
        (out / MARKER).unlink()
        (out / MARKER).mkdir()
        with pytest.raises(UserError, match="cannot be written"), workplace(out, "evaluate.json", overwrite=True):
            pass
        (out / MARKER).rmdir()
    with pytest.raises(UserError, match="exists already"), workplace(out, "evaluate.json"):
        pass
    assert (out / "evaluate.json").read_text() == (out / "evaluate.html").read_text() == "old"
    assert read(out / "episodes.jsonl") == [ONE] and not (out / ".before").exists()
