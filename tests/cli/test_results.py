"""What a command returns prints itself: who calls the function in Python reads what the command prints."""

from __future__ import annotations

import ast
import asyncio
import importlib
import inspect
import pkgutil
import re
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from tests.cli.test_judge import webgym
from tests.report.conftest import build_run

from webgym import cli
from webgym.cli.doctor import Check
from webgym.core.settings import Settings
from webgym.core.storage import StorageState
from webgym.core.verdict import Cost
from webgym.llm.prices import Totals
from webgym.results.evaluation import compare, evaluate
from webgym.results.export import export
from webgym.rollout.merging import merge_runs
from webgym.store.verify import verify
from webgym.testing.solutions import Checked

NOT_RESULTS = {
    "what is read or chosen": "agent.profile.Profile bench.rollout.plan.RolloutPlan "
    "browser.find.FoundBrowser browser.sandbox.SandboxState core.task.Task judge.base.Judge "
    "judge.labels.HumanLabel judge.labels.LabelFile judge.webjudge.Labelled judge.webjudge.Pairs "
    "store.verdicts.Judged tasks.files.TaskFile train.estimate.Gpus train.stopping.Stop",
    "what runs": "browser.process.BrowserProcess compat.app.RunningCompat offline.app.RunningSites "
    "server.gateway.RunningGateway train.loop.Training",
    "rows, all of which the command shows as one table": "bench.rollout.results.Compared "
    "bench.rollout.results.Measured study.conditions.Result",
    "already what is shown": "core.tables.Table results.summary.Summary",
    "counted beside the figures of the paper, which it does not know": "tasks.sources.base.Read",
}
"""Types that functions return to commands, and that need no text of their own."""
EXCUSED = {name for names in NOT_RESULTS.values() for name in names.split()}


@cache
def imported(module: ModuleType) -> dict[str, str]:
    """The names that a module imports from the package, anywhere in it, with the modules they come from."""
    return {
        alias.name: node.module
        for node in ast.walk(ast.parse(inspect.getsource(module)))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("webgym.")
        for alias in node.names
        if node.module
    }


def returned() -> Iterator[tuple[str, type]]:
    """The package's own types in the annotations of what commands import and call, with who calls it."""
    for info in pkgutil.walk_packages(cli.__path__, "webgym.cli."):
        for name, home in imported(importlib.import_module(info.name)).items():
            function = getattr(importlib.import_module(home), name, None)
            if home.startswith("webgym.cli") or not inspect.isfunction(function):
                continue
            module = importlib.import_module(inspect.unwrap(function).__module__)
            for word in re.findall(r"\b[A-Z]\w+", str(function.__annotations__.get("return"))):
                place = imported(module).get(word, module.__name__)
                kind = getattr(importlib.import_module(place), word, None)
                if inspect.isclass(kind) and kind.__module__.startswith("webgym."):
                    yield f"{info.name.removeprefix('webgym.cli.')} calls {name}", kind


def prints_itself(kind: type) -> bool:
    return any("__str__" in vars(base) for base in kind.__mro__ if base.__module__.startswith("webgym."))


def test_what_a_command_returns_prints_itself() -> None:
    mute = {
        f"{kind.__module__.removeprefix('webgym.')}.{kind.__name__}": caller
        for caller, kind in returned()
        if not issubclass(kind, Settings) and not prints_itself(kind)
    }
    assert mute.keys() == EXCUSED, mute
    # What methods return, or is made of what functions return.
    assert all(map(prints_itself, (Check, Checked, Cost, StorageState, Totals)))


def test_a_printed_result_reads_as_what_the_command_prints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, out = asyncio.run(build_run(tmp_path / "run", 12)), tmp_path / "out"

    def printed(*arguments: str | Path) -> str:
        assert webgym(*arguments) == 0
        shutil.rmtree(out, ignore_errors=True)
        return capsys.readouterr().out

    assert printed("verify", run) == f"{verify(run)}\n"
    assert printed("compare", run, run) == f"{compare(run, run)}\n"
    assert f"{evaluate(run)}\n" in printed("eval", "--of", run)  # before how to judge what is not judged
    said = printed("export", run, "--out", out, "--split", "all")
    assert said == f"{export(run, out, 'parquet', split='all')}\n"
    shutil.rmtree(out)
    said = printed("merge", run, "--out", out, "--no-report")
    assert f"\n{asyncio.run(merge_runs([run], out))}; attempt them: webgym rollout --resume" in said
