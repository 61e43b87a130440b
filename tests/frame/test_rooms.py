"""The house stays readable: small files, small rooms."""

from collections import Counter
from pathlib import Path
from statistics import median

HOUSE = Path(__file__).parents[2] / "vispeg"
FILES = {str(path.relative_to(HOUSE)): path for path in HOUSE.rglob("*.py") if path.name != "__init__.py"}
LINES = {name: len(path.read_text(encoding="utf-8").splitlines()) for name, path in FILES.items()}
MEDIAN, LONGEST, ROOM = 110, 300, 20


def test_half_of_the_files_are_short():
    assert median(LINES.values()) <= MEDIAN


def test_no_file_is_long():
    long = {name: count for name, count in LINES.items() if count > LONGEST}
    assert not long, "one concept a file: move one out"


def test_no_room_is_full():
    rooms = Counter(str(Path(name).parent) for name in FILES)
    full = {room: count for room, count in rooms.items() if count > ROOM}
    assert not full, "make a wing of what belongs together"
