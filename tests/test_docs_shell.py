"""Commands in README and docs run, in this process: a page's after one another, in a folder of its own.

They are as they stand there, but for what ``SMALLER`` adds, so that a run is of two tasks, and for a model's
address. What cannot run here stands in ``ELSEWHERE``.
"""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import yaml
from tests.integrations.engine import reply_text
from tests.judge.judge_model import Asked, serve_judge
from tests.llm.endpoint import serve
from tests.report.conftest import build_run
from tests.serving import beside
from tests.test_docs import PAGES, ROOT, blocks, calls

import webgym
from webgym.cli import main
from webgym.core.action import Answer
from webgym.judge.labels import HumanLabel
from webgym.rollout.labels import LABELS, LabelStore
from webgym.rollout.store import RunReader

SMALL: dict[str, Any] = {
    "sites": {"collection": "small"},
    "server": {"static": True},
    "policy": {"check": False},
    "tasks": {"count": 2},
}
"""A run of two tasks, without browsers where the websites are small."""

SMALLER = {
    "eval": ["--config", "run.yaml", "--limit", "2"],
    "rollout --out runs/first": ["--config", "run.yaml"],  # its model is elsewhere
    "rollout --tasks": ["--config", "browsers.yaml", "--sessions", "2"],
    "sites check": ["--sample", "1", "--sessions", "1"],
    "tasks offline": ["--collection", "small"],
    "tasks split": ["--test", "9"],
}
"""What is added to the commands that begin so."""

ELSEWHERE = {
    "bench": ("it measures for minutes", "tests/bench/test_rollout_bench.py"),
    "compare": ("the runs of the page take minutes", "tests/rollout/test_comparison.py"),
    "demo": ("it trains for minutes", "tests/tiny/test_demo.py"),
    "doctor": ("it starts a browser", "tests/cli/test_doctor.py"),
    "judge agreement --webjudge": ("the file is somebody else's", "tests/judge/test_agreement.py"),
    "llm import": ("its replies are of a batch endpoint", "tests/llm/test_command.py"),
    "pretrain": ("hours", "tests/tiny/test_recipe.py"),
    "serve": ("it ends when it is stopped", "tests/server/test_process.py"),
    "simulate": ("half a minute of computing", "tests/simulate/test_command.py"),
    "sites serve": ("it ends when it is stopped", "tests/cli/test_kill.py"),
    "study --out": ("hours", "tests/tiny/test_study.py"),
    "tasks build": ("its sources are elsewhere", "tests/tasks/test_build.py"),
    "tasks sources --read": ("its sources are elsewhere", "tests/tasks/sources/test_command.py"),
    "train": ("it needs the weights of a model", "tests/cli/test_train.py"),
    "view": ("it ends when it is stopped", "tests/report/test_live.py"),
}
"""Why commands that begin so do not run here, and the test that runs them."""


def commands(page: Path) -> list[list[str]]:
    """The words of a page's commands that are WebGym's."""
    shell = [each for each in blocks("sh", "bash", "console") if str(each.id).startswith(f"{page.name}:")]
    found = [call for each in shell for call in calls(str(each.values[0]))]
    return [words[1:] for words in found if words[0].rpartition("/")[2] == "webgym" and words[1:]]


def begun_by(words: list[str], keys: Iterable[str]) -> str:
    """The longest of the keys that the command begins with; empty if it begins with none."""
    command = " ".join(words) + " "
    return max((key for key in keys if command.startswith(f"{key} ")), key=len, default="")


def runs_here(page: Path) -> list[list[str]]:
    return [words for words in commands(page) if not begun_by(words, ELSEWHERE)]


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what pages take for given."""
    folder = tmp_path_factory.mktemp("given")
    tasks = list(webgym.OfflineWeb(per_family=3, collection="small").tasks())
    tasks[0] = msgspec.structs.replace(tasks[0], id="insta-v3/17", instruction="Buy a train ticket.")
    for name in ("tasks.jsonl", "tasks.parquet", "train.jsonl"):
        webgym.write_tasks(folder / name, tasks)
    whole = [
        msgspec.structs.replace(each, website=f"https://{n}.test/", split=None)
        for n, each in enumerate(tasks)
    ]
    webgym.write_tasks(folder / "whole.jsonl", whole)
    (folder / "browsers.yaml").write_text(yaml.safe_dump(SMALL | {"server": {}}))
    (folder / "run.yaml").write_text(yaml.safe_dump(SMALL | {"policy": {"name": "scripted", "check": False}}))
    for split in ("train", "test"):
        webgym.write_tasks(folder / "set" / f"{split}.jsonl", [each for each in tasks if each.split == split])
    asyncio.run(build_run(folder / "runs" / "first", 6))
    return folder


def label(run: Path) -> None:
    """Label a run's attempts, as a person does on the labelling page."""
    labels = LabelStore(run / LABELS)
    for trajectory in RunReader(run).trajectories():
        labels.put(HumanLabel("failure", trajectory.episode.attempt_id))


@pytest.fixture(scope="module")
def judge() -> Iterator[str]:
    """Address of a model that finds that everything holds."""

    def answers(asked: Asked) -> str:
        return (
            asked.each(lambda name: True)
            if asked.stage == "keypoint"
            else asked.verdict(asked.stage != "blocking")
        )

    with beside(serve_judge(answers)) as served:
        yield served.url


@pytest.fixture(scope="module")
def policy() -> Iterator[str]:
    """Address of a model that knows the answer without looking."""
    with beside(serve()) as served:
        served.text = reply_text(Answer("42"))
        yield served.url()


@pytest.mark.browser
@pytest.mark.parametrize("page", [pytest.param(page, id=page.name) for page in PAGES if runs_here(page)])
def test_commands_run(
    page: Path,
    held: Path,
    judge: str,
    policy: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = shutil.copytree(held, tmp_path / "page")
    monkeypatch.chdir(folder)
    for words in runs_here(page):
        if words[0] == "rollout" and "runs/first" in words and "--out" in words:
            shutil.rmtree("runs/first")
        if words[:2] == ["judge", "agreement"]:
            label(Path("runs/first"))
        model = judge if words[0] == "judge" or "--judge-base-url" in words else policy
        given = [
            re.sub(r"^(URL|http://(gpu|127\.0\.0\.1):8000/v1)$", model, word).replace("/shared/", "shared/")
            for word in words
        ]
        given = ["runs/first" if word == "RUN" else word for word in given]
        given += SMALLER.get(begun_by(words, SMALLER), [])
        with pytest.raises(SystemExit) as ended:
            main(given)
        told = capsys.readouterr()
        assert ended.value.code == 0, f"{' '.join(given)}: {told.out + told.err}"


@pytest.mark.parametrize(("command", "told"), [pytest.param(*each, id=each[0]) for each in ELSEWHERE.items()])
def test_what_runs_elsewhere_does(command: str, told: tuple[str, str]) -> None:
    _, test = told
    text = (ROOT / test).read_text()
    assert any(begun_by(words, [command]) for page in PAGES for words in commands(page)), "no page has it"
    # It gives these words to the command line, or calls the module that is named like the command.
    words = [word for word in command.split() if word != "--out"]
    assert all(f'"{word}"' in text or f".{word} import " in text for word in words)
