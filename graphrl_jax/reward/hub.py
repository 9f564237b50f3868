"""Reward models on the Hugging Face Hub. Only the three files of `card.py` travel."""

import importlib
import re
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from graphrl_jax.reward.card import CONFIG, MODEL, README
from graphrl_jax.runtime import optional_package

FILES = (CONFIG, MODEL, README)
_NAME = re.compile(r"\w[\w.-]*/\w[\w.-]*")
Answer = TypeVar("Answer")


def on_hub(name: str | Path) -> bool:
    """Whether a name is one that the hub is asked for: of the form owner/name, and no file or folder here."""
    return _NAME.fullmatch(Path(name).as_posix()) is not None and not Path(name).exists()


def download(name: str | Path, revision: str | None = None) -> Path:
    """The folder in the hub's cache with a model's files, of which missing ones are downloaded.

    Args:
      name: owner/name.
      revision: branch, tag or commit; default: the main branch.

    Raises:
      ValueError: the package is not installed, the hub cannot be reached, or it has no such model or revision.
    """
    name = Path(name).as_posix()
    hub = optional_package("huggingface_hub", "hub", f"{name} is no folder here, and models of the hub need")

    def ask() -> str:
        return hub.snapshot_download(name, revision=revision, allow_patterns=list(FILES))

    return Path(_asked(ask, f"{name} is no folder here, and cannot be loaded from the hub", name, revision))


def upload(folder: Path, name: str, private: bool | None = None, revision: str | None = None) -> str:
    """Writes the three files of a model's folder to the hub, in a repository that is created if there is none.

    Args:
      folder: the folder.
      name: owner/name.
      private: whether a new repository is private; default: the owner's setting.
      revision: branch that gets the files; it must exist. Default: the main branch.

    Returns:
      The address of the repository.

    Raises:
      ValueError: the name is of another form, the package is not installed, the hub cannot be reached, or it refuses.
    """
    if not _NAME.fullmatch(name):
        raise ValueError(f"the name of a model on the hub is {name!r}; allowed: owner/name")
    hub = optional_package("huggingface_hub", "hub", "models on the hub need")

    def ask() -> str:
        address = hub.create_repo(name, private=private, exist_ok=True)
        hub.upload_folder(
            repo_id=name,
            folder_path=folder,
            commit_message="Reward model",
            revision=revision,
            allow_patterns=list(FILES),
        )
        return str(address)

    return _asked(ask, f"{name} cannot be written to the hub", name, revision)


def _asked(ask: Callable[[], Answer], failure: str, name: str, revision: str | None) -> Answer:
    """What the hub answers.

    Raises:
      ValueError: it does not; the message begins with `failure`.
    """
    errors = importlib.import_module("huggingface_hub.errors")
    try:
        return ask()
    except errors.RepositoryNotFoundError:
        raise ValueError(f"{failure}: it has no {name}, or shows it only to others (`hf auth login`)") from None
    except errors.RevisionNotFoundError:
        raise ValueError(f"{failure}: {name} has no revision {revision!r}") from None
    except Exception as error:  # of the hub, of the HTTP packages of its releases, and of files
        raise ValueError(f"{failure}: {' '.join(str(error).split())}") from None
