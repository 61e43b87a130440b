"""The toy task and what the tests of learning share."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
sys.path.insert(0, str(Path(__file__).parent))  # so that tests find toy.py
