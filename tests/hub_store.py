"""A hub on this machine: repositories in memory, behind `huggingface_hub`'s functions or behind its server's paths."""

import base64
import hashlib
import json
import shutil
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.machinery import ModuleSpec
from pathlib import Path
from threading import Thread
from types import ModuleType, SimpleNamespace
from urllib.parse import unquote, urlsplit

TOKEN = "hf_token_of_a_test"


class Absent(Exception):
    """What the server says in `X-Error-Code`."""


@dataclass
class Repo:
    private: bool
    commits: dict = field(default_factory=dict)
    refs: dict = field(default_factory=dict)
    tags: dict = field(default_factory=dict)

    def commit(self, branch, adds=None, stale=()):
        before = self.commits[self.refs[branch]] if branch in self.refs else {}
        files = {n: b for n, b in before.items() if n not in stale} | (adds or {})
        oid = hashlib.sha1(repr((len(self.commits), sorted(files.items()))).encode()).hexdigest()
        self.commits[oid], self.refs[branch] = files, oid
        return oid

    def at(self, revision):
        refs = {**self.tags, **self.refs, **{oid: oid for oid in self.commits}}
        if revision not in refs:
            raise Absent("RevisionNotFound")
        return refs[revision]

    @property
    def main(self):
        return self.commits[self.refs["main"]]


class Hub(dict):
    """(kind, OWNER/NAME) -> Repo."""

    refusing = False

    def get_repo(self, kind, name):
        if (kind, name) not in self:
            raise Absent("RepoNotFound")
        return self[kind, name]

    def make(self, kind, name, private):
        if (kind, name) not in self:
            self[kind, name] = repo = Repo(bool(private))
            repo.commit("main", {".gitattributes": b"*.safetensors filter=lfs\n"})


def package(hub):
    """A module in place of `huggingface_hub`: what the project calls of it, on `hub`."""
    errors = ModuleType("huggingface_hub.errors")
    for name, base in (
        ("HTTPError", Exception), ("HfHubHTTPError", None), ("RepositoryNotFoundError", None),
        ("GatedRepoError", None), ("RevisionNotFoundError", None), ("HFValidationError", ValueError),
        ("OfflineModeIsEnabled", ConnectionError), ("LocalEntryNotFoundError", FileNotFoundError),
        ("FileMetadataError", OSError),
    ):  # fmt: skip
        above = {"HfHubHTTPError": "HTTPError", "GatedRepoError": "RepositoryNotFoundError"}.get(name, "HfHubHTTPError")
        setattr(errors, name, type(name, (base or getattr(errors, above),), {"server_message": None}))

    @contextmanager
    def asked():
        if hub.refusing:
            error = errors.HfHubHTTPError("403")
            error.response = SimpleNamespace(status_code=403, reason_phrase="Forbidden")
            raise error
        try:
            yield
        except Absent as error:
            kinds = {"RepoNotFound": errors.RepositoryNotFoundError, "RevisionNotFound": errors.RevisionNotFoundError}
            raise kinds[str(error)]("404") from None

    @dataclass
    class CommitOperationAdd:
        path_in_repo: str
        path_or_fileobj: object

    @dataclass
    class CommitOperationDelete:
        path_in_repo: str

    class HfApi:
        endpoint = "http://hub"

        def __init__(self, *, library_name=None):
            pass

        def repo_info(self, repo_id, *, revision=None, repo_type=None, files_metadata=False):
            with asked():
                repo = hub.get_repo(repo_type, repo_id)
                oid = repo.at(revision or "main")
            files = [SimpleNamespace(rfilename=n, size=len(b)) for n, b in repo.commits[oid].items()]
            return SimpleNamespace(sha=oid, siblings=files, private=repo.private)

        def list_repo_refs(self, repo_id, *, repo_type=None):
            with asked():
                return SimpleNamespace(tags=[SimpleNamespace(name=n) for n in hub.get_repo(repo_type, repo_id).tags])

        def hf_hub_download(self, repo_id, filename, *, repo_type=None, revision=None, local_dir=None):
            with asked():
                repo = hub.get_repo(repo_type, repo_id)
                data = repo.commits[repo.at(revision)][filename]
            (Path(local_dir) / ".cache" / "huggingface").mkdir(parents=True, exist_ok=True)
            place = Path(local_dir) / filename
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(data)

        def create_repo(self, repo_id, *, private=None, repo_type=None, exist_ok=False):
            with asked():
                assert exist_ok or (repo_type, repo_id) not in hub
                hub.make(repo_type, repo_id, private)

        def create_branch(self, repo_id, *, branch, repo_type=None, exist_ok=False):
            refs = hub.get_repo(repo_type, repo_id).refs
            refs.setdefault(branch, refs["main"])

        def preupload_lfs_files(self, repo_id, additions, *, repo_type=None, revision=None):
            hub.get_repo(repo_type, repo_id).at(revision or "main")

        def create_commit(self, repo_id, operations, *, commit_message, repo_type=None, revision=None):
            adds = {o.path_in_repo: o.path_or_fileobj for o in operations if isinstance(o, CommitOperationAdd)}
            adds = {n: f if isinstance(f, bytes) else Path(f).read_bytes() for n, f in adds.items()}
            stale = [o.path_in_repo for o in operations if isinstance(o, CommitOperationDelete)]
            oid = hub.get_repo(repo_type, repo_id).commit(revision or "main", adds, stale)
            return SimpleNamespace(oid=oid, commit_url=f"{self.endpoint}/{repo_id}/commit/{oid}")

        def delete_tag(self, repo_id, *, tag, repo_type=None):
            with asked():
                if hub.get_repo(repo_type, repo_id).tags.pop(tag, None) is None:
                    raise Absent("RevisionNotFound")

        def create_tag(self, repo_id, *, tag, revision=None, repo_type=None):
            repo = hub.get_repo(repo_type, repo_id)
            assert tag not in repo.tags
            repo.tags[tag] = repo.at(revision)

    def validate_repo_id(name):
        if not all(c.isalnum() or c in "-_./" for c in name) or name.count("/") > 1:
            raise errors.HFValidationError(name)

    utils = ModuleType("huggingface_hub.utils")
    utils.validate_repo_id, utils.disable_progress_bars = validate_repo_id, lambda: None
    utils.logging = SimpleNamespace(set_verbosity_error=lambda: None)
    made = ModuleType("huggingface_hub")
    made.__spec__ = ModuleSpec("huggingface_hub", None)
    made.errors, made.utils, made.HfApi, made.get_token = errors, utils, HfApi, lambda: hub.token
    made.CommitOperationAdd, made.CommitOperationDelete = CommitOperationAdd, CommitOperationDelete
    return {"huggingface_hub": made, "huggingface_hub.errors": errors, "huggingface_hub.utils": utils}


class Asked(BaseHTTPRequestHandler):
    """The paths of the hub's server that the package asks for."""

    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def answer(self, body=b"", status=200, **headers):
        body = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        for name, value in {"Content-Length": len(body), **headers}.items():
            self.send_header(name.replace("_", "-"), str(value))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def do(self):
        hub, body = self.server.hub, self.rfile.read(int(self.headers.get("Content-Length", 0)))
        parts = [unquote(p) for p in urlsplit(self.path).path.split("/")[1:]]
        if hub.refusing:
            return self.answer({"error": "no"}, 403)
        try:
            return self.api(hub, parts[1:], body) if parts[0] == "api" else self.file(hub, parts)
        except Absent as error:
            return self.answer(b"", 404, X_Error_Code=error)

    do_GET = do_POST = do_DELETE = do_HEAD = do

    def api(self, hub, parts, body):
        if parts[0] == "validate-yaml":
            return self.answer({"errors": [], "warnings": []})
        if parts == ["repos", "create"]:
            asked = json.loads(body)
            kind, name = asked.get("type", "model"), f"{asked['organization']}/{asked['name']}"
            if (kind, name) in hub:
                return self.answer({"error": "exists", "url": f"{self.server.url}/{name}"}, 409)
            hub.make(kind, name, asked.get("visibility") == "private")
            return self.answer({"url": f"{self.server.url}/{'datasets/' * (kind == 'dataset')}{name}"})
        kind, name, (what, *more) = parts[0].removesuffix("s"), "/".join(parts[1:3]), parts[3:] or ["revision", "main"]
        repo, written = hub.get_repo(kind, name), self.command in ("POST", "DELETE")
        assert not written or self.headers["Authorization"] == f"Bearer {TOKEN}"
        if what == "revision":
            oid = repo.at(more[0])
            files = [{"rfilename": n, "size": len(b), "blobId": "0"} for n, b in repo.commits[oid].items()]
            return self.answer(
                {"_id": "0", "id": name, "sha": oid, "private": repo.private, "siblings": files, "tags": []}
            )
        if what == "refs":
            tags = [{"name": n, "ref": f"refs/tags/{n}", "targetCommit": oid} for n, oid in repo.tags.items()]
            return self.answer({"branches": [], "converts": [], "tags": tags})
        if what == "branch":
            repo.refs.setdefault(more[0], repo.refs["main"])
            return self.answer()
        if what == "preupload":
            repo.at(more[0])
            paths = [f["path"] for f in json.loads(body)["files"]]
            return self.answer({"files": [{"path": p, "uploadMode": "regular", "shouldIgnore": False} for p in paths]})
        if what == "commit":
            lines = [json.loads(line) for line in body.splitlines()]
            adds = {o["value"]["path"]: base64.b64decode(o["value"]["content"]) for o in lines if o["key"] == "file"}
            stale = [o["value"]["path"] for o in lines if o["key"] == "deletedFile"]
            oid = repo.commit(more[0], adds, stale)
            return self.answer(
                {"success": True, "commitOid": oid, "commitUrl": f"{self.server.url}/{name}/commit/{oid}"}
            )
        assert what == "tag"
        if self.command == "POST":
            tag = json.loads(body)["tag"]
            assert tag not in repo.tags
            repo.tags[tag] = repo.at(more[0])
        elif repo.tags.pop(more[0], None) is None:
            raise Absent("RevisionNotFound")
        return self.answer()

    def file(self, hub, parts):
        kind = "dataset" if parts[0] == "datasets" else "model"
        owner, name, _, revision, *path = parts[kind == "dataset" :]
        repo = hub.get_repo(kind, f"{owner}/{name}")
        oid = repo.at(revision)
        data = repo.commits[oid]["/".join(path)]
        return self.answer(data, ETag=f'"{hashlib.sha1(data).hexdigest()}"', X_Repo_Commit=oid)


@contextmanager
def served(hub):
    """The address of a server on loopback that has the repositories of `hub`."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), Asked)
    server.hub, server.url = hub, f"http://127.0.0.1:{server.server_port}"
    thread = Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server.url
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def downloaded(folder):
    """Name -> content of the files in a folder, without the marker."""
    paths = [p for p in Path(folder).rglob("*") if p.is_file() and p.name != ".vispeg.json"]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in paths}


def copied(name, source, target):
    """A folder's copy that may be changed."""
    return Path(shutil.copytree(source, target / name))
