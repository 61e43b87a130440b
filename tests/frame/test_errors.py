"""The one line that every mistake gets: what, what came, and choices that can be read."""

import pytest

from vispeg.core.effect import REGISTRY, effect
from vispeg.core.errors import MANY, NEAREST, UserError


def test_few_choices_are_all_listed():
    names = [f"joint{i}" for i in range(MANY)]
    assert all(name in str(UserError("no such joint", got="elbow", choices=names)) for name in names)


@pytest.mark.parametrize("got", ["friction", "coulomb_fricton", "xyzzy", "", None])
def test_of_many_choices_the_nearest_are_listed(got):
    assert len(REGISTRY) > MANY
    said = str(UserError("unknown effect", got=got, choices=sorted(REGISTRY), see="`vispeg effects` lists all"))
    named = said.partition("choices: ")[2].partition(";")[0].split(", ")
    assert len(named) == NEAREST and set(named) <= set(REGISTRY)
    assert f"of {len(REGISTRY)} choices" in said and said.endswith("`vispeg effects` lists all")


def test_an_unknown_effect_says_where_all_stand():
    with pytest.raises(UserError, match="did you mean 'coulomb_friction'.*`vispeg effects`") as error:
        effect("coulomb_fricton")
    assert len(str(error.value)) < 300 and "camera_delay" not in str(error.value)


def test_what_a_terminal_would_obey_is_escaped():
    error = UserError("unknown key", file="a\x1b[2J.yaml", choices=["\x08b", "\ud800"])
    assert str(error) == "a\\x1b[2J.yaml: unknown key; choices: \\x08b, \\ud800"
