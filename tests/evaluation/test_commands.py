"""The commands on records, and one short real evaluation of the scripted policy."""

import json

import numpy as np
import pytest
from pages import plain

from vispeg.api.gap import gap
from vispeg.api.opened import load
from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.evaluation.records import append, read
from vispeg.report.record import load_record


@pytest.fixture
def vispeg(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def call(*args):
        capsys.readouterr()
        code = main([str(a) for a in args])
        out, err = capsys.readouterr()
        return code, out, err

    return call


def test_a_gap_from_records_and_a_robots_csv(vispeg, tmp_path, invented):
    append(tmp_path / "e.jsonl", invented({("d", "depth"): 3.0}, {"S": 0.0, "V": -1.0}, 60, train_seeds=3))
    trials = [f"d,{i},{'yes,' if i % 3 else 'no,cable caught'}\n" for i in range(30)]
    (tmp_path / "r.csv").write_text("policy,seed,outcome,category\n" + "".join(trials))
    code, out, err = vispeg("gap", "--records", "e.jsonl", "--worlds", "S", "V", "--measured", "r.csv", "--out", "g")
    assert code == 0 and "d in robot: loses" in out, err
    values = json.loads((tmp_path / "g" / "gap.json").read_text())
    assert [w["name"] for w in values["worlds"]] == ["S", "V", "robot"] and values["provenance"]["inputs"]
    assert len(read(tmp_path / "g" / "episodes.jsonl")) == 2 * 3 * 60 + 30
    assert any("training seed of d (0, 1, 2)" in note for note in values["notes"])
    assert "cable caught" in (tmp_path / "g" / "gap.html").read_text()
    code, _, err = vispeg("gap", "--records", "e.jsonl", "--worlds", "S", "V", "--out", "g")
    assert code == 2 and "exists already" in err
    again = ("--measured", "r.csv", "--robot", "V", "--out", "h")
    code, _, err = vispeg("gap", "--records", "e.jsonl", "--worlds", "S", "V", *again)
    assert code == 2 and "--robot: a world has the robot's name" in err and not (tmp_path / "h").exists()


def test_a_gap_from_records_is_of_their_worlds_and_empty_rows_of_a_spreadsheet_are_no_trials(
    vispeg, tmp_path, invented
):
    append(tmp_path / "e.jsonl", invented({("d", "depth"): 3.0}, {"mine": 0.0, "V": -1.0, "S": 0.5}, 10))
    (tmp_path / "r.csv").write_text("policy,seed,outcome\nd,0,yes\n,,\nd,1,no\n , ,\n")
    code, _, err = vispeg("gap", "--records", "e.jsonl", "--measured", "r.csv", "--out", "g")
    assert code == 0, err
    values = json.loads((tmp_path / "g" / "gap.json").read_text())
    assert [w["name"] for w in values["worlds"]] == ["S", "V", "mine", "robot"] and values["reference"] == "S"
    assert [row["success"]["n"] for row in values["success"] if row["world"] == "robot"] == [2]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (("gap", "--out", "g"), "nothing to evaluate"),
        (("gap", "nowhere", "--out", "g"), "no such policy"),
        (("gap", "expert", "--worlds", "nominal", "mars", "--out", "g"), "unknown world"),
        (("gap", "expert", "--worlds", "nominal", "nominal", "--out", "g"), "two worlds of one name"),
        (
            ("gap", "expert", "--worlds", "nominal", "--control-worlds", "nominl", "--out", "g"),
            "did you mean 'nominal'",
        ),
        (("evaluate", "expert", "--episodes", "0", "--out", "g"), "no episodes"),
        (("evaluate", "expert", "--clearance", "0", "--out", "g"), "expected above 0 to 20 mm; got 0.0"),
        (("evaluate", "expert", "--controls", "frosen", "--out", "g"), "did you mean 'frozen'"),
        (("evaluate", "expert", "expert", "--out", "g"), "two policies called expert"),
        *(
            ((*command, "--seed", str(2**63 - 1), "--out", "g"), "expected 0 to 92233720368537")
            for command in (("evaluate", "expert"), ("gap", "expert", "--controls", "none"), ("perturb", "expert"))
        ),
        (("train", "peg-state", "--seed", str(2**32), "--out", "g"), "expected 0 to 2^32 - 1"),
        (("sensitivity", "expert", "--out", "g"), "nothing to sweep"),
        (("sensitivity", "expert", "--sweep", "camera-shift", "--out", "g"), "expert (state) looks at none"),
        (("sensitivity", "expert", "--sweep", "friction", "--sweep", "light", "--out", "g"), "changes images alone"),
        (("perturb", "expert", "--force", "60", "20", "--out", "g"), "not a push"),
        (("perturb", "expert", "--duration", "0", "--out", "g"), "--duration: not a push"),
        (("suite", "run", "expert", "--out", "g"), "needs exactly one target"),
        (("suite", "run", "expert", "--train", "nominal", "--target", "nominal", "--out", "g"), "the same"),
        (("suite", "compare", "g"), "no such file"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(vispeg, tmp_path, args, words):
    code, out, err = vispeg(*args)
    assert code == 2 and out == "" and words in err and len(err.strip().splitlines()) == 1, err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("where", "value"), [("x", 1000.0), ("height", 1000.0), ("roll", 9.0)])
def test_a_position_that_cannot_be_is_refused_before_an_old_result_is_cleared(vispeg, tmp_path, where, value):
    """The file that states it is named, whichever of task and effects refuses it; nothing is written."""
    listed = f"positions:\n- {{name: near, x: 0.01}}\n- {{name: far, {where}: {value}}}\n"
    (tmp_path / "far.yaml").write_text(f"format: vispeg-positions/1\nname: far\n{listed}")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "perturb.json").write_text('{"format": "vispeg-perturb/1"}')
    code, _, err = vispeg("perturb", "expert", "--positions", "far.yaml", "--out", "out", "--overwrite")
    assert code == 2 and f"far.yaml: positions[1].{where}" in err and len(err.strip().splitlines()) == 1, err
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["perturb.json"]


def test_a_folder_of_something_else_is_left_alone(vispeg, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("x")
    code, _, err = vispeg("evaluate", "expert", "--out", "mine", "--overwrite")
    assert code == 2 and "not a folder of such results" in err
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


def test_the_scripted_policy_succeeds_and_a_second_call_plays_nothing(vispeg, tmp_path):
    args = ("evaluate", "expert", "--world", "nominal", "--episodes", "6", "--videos", "0", "--quiet", "--out", "ev")
    code, out, err = vispeg(*args)
    assert code == 0 and "100 %" in out, err
    told = "expert: 6 of 6: 61 to 100 %; to tell it within 5 points takes up to 366 episodes"
    assert told in out and told in json.loads((tmp_path / "ev" / "evaluate.json").read_text())["notes"]
    page = plain((tmp_path / "ev" / "evaluate.html").read_text())  # an evaluation is not a gap
    assert "6 of 6 succeed, so 61 to 100 %</h1>" in page and told in page
    assert "fewer than three training seeds" not in page, "nobody trained the scripted policy"
    assert "<title>vispeg evaluate</title>" in page and "transfer gap" not in page
    assert not list((tmp_path / "ev").glob("gap.*"))
    first = (tmp_path / "ev" / "episodes.jsonl").read_bytes()
    (tmp_path / "ev" / "evaluate.json").unlink()
    assert vispeg(*args)[0] == 0 and (tmp_path / "ev" / "episodes.jsonl").read_bytes() == first
    rows = read(tmp_path / "ev" / "episodes.jsonl")
    assert [e.seed for e in rows] == list(range(1_000_000, 1_000_006)) and {len(e.world_hash) for e in rows} == {64}
    (tmp_path / "ev").rename(tmp_path / "expert")  # a result of the policy's name is nothing that the command reads
    assert vispeg(*args[:-1], "expert", "--overwrite")[0] == 0


@pytest.fixture
def played(monkeypatch):
    """Commands play nothing: an episode succeeds as the given function of job and seed says. Returns the jobs."""

    from vispeg.evaluation import runner

    run = runner.run

    def by(success):
        from vispeg.evaluation.records import Episode

        jobs = []

        def toss(job):
            jobs.append(job)
            e = job.entrant
            ok = [bool(success(job, s)) for s in job.seeds]
            head = (e.name, e.modality, e.train_seed, job.world_name, job.world_hash)
            ends = [(s, k, "success" if k else "jam") for s, k in zip(job.seeds, ok, strict=True)]
            more = {"time": 1.0, "control": job.control, "configuration": job.configuration}
            return [Episode(*head, *end, **more) for end in ends]

        monkeypatch.setattr(runner, "run", lambda todo, out, *_, **more: run(todo, out, arena=toss))
        return jobs

    return by


def test_controls_are_played_in_the_first_world_and_the_last_or_where_they_are_asked_for(vispeg, tmp_path, played):
    worlds = ("--worlds", "nominal", "unknown_hole", "randomized", "--episodes", "4", "--videos", "0")
    jobs = played(lambda job, seed: seed % 2)
    code, _, err = vispeg("gap", "expert", *worlds, "--out", "ends")
    assert code == 0, err
    assert [j.world_name for j in jobs if j.control == "hole_fixed"] == ["nominal", "randomized"]
    values = json.loads((tmp_path / "ends/gap.json").read_text())
    assert {r["world"] for r in values["success"] if r["control"]} == {"nominal", "randomized"}
    assert "no blind control: add a proprio policy" in values["notes"]
    html = (tmp_path / "ends/gap.html").read_text()
    assert all(text in html for text in ("<h3>In nominal</h3>", "<h3>In randomized</h3>", "no blind control"))
    jobs.clear()
    code, _, err = vispeg("gap", "expert", *worlds, "--control-worlds", "unknown_hole", "--out", "one")
    assert code == 0 and "16 episodes, 4 of them of controls (--controls none" in err
    assert [j.world_name for j in jobs if j.control] == ["unknown_hole"]
    jobs.clear()
    code, _, err = vispeg("gap", "expert", *worlds, "--controls", "none", "--out", "none")
    assert code == 0 and "of controls" not in err and len(jobs) == 3


def test_a_policy_in_the_world_of_its_training_is_at_home_there_and_not_refused(vispeg, tmp_path, played):
    """A naive and an identified policy can be compared in both their worlds."""
    played(lambda job, seed: job.world_name == "randomized" or seed % 2)
    both = ("gap", "state-3mm-randomized", "expert", "--worlds", "nominal", "randomized", "--controls", "none")
    code, _, err = vispeg(*both, "--episodes", "20", "--videos", "0", "--out", "g")
    assert code == 0, err
    values = json.loads((tmp_path / "g/gap.json").read_text())
    assert [p["home"] for p in values["policies"]] == [["randomized"], []]
    assert [g["home"] for g in values["gaps"]] == [True, False] and len(values["comparisons"]) == 2
    page = (tmp_path / "g/gap.html").read_text()
    assert "world of training" not in page and "(home)" not in page.split("randomized</h3>")[0]
    code, _, err = vispeg(
        "suite", "run", "state-3mm-randomized", "--train", "nominal", "--target", "randomized", "--out", "s"
    )
    assert code == 2 and "was trained in randomized" in err, "a suite has one training world"


def recorded(folder, *seeds, lost=()):
    """Episodes of the scripted policy in two worlds, as a run would have written them."""
    from vispeg.evaluation.records import Episode
    from vispeg.task.world_file import load_world

    episodes = []
    for world in ("nominal", "unknown_hole"):
        for s in (1_000_000 + s for s in seeds):
            ok = world == "nominal" or s - 1_000_000 not in lost
            head = ("expert", "state", 0, world, load_world(world).hash, s)
            episodes.append(Episode(*head, ok, "success" if ok else "jam", time=99.0))
    append(folder / "e.jsonl", episodes)
    return episodes


TWO = ("gap", "expert", "--worlds", "nominal", "unknown_hole", "--controls", "--records", "e.jsonl")


def test_only_what_the_records_lack_is_played(vispeg, tmp_path, played):
    stored = recorded(tmp_path, 0, 1, 3)
    jobs = played(lambda job, seed: True)
    code, _, err = vispeg(*TWO, "--episodes", "5", "--out", "g")
    assert code == 0, err
    assert {(j.world_name, *j.seeds) for j in jobs} == {(w, 1_000_002, 1_000_004) for w in ("nominal", "unknown_hole")}
    written = read(tmp_path / "g/episodes.jsonl")
    assert len(written) == 10 and written[: len(stored)] == stored
    jobs.clear()
    (tmp_path / "g/episodes.jsonl").replace(tmp_path / "e.jsonl")
    assert vispeg(*TWO, "--episodes", "4", "--out", "g", "--overwrite")[0] == 0 and not jobs
    assert sorted(read(tmp_path / "g/episodes.jsonl"), key=repr) == sorted(written, key=repr)


def test_the_scripted_policy_of_records_beside_a_trained_one_was_not_trained(vispeg, tmp_path, played):
    recorded(tmp_path, 0, 1, 3)
    played(lambda job, seed: True)
    trained = ("gap", "state-3mm-randomized", *TWO[2:], "--fine-tuned", "--episodes", "5", "--videos", "0")
    code, _, err = vispeg(*trained, "--out", "g")
    assert code == 0, err
    values = json.loads((tmp_path / "g/gap.json").read_text())
    assert {p["name"]: p["scripted"] for p in values["policies"]} == {"state-3mm-randomized": False, "expert": True}
    assert not [note for note in values["notes"] if note.startswith("expert")]


def test_the_scripted_policy_of_a_run_is_known_in_its_records_by_any_name(vispeg, tmp_path, played):
    played(lambda job, seed: True)
    worlds = ("--worlds", "nominal", "unknown_hole")
    assert (
        vispeg("gap", "script=expert", *worlds, "--episodes", "3", "--videos", "0", "--controls", "--out", "g")[0] == 0
    )
    assert vispeg("gap", "--records", "g/episodes.jsonl", *worlds, "--out", "again")[0] == 0
    first, again = (json.loads((tmp_path / out / "gap.json").read_text()) for out in ("g", "again"))
    assert again["policies"][0]["scripted"] and again["notes"] == first["notes"]


def test_records_of_another_world_or_policy_are_refused_before_anything_is_written(vispeg, tmp_path, played):
    from dataclasses import replace

    jobs = played(lambda job, seed: True)
    stored = recorded(tmp_path, 0, 1)
    (tmp_path / "run.json").write_text(json.dumps({"policies": {"expert/s0": "another", "else/s0": "x"}}))
    code, out, err = vispeg(*TWO, "--out", "g")
    assert code == 2 and "another policy than the expert/s0" in err and len(err.strip().splitlines()) == 1
    (tmp_path / "run.json").unlink()
    (tmp_path / "e.jsonl").unlink()
    append(tmp_path / "e.jsonl", [replace(e, world_hash="moved" + e.world) for e in stored])
    code, out, err = vispeg(*TWO, "--out", "g")
    assert code == 2 and "nominal: the records are from another world of this name" in err
    assert out == "" and len(err.strip().splitlines()) == 1 and not jobs and not (tmp_path / "g").exists()


def test_a_result_saved_from_python_knows_its_policies_and_worlds_as_the_command_s_does(vispeg, tmp_path, played):
    """Also through a gap from records alone. Records of two policies of one name are refused."""
    from vispeg.api.evaluate import evaluate

    played(lambda job, seed: True)
    for name, policy in (("a", "one=state-0.5mm"), ("b", "one=state-0.2mm")):
        evaluate(policy, episodes=3).save(tmp_path / name)
    assert vispeg("evaluate", "one=state-0.5mm", "--episodes", "3", "--videos", "0", "--out", "by-command")[0] == 0
    known = json.loads((tmp_path / "a/run.json").read_text())
    assert [*known["policies"], *known["worlds"]] == ["one/s1", "nominal"]
    assert json.loads((tmp_path / "by-command/run.json").read_text()) == known
    assert vispeg("gap", "--records", "a/episodes.jsonl", "--worlds", "nominal", "--out", "g")[0] == 0
    assert json.loads((tmp_path / "g/run.json").read_text()) == known
    other = ("gap", "one=state-0.2mm", "--controls", "none", "--episodes", "3", "--out", "h")
    code, _, err = vispeg(*other, "--records", "g/episodes.jsonl", "--worlds", "nominal", "unknown_hole")
    assert code == 2 and "another policy than the one/s1" in err
    code, _, err = vispeg("gap", "--records", "a/episodes.jsonl", "b/episodes.jsonl", "--out", "h")
    assert code == 2 and "b/episodes.jsonl: policies: one/s1 stood for another one in the files before" in err
    assert not (tmp_path / "h").exists() and len(err.strip().splitlines()) == 1


def test_episodes_that_saw_other_images_are_not_mixed_with_those_that_see_these(vispeg, tmp_path, played, monkeypatch):
    import cv2

    played(lambda job, seed: True)
    texture = "- {effect: image_texture, where: table, params: {amount: 1, pick: {uniform: [0, 1]}}}"
    (tmp_path / "w.yaml").write_text(f"format: vispeg-world/1\nbase: nominal\neffects:\n{texture}\n")
    for folder, grey in (("a", 10), ("b", 200)):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "x.png"), np.full((8, 8, 3), grey, np.uint8))
    run = ("evaluate", "rgb-S", "--world", "w.yaml", "--videos", "0", "--out", "e")
    monkeypatch.setenv("VISPEG_TEXTURES", str(tmp_path / "a"))
    assert vispeg(*run, "--episodes", "2")[0] == 0
    (tmp_path / "e" / "evaluate.json").unlink()  # as of a run that was stopped
    monkeypatch.setenv("VISPEG_TEXTURES", str(tmp_path / "b"))
    code, _, err = vispeg(*run, "--episodes", "3")
    assert code == 2 and "images: w stood for another one when this folder was begun" in err
    more = ("gap", "rgb-S", "--worlds", "w.yaml", "nominal", "--controls", "none", "--episodes", "2", "--fine-tuned")
    code, _, err = vispeg(*more, "--records", "e/episodes.jsonl", "--out", "g")
    assert code == 2 and "other images for the looks of w" in err and not (tmp_path / "g").exists()
    assert len(read(tmp_path / "e" / "episodes.jsonl")) == 2


def test_a_recorded_episode_is_filmed_without_being_played_and_the_film_says_how_it_ended_this_time(
    vispeg, tmp_path, played
):
    recorded(tmp_path, 0, 1, lost=[1])
    jobs = played(lambda job, seed: True)
    code, _, err = vispeg(*TWO, "--episodes", "2", "--videos", "1", "--out", "g")
    assert code == 0 and not jobs, err
    (pair,) = json.loads((tmp_path / "g/media.json").read_text())
    assert (pair["policy"], pair["seed"]) == ("expert", 1_000_001)
    assert [s["world"] for s in pair["sides"]] == ["nominal", "unknown_hole"]
    assert all((tmp_path / "g" / s["video"]).stat().st_size > 200 for s in pair["sides"])
    outcomes = [s["outcome"] for s in pair["sides"]]
    assert all(o.startswith("success after") and "99" not in o for o in outcomes), "the record said jam after 99 s"
    assert outcomes[1] in plain((tmp_path / "g/gap.html").read_text())
    values = json.loads((tmp_path / "g/gap.json").read_text())
    assert [r["success"]["value"] for r in values["success"]] == [1.0, 0.5]


@pytest.mark.parametrize(
    ("lost", "filmed"),
    [([], [0, 1]), ([3], [3, 0]), ([1, 2, 3], [1, 2])],
    ids=["nothing is lost", "one is", "more are lost than films asked for"],
)
def test_so_many_seeds_of_every_policy_are_filmed_and_those_that_are_lost_first(
    vispeg, tmp_path, played, monkeypatch, lost, filmed
):
    from vispeg.evaluation.films.media import Clip

    shots = []

    def shoot(job, seed):
        shots.append((job.entrant.name, job.world_name, seed - 1_000_000))
        return Clip(np.zeros((2, 16, 16, 3), np.uint8), None, "success", 1.0)

    monkeypatch.setattr("vispeg.evaluation.films.media.film", shoot)  # which takes seconds for each
    played(lambda job, seed: job.world_name == "nominal" or seed - 1_000_000 not in lost)
    args = ("gap", "expert", "twin=expert", "--worlds", "nominal", "randomized", "--controls", "--episodes", "4")
    code, _, err = vispeg(*args, "--videos", "2", "--out", "g")
    assert code == 0, err
    both = [(p, w, s) for p in ("expert", "twin") for s in filmed for w in ("nominal", "randomized")]
    assert shots == both
    listed = json.loads((tmp_path / "g/media.json").read_text())
    assert [(m["policy"], m["seed"] - 1_000_000) for m in listed] == [
        (p, s) for p in ("expert", "twin") for s in filmed
    ]
    shots.clear()
    assert (
        vispeg("gap", "expert", "--worlds", "nominal", "--controls", "--episodes", "4", "--videos", "1", "--out", "h")[
            0
        ]
        == 0
    )
    assert shots == [("expert", "nominal", 0)]


def small_suite(path, n=9):
    listed = "".join(f"  - {{name: c{i}, task: {{clearance_mm: {1 + 0.1 * i:g}}}}}\n" for i in range(n))
    path.write_text(f"format: vispeg-suite/1\nconfigurations:\n{listed}")


def test_a_suites_run_exits_with_one_on_an_alarm_so_that_it_can_guard_ci(vispeg, tmp_path, played):
    small_suite(tmp_path / "s.yaml")
    common = ("suite", "run", "expert", "--train", "nominal", "--target", "unknown_hole", "--suite", "s.yaml")

    def wins(job, seed, turn=1):
        i = int(job.configuration[1:])
        return seed % 20 < 2 * (i if turn > 0 or job.world_name == "nominal" else 8 - i)

    played(wins)
    code, out, err = vispeg(*common, "--out", "well")
    assert code == 0 and "healthy: r = 1.00" in out, err
    hashes = {w["name"]: w["hash"] for w in json.loads((tmp_path / "well/suite.json").read_text())["worlds"]}
    assert len(hashes) == 2 + 2 * 9 and {len(h) for h in hashes.values()} == {64} and "nominal / c3" in hashes
    assert hashes["unknown_hole"] in (tmp_path / "well/suite.html").read_text()
    played(lambda job, seed: wins(job, seed, -1))
    code, out, err = vispeg(*common, "--out", "ill")
    assert code == 1 and "alarm: r = −1.00" in out and (tmp_path / "ill/suite.html").is_file(), err
    played(lambda job, seed: job.world_name == "nominal" or seed % 3)  # 100 % at home, 66 % in the target, everywhere
    code, out, err = vispeg(*common, "--out", "fallen")
    assert code == 1 and "alarm: expert loses 30 points (" in out and "hardly varies" in out, err


def test_a_suite_against_a_robot_refuses_configurations_that_it_does_not_know(vispeg, tmp_path, played):
    small_suite(tmp_path / "s.yaml")
    trials = [f"expert,{s},{int(s < 2 * i)},c{i}\n" for i in range(9) for s in range(20)]
    args = ("suite", "run", "expert", "--train", "nominal", "--measured", "r.csv", "--suite", "s.yaml", "--out", "g")
    (tmp_path / "r.csv").write_text("policy,seed,outcome,configuration\n" + "".join(trials) + "expert,0,1,c11\n")
    jobs = played(lambda job, s: s % 20 < 2 * int(job.configuration[1:]))
    code, out, err = vispeg(*args)
    assert code == 2 and "does not know the configurations 'c11'" in err and len(err.strip().splitlines()) == 1
    assert not jobs and not (tmp_path / "g").exists()
    (tmp_path / "r.csv").write_text("policy,seed,outcome,configuration\n" + "".join(trials))
    code, out, err = vispeg(*args)
    assert code == 0 and "healthy" in out, err
    hashes = {w["name"]: w["hash"] for w in json.loads((tmp_path / "g/suite.json").read_text())["worlds"]}
    assert hashes["robot"] == "" and hashes["nominal"]


def test_a_suite_says_which_two_worlds_have_one_name(vispeg, tmp_path):
    """Two different worlds, or one with the name of the robot, are not called the same."""
    late = "effects: [{effect: command_delay, params: {delay: 0.02}}]\n"
    for file, name, more in (("a", "rig", ""), ("b", "rig", late), ("c", "robot", "")):
        (tmp_path / f"{file}.yaml").write_text(f"format: vispeg-world/1\nname: {name}\nbase: nominal\n{more}")
    (tmp_path / "r.csv").write_text("policy,seed,outcome,configuration\nexpert,0,1,c0\n")
    for args, words in (
        (
            ("a.yaml", "--target", "b.yaml"),
            "b.yaml: name: two worlds of one name; expected another name than that of a.yaml",
        ),
        (("c.yaml", "--measured", "r.csv"), "--train: the training world has the robot's name"),
        (("a.yaml", "--target", "a.yaml"), "training world and target are the same"),
    ):
        code, _, err = vispeg("suite", "run", "expert", "--train", *args, "--out", "g")
        assert code == 2 and words in err, err


def suite_folder(folder, counts, version, hashes=None):
    from vispeg.evaluation import suite
    from vispeg.evaluation.records import Episode

    episodes = []
    for i, count in enumerate(counts):
        for world in ("S", "T"):
            for s in range(40):
                ok = s < (count if world == "T" else 4 * (i + 1))
                category = "success" if ok else "jam"
                episodes.append(Episode("a", "state", 0, world, f"{world}{i}", s, ok, category, configuration=f"c{i}"))
    append(folder / "episodes.jsonl", episodes)
    (folder / "suite.json").write_text(json.dumps(suite.summarise(episodes, "S", "T", version, hashes)))


def test_the_suites_exit_code_is_one_on_an_alarm_or_a_regression_and_zero_otherwise(vispeg, tmp_path):
    rising = [4 * (i + 1) for i in range(9)]
    suite_folder(tmp_path / "v1", rising, "v1")
    suite_folder(tmp_path / "v2", rising, "v2")
    suite_folder(tmp_path / "fell", [*rising[:-1], 22], "fell")
    suite_folder(tmp_path / "alarm", rising[::-1], "alarm")
    code, out, _ = vispeg("suite", "compare", "v1", "v2", "--out", "c")
    assert code == 0 and "healthy: r = 1.00" in out and "no regression" in out and (tmp_path / "c/suite.html").is_file()
    for opened in (load, load_record):
        with pytest.raises(UserError, match="another kind of result.*vispeg-suite-compare/1"):
            opened(tmp_path / "c")
    code, out, _ = vispeg("suite", "compare", "v1", "v2", "fell")
    assert code == 1 and "fell: a in T, c8" in out and "fell: healthy" in out
    assert vispeg("suite", "compare", "alarm")[0] == 1
    assert vispeg("suite", "compare", "v1")[0] == 0


def test_versions_that_were_made_in_different_worlds_are_not_compared(vispeg, tmp_path):
    for name in ("v1", "v2"):
        suite_folder(tmp_path / name, [4 * (i + 1) for i in range(9)], name, {"S": "aa", "T": f"hash-of-{name}"})
    code, out, err = vispeg("suite", "compare", "v1", "v2")
    assert code == 2 and out == "" and "v1 and v2 were made in different worlds" in err
    assert len(err.strip().splitlines()) == 1


def test_a_list_where_one_is_meant_is_one_line():
    with pytest.raises(UserError, match="measured: exactly one is needed"):
        gap("expert", "nominal", measured=["a.csv", "b.csv"])
