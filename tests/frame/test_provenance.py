"""A result's origin: digests depend on content and names inside, and on nothing else."""

import hashlib
import json
import shlex
from importlib import metadata

import pytest

from vispeg.core.errors import UserError
from vispeg.core.provenance import digest, provenance

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
