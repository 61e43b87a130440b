"""Joints, contact and pictures of one run: what was hidden is named in its own channel, and in no other."""

import json

import pytest

from vispeg.cli.main import main

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(1800),
]  # three minutes of processor time a case, an encoder a quarter of an hour


def diagnosed(folder, *effects):
    """The record of `vispeg diagnose` on two recordings with these effects, through the command line."""
    for seed, name in enumerate(("a", "b"), 1):
        how = ["--motion", "look-and-insert", "--look", f"S/{seed}", "--fps", "0.5", "--seed", str(seed)]
        main(
            ["record", "peg-cell", *how, "--effects", *effects, "--out", str(folder / name), "--quiet"]
            if effects
            else ["record", "peg-cell", *how, "--out", str(folder / name), "--quiet"]
        )
    here = ["--recording", str(folder / "a"), "--validate", str(folder / "b"), "--threads", "1", "--quiet"]
    main(["diagnose", "peg-cell", *here, "--out", str(folder / "found")])
    return json.loads((folder / "found" / "diagnosis.json").read_text())


def named(record):
    """Channel -> labels of the effects that it named."""
    out = {row["channel"]: set() for row in record["by_channel"]}
    assert set(out) == {"joints", "pictures", "contact"}
    for e in record["effects"]:
        out[e["channel"]].add(f"{e['effect']}({e['where']})")
    return out


def test_nothing_hidden_nothing_named(tmp_path):
    record = diagnosed(tmp_path)
    assert named(record) == {"joints": set(), "pictures": set(), "contact": set()}
    assert record["verdict"] == "adequate", record["reason"]


def test_an_encoders_offset_is_the_arms(tmp_path):
    record = diagnosed(tmp_path, "encoder_offset:joint4:offset=0.012")
    every = set.union(*named(record).values())
    assert every == {"encoder_offset(joint4)"}


def test_a_moved_camera_and_a_rough_contact_are_named_each_in_its_channel(tmp_path):
    hidden = "contact_friction:peg:scale=1.7", "camera_offset:wrist_wide:x=0.004"
    record = diagnosed(tmp_path, *hidden)
    assert named(record) == {
        "joints": set(),
        "pictures": {"camera_offset(wrist_wide)"},
        "contact": {"contact_friction(peg)"},
    }
    rows = [*record["effects"], *(e for row in record["by_channel"] for e in row["record"]["effects"])]
    assert len(rows) == 4 and all({"explains", "without"} <= e.keys() for e in rows), "of every channel"
