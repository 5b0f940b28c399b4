"""Where GPUs go: chosen, described, and started with the GPUs that they were given."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest
import yaml
from pydantic import SecretStr, ValidationError
from tests.conftest import Calls, wait_until
from tests.train import fake_vllm
from tests.train.test_kill import GIVEN

from webgym.core.errors import ConfigError
from webgym.core.settings import merged
from webgym.inference.vllm import VllmApi
from webgym.train.estimate import Gpus
from webgym.train.layout import Layout
from webgym.train.loop import TrainConfig
from webgym.train.placing import choose, gpus_of, placed
from webgym.train.start import loaded

PRESET = Path(__file__).parents[2] / "configs/train/qwen3-vl-8b.yaml"
MODEL = "Qwen/Qwen3-VL-8B-Instruct"
JUDGE = {"rollout": {"judge": {"rubric": {"chat": {"model": MODEL}}}}}
"""A judge whose size needs no download."""


def preset(**changes: Any) -> TrainConfig:
    return TrainConfig.model_validate(merged(merged(yaml.safe_load(PRESET.read_text()), JUDGE), changes))


@pytest.mark.parametrize("text", ["1+0+0", "4+3+1", "4+2x2+0", "12+3x4+2"])
def test_a_layout_is_read_as_it_is_written(text: str) -> None:
    assert str(Layout.parse(text)) == text


def test_parts_of_a_layout_may_be_left_out_and_others_are_refused() -> None:
    assert Layout.parse("8") == Layout(8)
    assert Layout.parse("4+4") == Layout(4, 4)
    assert Layout.parse("4+2x2+1").replying == range(4, 8)
    assert Layout.parse("4+2x2+1").judging == range(8, 9)
    for text in ("0+1+0", "4+", "4+3+1+1", "four"):
        with pytest.raises(ValidationError, match=r"such as 4\+3\+1"):
            preset(layout=text)


@pytest.mark.parametrize(
    ("gpus", "changes", "expected"),
    [
        ("8xh100", {}, "4+3+1"),
        ("4xh200", {}, "2+1+1"),
        ("1xh200", {}, "1+0+0"),
        ("2xh100", {}, "1+1+0"),  # too few for a judge
        ("8xh100", {"learn": {"update": {"lora": {}, "weights": "bfloat16"}}}, "1+6+1"),
        ("8xh100", {"local": None, "vllm": {"base_url": "http://elsewhere:1/v1"}}, "7+0+1"),
        ("8xh100", {"rollout": {"judge": {"rubric": {"chat": {"base_url": "http://elsewhere:1"}}}}}, "4+4+0"),
    ],
)
def test_by_itself_the_learner_gets_what_an_update_needs_and_servers_the_rest(
    gpus: str, changes: dict[str, Any], expected: str
) -> None:
    assert str(choose(preset(**changes), gpus_of(gpus))) == expected


def test_a_server_gets_the_gpus_that_its_model_needs() -> None:
    tight = Gpus(8, memory_gib=24)
    layout = choose(preset(learn={"update": {"micro_batch": 1}}), tight)
    assert (layout.server_gpus, layout.judge) == (2, 2)


def test_what_a_layout_starts_gets_the_gpus_that_are_visible_in_their_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "a,b,c,d,e,f")
    here, judge, gpus = placed(preset(layout="1+2x2+1"))
    assert here.local is None
    assert here.vllm is not None
    assert [each.env["CUDA_VISIBLE_DEVICES"] for each in here.vllm.each()] == ["b,c", "d,e"]
    assert {each.tensor_parallel_size for each in here.vllm.each()} == {2}
    assert here.sampling == preset().sampling
    assert judge is not None
    assert (judge.model, gpus) == (MODEL, ["f"])
    assert placed(preset()) == (preset(), None, [])


@pytest.mark.parametrize(
    ("layout", "changes", "told"),
    [
        ("4+3+1", {}, "takes 8 GPUs, and this machine has 4"),
        ("1+1+1", {"rollout": {"judge": {"rubric": {"chat": {"base_url": "http://b:1"}}}}}, "for a judge"),
        ("1+1+1", {"local": None, "vllm": {"base_url": "http://b:1"}}, "vllm.base_url names one"),
    ],
)
def test_a_layout_that_does_not_fit_is_refused(
    layout: str, changes: dict[str, Any], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0,1,2,3")
    with pytest.raises(ConfigError, match=told):
        placed(preset(layout=layout, **changes))


def test_explain_says_where_each_gpu_goes_and_what_waiting_for_one_process_costs(calls: Calls) -> None:
    judge = ("--rollout.judge.rubric.chat.model", MODEL)
    code, told = calls.run("train", PRESET, "--explain", "--gpus", "8xh100", *judge)
    assert code == 0, told
    assert "4+3+1 of 8 x 80 GiB: learner 0-3, policy 4-6, judge 7" in told
    assert "3 of 1 GPU: 16.3 GiB of weights per GPU, 55.7 for requests" in told
    assert f"{MODEL} on 1 GPU: 16.3 GiB" in told
    assert "transformers" not in told
    code, told = calls.run("train", PRESET, "--explain", "--layout", "8", *judge)
    assert code == 0, told
    assert "the first of 8 processes replies with transformers" in told
    assert "while 7 GPUs wait" in told
    assert calls.run("train", PRESET, "--explain", "--gpus", "8xtpu")[0] == 2
    assert "GiB per GPU, fits" in calls.run("train", "tiny", "--explain")[1]  # pictures of 192 x 128


def became(calls: Calls, monkeypatch: pytest.MonkeyPatch, *words: object, **environment: str) -> list[str]:
    """The program and arguments that a command became."""
    found: list[str] = []

    def execv(_: str, command: list[str]) -> None:
        found.extend(command)
        raise SystemExit(0)

    monkeypatch.setattr(os, "execv", execv)
    monkeypatch.setattr(sys, "argv", ["webgym", *map(str, words)])
    code, told = calls.run(*words, CUDA_VISIBLE_DEVICES="0,1,2,3,4,5,6,7", **environment)
    assert code == 0, told
    return found


@pytest.mark.parametrize(("lora", "way"), [(False, "fsdp2"), (True, "ddp")])
def test_a_process_is_launched_for_each_gpu_that_learns(
    calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lora: bool, way: str
) -> None:
    (tmp_path / "tasks.jsonl").touch()
    words = ["train", PRESET, "--out", tmp_path / "out", "--rollout.tasks.file", tmp_path / "tasks.jsonl"]
    words += [
        "--rollout.judge.rubric.chat.model",
        MODEL,
        *(["--learn.update.lora.rank", "8"] if lora else []),
    ]
    chosen = ["--layout", "2+5+1"] if lora else ["--gpus", "8xh100"]
    command = became(calls, monkeypatch, *words, *chosen)
    own = command.index("webgym")
    assert f"{way}.yaml" in " ".join(command[:own])
    assert command[command.index("--num_processes") + 1] == ("2" if lora else "4")
    assert command[own + 1 :] == [*map(str, words), *chosen, *([] if lora else ["--layout", "4+3+1"])]
    assert not (tmp_path / "out").exists()


def test_a_training_goes_on_in_its_layout_or_in_another(
    calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "config.yaml").write_text(yaml.safe_dump(preset(layout="2+1+1").model_dump(mode="json")))
    for chosen, learners in ([], "2"), (["--layout", "3+1"], "3"), (["--gpus", "8xh100"], "4"):
        command = became(calls, monkeypatch, "train", "--resume", tmp_path, *chosen)
        assert command[command.index("--num_processes") + 1] == learners


def test_another_number_of_processes_than_the_layouts_is_refused(calls: Calls, tmp_path: Path) -> None:
    (tmp_path / "tasks.jsonl").touch()
    words = ["train", PRESET, "--out", tmp_path / "out", "--rollout.tasks.file", tmp_path / "tasks.jsonl"]
    launched = {"RANK": "0", "WORLD_SIZE": "2", "CUDA_VISIBLE_DEVICES": "0,1,2,3"}
    code, told = calls.run(*words, "--layout", "4", **launched)
    assert (code, "2 processes were launched, and of the layout 4+0+0 4 learn" in told) == (2, True), told


def with_judge(path: Path, port: int, **changes: Any) -> TrainConfig:
    """The tiny policy in no browser, and a judge on this machine."""
    chat = {"base_url": f"http://127.0.0.1:{port}/v1", "model": "org/judge"}
    rollout = {
        "sites": {"collection": "small", "per_family": 4},
        "server": {"static": True, "pictures": str(path / "pictures")},
        "agent": {"profile": "tiny", "prompt_format": "compact", "rounds": 0},
        "policy": {"check": False},
        "judge": {"name": "rubric", "without_rubric": True, "rubric": {"chat": chat}},
    }
    return TrainConfig.model_validate({"learn": {"model": "tiny"}, "rollout": rollout, **changes})


def test_servers_of_policy_and_judge_are_started_on_their_gpus_and_end_with_the_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command, pids = tmp_path / "vllm", tmp_path / "pids"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -S {fake_vllm.__file__} "$@"\n')
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setenv("FAKE_VLLM", "engine")
    monkeypatch.setenv("FAKE_VLLM_PIDS", str(pids))
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "10,11,12,13,14")
    monkeypatch.delenv("WEBGYM_API_KEY", raising=False)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    config = with_judge(tmp_path, port, layout="1+2+2")

    def server(number: int) -> psutil.Process:
        return psutil.Process(int(pids.read_text().splitlines()[number].split()[0]))

    async def go() -> list[psutil.Process]:
        async with loaded(config, tmp_path / "out"):
            judge, *policy = map(server, range(3))
            assert sorted(each.environ()["CUDA_VISIBLE_DEVICES"] for each in policy) == ["11", "12"]
            assert judge.environ()["CUDA_VISIBLE_DEVICES"] == "13,14"
            assert judge.environ()["VLLM_API_KEY"] == os.environ["WEBGYM_API_KEY"]
            given = judge.cmdline()
            assert given[given.index("serve") + 1] == "org/judge"
            assert given[given.index("--tensor-parallel-size") + 1] == "2"
            os.kill(judge.pid, signal.SIGKILL)
            api = VllmApi(config.rollout.judge.rubric.chat.base_url, SecretStr(""))  # type: ignore[union-attr]
            async with asyncio.timeout(30):
                while len(pids.read_text().splitlines()) < 4 or not await api.is_up():
                    await asyncio.sleep(0.05)
            await api.close()
            return [judge, *policy, server(3)]

    started = asyncio.run(go())
    wait_until(lambda: not any(each.is_running() for each in started), 20)
    assert not any(each.is_running() for each in started)


async def test_who_collects_in_one_process_of_several_is_told_what_it_costs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("webgym.train.start.present_gpus", lambda: Gpus(4))
    config = with_judge(tmp_path, 1, local={"path": "tiny", "device": "cuda"})
    told: list[str] = []
    with pytest.raises(ConfigError, match="cuda"):  # of this machine
        async with loaded(config, tmp_path / "out", tell=told.append):
            pass
    assert any("while 3 GPUs wait" in line for line in told), told


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_processes_of_a_layout_learn_together(tmp_path: Path) -> None:
    """On processors, in which accelerate takes the place of GPUs."""
    given = tmp_path / "given.yaml"
    given.write_text(yaml.safe_dump(GIVEN | {"learn": GIVEN["learn"] | {"model": "tiny"}}))
    words = [sys.executable, "-m", "webgym", "train", given, "--out", tmp_path / "out", "--layout", "2"]
    here = {"CUDA_VISIBLE_DEVICES": "0,1", "ACCELERATE_USE_CPU": "true", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [*map(str, words), "--check"],
        cwd=Path(__file__).parents[2],
        env=os.environ | here,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "on 2 processes in" in done.stdout
