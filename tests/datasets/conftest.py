"""Makes the helpers in this folder, and those that all tests share, importable from the tests beside them."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
