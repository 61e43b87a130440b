"""Makes the modules beside these folders importable from the tests here."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
