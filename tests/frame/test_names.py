"""Names say what a thing is: fewer and fewer are a participle or a pronoun (found, given, one, ...)."""

import ast
from collections import Counter
from pathlib import Path

HOUSE = Path(__file__).parents[2] / "vispeg"
MOST = {  # bindings of each name; lower a number with every one that gets a better name
    "left": 13, "known": 3, "given": 1,  # sides; an option of `vispeg finetune`; a key of diagnosis.json
    "found": 0, "seen": 0, "own": 0, "one": 0, "told": 0, "kept": 0, "shown": 0, "whole": 0,
}  # fmt: skip


def bindings(tree):
    """Names that variables and arguments are given in a tree, each as often as it is bound."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.arg):
            yield node.arg


def test_bindings_are_counted():
    tree = ast.parse("def f(given):\n    left, right = given\n    return [one for one in left if (seen := one)]")
    assert Counter(bindings(tree)) == {"given": 1, "left": 1, "right": 1, "one": 1, "seen": 1}


def test_names_that_say_nothing_become_fewer():
    count = Counter(n for path in HOUSE.rglob("*.py") for n in bindings(ast.parse(path.read_text(encoding="utf-8"))))
    assert {name: count[name] for name in MOST if count[name] > MOST[name]} == {}, "call it what it is"
