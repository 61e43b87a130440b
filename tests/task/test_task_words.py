"""The package speaks of its first task in that task's rooms: elsewhere the words are on a list that only shrinks."""

import re
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "vispeg"
WORD = re.compile(r"(?<![a-z])(peg|hole|clearance)s?(?![a-z])|Peg[A-Z]", re.IGNORECASE)
ROOMS = ("task/peg/", "effects/task/", "robots/")  # the task, effects of its family, its cell
ELSEWHERE = {
    "__init__.py",
    "api/catalogue.py",
    "api/recording/contact.py",
    "api/recording/look.py",
    "api/recording/cell.py",
    "cli/learning/combine.py",
    "cli/evaluation/evaluate.py",
    "cli/evaluation/trials.py",
    "cli/evaluation/exploit.py",
    "cli/evaluation/gap.py",
    "cli/measuring/measure.py",
    "cli/measuring/measure_object.py",
    "cli/recordings/motions.py",
    "cli/evaluation/perturb.py",
    "cli/learning/play.py",
    "cli/recordings/record.py",
    "cli/evaluation/suite.py",
    "cli/learning/train.py",
    "datasets/formats/bop.py",
    "datasets/example.py",
    "effects/camera/depth/depth_dropout.py",
    "effects/camera/depth/grazing_holes.py",
    "effects/contact/contact_friction.py",
    "effects/contact/fixture_compliance.py",
    "evaluation/controls.py",
    "evaluation/entrants.py",
    "evaluation/stress/exploit.py",
    "evaluation/stress/perturb.py",
    "evaluation/stress/sensitivity.py",
    "learn/config.py",
    "learn/methods/curriculum.py",
    "learn/meta.py",
    "recordings/cell.py",
    "recordings/checks/contact_check.py",
    "recordings/importers/lerobot_video.py",
    "recordings/regimes.py",
    "report/gap/words.py",
    "task/__init__.py",
    "task/registry.py",
    "task/environments/vector.py",
    "vision/excites.py",
}


def speaking():
    """Files outside the rooms that say one of the words."""
    files = {p.relative_to(PACKAGE).as_posix(): p for p in PACKAGE.rglob("*.py")}
    return {name for name, p in files.items() if not name.startswith(ROOMS) and WORD.search(p.read_text())}


def test_no_other_file_says_peg_hole_or_clearance():
    assert speaking() <= ELSEWHERE, "a file of any task names this one's parts: ask the contract or the scene"


def test_the_list_has_no_file_that_is_clean():
    assert not ELSEWHERE - speaking(), "take these off the list"


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
    clean += ["demonstrations/plan.py", "evaluation/arena.py", "evaluation/players.py", "evaluation/films/film.py"]
    assert not speaking() & set(clean)
