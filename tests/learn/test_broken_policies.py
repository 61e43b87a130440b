"""Every broken policy is refused in one line, by every command that takes one, and nothing is left behind."""

import json
import shutil

import mutations
import pytest
import torch
from safetensors.torch import load_file, save_file

from vispeg.cli.main import main
from vispeg.core.errors import UserError
from vispeg.learn.coarse_to_fine import combine, open_policy
from vispeg.learn.policy import load
from vispeg.learn.record import WEIGHTS
from vispeg.learn.shipped import META, names, policy_folder

EVERY = 5  # of the changes, so that the test is quick; the slow one tries all


@pytest.fixture
def folder(tmp_path):
    """A policy that sees, with everything that a record may say."""
    folder = shutil.copytree(policy_folder("depth-S-randomized"), tmp_path / "p")
    record = json.loads((folder / META).read_text())
    task = {key: record["meta"]["task"][key] for key in ("stack", "dof", "cameras", "image_size", "clearance_mm")}
    kept = {key: record["meta"].get(key) for key in ("world", "world_hash", "seed")} | {"task": task}
    told = kept | {"world_hashes": ["a"], "world_parts": {"b": "looks"}, "finetuned": {"world": "S", "world_hash": "c"}}
    (folder / META).write_text(json.dumps(record | {"meta": told}))
    return folder


@pytest.fixture(params=[EVERY, pytest.param(1, marks=pytest.mark.slow)], ids=["some", "all"])
def every(request):
    return request.param


def test_every_change_of_a_record(folder, every):
    found = {}
    for what in mutations.json_files(folder / META, every):
        found[what] = mutations.tried(lambda: open_policy(folder))
    assert not mutations.unclear(found) and len(found) > 400 / every
    assert all(how != "fine" for what, how in found.items() if what.endswith(("= nan", "= inf")))
    assert all(how != "fine" for what, how in found.items() if "layout.images" in what and "=" in what)


def test_every_file_that_is_none(folder):
    found = {}
    for what in mutations.files(folder, [META, WEIGHTS]):
        found[what] = mutations.tried(lambda: open_policy(folder))
    assert not mutations.unclear(found) and "fine" not in found.values()


def test_a_broken_pair_is_refused_too(tmp_path, every):
    combine(policy_folder("depth-S"), policy_folder("state-0.5mm"), 0.006, tmp_path / "both")
    record = json.loads((tmp_path / "both" / META).read_text())
    (tmp_path / "both" / META).write_text(json.dumps(record | {"meta": {}}))
    changes = mutations.json_files(tmp_path / "both" / META, every)
    found = {what: mutations.tried(lambda: open_policy(tmp_path / "both")) for what in changes}
    assert not mutations.unclear(found)
    assert mutations.tried(lambda: load(tmp_path / "both")).endswith("expected one network (vispeg-policy/1)")
    shutil.rmtree(tmp_path / "both/fine")
    assert "no such policy" in mutations.tried(lambda: open_policy(tmp_path / "both"))


def test_every_shipped_policy_says_its_weights_hash():
    for name in names():
        record = json.loads((policy_folder(name) / META).read_text())
        assert record.get("weights", "").startswith("sha256:"), f"run: scripts/hash_policies.py assets/policies/{name}"


def poison(folder):
    """Weights that are not finite, under their own hash."""
    weights = load_file(folder / WEIGHTS)
    name = sorted(weights)[1]
    weights[name].view(-1)[0] = torch.nan
    save_file(weights, folder / WEIGHTS)
    forget(folder)
    return name


def forget(folder):
    """A record of before, which does not say the weights' hash."""
    record = json.loads((folder / META).read_text())
    del record["weights"]
    (folder / META).write_text(json.dumps(record))


def swap(folder):
    """Weights of the same shapes that are another policy's."""
    shutil.copy(policy_folder("depth-S") / WEIGHTS, folder / WEIGHTS)


def test_other_weights_of_the_same_shapes_are_told_where_the_record_says_its_own(folder):
    swap(folder)
    with pytest.raises(UserError, match="are not the weights of the policy.json beside them; expected sha256:"):
        load(folder)
    forget(folder)
    assert load(folder).modality == "depth"


def test_weights_that_are_not_finite_are_named(folder):
    name = poison(folder)
    with pytest.raises(UserError, match=f"{WEIGHTS}: {name}: holds weights that are not finite"):
        load(folder)


COMMANDS = [
    "evaluate p --episodes 1 --out out",
    "gap p --worlds S N --episodes 1 --out out",
    "suite run p --train S --target N --out out",
    "perturb p --world S --episodes 1 --out out",
    "sensitivity p --world S --sweep latency --episodes 1 --out out",
    "exploit p --world S --out out",
    "play p --out out",
    "export p --out out.onnx",
    "combine p state-0.5mm --out out",
    "finetune p --world N --out out",
    "finetune depth-S --world N --teacher p --out out",
    "train peg-depth --recipe distill --teacher p --distill-steps 8 --out out",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_it_and_leaves_nothing_behind(folder, command, monkeypatch, capsys):
    poison(folder)
    monkeypatch.chdir(folder.parent)
    assert main(command.split()) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and "not finite" in lines[0], lines
    assert [path.name for path in folder.parent.iterdir()] == ["p"]
