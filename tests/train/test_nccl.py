"""All weights by NCCL: tested with gloo in its place (fake_nccl), between processes; no GPU has tried it."""

from __future__ import annotations

import asyncio
from asyncio import Event
from collections.abc import Iterator
from contextlib import ExitStack
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, cast

import pytest
import torch
from pydantic import ValidationError
from safetensors.torch import load_file, save_file
from tests.train import fake_nccl, forking
from tests.train.fake_nccl import FakeWorkers
from tests.train.fake_vllm import running
from tests.train.test_vllm import reply, saved, turn, until
from tests.train.test_vllm_fleet import opened, session

from webgym.core.errors import ConfigError, PublishError
from webgym.inference import nccl
from webgym.inference.nccl import NcclApi
from webgym.inference.vllm import VllmConfig
from webgym.train.config import LoraConfig
from webgym.train.engine_serving import EngineServing


@pytest.fixture(autouse=True)
def _gloo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake_nccl.install(tmp_path / "packages", monkeypatch)
    forking._CONTEXT.set_forkserver_preload(["tests.train.preloaded"])
    monkeypatch.setattr(nccl, "_CONTEXT", forking._CONTEXT)


@pytest.fixture
def fakes() -> Iterator[list[FakeWorkers]]:
    with ExitStack() as stack:
        started = (stack.enter_context(running("dev", "nccl", of=FakeWorkers)) for _ in range(2))
        yield [cast("FakeWorkers", fake) for fake in started]


@pytest.fixture
def fake(fakes: list[FakeWorkers]) -> FakeWorkers:
    return fakes[0]


def weights(folder: Path, off: float = 0.25, since: float = 0.0) -> Path:
    """Saved weights in two files, in both types, without the output weights, which are tied to the others."""
    random = torch.Generator().manual_seed(round(1000 * off))
    table = torch.randn(50, 8, generator=random).bfloat16()
    norm = torch.randn(8, generator=random)
    saved(folder, off=off, since=since)
    # An odd number of bytes in front of float32, in the order of the files.
    path = torch.tensor(list(str(folder).encode().ljust(151)), dtype=torch.uint8)
    save_file(
        {"model.embed_tokens.weight": table, "scale": torch.tensor(2.0)}, folder / "model-1.safetensors"
    )
    save_file({"model.norm.weight": norm, fake_nccl.FOLDER: path}, folder / "model-2.safetensors")
    (folder / "training").mkdir()
    save_file({"exp_avg/x": norm}, folder / "training" / "shard-1.safetensors")
    return folder


def tensors(folder: Path) -> dict[str, torch.Tensor]:
    return load_file(folder / "model-1.safetensors") | load_file(folder / "model-2.safetensors")


def have(fake: FakeWorkers, folder: Path) -> bool:
    """Whether every worker has the weights, bit for bit."""
    wanted = tensors(folder)
    return fake.weights == str(folder) and all(
        received.keys() == wanted.keys()
        and all(
            each.dtype == wanted[name].dtype and torch.equal(each, wanted[name])
            for name, each in received.items()
        )
        for received in fake.received
    )


def serving_of(fake: FakeWorkers, path: Path, lora: LoraConfig | None = None, **given: Any) -> EngineServing:
    config = VllmConfig.model_validate({"base_url": fake.url, "transfer": "nccl"} | given)
    return EngineServing(config, "org/Model-8B", path, lora=lora)


def sender(serving: EngineServing) -> BaseProcess:
    assert isinstance(serving._api, NcclApi)
    assert serving._api._sender is not None
    return serving._api._sender[0]


async def test_every_worker_gets_the_saved_weights_bit_for_bit_from_one_process(
    fake: FakeWorkers, tmp_path: Path
) -> None:
    async with serving_of(fake, tmp_path) as serving:
        first = sender(serving)
        for version, off in (("1", 0.25), ("2", 0.5)):
            fake.log.clear()
            await serving.publish(weights(tmp_path / version, off, off - 0.25), version)
            assert have(fake, tmp_path / version)
            assert (await reply(serving)).weight_version == fake.label == version
            assert (
                fake.log
                == (
                    "weight_checker pause start_weight_update update_weights finish_weight_update "
                    "reset_prefix_cache reset_mm_cache update_weight_version resume weight_checker"
                ).split()[version == "2" :]
            )
        assert sender(serving) == first
    await until(lambda: not first.is_alive())


REQUESTS = ["/pause", "/start_weight_update", "/update_weights", "/finish_weight_update"]
REQUESTS += ["/reset_prefix_cache", "/update_weight_version", "/resume"]


@pytest.mark.parametrize("path", REQUESTS)
async def test_whatever_request_of_an_update_fails_the_old_weights_reply(
    fake: FakeWorkers, tmp_path: Path, path: str
) -> None:
    first = weights(tmp_path / "1")
    second = weights(tmp_path / "2", 0.5, 0.25)
    async with serving_of(fake, tmp_path) as serving:
        await serving.publish(first, "1")
        for fault in ("500", "breaks_off"):
            is_repeated = fault == "breaks_off" and path not in fake_nccl.NCCL
            fake.faults[f"POST {path}"] = [fault] * (2 if is_repeated else 1)
            with pytest.raises(PublishError, match="cannot publish the weights 2"):
                await serving.publish(second, "2")
            assert have(fake, first)
            assert (fake.label, fake.is_paused, fake.left_over) == ("1", False, False)
            assert (await reply(serving)).weight_version == "1"
        await serving.publish(second, "2")
        assert have(fake, second)


async def test_a_worker_that_fails_half_way_and_a_process_that_is_killed_leave_the_old_weights(
    fake: FakeWorkers, tmp_path: Path
) -> None:
    first = weights(tmp_path / "1")
    second = weights(tmp_path / "2", 0.5, 0.25)
    async with serving_of(fake, tmp_path) as serving:
        await serving.publish(first, "1")
        fake.quirks.add("refuses")
        with pytest.raises(
            PublishError, match=r"weights 2: .*/update_weights answered 500: the transfer failed"
        ):
            await serving.publish(second, "2")
        assert have(fake, first)
        fake.go_on_receiving.clear()
        publishing = asyncio.create_task(serving.publish(second, "2"))
        await until(lambda: fake.log[-1] == "update_weights")
        sender(serving).kill()
        fake.go_on_receiving.set()
        with pytest.raises(PublishError, match="the process that sends weights ended"):
            await publishing
        assert have(fake, first)
        whole = (second / "model-2.safetensors").read_bytes()
        (second / "model-2.safetensors").write_bytes(b"torn")
        with pytest.raises(PublishError, match="the process that sends weights failed: SafetensorError: "):
            await serving.publish(second, "2")
        assert have(fake, first)
        assert (await reply(serving)).weight_version == "1"
        (second / "model-2.safetensors").write_bytes(whole)
        (process := sender(serving)).kill()
        await until(lambda: not process.is_alive())
        await serving.publish(second, "2")
        assert have(fake, second)


async def test_where_even_the_old_weights_cannot_be_sent_nothing_replies(
    fake: FakeWorkers, tmp_path: Path
) -> None:
    async with serving_of(fake, tmp_path) as serving:
        await serving.publish(weights(tmp_path / "1"), "1")
        fake.faults["POST /update_weights"] = ["500"]
        fake.faults["POST /init_weight_transfer_engine"] = ["500"]
        with pytest.raises(PublishError, match="update_weights answered 500"):
            await serving.publish(weights(tmp_path / "2", 0.5, 0.25), "2")
        with pytest.raises(TimeoutError):
            await asyncio.wait_for(reply(serving), 0.1)


async def test_new_weights_reach_all_servers_or_none_and_one_that_was_started_anew(
    fakes: list[FakeWorkers], tmp_path: Path
) -> None:
    first = weights(tmp_path / "1")
    second = weights(tmp_path / "2", 0.5, 0.25)
    async with opened(fakes, tmp_path, transfer="nccl") as fleet:
        sessions = [session(fleet) for _ in fakes]
        await fleet.publish(first, "1")
        fakes[1].quirks.add("refuses")
        with pytest.raises(PublishError, match="the transfer failed"):
            await fleet.publish(second, "2")
        assert all(have(fake, first) for fake in fakes)
        fakes[1].is_away = True
        await fleet.publish(second, "2")
        assert [have(fake, second) for fake in fakes] == [True, False]
        away = fakes[1]
        away.groups, away.weights, away.label, away.is_away = [], "", "default", False
        await until(lambda: have(away, second) and not any(map(Event.is_set, fleet._fleet.left_out.values())))
        assert [(await each.reply(turn())).weight_version for each in sessions] == ["2", "2"]


async def test_what_cannot_work_is_said_before_anything_starts(
    fake: FakeWorkers, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match=r"update.lora trains adapters .*leave vllm.transfer out"):
        serving_of(fake, tmp_path, LoraConfig())
    command = VllmConfig(transfer="nccl").command("model", "name", 1, "in_place", 0)
    assert command[-2:] == ["--weight-transfer-config", '{"backend": "nccl"}']
    with pytest.raises(ValidationError, match="transfer: nccl is for engine: vllm"):
        serving_of(fake, tmp_path, engine="sglang")
    fake.quirks.add("unconfigured")
    with pytest.raises(ConfigError, match="Weight transfer not configured"):
        await serving_of(fake, tmp_path).__aenter__()
    fake.quirks.remove("nccl")
    with pytest.raises(ConfigError, match=r"does not offer /get_world_size.*--weight-transfer-config"):
        await serving_of(fake, tmp_path).__aenter__()
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(ConfigError, match=r"needs vLLM beside the training, too .pip install vllm"):
        serving_of(fake, tmp_path)
