"""Commands in README and docs run, in this process: a page's after one another, in a folder of its own.

They are as they stand there, but for what ``SMALLER`` adds, so that they are over in seconds, and for a
model's address. What a test elsewhere takes from ``documented`` runs there; what other programs are given is
checked as far as they let it, by ``CHECKS``; what cannot run stands in ``NOT_RUN``.
"""

from __future__ import annotations

import ast
import asyncio
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import tomllib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
import yaml
from tests.bench.test_rollout_bench import PLAN, measured
from tests.documented import PAGES, ROOT, SHELL, blocks_of, calls, commands_of
from tests.integrations.engine import reply_text
from tests.judge.judge_model import Asked, serve_judge
from tests.llm.endpoint import serve
from tests.report.conftest import build_run
from tests.report.training import build_training
from tests.serving import beside
from tests.tasks.hub_server import Hub, serve_hub, use
from tests.test_docs import wrong

import webgym
from webgym.bench.rollout.plan import PARTS, RolloutPlan
from webgym.bench.rollout.results import begin, file_of
from webgym.cli import main
from webgym.core.action import Answer
from webgym.judge.labels import HumanLabel
from webgym.results.labels import LABELS, LabelStore
from webgym.store.runs import RunReader

SMALL: dict[str, Any] = {
    "sites": {"collection": "small", "per_family": 6},
    "server": {"static": True},
    "policy": {"check": False},
    "tasks": {"count": 2},
}
"""A run of two tasks, without browsers where the websites are small."""

SMALLER = {
    "bench rollout --quick": "--no-measure --cpus 1 --out runs/quick",
    "bench rollout --out": (
        "--no-measure --trajectories 8 --sessions 4 --cpus 1 --cpus 2 --mean-steps 5 --rounds 2"
    ),
    "demo --collect-only": "--tasks 2 --sessions 2",
    "eval": "--config run.yaml --limit 2",
    "eval --tasks": "--config browsers.yaml --sessions 2 --limit 2",
    "rollout --out runs/first": "--config run.yaml",  # its model is elsewhere
    "rollout --tasks": "--config browsers.yaml --sessions 2",
    "simulate": "--config small.yaml --environments 16",
    "sites check": "--sample 1 --sessions 1 --family desk",
    "sites serve": "--port 0",
    "tasks offline": "--collection small --per-family 6",
    "tasks split": "--test 9",
}
"""What is added to the commands that begin so."""

SERVERS = ("sites serve", "view")
"""Commands that begin so are asked once, and stopped with Ctrl-C."""

NOT_RUN = {
    "chown": "it needs an administrator; tests/browser/test_cgroups.py divides a group where it may",
    "echo": "as chown",
    "mkdir": "as chown",
    "tee": "as chown",
    "vllm": "it needs a GPU",
    "webgym eval --benchmark": "it needs websites of others; tests/cli/test_benchmarks.py has one",
    "webgym eval --of runs/om2w": "as webgym eval --benchmark",
    "webgym judge agreement --webjudge WebJudge_results.json": "tests/judge/test_agreement.py has such files",
    "webgym judge agreement runs/om2w": "as webgym eval --benchmark",
    "webgym judge runs/om2w": "as webgym eval --benchmark",
    "webgym rollout --config live.yaml": "it needs websites of others",
    "webgym rollout --tasks first.jsonl --split test": "it needs websites of others",
    "webgym tasks probe": "it needs websites of others; tests/rollout/test_probe.py has one",
    "webgym serve --cgroup": "as chown; tests/browser/test_cgroups.py starts a browser in a cgroup",
    "webgym train CONFIG --from": "it needs a model; tests/train/test_warm_start.py has one",
    "webgym train configs/train/qwen3-vl-8b.yaml --out training/first --gpus 8": (
        "it needs GPUs; tests/train/test_layout.py has what it starts"
    ),
    "webgym view runs/live": "as webgym rollout --tasks first.jsonl",
    "webgym serve --host": "it ends with its machine; tests/train/test_slurm.py has one",
}
"""Why commands that begin so do not run."""

IN_A_SHELL = {"export": "printenv WEBGYM_TOKEN", "head": "true"}
"""Lines with these commands run in a shell, and then this."""


def pip_takes(words: list[str]) -> bool:
    """Our extras exist; other packages are those that the adapters are tested with."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    tested = (ROOT / "scripts" / "test-integrations").read_text()
    for word in words[1:]:
        if ours := re.fullmatch(r"(?:webgym-rl|\.)\[([\w,-]+)\]", word):
            if not set(ours[1].split(",")) <= set(extras):
                return False
        elif word not in tested:
            return False
    return words[0] == "install"


def docker_takes(words: list[str]) -> bool:
    """There is no container runtime: its files are there, and what runs in the image are words of ours."""
    files = [word.partition("=")[2] for word in words if word.startswith("seccomp=")]
    if words[0] == "build":
        return (ROOT / words[words.index("-f") + 1]).is_file()
    image = len(words) - 1 - words[::-1].index("webgym")
    return bool(files) and all((ROOT / file).is_file() for file in files) and wrong(words[image:]) == ""


def succeeds(*command: str) -> bool:
    return subprocess.run(command, cwd=ROOT, capture_output=True, check=False).returncode == 0


CHECKS: dict[str, Callable[[list[str]], bool]] = {
    "docker": docker_takes,
    "make": lambda words: succeeds("make", "--dry-run", *words),
    "openssl": lambda words: succeeds("openssl", *words),
    "pip": pip_takes,
    "playwright": lambda words: succeeds(sys.executable, "-m", "playwright", *words, "--dry-run"),
    "pytest": lambda words: all((ROOT / word).exists() for word in words if "/" in word),
}
"""Whether a program of this name takes these words."""


def begun_by(words: list[str], keys: Iterable[str]) -> str:
    """The longest of the keys that the command begins with; empty if it begins with none."""
    command = " ".join(words) + " "
    return max((key for key in keys if command.startswith(f"{key} ")), key=len, default="")


@cache
def run_by_other_tests() -> frozenset[str]:
    """The commands that tests take from ``documented``."""
    found = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        if "documented(" in (text := path.read_text()):
            for node in ast.walk(ast.parse(text)):
                match node:
                    case ast.Call(func=ast.Name(id="documented"), args=[ast.Constant(value=str(command))]):
                        found.add(command)
    return frozenset(found)


def without_sudo(words: list[str]) -> list[str]:
    return words[1:] if words[0] == "sudo" else words


def elsewhere(words: list[str]) -> bool:
    words = without_sudo(words)
    return " ".join(words) in run_by_other_tests() or bool(begun_by(words, [*NOT_RUN, *IN_A_SHELL]))


def runs_here(page: Path) -> list[list[str]]:
    """The words of a page's commands that are WebGym's, and run by this test."""
    return [words[1:] for words in commands_of(page) if words[0] == "webgym" and not elsewhere(words)]


@pytest.fixture(scope="module")
def held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what pages take for given."""
    folder = tmp_path_factory.mktemp("given")
    tasks = list(webgym.OfflineWeb(per_family=6, collection="small").tasks())
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
    (folder / "small.yaml").write_text("workload: {trajectories: 40, mean_steps: 1.5, budgets: [2, 2, 2]}\n")
    [(_, system)] = blocks_of(ROOT / "docs" / "simulate.md", "yaml")
    (folder / "system.yaml").write_text(system)
    (folder / "configs").symlink_to(ROOT / "configs")
    for split in ("train", "test"):
        webgym.write_tasks(folder / "set" / f"{split}.jsonl", [each for each in tasks if each.split == split])
    asyncio.run(build_run(folder / "runs" / "first", 6))
    quick = RolloutPlan(trajectories=12, sessions=6, cpus=(1,), mean_steps=5.0, rounds=1)
    for plan, name, parts in ((PLAN, "bench-rollout", PARTS), (quick, "quick", ["calibration"])):
        bench = folder / "runs" / name
        begin(plan, bench)
        for cell in plan.cells(parts):
            file_of(bench, cell).write_bytes(msgspec.json.encode(measured(cell, 30.0)))
    return folder


@pytest.fixture(scope="module")
def hub(held: Path) -> Iterator[Hub]:
    """A hub with the published set."""
    files = {path.name: path.read_bytes() for path in (held / "set").iterdir()}
    with beside(serve_hub()) as served:
        served.commit("microsoft/webgym_tasks", files)
        yield served


def label(run: Path) -> None:
    """Label a run's attempts, as a person does on the labelling page."""
    labels = LabelStore(run / LABELS)
    for trajectory in RunReader(run).trajectories():
        labels.put(HumanLabel("failure", trajectory.episode.attempt_id))


def prepare(words: list[str]) -> None:
    """Do what is done before a command on its page."""
    first = Path("runs/first")
    if words[0] == "rollout" and "runs/first" in words and "--out" in words:
        shutil.rmtree(first)
    if words[:2] == ["judge", "agreement"]:
        label(first)
    if words[:2] == ["compare", "runs/first/evaluations/0000"]:  # which the page's demo has made
        shutil.rmtree(first)
        build_training(first, iterations=2, count=6)


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


class Visitor(threading.Thread):
    """Asks a server that a command in this process has started, and stops it with Ctrl-C.

    Attributes:
        said: what the command has printed.
        status: of the reply.
    """

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        super().__init__(daemon=True)
        self._capsys = capsys
        self._is_over = threading.Event()
        self.said, self.status = "", 0

    def run(self) -> None:
        while not self._is_over.wait(0.05):
            self.said += self._capsys.readouterr().out
            # The offline web says its address, and the name of a website; a page of ours only its address.
            web = re.search(r"MAP \S+ (127\.0\.0\.1:\d+)' http://(\S+)/\n", self.said)
            if found := web or re.match(r"http://((127\.0\.0\.1:\d+))\S*\n", self.said):
                headers = {"host": found[2]}
                answer = httpx.get(f"http://{found[1]}/", headers=headers, trust_env=False, timeout=60)
                self.status = answer.status_code
                os.kill(os.getpid(), signal.SIGINT)
                return

    def end(self) -> None:
        """The command is over."""
        self._is_over.set()
        self.join()


def run(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Run a command of WebGym's; a server is asked and stopped."""
    visitor = Visitor(capsys) if (is_server := bool(begun_by(words, SERVERS))) else None
    if visitor:
        visitor.start()
    try:
        with pytest.raises(SystemExit) as ended:
            main(words)
    finally:
        if visitor:
            visitor.end()
    told = capsys.readouterr()
    said = (visitor.said if visitor else "") + told.out + told.err
    assert ended.value.code in ((0, 130) if is_server else (0,)), f"{' '.join(words)}: {said}"
    if visitor:
        assert visitor.status == httpx.codes.OK, said


@pytest.mark.browser
@pytest.mark.parametrize("page", [pytest.param(page, id=page.name) for page in PAGES if runs_here(page)])
def test_commands_run(
    page: Path,
    held: Path,
    judge: str,
    policy: str,
    hub: Hub,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = shutil.copytree(held, tmp_path / "page", symlinks=True)
    monkeypatch.chdir(folder)
    use(hub, tmp_path / "cache", monkeypatch)
    monkeypatch.setenv("HF_TOKEN", hub.token)
    for words in runs_here(page):
        prepare(words)
        model = judge if words[0] == "judge" or "--judge-base-url" in words else policy
        given = [
            re.sub(r"^(URL|http://(gpu|127\.0\.0\.1):8000/v1)$", model, word).replace("/shared/", "shared/")
            for word in words
        ]
        names = {"RUN": "runs/first", "CONFIG": "configs/train/qwen3-vl-8b.yaml"}
        run(
            [*(names.get(word, word) for word in given), *SMALLER.get(begun_by(words, SMALLER), "").split()],
            capsys,
        )


@pytest.mark.parametrize("name", IN_A_SHELL)
def test_lines_run_in_a_shell(name: str, held: Path, hub: Hub, tmp_path: Path) -> None:
    blocks = [code.replace("\\\n", " ") for page in PAGES for _, code in blocks_of(page, *SHELL)]
    lines = [
        line for code in blocks for line in code.splitlines() if name in (call[0] for call in calls(line))
    ]
    assert lines
    of_hub = {"HF_ENDPOINT": hub.url, "HF_HOME": str(tmp_path), "HF_HUB_OFFLINE": "0"}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    for line in lines:
        script = f"set -euo pipefail\n{line}\n{IN_A_SHELL[name]}"
        ran = subprocess.run(
            ["bash", "-c", script],
            cwd=held,
            env=os.environ | of_hub | {"PATH": path},
            capture_output=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stderr.decode()
        assert ran.stdout.strip(), line


def others() -> list[Any]:
    """Commands that are not WebGym's, and neither run by a test of their own nor said not to run."""
    found = {" ".join(words): words for page in PAGES for words in map(without_sudo, commands_of(page))}
    return [
        pytest.param(words, id=command)
        for command, words in found.items()
        if words[0] != "webgym" and not elsewhere(words)
    ]


@pytest.mark.parametrize("words", others())
def test_other_programs_take_their_words(words: list[str]) -> None:
    assert CHECKS[words[0]](words[1:])


def test_what_does_not_run_is_on_a_page_and_names_a_test_that_is_there() -> None:
    held = [without_sudo(words) for page in PAGES for words in commands_of(page)]
    assert [key for key in NOT_RUN if not any(begun_by(words, [key]) for words in held)] == []
    named = [name for reason in NOT_RUN.values() for name in re.findall(r"tests/[\w/]+\.py", reason)]
    assert all((ROOT / name).is_file() for name in named)
    assert run_by_other_tests() <= {" ".join(words) for words in held}
