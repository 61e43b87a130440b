"""Rewrites the tables of docs/rules.md from vispeg/core/rules.py.

python scripts/rules_page.py
"""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from vispeg.core.rules import STEPS, Rule, rules

PAGE = Path(__file__).resolve().parents[1] / "docs" / "rules.md"


def row(rule: Rule) -> str:
    """Return a rule as a row of a table."""
    values = rule.value if isinstance(rule.value, tuple) else (rule.value,)
    cells = (f"`{rule.name}`", ", ".join(f"{v:g}" for v in values), rule.decides, rule.channel, rule.evidence)
    return "| " + " | ".join(cells) + " |"


def page() -> str:
    """Return the page: its present introduction, and a new table for each step."""
    parts = [PAGE.read_text(encoding="utf-8").split("\n## ", 1)[0].rstrip()]
    for step in STEPS:
        head = ["| rule | value | decides | channel | why |", "|---|---|---|---|---|"]
        parts.append(f"## {step.__name__}\n\n{step.__doc__}\n\n" + "\n".join([*head, *map(row, rules(step))]))
    return "\n\n".join(parts) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
