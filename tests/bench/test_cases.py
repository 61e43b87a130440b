"""The case list: large enough, deterministic, nothing given away in names of folders or files."""

import numpy as np
import pytest
import yaml
from cases import DEV, GRID, SIZES, cases, choose
from make import folders, make

from vispeg.core.errors import UserError


def test_standard_list_covers_every_effect_at_three_sizes():
    found = cases()
    assert len(found) >= 160
    assert len({c.key for c in found}) == len(found)
    for effect, (places, _) in GRID.items():
        names = {c.name for c in found}
        assert {f"{effect}/{where}/{size}" for where in places for size in SIZES} <= names
    kinds = [c.kind for c in found]
    assert kinds.count("none") == 40 and kinds.count("pair") == 25 and kinds.count("unknown") >= 21


def test_same_seed_same_cases_and_scored_differ_from_dev():
    assert cases() == cases()
    scored, dev = cases(), cases(DEV)
    assert [c.name for c in scored] == [c.name for c in dev]
    assert not {c.key for c in scored} & {c.key for c in dev}
    assert all(a.hidden != b.hidden for a, b in zip(scored, dev, strict=True) if a.hidden)


def test_larger_means_larger():
    by = {c.name: c for c in cases()}
    small, large = (by[f"coulomb_friction/joint4/{s}"].hidden[0].params["torque"] for s in ("small", "large"))
    assert large > 4.0 * small


def test_limit_thins_evenly_and_a_misspelling_is_explained():
    few = choose((), DEV, limit=10)
    assert len(few) == 10 and {c.kind for c in few} >= {"single", "none"}
    with pytest.raises(UserError, match="no case matches"):
        choose(("colomb_friction/*",), DEV)


def test_recordings_do_not_give_the_secret_away(tmp_path, monkeypatch):
    monkeypatch.setattr("make.DURATION", 1.5)
    (case,) = choose(("backlash/joint3/large",), DEV)
    make(tmp_path, [case], say=lambda text: None)
    for folder in folders(tmp_path, case):
        text = (folder / "recording.yaml").read_text()
        head, first = yaml.safe_load(text), (folder / "samples.csv").read_text().splitlines()
        assert not any(word in text + str(folder.relative_to(tmp_path)) for word in ("backlash", "joint3/", "large"))
        assert head["format"] == "vispeg-recording/1" and head["torque_sensor"] == "joint"
        table = np.array([[float(x) for x in line.split(",")] for line in first[1:]])
        assert table.shape == (750, len(first[0].split(","))) and (np.diff(table[:, 0]) > 0.0).all()


def test_cases_of_many_effects_hide_six_to_twenty_places_once_each():
    from cases import FEWEST, MANY_COUNT, MOST, UNKNOWN, many

    found = many()
    assert len(found) == MANY_COUNT and found == many() and found != many(DEV)
    assert sum(c.kind == "strange" for c in found) == 5
    for case in found:
        library = [(h.effect, h.where) for h in case.hidden if h.effect not in UNKNOWN]
        assert FEWEST <= len(library) <= MOST and len(set(library)) == len(library)
        assert (len(case.hidden) > len(library)) == (case.kind == "strange")
