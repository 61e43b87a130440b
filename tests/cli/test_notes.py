"""Notes in Python are the one line that the command prints, once; filters of warnings hold for them."""

import shutil
import subprocess
import sys
import warnings

import pytest

from vispeg.cli.main import main
from vispeg.core.notes import Note, note

SCRIPT = """
import warnings
from vispeg.core.notes import note
for _ in range(2):
    note("rig: unknown columns are ignored: x,\\n y")
warnings.warn("another library's")
"""


def test_a_note_is_one_line_without_a_place_in_the_source_and_comes_once():
    said = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=True).stderr
    first, other = said.splitlines()[:2]
    assert first == "vispeg: note: rig: unknown columns are ignored: x, y"
    assert other.endswith("UserWarning: another library's")


def test_filters_of_warnings_hold_for_notes():
    with warnings.catch_warnings():
        warnings.simplefilter("error", Note)
        with pytest.raises(Note, match="as an error"):
            note("as an error")


@pytest.mark.parametrize("filters", ["ignore", "error", "always"])
def test_a_commands_notes_are_its_output_whatever_the_filters(rigs, tmp_path, capsys, filters):
    folder = tmp_path / "rig"
    shutil.copytree(rigs["nominal"], folder)
    header = folder / "recording.yaml"
    header.write_text(header.read_text() + "shoe_size: 42\n")
    with warnings.catch_warnings():
        warnings.simplefilter(filters)
        before = warnings.showwarning
        assert main(["check", str(folder)]) == 0
        assert warnings.showwarning is before
    said = f"vispeg: note: {header}: unknown keys are ignored: shoe_size"
    assert capsys.readouterr().err.splitlines().count(said) == 1
