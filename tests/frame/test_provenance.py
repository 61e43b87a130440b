"""A result's origin: digests depend on content and names inside, and on nothing else."""

import hashlib
import json
import shlex
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from vispeg.api.inputs import read_inputs
from vispeg.core.errors import UserError
from vispeg.core.provenance import digest, provenance
from vispeg.recordings.frames.camera import RecordedCamera
from vispeg.recordings.frames.frames import Frames, RecordedFrame
from vispeg.recordings.recording import Control, Recording, Signal
from vispeg.robots.model import load

FILES = {"recording.yaml": b"format: x\n", "samples.csv": b"time\n0\n", "frames/0.png": b"\x89PNG", "empty": b""}


def folder(path, files):
    for name, data in files.items():
        (path / name).parent.mkdir(parents=True, exist_ok=True)
        (path / name).write_bytes(data)
    return path


def test_file_digest_is_sha256_of_its_bytes(tmp_path):
    (tmp_path / "f").write_bytes(b"abc")
    # FIPS 180-2, appendix B.1
    assert digest(tmp_path / "f") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"


def test_folder_digest_evaluated_independently(tmp_path):
    lines = sorted((name, hashlib.sha256(data).hexdigest()) for name, data in FILES.items())
    text = "".join(f"{sha}  {name}\n" for name, sha in lines)
    assert digest(folder(tmp_path / "a", FILES)) == hashlib.sha256(text.encode()).hexdigest()


def test_folder_digest_ignores_its_name_and_the_order_of_writing(tmp_path):
    backwards = dict(reversed(FILES.items()))
    assert digest(folder(tmp_path / "a", FILES)) == digest(folder(tmp_path / "b", backwards))


@pytest.mark.parametrize("change", ["content", "rename", "swap", "remove", "add", "move"])
def test_any_change_inside_changes_the_digest(tmp_path, change):
    files = dict(FILES)
    if change == "content":
        files["samples.csv"] = b"time\n1\n"
    elif change == "rename":
        files["sample.csv"] = files.pop("samples.csv")
    elif change == "swap":
        files["samples.csv"], files["recording.yaml"] = files["recording.yaml"], files["samples.csv"]
    elif change == "remove":
        del files["empty"]
    elif change == "add":
        files["also"] = b""
    else:
        files["0.png"] = files.pop("frames/0.png")
    assert digest(folder(tmp_path / "a", FILES)) != digest(folder(tmp_path / "b", files))


def test_provenance_repeats_the_command_and_names_versions(tmp_path):
    a, b = folder(tmp_path / "a", FILES), folder(tmp_path / "b", {"x": b"1"})
    argv = ["vispeg", "diagnose", "my robot.xml", "--out", "o'ut"]
    record = provenance(argv, 7, [b, a])
    assert shlex.split(record["command"]) == argv
    as_module = provenance(["/some/where/vispeg/__main__.py", *argv[1:]], 7, [])
    assert as_module["command"] == record["command"], "a folder of this machine is no part of the command"
    assert record["seed"] == 7
    assert record["versions"]["numpy"] == metadata.version("numpy")
    assert set(record["versions"]) == {"vispeg", "python", "mujoco", "numpy", "scipy", "cma"}
    assert record["inputs"] == {str(a): f"sha256:{digest(a)}", str(b): f"sha256:{digest(b)}"}
    assert json.dumps(record) == json.dumps(provenance(argv, 7, [a, b])), "the order of the inputs does not matter"


def test_missing_input_is_the_users_to_put_right(tmp_path):
    with pytest.raises(UserError, match="nowhere.*cannot be read"):
        provenance([], None, [tmp_path / "nowhere"])


def changed(array, at):
    out = array.copy()
    out.flat[at] += 1
    return out


def test_a_digest_of_a_recording_in_memory_depends_on_all_of_it():
    """On each reading of a further signal, each pixel and each number of the controller; not on which copy it is."""
    n = 400
    time = np.arange(n) / 100.0
    q = 0.1 * np.sin(time)[:, None] * np.ones(7)
    eye = RecordedCamera("eye", 64, 48, 60.0, 60.0, 31.5, 23.5, mount="flange", pose=np.eye(4))
    current, gains, rgb = np.ones((n, 7)), np.full(7, 100.0), np.zeros((48, 64, 3), np.uint8)

    def digest_of(current=current, gains=gains, rgb=rgb):
        control = Control("position", 100.0, "model", gains, np.full(7, 10.0))
        frames = Frames({"eye": eye}, (RecordedFrame(0.5, eye, rgb),))
        rest = {"signals": {"current": Signal(current, "A")}, "frames": frames}
        rec = Recording(Path("r"), "iiwa14", load("iiwa14").joints, 100.0, control, time, q, q_cmd=q, **rest)
        (value,) = read_inputs("iiwa14", rec, (), need_validate=False).digests[0].values()
        return value

    values = [
        digest_of(),
        digest_of(current=changed(current, 1400)),
        digest_of(gains=changed(gains, 3)),
        digest_of(rgb=changed(rgb, 4600)),
    ]
    assert len(set(values)) == 4
    assert digest_of(current.copy(), gains.copy(), rgb.copy()) == values[0]
