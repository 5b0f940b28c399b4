"""A policy behind SGLang: the same promises as with vLLM, by SGLang's own endpoints."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest
from tests.train import fake_sglang, fake_vllm
from tests.train.fake_sglang import FakeSglang
from tests.train.test_vllm import reply, saved

from webgym.core.errors import ConfigError, PublishError
from webgym.inference.vllm import VllmConfig
from webgym.train.config import LoraConfig
from webgym.train.engine_serving import EngineServing


def serving_of(fake: fake_vllm.FakeVllm, path: Path, *, lora: bool = False) -> EngineServing:
    config = VllmConfig(engine="sglang", base_url=fake.url)
    return EngineServing(config, "org/Model-8B", path, lora=LoraConfig() if lora else None)


@pytest.mark.parametrize("lora", [True, False])
async def test_weights_are_published_and_replies_are_of_them(tmp_path: Path, lora: bool) -> None:
    with fake_vllm.running("lora", of=FakeSglang) as fake:
        async with serving_of(fake, tmp_path, lora=lora) as serving:
            first = await reply(serving)
            assert first.weight_version == "0"
            assert first.tokens is not None
            assert (first.tokens.prompt_ids, first.tokens.reply_ids) == ([1, 2, 3], [5, 6])
            for version, off, since in (("1", 0.25, 0.0), ("2", 0.5, 0.25)):
                await serving.publish(saved(tmp_path / version, off=off, since=since), version)
                assert (await reply(serving)).weight_version == version
                assert not fake.is_paused
            assert len(fake.adapters) == int(lora), "the old one is gone"
            assert fake.label == ("default" if lora else "2")


@pytest.mark.parametrize(
    ("quirk", "told"),
    [
        ("refuses", "answered 400: .*a tensor is missing"),
        ("stale_part", "nats"),
        ("stale_workers", "the same weights as before, by the checksums"),
    ],
)
async def test_weights_that_do_not_arrive_leave_the_old_ones(tmp_path: Path, quirk: str, told: str) -> None:
    with fake_vllm.running(of=FakeSglang) as fake:
        async with serving_of(fake, tmp_path) as serving:
            old = saved(tmp_path / "1")
            await serving.publish(old, "1")
            fake.quirks.add(quirk)
            with pytest.raises(PublishError, match=told):
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            fake.quirks.discard(quirk)
            assert (fake.weights, fake.label, fake.is_paused) == (str(old), "1", False)


async def test_one_that_cannot_load_adapters_says_how_to_start_it(tmp_path: Path) -> None:
    with fake_vllm.running(of=FakeSglang) as fake:
        with pytest.raises(ConfigError, match="does not offer /load_lora_adapter") as caught:
            async with serving_of(fake, tmp_path, lora=True):
                raise AssertionError
        assert "--enable-lora" in caught.value.hint


@pytest.mark.parametrize("lora", [True, False])
async def test_one_of_ours_is_started_and_nobody_sees_its_key(tmp_path: Path, lora: bool) -> None:
    program = tmp_path / "sglang"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -S {fake_sglang.__file__} "$@"\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    config = VllmConfig(engine="sglang", executable=str(program))
    adapters = LoraConfig(rank=20) if lora else None
    async with EngineServing(config, "org/Model-8B", tmp_path / "training", lora=adapters) as serving:
        await serving.publish(saved(tmp_path / "1"), "1")
        assert (await reply(serving)).weight_version == "1"
        [secret] = (tmp_path / "training").glob("*.yaml")
        assert secret.stat().st_mode & 0o077 == 0
