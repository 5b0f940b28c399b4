"""The run folder is read by others: every snippet of its documentation runs as it stands there."""

from __future__ import annotations

import asyncio
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.report.conftest import build_run

DOCS = Path(__file__).parents[2] / "docs/run-folder.md"
SNIPPETS = re.findall(r"```python\n(.*?)```", DOCS.read_text(), re.S)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("readers")
    asyncio.run(build_run(folder / "runs/first", distinct=1))
    shards = folder / "runs/first/trajectories"
    lines = (shards / "00000.jsonl").read_bytes().splitlines(keepends=True)
    (shards / "00000.jsonl").write_bytes(b"".join(lines[:5]))
    (shards / "00001.jsonl").write_bytes(b"".join(lines[5:]))  # a second shard, with other outcomes
    return folder


@pytest.mark.parametrize(
    ("library", "said"),
    [
        ("pandas", r"success +4\.0"),
        ("duckdb", r"success +│ +4"),
        ("datasets", r"^success \["),
        ("hashlib", ""),
    ],
)
def test_a_snippet_of_the_documentation_runs(folder: Path, library: str, said: str) -> None:
    pytest.importorskip(library)
    snippet = next(code for code in SNIPPETS if f"import {library}\n" in code)
    environment = {**os.environ, "HF_HOME": str(folder / "hub"), "HF_HUB_OFFLINE": "1", "PYTHONPATH": ""}
    environment["PYTHONWARNINGS"] = "ignore"
    done = subprocess.run(
        [sys.executable, "-c", snippet],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.search(said, done.stdout, re.M), done.stdout
    shutil.rmtree(folder / "hub", ignore_errors=True)
