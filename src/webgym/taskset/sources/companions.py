"""Companion files of a file of tasks: answers, rubric trees."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import TypeVar

import msgspec

from webgym.taskset.sources.problems import PassedOver

T = TypeVar("T")


class Companions:
    """Reads the companion files in the folder of a file of tasks, each once.

    Args:
        folder: of the tasks' file; ``None`` if there is none (a data set of the hub).

    Attributes:
        folder: as given.
        broken: companions that could not be read.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._loaded: dict[str, object] = {}
        self.broken: list[PassedOver] = []

    def load(self, name: str, build: Callable[[object], T]) -> T | None:
        """The result of ``build`` for a companion's JSON; ``None`` if there is no such file, or it is broken.

        Args:
            name: of the file, relative to the folder; paths outside of the folder are not read.
            build: converts the decoded JSON; may raise ValueError.
        """
        if name not in self._loaded:
            self._loaded[name] = self._read(name, build)
        return self._loaded[name]  # type: ignore[return-value]

    def _read(self, name: str, build: Callable[[object], T]) -> T | None:
        path = self._find(name)
        if path is None:
            return None
        try:
            return build(msgspec.json.decode(path.read_bytes()))
        except OSError as error:
            self.broken.append(PassedOver(str(path), f"cannot be read: {error.strerror}"))
        except (ValueError, RecursionError) as error:
            self.broken.append(PassedOver(str(path), f"is not a companion file of the tasks: {error}"))
        return None

    def _find(self, name: str) -> Path | None:
        parts = PurePosixPath(name.replace("\\", "/")).parts
        if self.folder is None or not parts or ".." in parts or "\0" in name:
            return None
        whole = self.folder.joinpath(*(part for part in parts if part not in ("/", ".")))
        for path in (whole, self.folder / parts[-1]):
            try:
                if path.is_file():
                    return path
            except OSError:  # the file name is too long
                return None
        return None
