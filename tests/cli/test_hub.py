"""Policies and datasets to the hub and back: the same bytes, the format's files alone, nothing where something is off.

Everything is tried twice: with the package's functions replaced by ones that keep repositories in memory, and, where
`huggingface_hub` is installed, with the package itself against a server on loopback.
"""

import json
import sys

import pytest
from hub_store import TOKEN, Hub, copied, downloaded, package, served

from vispeg.core.assets import assets
from vispeg.datasets.example import write_dataset

POLICY = assets() / "policies" / "state-3mm"


@pytest.fixture(params=["functions", "package"])
def hub(request, monkeypatch, tmp_path):
    hub = Hub()
    hub.token = TOKEN
    if request.param == "functions":
        for name, module in package(hub).items():
            monkeypatch.setitem(sys.modules, name, module)
        yield hub
        return
    real = pytest.importorskip("huggingface_hub.constants")
    monkeypatch.setenv("HF_TOKEN", TOKEN)
    with served(hub) as url:
        monkeypatch.setattr(real, "ENDPOINT", url)
        monkeypatch.setattr(real, "HF_TOKEN_PATH", str(tmp_path / "no-token"))
        monkeypatch.setattr(real, "HUGGINGFACE_CO_URL_TEMPLATE", url + "/{repo_id}/resolve/{revision}/{filename}")
        yield hub


@pytest.fixture(scope="module")
def frames(tmp_path_factory):
    return write_dataset(tmp_path_factory.mktemp("frames"))


def test_a_policy_comes_back_and_plays(hub, vispeg, tmp_path):
    pytest.importorskip("torch")
    code, out, err = vispeg("hub", "push", "state-3mm", "some/peg", "--json", "--quiet")
    assert code == 0 and err == "", err
    sent, repo = json.loads(out), hub["model", "some/peg"]
    assert sent["commit"] == repo.refs["main"] and sent["tag"] is None and not repo.private and not repo.tags
    assert set(repo.main) == {".gitattributes", "README.md", *downloaded(POLICY)} == {".gitattributes", *sent["files"]}
    repo.commit("main", {"evil.pkl": b"cos\nsystem\n", "run.py": b"print()"})
    code, out, err = vispeg("hub", "pull", "some/peg", "--out", "new/mine", "--json", "--quiet")
    assert code == 0 and err == "", err
    assert downloaded("new/mine") == downloaded(POLICY) and json.loads(out)["commit"] == repo.refs["main"]
    assert vispeg("evaluate", "new/mine", "--world", "nominal", "--episodes", 1, "--videos", 0, "--out", "e")[0] == 0
    assert vispeg("hub", "pull", "some/peg", "--out", "new/mine")[0] == 2
    assert vispeg("hub", "pull", "some/peg", "--out", "new/mine", "--overwrite")[0] == 0


def test_a_pair_comes_back(hub, vispeg):
    pytest.importorskip("torch")
    assert vispeg("combine", "depth-S", "state-0.5mm", "--out", "both")[0] == 0
    assert vispeg("hub", "push", "both", "some/both", "--private")[0] == 0
    assert hub["model", "some/both"].private
    assert vispeg("hub", "pull", "some/both", "--out", "again")[0] == 0
    assert downloaded("again") == downloaded("both") and len(downloaded("both")) == 5


@pytest.mark.parametrize("name", ["policy.safetensors", "policy.json"])
def test_a_changed_policy_is_refused(hub, vispeg, refused, name):
    pytest.importorskip("torch")
    assert vispeg("hub", "push", "state-3mm", "some/peg")[0] == 0
    data = bytearray(hub["model", "some/peg"].main[name])
    at = len(data) // 2 if name.endswith("tensors") else data.index(b"sha256:") + 7
    data[at] = ord("0") if data[at] != ord("0") else ord("1")
    hub["model", "some/peg"].commit("main", {name: bytes(data)})
    refused(["hub", "pull", "some/peg", "--out", "mine"], "mine/policy.safetensors", "are not the weights")


def test_a_policy_without_a_hash_is_refused_both_ways(hub, vispeg, refused, tmp_path):
    pytest.importorskip("torch")
    assert vispeg("hub", "push", "state-3mm", "some/peg")[0] == 0
    record = json.loads((POLICY / "policy.json").read_text())
    del record["weights"]
    hub["model", "some/peg"].commit("main", {"policy.json": json.dumps(record).encode()})
    refused(["hub", "pull", "some/peg", "--out", "mine"], "weights", "is missing")
    old = copied("old", POLICY, tmp_path)
    (old / "policy.json").write_text(json.dumps(record))
    refused(["hub", "push", old, "some/old"], "weights", "is missing")
    assert ("model", "some/old") not in hub


def test_a_dataset_comes_back_and_has_its_tag(hub, vispeg, frames):
    code, out, err = vispeg("hub", "push", frames, "some/frames", "--json")
    assert code == 0, err
    repo, version = (
        hub["dataset", "some/frames"],
        json.loads((frames / "meta/info.json").read_text())["codebase_version"],
    )
    assert repo.tags == {version: repo.refs["main"]} and json.loads(out)["tag"] == version
    assert f"{version}".encode() in repo.main["README.md"]
    first = repo.refs["main"]
    repo.commit("main", {"data/chunk-000/file-000.parquet": b"unfinished", "README.md": b"mine"})
    assert vispeg("hub", "pull", "some/frames", "--dataset", "--out", "there")[0] == 0, "the tag's revision"
    assert downloaded("there") == downloaded(frames)
    assert vispeg("dataset", "check", "there")[0] == 0
    assert vispeg("hub", "pull", "some/frames", "--dataset", "--revision", first, "--out", "by-commit")[0] == 0


def test_a_dataset_that_is_pushed_again(hub, vispeg, refused, frames):
    assert vispeg("hub", "push", frames, "some/frames")[0] == 0
    repo = hub["dataset", "some/frames"]
    repo.commit(
        "main", {"data/chunk-000/file-099.parquet": b"of a longer one", "README.md": b"mine", "notes.txt": b"1"}
    )
    before = dict(repo.refs)
    refused(["hub", "push", frames, "some/frames"], "some/frames", "holds a dataset already", "--overwrite")
    refused(["hub", "push", frames, "some/frames", "--private", "--overwrite"], "is public")
    assert repo.refs == before
    assert vispeg("hub", "push", frames, "some/frames", "--overwrite")[0] == 0
    assert repo.main == {".gitattributes": repo.main[".gitattributes"], "README.md": b"mine", "notes.txt": b"1"} | (
        downloaded(frames)
    )
    assert repo.tags == {"v3.0": repo.refs["main"]}
    main = repo.refs["main"]
    assert vispeg("hub", "push", frames, "some/frames", "--revision", "trial", "--overwrite")[0] == 0
    assert repo.refs["main"] == main and repo.tags == {"v3.0": main} and "trial" in repo.refs


def test_a_changed_dataset_is_refused(hub, vispeg, refused, frames):
    assert vispeg("hub", "push", frames, "some/frames")[0] == 0
    repo = hub["dataset", "some/frames"]
    name = next(n for n in repo.main if n.startswith("data/"))
    data = bytearray(repo.main[name])
    data[len(data) // 2] ^= 1
    repo.commit("main", {name: bytes(data)})
    refused(["hub", "pull", "some/frames", "--dataset", "--revision", "main", "--out", "x"], f"x/{name}", "changed")


def test_a_dataset_that_is_not_read_here_is_refused_before_its_data_come(hub, vispeg, refused, frames):
    assert vispeg("hub", "push", frames, "some/frames")[0] == 0
    repo = hub["dataset", "some/frames"]
    info = json.loads(repo.main["meta/info.json"])
    info["features"]["observation.images.eye"]["dtype"] = "video"
    repo.commit("main", {"meta/info.json": json.dumps(info).encode()})
    asked = []
    from vispeg.api.hub.repository import Repository

    fetch = Repository.fetch
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            Repository, "fetch", lambda self, state, names, *_: (asked.extend(names), fetch(self, state, names, *_))
        )
        refused(
            ["hub", "pull", "some/frames", "--dataset", "--revision", "main", "--out", "x"], "observation.images.eye"
        )
    assert asked and all(name.startswith("meta/") for name in asked)


def test_names_that_lead_elsewhere_are_not_fetched(hub, vispeg, frames, tmp_path):
    assert vispeg("hub", "push", frames, "some/frames")[0] == 0
    repo = hub["dataset", "some/frames"]
    names = ("data/../../x.parquet", "data/.git/x.json", "/data/x.json", "data//x.json", "meta/x.py", "meta/x.pkl")
    repo.commit("main", dict.fromkeys(names, b"{}"))
    args = ("hub", "pull", "some/frames", "--dataset", "--revision", "main", "--out", "a/x")
    assert vispeg(*args)[0] == 0
    assert downloaded(tmp_path / "a/x") == downloaded(frames)


def test_refusals(hub, refused, tmp_path, monkeypatch, frames):
    refused(["hub", "pull", "no/such", "--out", "x"], "no/such", "no such model repository", "--dataset")
    refused(["hub", "pull", "no/such", "--dataset", "--out", "x"], "no such dataset repository")
    for name in ("alone", "a/b/c", "sp ace/x"):
        refused(["hub", "pull", name, "--out", "x"], "not a repository's name", "OWNER/NAME")
        refused(["hub", "push", frames, name], "not a repository's name", "OWNER/NAME")
    (tmp_path / "empty").mkdir()
    refused(["hub", "push", "empty", "some/peg"], "empty", "neither a policy nor a dataset", "policy.json")
    refused(["hub", "push", "nowhere", "some/peg"], "no such policy", "state-3mm")
    hub.make("model", "some/bare", False)
    refused(["hub", "pull", "some/bare", "--out", "x"], "some/bare", "holds no policy", "policy.json")
    refused(["hub", "pull", "some/bare", "--revision", "v9", "--out", "x"], "no such revision", "v9")
    hub.refusing = True
    refused(["hub", "pull", "some/bare", "--out", "x"], "refuses (403)", "hf auth login")
    refused(["hub", "push", frames, "some/bare"], "refuses (403)", "hf auth login")
    hub.token = None
    monkeypatch.setenv("HF_TOKEN", "")
    refused(["hub", "push", frames, "some/bare"], "nobody is logged in", "HF_TOKEN")
    assert set(hub) == {("model", "some/bare")}


def test_a_hub_that_is_not_there(refused, monkeypatch):
    real = pytest.importorskip("huggingface_hub.constants")
    with served(Hub()) as url:
        pass
    monkeypatch.setattr(real, "ENDPOINT", url)
    refused(["hub", "pull", "some/peg", "--out", "x"], "does not answer", url)
