"""One thing is singular, any other number plural."""

from pathlib import Path

import pytest

from vispeg.api.datasets import RenderedDataset
from vispeg.core.counts import count


@pytest.mark.parametrize(("number", "said"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (11, "11 frames")])
def test_a_number_and_its_noun_agree(number, said):
    assert count(number, "frame") == said


def test_a_dataset_of_one_frame_says_so():
    made = RenderedDataset(Path("d"), 1, ("wrist",), 0, 2.0)
    assert [block.text for block in made.summary] == ["1 frame of 1 camera in d; 2 s, 0.5 frames/s"]
