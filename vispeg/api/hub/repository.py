"""A repository on the Hugging Face hub by `huggingface_hub`; whatever goes wrong there ends in one line.

`HF_ENDPOINT` names another server, `HF_TOKEN` or `hf auth login` the user.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.extras import require

LOGIN = "a login: `hf auth login`, or HF_TOKEN"
BATCH = 16  # files that are sent between two steps of the bar


@dataclass(frozen=True)
class State:
    """A repository at one commit.

    Attributes:
        commit: its hash.
        sizes: bytes by name of file.
        private: whether only its owner sees it.
    """

    commit: str
    sizes: Mapping[str, int]
    private: bool


class Repository:
    """OWNER/NAME on the hub.

    Args:
        name: OWNER/NAME.
        kind: `model` or `dataset`.

    Raises:
        UserError: a name that none can have, or the package is missing; and each method where the hub refuses, does
            not answer, or has no such repository or revision.
    """

    def __init__(self, name: str, kind: str):
        require("huggingface_hub", "the Hugging Face hub")
        from huggingface_hub import HfApi
        from huggingface_hub.utils import disable_progress_bars, logging, validate_repo_id

        disable_progress_bars()
        logging.set_verbosity_error()
        self.name, self.kind, self.api = name, kind, HfApi(library_name="vispeg")
        with self._answered():
            validate_repo_id(name)
        if name.count("/") != 1:
            raise UserError("not a repository's name", expected="OWNER/NAME", got=name)

    def at(self, revision: str | None = None) -> State:
        """What is there at a branch, tag or commit; at the newest commit where none is named."""
        with self._answered(revision):
            return self._at(revision)

    def there(self, revision: str | None = None) -> State | None:
        """As `at`; None where there is no such repository, or revision of it, yet."""
        from huggingface_hub import errors

        with self._answered(revision), suppress(errors.RepositoryNotFoundError, errors.RevisionNotFoundError):
            return self._at(revision)
        return None

    def tags(self) -> set[str]:
        """Names of its tags."""
        with self._answered():
            return {tag.name for tag in self.api.list_repo_refs(self.name, repo_type=self.kind).tags}

    def fetch(self, state: State, names: list[str], folder: Path, watch: Callable[[int], None]) -> None:
        """Downloads files into a folder, under their names; `watch` hears of bytes that have come."""
        try:
            for name in names:
                with self._answered(state.commit):
                    self.api.hf_hub_download(
                        self.name, name, repo_type=self.kind, revision=state.commit, local_dir=folder
                    )
                watch(state.sizes[name])
        finally:
            shutil.rmtree(folder / ".cache", ignore_errors=True)  # the package's notes on the download

    def create(self, private: bool, branch: str | None) -> None:
        """Makes the repository and the branch where they are not there."""
        with self._answered(branch):
            self.api.create_repo(self.name, repo_type=self.kind, private=private or None, exist_ok=True)
            if branch is not None:
                self.api.create_branch(self.name, branch=branch, repo_type=self.kind, exist_ok=True)

    def commit(
        self,
        files: Mapping[str, Path | bytes],
        stale: list[str],
        branch: str | None,
        watch: Callable[[int], None],
    ) -> tuple[str, str]:
        """Sends files and removes stale ones, as one commit. Returns its hash and address."""
        from huggingface_hub import CommitOperationAdd, CommitOperationDelete

        adds = [CommitOperationAdd(path_in_repo=n, path_or_fileobj=f) for n, f in files.items()]
        sizes = [f.stat().st_size if isinstance(f, Path) else len(f) for f in files.values()]
        with self._answered(branch):
            for i in range(0, len(adds), BATCH):
                batch = adds[i : i + BATCH]
                self.api.preupload_lfs_files(self.name, additions=batch, repo_type=self.kind, revision=branch)
                watch(sum(sizes[i : i + BATCH]))
            made = self.api.create_commit(
                self.name,
                [*adds, *(CommitOperationDelete(path_in_repo=name) for name in stale)],
                commit_message=f"vispeg hub push ({len(adds)} files)",
                repo_type=self.kind,
                revision=branch,
            )
        return str(made.oid), str(made.commit_url)

    def tag(self, name: str, commit: str) -> None:
        """Gives a tag to a commit, from whichever had it before."""
        from huggingface_hub import errors

        with self._answered():
            with suppress(errors.RevisionNotFoundError):
                self.api.delete_tag(self.name, tag=name, repo_type=self.kind)
            self.api.create_tag(self.name, tag=name, revision=commit, repo_type=self.kind)

    def logged_in(self) -> None:
        """Raises UserError where nobody is."""
        from huggingface_hub import get_token

        if get_token() is None:
            raise UserError("nobody is logged in at the hub, which pushing needs", expected=LOGIN)

    def _at(self, revision: str | None) -> State:
        info = self.api.repo_info(self.name, repo_type=self.kind, revision=revision, files_metadata=True)
        sizes = {file.rfilename: int(file.size or 0) for file in info.siblings or ()}
        return State(str(info.sha), sizes, bool(info.private))

    @contextmanager
    def _answered(self, revision: str | None = None) -> Iterator[None]:
        """What the package raises, as a UserError."""
        from huggingface_hub import errors

        try:
            yield
        except errors.HFValidationError:
            expected = "OWNER/NAME of letters, digits, '-', '_' and '.'"
            raise UserError("not a repository's name", expected=expected, got=self.name) from None
        except errors.GatedRepoError:
            raise UserError("is gated; ask its owner for access on its page", file=self.name) from None
        except errors.RepositoryNotFoundError:
            what = f"the hub has no such {self.kind} repository, or shows it to its owner alone"
            other = "with --dataset for a dataset" if self.kind == "model" else "without --dataset for a policy"
            raise UserError(what, file=self.name, expected=f"OWNER/NAME, {other}; of a private one {LOGIN}") from None
        except errors.RevisionNotFoundError:
            expected = "a branch, tag or commit of the repository"
            raise UserError("no such revision", file=self.name, expected=expected, got=revision) from None
        except errors.HfHubHTTPError as error:
            status = error.response.status_code
            if status in (401, 403):
                expected = f"{LOGIN} that may write there"
                raise UserError(f"the hub refuses ({status})", file=self.name, expected=expected) from None
            said = error.server_message or error.response.reason_phrase
            raise UserError(f"the hub answers {status}: {said}", file=self.name) from None
        except (errors.OfflineModeIsEnabled, errors.LocalEntryNotFoundError, errors.HTTPError) as error:
            raise self._away(error) from None
        except (ConnectionError, TimeoutError, RuntimeError, errors.FileMetadataError) as error:  # RuntimeError: of xet
            raise self._away(error) from None

    def _away(self, error: Exception) -> UserError:
        cause = error.__cause__ or error  # "please check your connection" stands for many things
        reason = (str(cause).splitlines() or [""])[0] or type(cause).__name__
        return UserError(f"the hub at {self.api.endpoint} does not answer ({reason[:200]})", file=self.name)
