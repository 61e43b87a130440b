"""The public face: names load on use, in any order, with types; README, reference and `__all__` agree."""

import re
import subprocess
import sys
from itertools import permutations
from pathlib import Path

import pytest

import vispeg

ROOT = Path(__file__).parents[2]


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_the_package_imports_no_room():
    assert python("import sys, vispeg; print([m for m in sys.modules if m.startswith('vispeg.')])").strip() == "[]"


@pytest.mark.parametrize("name", vispeg.__all__)
def test_a_name_is_there_and_documented(name):
    value = getattr(vispeg, name)
    assert value.__doc__ and name in dir(vispeg)
    if name != "effects":
        assert value.__name__ == name
        reference = (ROOT / "docs/reference/python.md").read_text(encoding="utf-8")
        assert f"\n::: {value.__module__}.{name}\n" in reference


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'diagnoze'"):
        vispeg.diagnoze  # noqa: B018  # reading it is the test


def test_type_checkers_see_the_names_that_there_are():
    text = (ROOT / "vispeg/__init__.py").read_text(encoding="utf-8").split("if TYPE_CHECKING:")[1].split("\n\n")[0]
    found = re.findall(r"from (\S+) import (\w+) as (\w+)$", text, re.MULTILINE)  # without `as` a name is not public
    assert sorted(name for _, name, _ in found) == sorted(name for _, _, name in found) == sorted(vispeg.__all__)
    assert all(vispeg._PLACES.get(name, "vispeg") == module for module, name, _ in found)


FIRST = {
    "core": "from vispeg.core.effect import effect",
    "words": "from vispeg.worlds.words import place",
    "world": "import vispeg; vispeg.World",
    "room": "import vispeg.effects.joint.coulomb_friction",
}


@pytest.mark.parametrize("order", list(permutations(FIRST, 2)), ids="-".join)
def test_effects_enrol_in_any_order_of_imports(order):
    code = "\n".join(FIRST[name] for name in order)
    said = python(f"{code}\nfrom vispeg.core.effect import REGISTRY\nprint(len(REGISTRY), 'payload' in REGISTRY)")
    from vispeg.core.effect import REGISTRY

    own = [n for n, e in REGISTRY.items() if type(e).__module__.startswith("vispeg.effects.")]
    assert said.split() == [str(len(own)), "True"]


def test_an_effect_of_ones_own_cannot_take_a_name_of_the_library():
    code = (
        "from vispeg.core.effect import Effect\nclass Mine(Effect):\n    name, family, params = 'payload', 'body', {}\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=120)
    assert done.returncode != 0 and "'payload' is registered twice" in done.stderr
