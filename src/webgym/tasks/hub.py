"""Data sets on the Hugging Face hub, wherever a task file is taken.

``hub:OWNER/NAME[@REVISION][:PART]``, or ``hf://datasets/OWNER/NAME[@REVISION][/PART]`` as the hub's own
library writes it. A part is a split (``test``), a file (``data/test.parquet``) or a folder; without one, it
is all that the data set holds. A revision is a branch, a tag or a commit.

The library ``huggingface_hub`` downloads and caches: ``HF_ENDPOINT``, ``HF_TOKEN``, ``HF_HOME`` and
``HF_HUB_OFFLINE`` apply, and a hub that does not answer does not matter once the files are there.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import unquote

from webgym.core.errors import ConfigError, TaskFileError

HUB: Final = "hub:"
_SUFFIXES: Final = (".jsonl", ".ndjson", ".json", ".csv", ".tsv", ".parquet", ".gz", ".bz2", ".xz", ".zst")
"""Suffixes of files that are downloaded: those of tasks and their companions."""
_NAME: Final = r"(?P<name>[\w.-]+/[\w.-]+)(?:@(?P<revision>[^:@{end}]+))?"
_FORMS: Final = (
    re.compile(rf"hub:{_NAME.format(end='')}(?::(?P<part>.+))?"),
    # As a path, it has one slash.
    re.compile(rf"hf:/{{1,2}}datasets/{_NAME.format(end='/')}(?:/(?P<part>.+))?"),
)


class Address(NamedTuple):
    """A data set on the hub, or a part of it.

    Attributes:
        name: ``OWNER/NAME``.
        revision: branch, tag or commit; ``None`` for the main branch.
        part: split, file or folder; ``None`` for everything.
    """

    name: str
    revision: str | None = None
    part: str | None = None

    def __str__(self) -> str:
        revision = f"@{self.revision}" if self.revision else ""
        return f"{HUB}{self.name}{revision}{f':{self.part}' if self.part else ''}"

    def holds(self, file: str) -> bool:
        """Whether a file of the data set belongs to this address.

        Args:
            file: its path in the data set.
        """
        if not file.endswith(_SUFFIXES):
            return False
        part, name = (self.part or "").strip("/"), file.rpartition("/")[2]
        after = name.removeprefix(part)
        is_split = after != name and not after[:1].isalnum()  # test.jsonl, test-00000-of-00001.parquet
        return not part or is_split or file == part or file.startswith(f"{part}/")


def address_of(where: Path | str) -> Address | None:
    """The address that a task file's name is; ``None`` if it is a file's.

    Raises:
        ConfigError: it begins as one, and is none.
    """
    text = str(where)
    if not text.startswith((HUB, "hf:/")):
        return None
    match = next((found for form in _FORMS if (found := form.fullmatch(text))), None)
    if match is None:
        raise ConfigError(
            f"{text!r} is no address of a data set on the hub", hint="give hub:OWNER/NAME[@REVISION][:SPLIT]"
        )
    revision = match["revision"]
    return Address(match["name"], revision and unquote(revision), match["part"])


def pinned(where: Path | str) -> str:
    """The address with the commit that its revision names now; what is no address stays as it is.

    Raises:
        ConfigError, TaskFileError: as for :func:`download`.
    """
    address = address_of(where)
    return str(where) if address is None else str(address._replace(revision=_snapshot(address).name))


def download(address: Address) -> list[Path]:
    """The files at an address, sorted, in the cache of the hub's library.

    Raises:
        ConfigError: the library is not installed.
        TaskFileError: the hub cannot be reached or refuses, or there is no such data set, revision or part.
    """
    folder = _snapshot(address)
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    if found := [path for path in files if address.holds(path.relative_to(folder).as_posix())]:
        return found
    raise TaskFileError(f"{address} holds no file of tasks", hint="see the files of the data set on the hub")


def push(folder: Path, address: Address, message: str, *, is_public: bool, replaces: Sequence[str]) -> str:
    """Upload a folder as a data set, which is made if there is none; the address of the commit.

    Args:
        folder: what to upload.
        address: of the data set; its revision is a branch, which is made if there is none.
        message: of the commit.
        is_public: whether everybody may read a data set that is made.
        replaces: patterns of files of an earlier commit that are deleted.

    Raises:
        ConfigError: the library is not installed, or the address has a part.
        TaskFileError: the hub cannot be reached or refuses.
    """
    if address.part:
        raise ConfigError(f"a data set is pushed whole, not the part {address.part!r}", hint="leave it out")
    with _answers(address) as library:
        api = library.HfApi()
        api.create_repo(address.name, repo_type="dataset", private=not is_public, exist_ok=True)
        if address.revision:
            api.create_branch(address.name, branch=address.revision, repo_type="dataset", exist_ok=True)
        commit = api.upload_folder(
            repo_id=address.name,
            repo_type="dataset",
            folder_path=folder,
            revision=address.revision,
            commit_message=message,
            delete_patterns=list(replaces),
        )
    return str(address._replace(revision=commit.oid))


def _snapshot(address: Address) -> Path:
    """The folder with the files of an address; its name is the commit."""
    with _answers(address) as library:
        folder = library.snapshot_download(
            address.name, repo_type="dataset", revision=address.revision, allow_patterns=_patterns(address)
        )
    return Path(folder)


def _patterns(address: Address) -> list[str]:
    part = (address.part or "").strip("/")
    if not part:
        return [f"*{suffix}" for suffix in _SUFFIXES]
    return [part, f"{part}/*", f"{part}[!0-9A-Za-z]*", f"*/{part}[!0-9A-Za-z]*"]


@contextmanager
def _answers(address: Address) -> Iterator[Any]:
    """The hub's library, whose errors become ours."""
    try:
        import huggingface_hub
    except ImportError as error:
        raise ConfigError(
            "the hub needs the library huggingface_hub", hint="pip install 'webgym-rl[hub]'"
        ) from error
    try:
        yield huggingface_hub
    except Exception as error:  # of the network, the hub or the library
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise TaskFileError(
            f"{address} and the hub: {reason}",
            hint="check name, revision and network; private and gated ones need `hf auth login` or HF_TOKEN",
        ) from error
