"""The demo: the package's own weights act in real browsers, learn, and act again."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("torch")

from tests.conftest import Calls
from tests.documented import documented

from webgym.inference.model import load_model
from webgym.offline.small import small_vocabulary
from webgym.store.runs import RunReader
from webgym.study.demo import WEIGHTS
from webgym.study.model import vocabulary
from webgym.train.folder import TrainingFolder


def test_the_packages_weights_are_for_the_websites_of_today() -> None:
    loaded = load_model(WEIGHTS)
    assert sum(each.numel() for each in loaded.model.parameters()) < 10_000_000
    tokens = loaded.tokenizer.get_vocab()
    assert sorted(tokens, key=tokens.__getitem__) == vocabulary(small_vocabulary(), (192, 128))
    assert (WEIGHTS / "README.md").is_file()


@pytest.mark.browser
def test_a_small_demo_acts_learns_and_acts_again_on_the_same_unseen_tasks(
    tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    out = Path("runs/first")
    Path("tiny").mkdir()
    Path("tiny/model").symlink_to(WEIGHTS)
    own_weights = documented("webgym demo --weights tiny/model")[1:]
    tutorial = documented("webgym demo --tasks 60 --iterations 2 --out runs/first")[1:]
    small = ("--tasks", 4, "--iterations", 1, "--sessions", 2)
    code, said = calls.run(*documented("webgym demo"), *own_weights, *tutorial, *small)
    assert code == 0, said
    for when in ("before", "after"):
        assert f"{when:8} " in said
    assert (out / "report.html").is_file()
    browsed = said.splitlines()[-1].removeprefix("browse   webgym view ")
    assert RunReader(Path(browsed)).path == out / "evaluations" / "0001"
    assert sorted(TrainingFolder(out).evaluations()) == [0, 1]
    runs = [RunReader(out / "evaluations" / number) for number in ("0000", "0001")]
    attempted = [sorted(each.episode.task_id for each in run.trajectories()) for run in runs]
    assert attempted[0] == attempted[1]
    assert len(attempted[0]) == 4
    assert {task.split for task in runs[0].tasks.values()} == {"test"}
    trained = RunReader(out / "iterations" / "0001" / "run")
    assert {task.split for task in trained.tasks.values()} == {"train"}
