"""A policy is judged at the clearance that is asked for, and it is said when that is not its own."""

import json

import pytest

from vispeg.api.films import played_in
from vispeg.api.gap import gap
from vispeg.cli.main import main
from vispeg.cli.tolerance import at_tolerance
from vispeg.core.assets import assets
from vispeg.core.notes import Note
from vispeg.evaluation.entrants import entrants
from vispeg.evaluation.records import read
from vispeg.task.world_file import load_world


@pytest.mark.parametrize(("more", "told"), [((), "here it is 3 mm"), (("--clearance", "0.5"), "")])
def test_another_clearance_is_told_and_the_folder_has_a_name(capsys, tmp_path, monkeypatch, more, told):
    pytest.importorskip("torch")
    monkeypatch.chdir(tmp_path)
    args = ["evaluate", "state-0.5mm", "--world", "nominal", "--episodes", "2", "--videos", "0", "--quiet", *more]
    assert main(args) == 0
    assert told in capsys.readouterr().err
    (episode, _) = read(tmp_path / "evaluated" / "state-0.5mm-nominal" / "episodes.jsonl")
    assert episode.success


def test_a_gap_tells_of_a_clearance_that_a_policy_was_not_made_for():
    pytest.importorskip("torch")
    asked = {"controls": "none", "episodes": 1}
    with pytest.warns(Note, match="state-0.5mm was made for 0.5 mm, in nominal it is 3 mm"):
        found = gap(["state-0.5mm", "expert"], ["nominal", "unknown_hole"], **asked)
    assert len([said for said in found.record["notes"] if "was made for" in said]) == 2, "one for each world"


def test_a_policy_is_played_at_its_own_clearance_in_its_own_world():
    pytest.importorskip("torch")
    policy = assets() / "policies" / "state-0.5mm"
    assert played_in(policy) == ("randomized", {"clearance_mm": 0.5})
    assert played_in(policy, "nominal") == ("nominal", {})
    assert played_in(policy, tolerance=2.0) == ("randomized", {"clearance_mm": 2.0})


def test_a_policy_that_does_not_say_what_it_was_made_for_is_taken_as_it_is(capsys, tmp_path):
    record = json.loads((assets() / "policies" / "state-3mm" / "policy.json").read_text())
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "policy.json").write_text(json.dumps(record | {"meta": {}}))
    who, world = entrants([str(tmp_path / "mine"), "state-0.5mm"]), load_world("searching")
    assert [e.tolerance for e in who] == [None, 0.5]
    assert at_tolerance(who, world, 2.0) == {"clearance_mm": 2.0}
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("state-0.5mm was made for 0.5 mm, here it is 2 mm")
