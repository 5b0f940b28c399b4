"""Several servers behind one policy: sessions stay, weights reach all or none, who is away comes back."""

from __future__ import annotations

import asyncio
import os
import signal
import stat
import sys
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import ExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from tests.train import fake_vllm
from tests.train.making import task
from tests.train.test_vllm import pids, saved, turn, until

from webgym.core.errors import PublishError, TrainingError
from webgym.core.trajectory import Reply
from webgym.inference.vllm import VllmConfig
from webgym.train import engine_fleet
from webgym.train.engine_fleet import EngineFleet, FleetPolicy, FleetSession
from webgym.train.folder import TrainingFolder
from webgym.train.loop import TrainConfig
from webgym.train.start import make_serving


@pytest.fixture(autouse=True)
def _polls_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine_fleet, "_POLL_SECONDS", 0.02)


@pytest.fixture
def fakes() -> Iterator[list[fake_vllm.FakeVllm]]:
    with ExitStack() as stack:
        yield [stack.enter_context(fake_vllm.running("dev", "lora")) for _ in range(3)]


def fleet_of(out: Path, *, lora: bool = False, **vllm: Any) -> EngineFleet:
    learn = {"model": "org/Model-8B", "update": {"lora": {} if lora else None}}
    serving = make_serving(TrainConfig.model_validate({"learn": learn, "vllm": vllm}), TrainingFolder(out))
    assert isinstance(serving, EngineFleet)
    return serving


@asynccontextmanager
async def opened(
    fakes: Sequence[fake_vllm.FakeVllm], out: Path, *, lora: bool = False, **vllm: Any
) -> AsyncIterator[EngineFleet]:
    async with fleet_of(out, lora=lora, base_url=[fake.url for fake in fakes], **vllm) as fleet:
        watch = asyncio.create_task(fleet.watch())
        yield fleet
        watch.cancel()
        await asyncio.gather(watch, return_exceptions=True)


def session(fleet: EngineFleet) -> FleetSession:
    assert isinstance(fleet.policy, FleetPolicy)
    return fleet.policy.begin(task("a"), 1)


async def reply(session: FleetSession) -> Reply:
    return await session.reply(turn())


def sampled(fake: fake_vllm.FakeVllm) -> int:
    return sum(body["temperature"] > 0 for body in fake.asked)


async def test_a_session_stays_with_a_server_and_a_new_one_goes_where_the_fewest_are(
    fakes: list[fake_vllm.FakeVllm], tmp_path: Path
) -> None:
    async with opened(fakes, tmp_path) as fleet:
        sessions = [session(fleet) for _ in range(3)]
        for each in (*sessions, *sessions, sessions[0]):
            assert (await reply(each)).policy == "Model-8B"
        assert sorted(map(sampled, fakes)) == [2, 2, 3]
        busiest = max(fakes, key=sampled)
        del sessions[0], each
        await reply(session(fleet))
        assert sampled(busiest) == 4, "its session is over"


@pytest.mark.parametrize("lora", [False, True], ids=["in_place", "adapters"])
async def test_new_weights_reach_all_servers_or_none(
    fakes: list[fake_vllm.FakeVllm], tmp_path: Path, lora: bool
) -> None:
    first = saved(tmp_path / "1")
    async with opened(fakes, tmp_path, lora=lora) as fleet:
        sessions = [session(fleet) for _ in fakes]
        await fleet.publish(first, "1")
        assert [(await reply(each)).weight_version for each in sessions] == ["1", "1", "1"]
        fakes[1].quirks.add("half_loads")
        with pytest.raises(PublishError, match="does not pass its self-test"):
            await fleet.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
        for fake in (fakes[0], fakes[2]):
            assert (list(fake.adapters.values()) if lora else [fake.weights]) == [str(first)]
        fakes[1].quirks.remove("half_loads")
        if lora:
            assert [(await reply(each)).weight_version for each in sessions] == ["1", "1", "1"]
            await fleet.publish(tmp_path / "2", "2")
            assert [(await reply(each)).weight_version for each in sessions] == ["2", "2", "2"]


@pytest.mark.parametrize("lora", [False, True], ids=["in_place", "adapters"])
async def test_a_server_that_is_away_is_left_out_and_comes_back_with_the_newest_weights(
    fakes: list[fake_vllm.FakeVllm], tmp_path: Path, lora: bool
) -> None:
    async with opened(fakes, tmp_path, lora=lora) as fleet:
        sessions = [session(fleet) for _ in fakes]
        await fleet.publish(saved(tmp_path / "1"), "1")
        for each in sessions:
            await reply(each)
        away = fakes[1]
        away.go_on.clear()
        slow = [asyncio.create_task(reply(each)) for each in sessions]
        await until(lambda: away.in_flight == 1)
        away.is_away = True
        assert [(await each).weight_version for each in slow] == ["1", "1", "1"], "others have replied for it"
        asked = sampled(away)
        away.go_on.set()
        second = saved(tmp_path / "2", off=0.5, since=0.25)
        await fleet.publish(second, "2")
        assert [(await reply(each)).weight_version for each in sessions] == ["2", "2", "2"]
        assert sampled(away) == asked
        # Started anew, by whom it belongs to: with the weights that learning starts from.
        away.weights, away.label, away.adapters, away.is_away = "", "default", {}, False
        await until(lambda: str(second) in ([*away.adapters.values()] if lora else [away.weights]))
        more = [session(fleet) for _ in fakes]
        await until(lambda: not any(each.is_set() for each in fleet._fleet.left_out.values()))
        assert {(await reply(each)).weight_version for each in (*more, *sessions)} == {"2"}
        assert sampled(away) > asked


async def test_no_server_at_all_is_an_error_of_the_publication(
    fakes: list[fake_vllm.FakeVllm], tmp_path: Path
) -> None:
    async with opened(fakes, tmp_path) as fleet:
        for fake in fakes:
            fake.is_away = True
        with pytest.raises(PublishError, match="no server answers"):
            await fleet.publish(saved(tmp_path / "1"), "1")
        for fake in fakes:
            fake.is_away = False
        await until(lambda: not any(each.is_set() for each in fleet._fleet.left_out.values()))
        await fleet.publish(tmp_path / "1", "1")
        assert (await reply(session(fleet))).weight_version == "1"


def test_replicas_share_the_gpus_and_one_that_is_killed_for_good_leaves_the_others(tmp_path: Path) -> None:
    command = tmp_path / "vllm"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -S {fake_vllm.__file__} "$@"\n')
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    env = {"CUDA_VISIBLE_DEVICES": "4,5,6,7", "FAKE_VLLM": "engine", "FAKE_VLLM_PIDS": str(tmp_path / "pids")}
    settings: dict[str, Any] = {"executable": str(command), "env": env, "restarts": 0}

    async def go() -> None:
        out = tmp_path / "training"
        async with fleet_of(out, replicas=2, tensor_parallel_size=2, **settings) as fleet:
            watch = asyncio.create_task(fleet.watch())
            assert len(pids(tmp_path)) == 4
            sessions = [session(fleet) for _ in range(4)]
            await fleet.publish(saved(tmp_path / "1"), "1")
            os.kill(pids(tmp_path)[0], signal.SIGKILL)
            assert [(await reply(each)).weight_version for each in sessions] == ["1"] * 4
            await fleet.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            assert [(await reply(each)).weight_version for each in sessions] == ["2"] * 4
            os.kill(pids(tmp_path)[2], signal.SIGKILL)
            with pytest.raises(ExceptionGroup) as caught:
                await asyncio.wait_for(watch, 20)
            assert caught.group_contains(TrainingError, match="started again 0 times")

    asyncio.run(go())
    logs = [(tmp_path / "training" / f"vllm-{number}.log").read_text() for number in (1, 2)]
    assert [line for log in logs for line in log.splitlines() if line.startswith("GPUS")] == [
        "GPUS 4,5",
        "GPUS 6,7",
    ]


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"replicas": 2}, "2 replicas are started here and need 2 GPUs"),
        ({"replicas": 2, "env": {"CUDA_VISIBLE_DEVICES": "1"}}, "need 2 GPUs"),
        ({"replicas": 2, "env": {"CUDA_VISIBLE_DEVICES": "1,2"}, "base_url": "http://a:1"}, "started here"),
        ({"base_url": []}, "must name servers, each once"),
        ({"base_url": ["http://a:1", "http://a:1"]}, "must name servers, each once"),
    ],
)
def test_servers_that_cannot_be_are_refused(settings: dict[str, Any], told: str) -> None:
    with pytest.raises(ValidationError, match=told):
        VllmConfig.model_validate(settings)
