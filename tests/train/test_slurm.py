"""The examples for Slurm, under a real one on this machine (Debian: apt-get install slurm-wlm munge)."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml
from tests.conftest import wait_until
from tests.train.test_kill import trained

from webgym.core.outcome import Outcome
from webgym.store.runs import RunReader
from webgym.train.folder import Stage, TrainingFolder

ROOT = Path(__file__).parents[2]
EXAMPLE = str(ROOT / "examples/slurm/train.sbatch")
MISSING = [name for name in ("slurmctld", "slurmd", "munged", "sbatch") if shutil.which(name) is None]

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(2400),
    pytest.mark.skipif(bool(MISSING), reason=f"no {', '.join(MISSING)}: apt-get install slurm-wlm munge"),
    pytest.mark.skipif(os.geteuid() != 0, reason="slurmd starts jobs as root alone"),
]

TINY: dict[str, Any] = {
    "learn": {
        "model": "tiny",
        "replay": {"steps": 16, "passes": 1},
        "update": {"precision": "fp32", "learning_rate": 1e-3, "batch": 8, "micro_batch": 8},
    },
    "rollout": {
        "sites": {"collection": "small", "latency": 0},
        "agent": {"profile": "tiny", "prompt_format": "compact", "rounds": 0},
        "attempt": {"budget_easy": 6},
        "collector": {"sessions": 2},
    },
    "sampler": {"ratio": {"easy": 1}},
    "loop": {"iterations": 2, "tasks": 100, "evaluate_every": 2},
    "evaluation": {"count": 10, "budget": [4, 4, 4]},
    "local": {"path": "tiny", "threads": 1},
}
"""The tiny policy in real browsers, for as long as a job's shortest limit is noticed in: minutes."""

VLLM = """#!{python}
import http.server, os, sys
class Healthy(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(200)
        self.end_headers()
open({log!r}, "a").write(" ".join([*sys.argv[1:], os.environ["CUDA_VISIBLE_DEVICES"]]) + "\\n")
http.server.HTTPServer(("127.0.0.1", int(sys.argv[sys.argv.index("--port") + 1])), Healthy).serve_forever()
"""
"""In place of vLLM: notes how it was called, and is healthy."""


def free_ports(count: int) -> int:
    """The first of so many free ports in a row."""
    for first in range(21000, 60000, count):
        with ExitStack() as stack:
            try:
                for port in range(first, first + count):
                    stack.enter_context(socket.create_server(("127.0.0.1", port)))
            except OSError:
                continue
            return first
    raise AssertionError("no free ports")


@contextmanager
def cluster(nodes: int = 1) -> Iterator[Callable[..., str]]:
    """A Slurm of this machine, as if it were so many with 8 GPUs; yields what runs its commands."""
    names = ["localhost"] if nodes == 1 else [f"n{number}" for number in range(1, nodes + 1)]
    folder = Path(tempfile.mkdtemp(prefix="slurm", dir="/tmp"))  # a socket's path must be short
    host, port = socket.gethostname().partition(".")[0], free_ports(1 + nodes)
    machines = f"NodeName=localhost Port={port + 1}"
    if nodes > 1:
        machines = f"NodeName=n[1-{nodes}] Port=[{port + 1}-{port + nodes}]"
    (folder / "slurm.conf").write_text(f"""
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
AuthInfo=socket={folder}/munge,cred_expire=5
SlurmUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
ReturnToService=2
SelectType=select/cons_tres
GresTypes=gpu
KillWait=5
MinJobAge=86400
SlurmdParameters=config_overrides
{machines} NodeHostname={host} NodeAddr=127.0.0.1 CPUs=16 RealMemory=4000 Gres=gpu:8
PartitionName=all Nodes=ALL Default=YES
""")
    (folder / "gres.conf").write_text(f"Name=gpu File={folder}/gpu[0-7]\n")
    (folder / "cgroup.conf").write_text("CgroupAutomount=no\n")
    for name in ("state", "bin", "job"):
        (folder / name).mkdir()
    for number in range(8):
        (folder / f"gpu{number}").touch()
    (folder / "key").write_bytes(os.urandom(128))
    (folder / "key").chmod(0o600)
    vllm = folder / "bin/vllm"
    vllm.write_text(VLLM.format(python=sys.executable, log=str(folder / "job/vllm.txt")))
    vllm.chmod(0o755)
    if nodes > 1:  # names of nodes that only Slurm knows
        accelerate = folder / "bin/accelerate"
        real = f"{sys.executable} -m accelerate.commands.accelerate_cli"
        accelerate.write_text(f'#!/bin/bash\nexec {real} "${{@/#n1/127.0.0.1}}"\n')
        accelerate.chmod(0o755)
    environment = {
        **os.environ,
        "SLURM_CONF": str(folder / "slurm.conf"),
        "PATH": f"{folder}/bin:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "OMP_NUM_THREADS": "1",
    }

    def run(*words: str, **more: str) -> str:
        done = subprocess.run(
            words, cwd=folder / "job", env=environment | more, capture_output=True, text=True, check=True
        )
        return done.stdout

    munge = [f"--{name}={folder}/{name}" for name in ("log-file", "pid-file", "seed-file")]
    munged = ["munged", "--foreground", "--force", f"--key-file={folder}/key", f"--socket={folder}/munge"]

    def end_jobs() -> None:
        run("scancel", "--user=root", "--full")
        wait_until(lambda: not run("squeue", "--noheader"), 60)

    with ExitStack() as daemons:
        daemons.callback(shutil.rmtree, folder)
        workers = [["slurmd", "-D", "-N", name] for name in names]
        for place, command in enumerate(([*munged, *munge], ["slurmctld", "-D", "-c"], *workers)):
            log = daemons.enter_context((folder / f"daemon-{place}.txt").open("w"))
            daemon = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
            daemons.callback(daemon.wait, 30)
            daemons.callback(daemon.terminate)
            time.sleep(1)
        wait_until(lambda: run("sinfo", "--noheader", "--format=%T %D") == f"idle {nodes}\n", 60)
        daemons.callback(end_jobs)
        yield run


@pytest.mark.browser
def test_a_job_that_its_limit_cuts_off_goes_on_and_makes_each_attempt_once(tmp_path: Path) -> None:
    given, out = tmp_path / "tiny.yaml", TrainingFolder(tmp_path / "out")
    given.write_text(yaml.safe_dump(TINY))
    with cluster() as run:
        given_too = {"LEARNER_GPUS": "0,1", "JUDGE_MODEL": "a/judge", "STOP_BEFORE": "100s"}
        options = ("--time=60", "--signal=B:USR1@10")
        job = run("sbatch", "--parsable", *options, EXAMPLE, **script(given, out), **given_too).strip()

        def shown(name: str) -> str:
            (value,) = re.findall(rf"\b{name}=(\S+)", run("scontrol", "show", "job", job))
            return str(value)

        def log() -> str:
            file = Path(shown("StdOut"))
            return file.read_text() if file.exists() else ""

        def has_ended() -> bool:
            return shown("JobState") in ("FAILED", "COMPLETED", "TIMEOUT", "CANCELLED")

        def attempts() -> dict[str, Any]:
            return dict(RunReader(out.run(1)).attempts) if (out.run(1) / "config.yaml").exists() else {}

        # The first job does not know that its limit is lowered, and is cut off; the next one stops in time.
        wait_until(lambda: attempts() or has_ended(), 900)
        assert not has_ended(), log()
        hours, minutes, _ = shown("RunTime").split(":")
        limit = 60 * int(hours) + int(minutes) + 2  # the signal may come a minute early
        run("scontrol", "update", f"JobId={job}", f"TimeLimit={limit}")
        wait_until(lambda: shown("Restarts") == "1" or has_ended(), 60 * limit + 60)
        assert not has_ended(), log()
        run("scontrol", "update", f"JobId={job}", "TimeLimit=4")
        first = {name: entry for name, entry in attempts().items() if entry.outcome is not Outcome.CANCELLED}
        wait_until(lambda: shown("Restarts") == "2" or has_ended(), 300)
        assert not has_ended(), log()
        assert "stopped in time, nothing is lost" in log()
        run("scontrol", "update", f"JobId={job}", "TimeLimit=60")
        wait_until(has_ended, 1800)
        print(log(), run("scontrol", "show", "job", job))
        assert shown("JobState") == "COMPLETED", log()
        called = (Path(shown("StdOut")).parent / "vllm.txt").read_text().splitlines()
        assert len(called) == int(shown("Restarts")) + 1 == 3
        assert all(re.match(r"serve a/judge --host 127\.0\.0\.1 --port \d+ .* 7$", line) for line in called)
        assert log().count("the check passed") == 1

    pages = {"static": True, "pictures": str(tmp_path / "pictures")}
    given.write_text(yaml.safe_dump(TINY | {"rollout": TINY["rollout"] | {"server": pages}}))
    trained(tmp_path / "log", given, "--out", tmp_path / "whole")
    assert made(out) == made(TrainingFolder(tmp_path / "whole"))
    assert attempts().items() >= first.items(), "what was on disk when the job was cut off is kept"


@pytest.mark.browser
def test_two_nodes_learn_together_and_a_third_serves(tmp_path: Path) -> None:
    given, out = tmp_path / "tiny.yaml", TrainingFolder(tmp_path / "out")
    given.write_text(yaml.safe_dump(TINY | {"loop": {"iterations": 1, "tasks": 16, "evaluate_every": 0}}))
    with cluster(3) as run:
        more = {"LEARNER_GPUS": "0", "JUDGE_MODEL": ""}
        job = run("sbatch", "--parsable", "--nodes=3", EXAMPLE, **script(given, out), **more).strip()
        wait_until(lambda: not run("squeue", "--noheader", f"--job={job}"), 1200)
        (log,) = re.findall(r"StdOut=(\S+)", run("scontrol", "show", "job", job))
        assert "on 2 processes in" in Path(log).read_text(), Path(log).read_text()
    assert out.stage(1) is None
    assert out.figures(1, Stage.UPDATE)["samples"] > 0


def script(given: Path, out: TrainingFolder) -> dict[str, str]:
    """Variables of the example: a learner on processors, whose first process replies, too."""
    launch = {"ACCELERATE": str(ROOT / "configs/accelerate/ddp.yaml"), "ACCELERATE_USE_CPU": "true"}
    what = {"OUT": str(out.path), "CONFIG": str(given), "POLICY_MODEL": "", "SITES": "small"}
    return launch | what | {"PORT": str(free_ports(5))}


def made(training: TrainingFolder) -> dict[str, Counter[tuple[str, int]]]:
    """How often each sample of a training was attempted, without what a stop broke off."""
    runs = [*training.path.glob("iterations/*/run"), *training.path.glob("evaluations/*/")]
    return {
        str(path.relative_to(training.path)): Counter(
            (entry.task_id, entry.sample)
            for entry in RunReader(path).attempts.values()
            if entry.outcome is not Outcome.CANCELLED
        )
        for path in runs
    }
