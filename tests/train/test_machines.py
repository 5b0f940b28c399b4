"""One training on two machines, as far as processes know: two launches that meet over the network."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from tests.train.test_kill import GIVEN

from webgym.train.folder import Stage, TrainingFolder

ROOT = Path(__file__).parents[2]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return int(server.getsockname()[1])


def launched_together(*words: object) -> list[str]:
    """What two launches of ``webgym train``, with a process each, printed."""
    config = ROOT / "configs/accelerate/ddp.yaml"
    launch = [sys.executable, "-m", "accelerate.commands.accelerate_cli", "launch", f"--config_file={config}"]
    where = ["--main_process_ip=127.0.0.1", f"--main_process_port={free_port()}"]
    number = ["--num_machines=2", "--num_processes=2"]
    environment = os.environ | {"ACCELERATE_USE_CPU": "true", "OMP_NUM_THREADS": "1"}
    launches = [
        subprocess.Popen(
            [*launch, *where, *number, f"--machine_rank={rank}", "-m", "webgym", "train", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=environment,
        )
        for rank in range(2)
    ]
    printed = [launch.communicate(timeout=500)[0] for launch in launches]
    assert [launch.returncode for launch in launches] == [0, 0], "\n".join(printed)
    return printed


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    """A file of settings: a training of one iteration, without browsers."""
    given = GIVEN | {
        "learn": GIVEN["learn"] | {"model": "tiny"},
        "rollout": GIVEN["rollout"] | {"server": {"static": True, "pictures": str(tmp_path / "pictures")}},
        "loop": GIVEN["loop"] | {"iterations": 1, "tasks": 24, "evaluate_every": 0},
    }
    file = tmp_path / "train.yaml"
    file.write_text(yaml.safe_dump(given))
    return file


@pytest.mark.slow
@pytest.mark.timeout(600)  # two launches, each of which loads torch twice, beside others that do
def test_two_launches_take_the_step_of_a_check_together(tmp_path: Path, settings: Path) -> None:
    first, second = launched_together(settings, "--out", tmp_path / "out", "--check")
    assert "update     8 steps of" in first
    assert "on 2 processes in" in first
    assert "the check passed" in first
    assert "check" not in second
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_two_launches_train_together(tmp_path: Path, settings: Path) -> None:
    launched_together(settings, "--out", tmp_path / "out")
    folder = TrainingFolder(tmp_path / "out")
    assert folder.stage(1) is None
    assert folder.figures(1, Stage.UPDATE)["samples"] > 0
