"""A task set is read by others: the snippet of its documentation runs as it stands there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from webgym.offline import OfflineWeb
from webgym.tasks import write_tasks

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
