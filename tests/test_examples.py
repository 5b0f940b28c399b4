"""What users copy works: the examples run, the presets load."""

from __future__ import annotations

import ast
import re
import runpy
import sys
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

import webgym
from webgym.cli._run import settings
from webgym.judge.factory import refuse_unjudgeable
from webgym.offline.web import OfflineWeb
from webgym.tasks.sources import SOURCES
from webgym.taskset.construction.config import read_config

ROOT = Path(__file__).parent.parent


@pytest.mark.browser
@pytest.mark.parametrize("example", sorted((ROOT / "examples").glob("*.py")), ids=lambda path: path.stem)
def test_an_example_runs(
    example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As they are, but with fewer websites and browsers."""
    make_many = webgym.make_many
    few: dict[str, Any] = {"sites": {"per_family": 5}, "collector": {"sessions": 2}}
    monkeypatch.setattr(webgym, "make_many", lambda _, name: make_many(2, name))
    monkeypatch.setattr(webgym, "RunConfig", partial(webgym.RunConfig, **few))
    monkeypatch.setattr(sys, "argv", [str(example), str(tmp_path / "run")])
    runpy.run_path(str(example), run_name="__main__")
    assert "attempts" in capsys.readouterr().out


DOCUMENTED = re.findall(r"\.\. auto\w+:: (webgym\.\S+)", (ROOT / "docs" / "own-website.md").read_text())


@pytest.mark.parametrize("example", sorted((ROOT / "examples").rglob("*.py")), ids=lambda path: path.stem)
def test_an_example_imports_what_may_be_relied_on(example: Path) -> None:
    imported = set[str]()
    for node in ast.walk(ast.parse(example.read_text())):
        match node:
            case ast.ImportFrom(module=str(module), names=names):
                imported |= {f"{module}.{each.name}" for each in names}
            case ast.Import(names=names):
                imported |= {each.name for each in names}
    public = {"webgym", *(f"webgym.{name}" for name in webgym.__all__), *DOCUMENTED}
    assert [
        name
        for name in sorted(imported)
        if re.match(r"webgym\b", name)
        and name not in public
        and not re.match(r"webgym\.(integrations|testing)\.", name)
    ] == []


TASK_SET = ROOT / "configs" / "task-set.yaml"
RUNS = sorted(set((ROOT / "configs").glob("*.yaml")) - {TASK_SET})


@pytest.mark.parametrize("preset", RUNS, ids=lambda path: path.stem)
def test_a_preset_of_a_run_loads(preset: Path) -> None:
    config = settings([preset], {})
    assert config.policy.name == "openai"
    assert "split" in config.tasks.model_fields_set
    # Tasks of a task set have no hidden truth: the preset's judge must do without.
    task = next(iter(OfflineWeb(1, per_family=1).tasks()))
    refuse_unjudgeable(config.judge, [msgspec.structs.replace(task, truth=None)])


def test_the_preset_of_the_task_set_names_all_its_sources() -> None:
    assert set(read_config(TASK_SET, {}).sources) == set(SOURCES) - {"webgym"}
