"""Values in files of worlds and models that are no values."""

from __future__ import annotations

import pytest

from vispeg.core.errors import UserError
from vispeg.worlds.distribution import Choice, Uniform, parse
from vispeg.worlds.model_file import load_model

HUGE = 10**400  # YAML reads an integer of any length; no float holds it


@pytest.mark.parametrize(
    "raw", [HUGE, -HUGE, {"uniform": [0, HUGE]}, {"choice": [HUGE]}, {"normal": [0, float("nan")]}]
)
def test_a_number_that_no_float_holds_is_refused_in_one_line(raw):
    with pytest.raises(UserError, match=r"w.yaml.*params\.scale"):
        parse(raw, "w.yaml", "params.scale")


def test_integers_and_floats_are_numbers():
    assert parse(3) == 3.0
    assert parse({"uniform": [0, 1.5]}) == Uniform(0.0, 1.5) and parse({"choice": [1, 2]}) == Choice((1.0, 2.0))


@pytest.mark.parametrize("origin", ["hello", "[1, 2]"])
def test_an_origin_that_is_no_mapping_is_refused(tmp_path, origin):
    file = tmp_path / "model.yaml"
    entry = "{effect: viscous_friction, where: joint2, params: {damping: 1.0}, origin: %s}"
    file.write_text("format: vispeg-model/1\nrobot: iiwa14\neffects:\n- " + entry % origin + "\n")
    with pytest.raises(UserError, match=r"effects\[0\]\.origin: wrong origin.*a mapping"):
        load_model(file)
    file.write_text("format: vispeg-model/1\nrobot: iiwa14\neffects:\n- " + entry % "{from: fit}" + "\n")
    assert load_model(file).effects[0].origin == {"from": "fit"}
