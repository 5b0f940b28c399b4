"""What a command returns prints itself: who calls the function in Python reads what the command prints."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

import pytest
from tests.cli.test_judge import webgym
from tests.report.conftest import build_run

from webgym.results.evaluation import compare, evaluate
from webgym.results.export import export
from webgym.rollout.merging import merge_runs
from webgym.store.verify import verify


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
