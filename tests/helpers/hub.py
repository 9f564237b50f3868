"""A stand-in for the package `huggingface_hub`: its hub is a folder."""

import fnmatch
import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest


class RepositoryNotFoundError(OSError):
    """As `huggingface_hub.errors` has it."""


class RevisionNotFoundError(OSError):
    """As `huggingface_hub.errors` has it."""


class Hub(ModuleType):
    """The functions of the package that are used, with the arguments that are used; `calls` holds what they got.

    Args:
      folder: holds the repositories, OWNER/NAME/REVISION.
    """

    def __init__(self, folder: Path):
        super().__init__("huggingface_hub")
        self.folder, self.calls, self.fault = folder, [], None

    def create_repo(self, repo_id: str, *, private: bool | None = None, exist_ok: bool = False) -> str:
        self.calls.append({"repo_id": repo_id, "private": private})
        self._break()
        place = self.folder / repo_id / "main"
        assert exist_ok or not place.exists()
        place.mkdir(parents=True, exist_ok=True)
        return f"https://huggingface.co/{repo_id}"

    def upload_folder(
        self,
        *,
        repo_id: str,
        folder_path: str | Path,
        commit_message: str | None = None,
        revision: str | None = None,
        allow_patterns: list[str] | str | None = None,
    ) -> SimpleNamespace:
        copy(Path(folder_path), self._place(repo_id, revision), allow_patterns)
        return SimpleNamespace(commit_message=commit_message)

    def snapshot_download(
        self, repo_id: str, *, revision: str | None = None, allow_patterns: list[str] | str | None = None
    ) -> str:
        self._break()
        cache = self.folder / "cache" / repo_id
        copy(self._place(repo_id, revision), cache, allow_patterns)
        return str(cache)

    def _place(self, repo_id: str, revision: str | None) -> Path:
        place = self.folder / repo_id / (revision or "main")
        if not place.parent.exists():
            raise RepositoryNotFoundError("404 Client Error.\n\nRepository Not Found")
        if not place.exists():
            raise RevisionNotFoundError("404 Client Error.\n\nRevision Not Found")
        return place

    def _break(self) -> None:
        if self.fault is not None:
            raise self.fault


def copy(source: Path, target: Path, patterns: list[str] | str | None) -> None:
    """Copies the files of a folder that match a pattern."""
    target.mkdir(parents=True, exist_ok=True)
    for path in source.iterdir():
        if any(fnmatch.fnmatch(path.name, pattern) for pattern in patterns or ["*"]):
            shutil.copy(path, target)


def put_in_place(patch: pytest.MonkeyPatch, folder: Path) -> Hub:
    """The stand-in, imported in the place of the package."""
    hub = Hub(folder)
    errors = SimpleNamespace(
        RepositoryNotFoundError=RepositoryNotFoundError, RevisionNotFoundError=RevisionNotFoundError
    )
    patch.setitem(sys.modules, "huggingface_hub", hub)
    patch.setitem(sys.modules, "huggingface_hub.errors", errors)
    return hub


def take_away(patch: pytest.MonkeyPatch) -> None:
    """Importing the package fails, whether it is installed or not."""
    patch.setitem(sys.modules, "huggingface_hub", None)
