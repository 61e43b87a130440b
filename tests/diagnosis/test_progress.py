"""A diagnosis that was killed goes on to the very result of one that was not; another's progress is not used."""

from pathlib import Path

import numpy as np
import pytest
from loops import hinge, swings
from typed_record import mistakes

from vispeg.core.errors import UserError
from vispeg.diagnosis.progress import Progress
from vispeg.diagnosis.run import diagnose
from vispeg.diagnosis.schema import DiagnosisRecord
from vispeg.worlds.world import World


class Killed(Exception):
    """What stands for a signal."""


@pytest.fixture(scope="module")
def recordings():
    """A pendulum with dry friction on three swings."""
    return swings(hinge("coulomb_friction", torque=0.8), 3, 4.5)


def run(recordings, progress=None):
    world = World(recordings[0].robot)
    return diagnose(world, recordings[:2], recordings[2:], nthread=1, plan_next=False, progress=progress)


class Counted(Progress):
    """Progress that counts the answers that it has to work out, and is killed where it would work out one too many."""

    def __init__(self, file: Path | None = None, key: str = "", most: int = 10**9):
        super().__init__(file, key)
        self.worked_out, self.most = [], most

    def recall(self, question, work_out):
        """Recall the answer, or count it and work it out."""

        def counted():
            if len(self.worked_out) == self.most:
                raise Killed
            self.worked_out.append(str(question))
            return work_out()

        return super().recall(question, counted)


@pytest.mark.slow
def test_killed_and_run_again_ends_the_same(recordings, tmp_path):
    file = tmp_path / "part" / "progress.json"
    counted = Counted()
    whole = run(recordings, counted)
    assert len(whole.record["ladder"]) > 1, whole.record["reason"]
    assert mistakes(DiagnosisRecord, whole.record) == []
    assert mistakes(DiagnosisRecord, {**whole.record, "verdict": None, "more": 1}) == [
        "record.more is unknown",
        "record.verdict: None is no str",
    ]

    half = len(counted.worked_out) // 2
    with pytest.raises(Killed):
        run(recordings, Counted(file, "mine", half))
    assert file.is_file()
    progress = Counted(file, "mine")
    assert progress.resumed == half > 1
    again = run(recordings, progress)
    assert again.record == whole.record and again.world == whole.world
    for name, values in whole.arrays.items():
        np.testing.assert_array_equal(again.arrays[name], values, err_msg=name)
    assert len(progress.worked_out) == len(counted.worked_out) - half
    progress.remove()
    assert not file.parent.exists()


def test_progress_of_other_inputs_is_not_used(tmp_path):
    file = tmp_path / "progress.json"
    assert Progress(file, ["a", 1]).recall("question", lambda: [0.1, 1 / 3]) == [0.1, 1 / 3]
    assert Progress(file, ["a", 1]).recall("question", lambda: "not asked") == [0.1, 1 / 3]
    assert Progress(file, ["a", 2]).recall("question", lambda: "asked again") == "asked again"
    assert Progress(file, ["a", 2]).recall("another question", lambda: 7) == 7


def test_a_part_of_a_part_has_answers_of_its_own():
    whole = Progress()
    parts = [whole, whole.part("joints"), whole.part("baseline"), whole.part("joints").part("baseline")]
    assert [part.recall("question", lambda k=k: k) for k, part in enumerate(parts)] == [0, 1, 2, 3]
    assert whole.part("joints").part("baseline").recall("question", lambda: "not asked") == 3


def test_a_spoilt_file_is_said(tmp_path):
    file = tmp_path / "progress.json"
    file.write_text('{"key": ')
    with pytest.raises(UserError, match="remove it to begin anew"):
        Progress(file, "mine")
