"""A task set is read by others: the snippet of its documentation runs as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
from tests.conftest import Calls

from webgym.core.task import Task
from webgym.offline.web import OfflineWeb
from webgym.run.config import RunConfig
from webgym.tasks.formats import read_tasks, write_tasks

DOCS = Path(__file__).parents[2] / "docs/task-files.md"


def test_the_snippets_of_the_documentation_read_a_task_set(tmp_path: Path) -> None:
    for library in ("pandas", "duckdb", "datasets"):
        pytest.importorskip(library)
    (snippet,) = re.findall(r"```python\n(import duckdb.*?)```", DOCS.read_text(), re.S)
    web = OfflineWeb(per_family=2)
    tasks = [task for host in list(web.specs)[:3] for task in web.tasks_of(host)]
    for name in ("tasks.parquet", "tasks.jsonl"):
        write_tasks(tmp_path / name, tasks)
    environment = {**os.environ, "HF_HOME": str(tmp_path / "hub"), "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", snippet],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert f"train    {len(tasks)}" in done.stdout
    groups = [len(task.rubric.groups) for task in tasks]
    for count in set(groups):  # once for each format
        assert len(re.findall(rf"│ train +│ +{count} │ +{groups.count(count)} │", done.stdout)) == 2
    assert f"{len(tasks)} {len(tasks)} {tasks[0].instruction}" in done.stdout


def test_an_export_of_tasks_is_read_by_others(tmp_path: Path, calls: Calls) -> None:
    """In the formats of the test above; here it is what the command chooses."""
    duckdb = pytest.importorskip("duckdb")
    web = OfflineWeb(per_family=2)
    tasks = [task for host in list(web.specs)[:3] for task in web.tasks_of(host)]
    tasks[0] = msgspec.structs.replace(tasks[0], split="test")
    rest = [task for task in tasks if task.website != tasks[0].website]
    write_tasks(tmp_path / "mine" / "tasks.parquet", tasks)
    for kind, source in (("jsonl", tmp_path / "mine"), ("parquet", tmp_path / "mine" / "tasks.parquet")):
        out = tmp_path / kind
        said = calls.printed("export", source, "--format", kind, "--out", out)
        assert f"{len(rest)} tasks" in said
        assert f"left out: 1 tasks of another split, {len(tasks) - 1 - len(rest)} tasks that share" in said
        ids = duckdb.sql(f"select id from '{out}/tasks.{kind}'").fetchall()
        assert ids == [(task.id,) for task in rest]
    write_tasks(tmp_path / "train.parquet", tasks[1:])
    nowhere = ("--out", tmp_path / "no")
    said = calls.printed("export", tmp_path / "train.parquet", "--split", "test", *nowhere, code=2)
    assert f"has no task of the split 'test'; it holds {len(tasks) - 1} train (" in said
    assert said.count("\n") == 1
    assert not (tmp_path / "no").exists()
    said = calls.printed("export", tmp_path / "mine", "--format", "sharegpt", *nowhere, code=2)
    assert "tasks have no replies" in said


def test_tasks_that_come_with_webgym_are_exported_by_their_name(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = list(OfflineWeb(per_family=1, collection="small").tasks())[:5]
    asked: list[RunConfig] = []

    def given(config: RunConfig, tell: Callable[[str], None]) -> list[Task]:
        asked.append(config)
        return held

    monkeypatch.setattr("webgym.run.choice.all_tasks", given)
    calls.printed("export", "offline-small-v2", "--split", "all", "--out", tmp_path / "out")
    assert asked[0].sites.collection == "small"
    assert read_tasks(tmp_path / "out").tasks == held
    said = calls.printed("tasks", "show", "offline-small-v2")
    assert [line.partition("\t")[0] for line in said.splitlines()] == [task.id for task in held]
