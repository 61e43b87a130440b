"""The rules of a diagnosis stand in one table, are read where they decide, and can be varied."""

import runpy
from pathlib import Path

import pytest

from vispeg.core.rules import RULES, STEPS, rules, varied
from vispeg.diagnosis.selection.accept import threshold

ROOT = Path(__file__).parents[2]
EVERY = [rule for step in STEPS for rule in rules(step)]


def test_the_page_is_that_of_the_rules():
    script = runpy.run_path(str(ROOT / "scripts" / "rules_page.py"))
    assert script["PAGE"].read_text(encoding="utf-8") == script["page"](), "run scripts/rules_page.py"


def test_every_rule_has_one_place_and_says_what_it_decides():
    assert len({rule.name for rule in EVERY}) == len(EVERY) == len(vars(RULES))
    for rule in EVERY:
        assert getattr(RULES, rule.name) == rule.value
        assert rule.decides.endswith(".") and "|" not in rule.decides + rule.evidence
        assert len(rule.commit) == 8 and int(rule.commit, 16) >= 0


def test_a_rule_that_nothing_reads_is_none():
    text = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "vispeg").rglob("*.py"))
    assert [rule.name for rule in EVERY if f"RULES.{rule.name}" not in text] == []


def test_a_rule_has_another_value_while_a_block_lasts():
    scores, level = [4.0, 0.0, 0.0], threshold([4.0, 0.0, 0.0], 60)
    with pytest.raises(ZeroDivisionError), varied(discoveries=2 * RULES.discoveries):
        assert threshold(scores, 60) < level, "twice the false discoveries, a lower bar"
        raise ZeroDivisionError
    assert threshold(scores, 60) == level
    with pytest.raises(KeyError, match="no_rule"), varied(no_rule=1.0):
        pass
