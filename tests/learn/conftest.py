"""The toy task and what the tests of learning share."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]  # so that tests find toy.py, mutations.py
