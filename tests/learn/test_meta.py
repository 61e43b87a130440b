"""Records carry every world that a policy learned in, and evaluation refuses it there and where a part is the same."""

import json

import pytest
from test_train import Pointing
from toy import Reach

from vispeg.core.errors import UserError
from vispeg.core.files import write_text_atomic
from vispeg.datasets.describe import INFO, RENDER, RENDER_FILE
from vispeg.datasets.layout import COUNTED, VERSION
from vispeg.datasets.lerobot import DATA
from vispeg.evaluation.entrants import entrant, refuse_trained_on
from vispeg.learn.coarse_to_fine import combine
from vispeg.learn.experience.shown import made_in
from vispeg.learn.layout import Layout
from vispeg.learn.meta import interface, worlds
from vispeg.learn.methods.finetune import FinetuneSettings, finetune
from vispeg.learn.modalities import modality
from vispeg.learn.networks.actor import Actor
from vispeg.learn.policy import load, save
from vispeg.task.peg.config import PegConfig
from vispeg.task.world_file import load_world, parts

S, VNP, DEV = load_world("S"), load_world("VNP"), load_world("dev")


class Staged(Reach):
    """The toy, said to stand in a world."""

    def __init__(self, rows, file):
        super().__init__(rows, "depth")
        self.file, self.config = file, PegConfig()


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A policy of S, as old records tell it, fine-tuned in VNP on a few demonstrations and on some in dev."""
    place, env, seen = tmp_path_factory.mktemp("policies"), Reach(1, "depth"), modality("depth")
    layout = Layout.of(env.single_observation_space, env.single_action_space, seen.kinds)
    save(place / "old", Actor(layout, seen, (8,)), "depth", {"world": "S", "world_hash": "of S as it was"})
    settings = FinetuneSettings(demos=3, updates=2, known=0.2, known_steps=20, batch=16, shift=0, episodes=2)
    target, known = (lambda rows, given, file=file: Staged(rows, file) for file in (VNP, DEV))
    finetune(place / "old", place / "new", target, known, lambda env: Pointing(), settings, 0, say=lambda line: None)
    return place


def test_a_fine_tuned_policy_is_refused_where_it_was_tuned(tuned):
    old, new = entrant(str(tuned / "old")), entrant(str(tuned / "new"))
    refuse_trained_on([old], "VNP", VNP.hash)
    with pytest.raises(UserError, match="new was trained in VNP.*no transfer"):
        refuse_trained_on([new], "VNP", VNP.hash)
    with pytest.raises(UserError, match="new was trained in dev"):
        refuse_trained_on([new], "dev", DEV.hash)
    for name, part in (("V", "looks-unseen"), ("N", "sensor-unseen"), ("P", "plant")):
        with pytest.raises(UserError, match=f"new was trained with {part}, which {name} has too"):
            refuse_trained_on([new], name, load_world(name).hash)
    refuse_trained_on([old, new], "S", S.hash)
    assert new.trained_on == ("of S as it was", VNP.hash, DEV.hash)
    assert dict(new.parts) == parts("S") | parts("VNP") | parts("dev")


def test_fine_tuned_again_and_combined_it_is_still_refused(tuned, tmp_path):
    settings = FinetuneSettings(demos=3, updates=2, known=0.0, batch=16, shift=0, episodes=2)

    def target(rows, given):
        return Staged(rows, DEV)

    args = (tuned / "new", tmp_path / "again", target, None, lambda env: Pointing(), settings, 0)
    finetune(*args, say=lambda line: None)
    combine(tuned / "old", tmp_path / "again", 0.01, tmp_path / "both")
    for name in ("again", "both"):
        with pytest.raises(UserError, match="was trained in VNP"):
            refuse_trained_on([entrant(str(tmp_path / name))], "VNP", VNP.hash)


def test_a_record_of_before_that_was_fine_tuned_is_understood(tuned):
    meta = dict(load(tuned / "new").meta)
    del meta["world_hashes"], meta["world_parts"], meta["finetuned"]["world_parts"]
    found = worlds(meta)
    assert found["world_hashes"] == ["of S as it was", VNP.hash]
    assert found["world_parts"] == parts("S") | parts("VNP")
    assert worlds({}) == worlds({"finetuned": None, "world": "mars"}) == {"world_hashes": [], "world_parts": {}}


def test_a_datasets_world_counts_as_one_that_was_learned_in(tmp_path):
    info = {"codebase_version": VERSION, "features": COUNTED, "total_frames": 1, "fps": 1}
    plan = {"world": "VNP", "world_hash": "its"}
    for name, said in ((INFO, {**info, "data_path": DATA}), (RENDER, {"format": RENDER_FILE.name, "plan": plan})):
        write_text_atomic(tmp_path / name, json.dumps(said))
    assert worlds(made_in(tmp_path)) == {"world_hashes": ["its"], "world_parts": parts("VNP")}
    mine = tmp_path / "mine.yaml"
    mine.write_text("format: vispeg-world/1\nbase: VNP\n")
    plan = {"world": str(mine), "world_hash": load_world(mine).hash}
    write_text_atomic(tmp_path / RENDER, json.dumps({"format": RENDER_FILE.name, "plan": plan}), overwrite=True)
    assert set(parts("VNP")) <= set(worlds(made_in(tmp_path))["world_parts"]), "those of a file of one's own"
    mine.write_text("format: vispeg-world/1\nbase: nominal\n")
    assert worlds(made_in(tmp_path))["world_parts"] == {}, "those of a file that has changed are unknown"
    (tmp_path / RENDER).unlink()
    assert worlds(made_in(tmp_path)) == worlds({}), "another's dataset does not say"


def test_what_a_policy_was_made_for_is_kept_in_every_world():
    task = json.loads(json.dumps({"stack": 3, "cameras": ["a"], "image_size": 16, "steps": 9, "turn": None}))
    assert interface({"task": task}) == {"stack": 3, "cameras": ("a",), "image_size": 16}
    assert interface({}) == {}
