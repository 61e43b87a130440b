"""No circle of imports between files: whoever reads one file never has to come back to it."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in (ROOT / "vispeg").rglob("*.py")
}


def imported(tree, modules):
    """Modules among these that a file imports: at its top, in a function, or for type checkers alone."""
    out = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            out |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            out |= {full if (full := f"{node.module}.{alias.name}") in modules else node.module for alias in node.names}
    return out & set(modules)


def circles(graph):
    """Groups of modules each of which reaches every other."""

    def reach(start, arrows):
        seen, todo = set(), [start]
        while todo:
            for other in arrows.get(todo.pop(), ()):
                if other not in seen:
                    seen.add(other)
                    todo.append(other)
        return seen

    back = {name: {other for other, arrows in graph.items() if name in arrows} for name in graph}
    return {frozenset(reach(name, graph) & reach(name, back) | {name}) for name in graph if name in reach(name, graph)}


def test_a_circle_would_be_noticed():
    assert circles({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) == {frozenset("abc")}
    tree = ast.parse("if TYPE_CHECKING:\n    import b\ndef f():\n    from c import d")
    assert imported(tree, {"b", "c", "c.d"}) == {"b", "c.d"}


def test_no_files_import_each_other_in_a_circle():
    graph = {name: imported(ast.parse(path.read_text(encoding="utf-8")), MODULES) for name, path in MODULES.items()}
    del graph["vispeg"]  # the face names what the package holds, for type checkers alone
    assert not circles(graph), "move the piece that both need into a file below them"
