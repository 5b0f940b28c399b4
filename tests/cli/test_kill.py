"""Pulling the plug: kill -9 of the collector and of the server while a run goes on."""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections import Counter
from pathlib import Path

import psutil
import pytest
import yaml
from tests.conftest import Calls, Commands, wait_until

from webgym.core.errors import RunFolderError
from webgym.core.outcome import Outcome
from webgym.offline.web import OfflineWeb
from webgym.store.runs import RunReader
from webgym.tasks.formats import write_tasks
from webgym.tasks.sampling import draw

pytestmark = [pytest.mark.browser, pytest.mark.timeout(240)]

TASKS = 5


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    """A small run: short tasks of small websites that take their time, two browsers, retries."""
    web = OfflineWeb(per_family=3, collection="small")
    tasks = [task for task in web.tasks() if task.truth and len(task.truth.moves) <= 6]
    write_tasks(tmp_path / "tasks.jsonl", draw(tasks, TASKS, seed=5))
    held = {
        "retries": 3,
        "tasks": {"file": str(tmp_path / "tasks.jsonl"), "split": "all"},
        "sites": {"collection": "small", "per_family": 3},
        "collector": {"sessions": 2},
    }
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump(held))
    return path


def recorded(run: Path) -> int:
    """How many attempts are on disk."""
    try:
        return len(RunReader(run).attempts)
    except RunFolderError:
        return 0


def check_books(run: Path) -> Counter[Outcome]:
    """Every task came to a success, no attempt is there twice, and the summary adds up."""
    reader = RunReader(run)
    trajectories = list(reader.trajectories())
    outcomes = Counter(each.outcome for each in trajectories)
    assert len({each.episode.attempt_id for each in trajectories}) == len(trajectories)
    successes = Counter(each.episode.task_id for each in trajectories if each.outcome is Outcome.SUCCESS)
    assert successes == dict.fromkeys(reader.tasks, 1)
    assert len(reader.tasks) == TASKS
    summary = reader.summary
    assert summary is not None
    assert summary["attempts"] == len(trajectories) == sum(summary["outcomes"].values())
    return outcomes


def test_a_killed_collector_loses_only_what_was_in_flight(
    tmp_path: Path, settings: Path, commands: Commands, calls: Calls
) -> None:
    run = tmp_path / "run"
    first = commands.start("rollout", "--config", settings, "--out", run)
    wait_until(lambda: recorded(run) >= 2 or first.poll() is not None)
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    wait_until(lambda: not commands.left_over())  # the browsers went with it
    before = {entry.attempt_id: entry for entry in RunReader(run).attempts.values()}
    assert 2 <= len(before) < TASKS, commands.output(first)

    calls.printed("rollout", "--resume", run, "--no-report", WEBGYM_TEST_MARK=commands.mark)
    after = RunReader(run).attempts
    assert {name: after[name] for name in before} == before
    assert check_books(run).total() == TASKS

    # Nothing is left to do.
    calls.printed("rollout", "--resume", run, "--no-report", WEBGYM_TEST_MARK=commands.mark)
    assert len(RunReader(run).attempts) == TASKS
    assert not commands.left_over()


def test_a_killed_server_costs_attempts_and_no_trajectory(
    tmp_path: Path, settings: Path, commands: Commands
) -> None:
    tokens = {"WEBGYM_TOKEN": "the-token-of-the-server", "WEBGYM_SITES_TOKEN": "the-token-of-the-sites"}
    sites = commands.start(
        "sites", "serve", "--port", 0, "--collection", "small", "--per-family", 3, **tokens
    )
    wait_until(lambda: "list " in commands.output(sites))
    found = re.search(r"websites at (\S+)", commands.output(sites))
    assert found is not None

    def serve(port: str) -> tuple[subprocess.Popen[str], str]:
        rule = f"*.webgym.test={found[1]}"
        server = commands.start("serve", "--port", port, "--slots", 2, "--allow-host", rule, **tokens)
        wait_until(lambda: "slots " in commands.output(server))
        url = re.search(r"^server +(\S+)", commands.output(server), re.MULTILINE)
        assert url is not None
        return server, url[1]

    server, address = serve("0")
    run = tmp_path / "run"
    rollout = commands.start(
        "rollout", "--config", settings, "--out", run, "--no-report",
        "--server", address, "--sites", f"http://{found[1]}", **tokens,
    )  # fmt: skip
    wait_until(lambda: recorded(run) >= 2 or rollout.poll() is not None)
    os.kill(server.pid, signal.SIGKILL)
    server.wait()
    serve(address.rpartition(":")[2])
    assert rollout.wait(120) == 0, commands.output(rollout)
    outcomes = check_books(run)
    assert set(outcomes) <= {Outcome.SUCCESS, Outcome.ENVIRONMENT_ERROR}
    commands.end()
    wait_until(lambda: not commands.left_over())


def test_a_killed_server_takes_a_stopped_worker_with_it(commands: Commands) -> None:
    """The worker cannot see that the server is gone until it is continued."""
    server = commands.start("serve", "--port", 0, "--slots", 1, "--workers", 1)
    wait_until(lambda: "slots " in commands.output(server))
    [worker] = psutil.Process(server.pid).children()
    worker.suspend()
    wait_until(lambda: worker.status() == psutil.STATUS_STOPPED)
    os.kill(server.pid, signal.SIGKILL)
    server.wait()
    wait_until(lambda: not commands.left_over())
