"""Tasks kept on disk are those that would be made, whatever happens to the files."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from webgym.offline.web import COLLECTIONS, OfflineWeb
from webgym.offline.website import Split
from webgym.run import choice
from webgym.run.choice import KEPT_FILES, cached_tasks


def small(seed: int = 0, per_family: int = 2) -> OfflineWeb:
    return OfflineWeb(seed, per_family=per_family, collection="small")


def unmade(*given: object) -> None:
    raise AssertionError("they were to be read")


def test_they_are_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    splits: tuple[Split | None, ...] = ("train", "test", None)
    said: list[str] = []
    made = {split: cached_tasks(small(), split, tmp_path, tell=said.append) for split in splits}
    count = len(small().specs)
    assert said[-1] == f"making the tasks of {count} websites, once for this version of the offline web"
    assert len(said) == 3
    assert {split: list(small().tasks(split)) for split in made} == made
    web = small()
    monkeypatch.setattr(web, "tasks", unmade)
    for split, tasks in made.items():
        assert cached_tasks(web, split, tmp_path, tell=unmade) == tasks


def test_families_from_elsewhere_are_made_anew(tmp_path: Path) -> None:
    web = OfflineWeb(per_family=1, collection="small", families=COLLECTIONS["small"].families[:1])
    assert cached_tasks(web, None, tmp_path) == list(web.tasks())
    assert not list(tmp_path.iterdir())


def test_other_settings_and_other_code_make_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = cached_tasks(small(), None, tmp_path)
    assert len(cached_tasks(small(per_family=3), None, tmp_path)) > len(first)
    assert cached_tasks(small(seed=1), None, tmp_path) != first
    monkeypatch.setattr(choice, "digest_of_code", lambda: "other code")
    web = small()
    monkeypatch.setattr(web, "tasks", lambda split: iter(first[:3]))
    assert cached_tasks(web, None, tmp_path) == first[:3]


def test_a_damaged_file_is_made_anew(tmp_path: Path) -> None:
    first = cached_tasks(small(), None, tmp_path)
    (file,) = tmp_path.iterdir()
    whole = file.read_bytes()
    for damaged in (b"", whole[:-1], whole[:-1] + bytes([whole[-1] ^ 1]), b"\0" * len(whole)):
        file.write_bytes(damaged)
        assert cached_tasks(small(), None, tmp_path) == first
        assert file.read_bytes() == whole


def test_where_nothing_can_be_kept_they_are_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert cached_tasks(small(), None, tmp_path / "file") == list(small().tasks())


def test_old_files_go(tmp_path: Path) -> None:
    for nth in range(KEPT_FILES + 2):
        file = tmp_path / (f"{nth}.msgpack" if nth else ".0.msgpack.begun.torn")
        file.touch()
        os.utime(file, (nth, nth))
    cached_tasks(small(), None, tmp_path)
    assert len(list(tmp_path.iterdir())) == KEPT_FILES
    assert not (tmp_path / ".0.msgpack.begun.torn").exists()
