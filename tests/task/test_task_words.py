"""The package speaks of its first task in that task's rooms: elsewhere the words are on a list that only shrinks."""

import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "vispeg"
WORD = re.compile(r"(?i:(?<![a-z])(peg|hole|clearance)s?(?![a-z]))|(?<![A-Za-z])Peg[A-Z]")
ROOMS = ("task/peg/", "effects/task/", "robots/")  # the task, effects of its family, its cell
ELSEWHERE = {  # file: the one literal in it, a word of commands and files that stay as they are
    "recordings/cell.py": "peg-cell",  # in model files and commands: the cell that each recording states
    "recordings/regimes.py": '"hole"',  # in JSON of `vispeg check`: the regime of what is inserted
    "effects/camera/depth/grazing_holes.py": "grazing_holes",  # an effect of world files; depth images have such holes
    "evaluation/outlook.py": "peg insertion",  # a row of the article's table
    "cli/tolerance.py": "--clearance",  # the option that sets the tolerance of any task
}


def speaking(but=ELSEWHERE):
    """Files outside the rooms that say one of the words, beside what `but` says of each."""
    files = {p.relative_to(PACKAGE).as_posix(): p.read_text() for p in PACKAGE.rglob("*.py")}
    texts = {name: text.replace(but.get(name, "\0"), "") for name, text in files.items()}
    return {name for name, text in texts.items() if not name.startswith(ROOMS) and WORD.search(text)}


def test_no_other_file_says_peg_hole_or_clearance():
    assert not speaking(), "a file of any task names this one's parts: ask the contract or the scene"


def test_the_list_has_no_file_that_is_clean():
    assert not set(ELSEWHERE) - speaking(but={}), "take these off the list"


def test_the_contract_and_what_learns_by_it_name_no_part_of_a_task():
    clean = [
        "task/contract.py",
        "task/terms.py",
        "task/rewards.py",
        "task/environments/track.py",
        "task/standard_terms.py",
    ]
    clean += [
        "task/standard_rewards.py",
        "task/environments/simulation.py",
        "task/cell.py",
        "task/eyes.py",
        "task/environments/env.py",
    ]
    clean += [
        "learn/teacher.py",
        "learn/methods/sac.py",
        "learn/train.py",
        "learn/layout.py",
        "learn/networks/actor.py",
    ]
    clean += [
        "learn/methods/clone.py",
        "learn/coarse_to_fine.py",
        "learn/play.py",
        "learn/experience/replay.py",
        "demonstrations/stage.py",
    ]
    clean += ["demonstrations/plan.py", "evaluation/arena.py", "evaluation/players.py", "evaluation/films/media.py"]
    assert not speaking(but={}) & set(clean)
