"""A policy behind vLLM: weights arrive whole or not at all, and replies are of those that were published."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest
from tests.agent.test_context import observation
from tests.train import fake_vllm
from tests.train.making import request, task

from webgym.agent.policy import PolicyInput
from webgym.core.errors import ConfigError, PolicyError, PolicyUnreachable, PublishError, TrainingError
from webgym.core.trajectory import Reply
from webgym.inference.vllm import VllmConfig
from webgym.train.config import LoraConfig
from webgym.train.engine_serving import EnginePolicy, EngineServing
from webgym.train.folder import TrainingFolder
from webgym.train.selftest import SELFTEST, Greedy, SelfTest, known_messages, known_picture


def saved(
    folder: Path, off: float = 0.25, since: float = 0, before: str = "1", is_exact: bool = False
) -> Path:
    """Weights as the learner saves them, but for the weights. ``off`` tells them apart: how much lower their
    log-probabilities are than the first's; ``since`` that of the weights before, ``before`` their version."""
    folder.mkdir()
    first = Greedy(fake_vllm.REPLY, fake_vllm.FIRST, [2.0] * 8)
    then, now = (
        msgspec.structs.replace(first, logprobs=[each - lower for each in first.logprobs])
        for lower in (since, off)
    )
    known = (fake_vllm.PROMPT, 7, now, then, "the heading", is_exact, known_picture())
    test = SelfTest(*known, first=first, since=before if since else "0")
    (folder / SELFTEST).write_bytes(msgspec.json.encode(test))
    return folder


def turn() -> PolicyInput:
    return PolicyInput(
        task=task("a"),
        observation=observation(0),
        messages=request()[:1],
        images={},
        steps=(),
        index=0,
        budget=3,
        mode="coordinates",
        prompt_format="memory",
    )


async def reply(serving: EngineServing) -> Reply:
    async with serving.policy as policy:
        return await policy.begin(task("a"), 1).reply(turn())


def serving_of(fake: fake_vllm.FakeVllm, path: Path, *, lora: bool = False, **settings: Any) -> EngineServing:
    config = VllmConfig(base_url=fake.url, **settings)
    return EngineServing(config, "org/Model-8B", path, lora=LoraConfig() if lora else None)


# --- adapters ---------------------------------------------------------------------------------------------


def test_an_adapter_is_loaded_under_a_name_of_its_own_and_the_old_one_goes_after_its_last_reply(
    tmp_path: Path,
) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path, lora=True) as serving:
            first = await reply(serving)
            assert (first.policy, first.weight_version) == ("Model-8B", "0")
            assert first.tokens is not None
            assert (first.tokens.prompt_ids, first.tokens.reply_ids) == ([1, 2, 3], [5, 6])
            await serving.publish(saved(tmp_path / "1"), "1")
            (one,) = fake.adapters
            fake.go_on.clear()
            slow = asyncio.create_task(reply(serving))
            while not fake.in_flight:
                await asyncio.sleep(0.005)
            publishing = asyncio.create_task(serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2"))
            while len(fake.adapters) < 2 or fake.asked[-1]["temperature"]:
                await asyncio.sleep(0.005)
            await asyncio.sleep(0.05)
            assert one in fake.adapters, "its reply is not there yet"
            fake.go_on.set()
            assert (await slow).weight_version == "1"
            await publishing
            (two,) = fake.adapters
            assert one != two
            later = await reply(serving)
            assert (later.policy, later.weight_version) == ("Model-8B", "2")
            assert fake.asked[-1]["model"] == two
            # A training that was killed publishes the same version again, to a server that has it still.
            await serving.publish(saved(tmp_path / "2b", off=0.75, since=0.5), "2")
            assert two not in fake.adapters

    with fake_vllm.running("lora", "caches_names") as fake:
        asyncio.run(go(fake))


async def test_adapters_are_unloaded_at_the_end_and_those_of_a_process_that_was_killed_at_the_start(
    tmp_path: Path,
) -> None:
    with fake_vllm.running("lora") as fake:
        fake.adapters = {"webgym-1-abc": str(tmp_path / "iterations/0001"), "theirs": "/elsewhere/1"}
        async with serving_of(fake, tmp_path, lora=True) as serving:
            assert list(fake.adapters) == ["theirs"]
            await serving.publish(saved(tmp_path / "1"), "1")
            assert len(fake.adapters) == 2
        assert list(fake.adapters) == ["theirs"]


@pytest.mark.parametrize(
    ("quirk", "told"),
    [
        ("refuses", r"cannot publish the weights 2: .* cannot load webgym-2"),
        ("ignores_weights", "are not in use"),  # vLLM #48019: loaded, and bound to no module
        ("half_loads", "off by 0.5 nats per token, 0.05 are allowed"),
        ("stale_part", "off by 0.125 nats per token, 0.05 are allowed"),
        ("garbles", "off by inf nats"),
        ("resizes", "as 81 tokens where 80 are expected"),
        ("another_template", "does its chat template differ"),
    ],
)
def test_weights_that_do_not_pass_leave_the_old_ones(tmp_path: Path, quirk: str, told: str) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path, lora=True) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            held = dict(fake.adapters)
            fake.quirks.add(quirk)
            with pytest.raises(PublishError, match=told) as caught:
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            assert "\n" not in str(caught.value)
            assert fake.adapters == held
            assert (await reply(serving)).weight_version == "1"

    with fake_vllm.running("lora") as fake:
        asyncio.run(go(fake))


async def test_weights_that_leave_every_bit_as_it_was_did_not_arrive(tmp_path: Path) -> None:
    """Even where an update is too small for its difference to show against another server's rounding."""
    with fake_vllm.running("lora") as fake:
        async with serving_of(fake, tmp_path, lora=True) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            fake.frozen = str(tmp_path / "1")
            with pytest.raises(PublishError, match="gives exactly the same reply as before"):
                await serving.publish(saved(tmp_path / "2", off=0.252, since=0.25), "2")
            await serving.publish(tmp_path / "1", "1")


@pytest.mark.parametrize("quirk", ["no_tokens", "before_expansion"])
def test_a_server_that_tells_less_about_tokens_is_tested_by_what_it_tells(tmp_path: Path, quirk: str) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path, lora=True) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            if quirk == "no_tokens":
                assert (await reply(serving)).tokens is None
            fake.quirks.add("garbles")
            with pytest.raises(PublishError, match="self-test"):
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")

    with fake_vllm.running("lora", quirk) as fake:
        asyncio.run(go(fake))


def test_every_parameter_is_named_and_log_probabilities_of_another_distribution_are_not_kept(
    tmp_path: Path,
) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        plain = {"sampling": {"temperature": 1.0, "top_p": 1.0}}
        async with serving_of(fake, tmp_path, lora=True, **plain) as serving:
            found = await reply(serving)
            assert found.tokens is not None
            assert found.tokens.reply_logprobs == pytest.approx([-0.5, -0.1])
            named = {"temperature": 1, "top_p": 1, "top_k": -1, "min_p": 0, "repetition_penalty": 1}
            assert named.items() <= fake.asked[-1].items()
        async with serving_of(fake, tmp_path, lora=True, sampling={"temperature": 0.7}) as serving:
            found = await reply(serving)
            assert found.tokens is not None
            assert found.tokens.reply_logprobs is None, "by default they are of temperature 1"

    with fake_vllm.running("lora") as fake:
        asyncio.run(go(fake))


# --- all weights, in place --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quirks", "steps"),
    [
        (
            (),
            "weight_checker pause collective_rpc reset_prefix_cache reset_mm_cache update_weight_version "
            "resume weight_checker",
        ),
        (("no_version",), "pause collective_rpc reset_prefix_cache reset_mm_cache resume"),
    ],
)
def test_an_update_in_place_waits_for_replies_in_flight_and_lets_none_in(
    tmp_path: Path, quirks: tuple[str, ...], steps: str
) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path) as serving:
            fake.go_on.clear()
            fake.log.clear()
            slow = asyncio.create_task(reply(serving))
            while not fake.in_flight:
                await asyncio.sleep(0.005)
            publishing = asyncio.create_task(serving.publish(saved(tmp_path / "1"), "1"))
            assert isinstance(serving.policy, EnginePolicy)
            while serving.policy._open.is_set():
                await asyncio.sleep(0.005)
            held = asyncio.create_task(reply(serving))
            await asyncio.sleep(0.05)
            assert fake.log == []
            fake.go_on.set()
            assert (await slow).weight_version == "0"
            assert (await held).weight_version == "1"
            await publishing
            assert fake.log == steps.split(), "never with a reply in flight"
            assert fake.weights == str(tmp_path / "1")

    with fake_vllm.running("dev", *quirks) as fake:
        asyncio.run(go(fake))


def test_an_update_that_fails_half_way_is_undone(tmp_path: Path) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            fake.quirks.add("refuses")
            with pytest.raises(PublishError, match=r"cannot publish the weights 2: .* a tensor is missing"):
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            assert fake.weights == str(tmp_path / "1")
            assert (await reply(serving)).weight_version == fake.label == "1"

    with fake_vllm.running("dev") as fake:
        asyncio.run(go(fake))


REQUESTS = ["GET /weight_info", "POST /weight_checker", "POST /pause", "POST /collective_rpc"]
REQUESTS += ["POST /reset_prefix_cache", "POST /update_weight_version", "POST /resume"]


@pytest.mark.parametrize("path", REQUESTS)
async def test_whatever_request_of_an_update_fails_the_old_weights_reply(tmp_path: Path, path: str) -> None:
    first = saved(tmp_path / "1")
    with fake_vllm.running("dev") as fake:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(first, "1")
            tries = 2 if path.startswith("POST") else 4  # aiohttp itself repeats a GET
            for fault in (["500"], ["breaks_off"] * tries):
                fake.faults[path] = fault
                with pytest.raises(PublishError, match="cannot publish the weights 2"):
                    await serving.publish(saved(tmp_path / fault[0], off=0.5, since=0.25), "2")
                assert (fake.weights, fake.label, fake.is_paused) == (str(first), "1", False)
                assert (await reply(serving)).weight_version == "1"
            fake.faults[path] = ["breaks_off"]  # as by a server that closes a connection that it had kept
            await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            assert (await reply(serving)).weight_version == "2"


@pytest.mark.parametrize(
    ("quirk", "told"),
    [
        ("stale_workers", "has the same weights as before, by the checksums of its worker dp0:tp0"),
        ("stale_copy", "has copies of norm.weight that differ, by the checksums of its worker dp1:tp0"),
        ("stale_part", "off by 0.004 nats per token, 0.0001 are allowed"),
    ],
)
async def test_weights_that_arrived_in_part_are_refused_however_small_the_update(
    tmp_path: Path, quirk: str, told: str
) -> None:
    with fake_vllm.running("dev") as fake:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1", is_exact=True), "1")
            fake.quirks.add(quirk)
            with pytest.raises(PublishError, match=told):
                await serving.publish(saved(tmp_path / "2", off=0.258, since=0.25, is_exact=True), "2")


async def test_the_difference_that_a_server_always_has_does_not_hide_that_a_part_is_stale(
    tmp_path: Path,
) -> None:
    with fake_vllm.running("dev", "rounds") as fake:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            fake.quirks.add("stale_part")
            told = "changed otherwise than the learner, by 0.125 nats per token where that changed by 0.25"
            with pytest.raises(PublishError, match=told):
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            fake.quirks.remove("stale_part")
            await serving.publish(tmp_path / "2", "2")


def test_what_cannot_be_undone_never_replies(tmp_path: Path) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            fake.quirks.add("half_loads")  # for good, so the old weights do not pass either
            with pytest.raises(PublishError, match="off by"):
                await serving.publish(saved(tmp_path / "2", off=0.5, since=0.25), "2")
            with pytest.raises(TimeoutError):
                await asyncio.wait_for(reply(serving), 0.1)

    with fake_vllm.running("dev") as fake:
        asyncio.run(go(fake))


async def test_the_weights_of_another_training_are_not_replaced(tmp_path: Path) -> None:
    with fake_vllm.running("dev") as fake:
        async with serving_of(fake, tmp_path) as ours, serving_of(fake, tmp_path) as theirs:
            await theirs.publish(saved(tmp_path / "1"), "1")
            with pytest.raises(TrainingError, match="has the weights '1' of others, not '0'"):
                await ours.publish(saved(tmp_path / "2"), "1")
            assert fake.weights == str(tmp_path / "1")


async def test_a_resumed_training_publishes_to_a_server_that_has_its_newest_weights(tmp_path: Path) -> None:
    newest = (saved(tmp_path / "3"), "3")
    with fake_vllm.running("dev", weights=str(newest[0])) as fake:
        config = VllmConfig(base_url=fake.url)
        async with EngineServing(config, "org/Model-8B", tmp_path, newest=newest) as serving:
            fake.quirks.add("refuses")
            with pytest.raises(PublishError, match="a tensor is missing"):
                await serving.publish(*newest)
            assert (fake.weights, fake.label) == (str(newest[0]), "3"), "not the initial weights"
            assert (await reply(serving)).weight_version == "3"
        async with EngineServing(config, "org/Model-8B", tmp_path, newest=newest) as serving:
            await serving.publish(*newest)
            assert (await reply(serving)).weight_version == "3"
            fake.frozen = str(newest[0])
            with pytest.raises(PublishError, match="gives exactly the same reply as before"):
                await serving.publish(saved(tmp_path / "4", off=0.252, since=0.25, before="3"), "4")


@pytest.mark.parametrize("how", ["label", "name"])
def test_a_model_that_changes_under_us_gives_no_reply_and_ends_the_training(tmp_path: Path, how: str) -> None:
    def change(fake: fake_vllm.FakeVllm) -> None:
        if how == "label":
            fake.label = "somebody else's"
        else:
            fake.calls_itself = "another-model"

    async def go(fake: fake_vllm.FakeVllm) -> None:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            watch = asyncio.create_task(serving.watch())
            asked = fake.weight_info_asked
            await reply(serving)
            assert fake.weight_info_asked == asked, "the reply itself names its weights"
            change(fake)
            for _ in range(5):
                assert not watch.done()
                with pytest.raises(PolicyError, match="replied with the"):
                    await reply(serving)
            with pytest.raises(TrainingError, match="was changed by others") as caught:
                await watch
            assert "\n" not in str(caught.value)

    with fake_vllm.running("dev") as fake:
        asyncio.run(go(fake))


async def test_a_server_without_labels_that_was_away_is_tested_again_before_its_replies_count(
    tmp_path: Path,
) -> None:
    with fake_vllm.running("dev", "no_version") as fake:
        async with serving_of(fake, tmp_path) as serving:
            await serving.publish(saved(tmp_path / "1"), "1")
            for quirk in ("", "breaks_off"):
                fake.faults["POST /v1/chat/completions"] = [quirk] if quirk else []
                asked = len(fake.asked)
                assert (await reply(serving)).weight_version == "1"
                assert len(fake.asked) - asked == (2 if quirk else 1)
            fake.faults["POST /v1/chat/completions"] = ["breaks_off"]
            fake.weights = ""  # it was started again, with those that it began with
            for _ in range(2):
                with pytest.raises(PolicyError, match="the served model does not pass its self-test"):
                    await reply(serving)


class _Lost:
    """Weights whose server ends before the reply is there."""

    def __init__(self, policy: EnginePolicy) -> None:
        self._policy = policy

    async def reply(self, _turn: PolicyInput) -> Reply:
        self._policy.hold()
        raise PolicyUnreachable("gone")


async def test_a_reply_that_was_lost_because_the_server_ended_is_asked_for_again(tmp_path: Path) -> None:
    with fake_vllm.running("dev") as fake:
        async with serving_of(fake, tmp_path) as serving:
            policy = serving.policy
            assert isinstance(policy, EnginePolicy)
            assert policy.served is not None
            healthy = policy.served
            policy.switch(dataclasses.replace(healthy, policy=cast("Any", _Lost(policy))))
            lost = asyncio.create_task(reply(serving))
            await asyncio.sleep(0.02)
            assert not lost.done()
            policy.switch(healthy)
            assert (await lost).text == "click"


# --- what cannot work is told before anything starts --------------------------------------------------------


@pytest.mark.parametrize(
    ("quirks", "settings", "told"),
    [
        (("dev",), {"lora": True}, "does not offer /v1/load_lora_adapter.*VLLM_ALLOW_RUNTIME_LORA_UPDATING"),
        (("lora",), {}, "does not offer /pause.*VLLM_SERVER_DEV_MODE=1"),
        (("dev",), {"model": "other"}, "has the models base"),
        (("dev",), {"base_url": "http://127.0.0.1:9/v1"}, "cannot be reached"),
        (("dev", "trained"), {}, "other weights than learning starts from: '7'"),
        (("dev", "paused"), {}, "is paused, as after weights that were cut off"),
    ],
)
def test_a_server_that_cannot_be_used_is_refused_in_one_line(
    tmp_path: Path, quirks: tuple[str, ...], settings: dict[str, Any], told: str
) -> None:
    async def go(fake: fake_vllm.FakeVllm) -> None:
        fake.label = "7" if "trained" in fake.quirks else "default"
        fake.is_paused = "paused" in fake.quirks
        given = {"base_url": fake.url} | settings
        lora = LoraConfig() if given.pop("lora", False) else None
        async with EngineServing(VllmConfig.model_validate(given), "org/Model-8B", tmp_path, lora=lora):
            raise AssertionError("it starts")

    with fake_vllm.running(*quirks) as fake, pytest.raises(ConfigError, match=told) as caught:
        asyncio.run(go(fake))
    assert "\n" not in str(caught.value)


# --- a server of ours ---------------------------------------------------------------------------------------


@pytest.fixture
def vllm(tmp_path: Path) -> str:
    """The command."""
    command = tmp_path / "vllm"
    command.write_text(f'#!/bin/sh\nexec {sys.executable} -S {fake_vllm.__file__} "$@"\n')
    command.chmod(command.stat().st_mode | stat.S_IXUSR)
    return str(command)


@asynccontextmanager
async def ours(
    vllm: str,
    path: Path,
    *quirks: str,
    lora: bool = False,
    newest: tuple[Path, str] | None = None,
    **settings: Any,
) -> AsyncIterator[EngineServing]:
    env = {"FAKE_VLLM": " ".join(quirks), "FAKE_VLLM_PIDS": str(path / "pids")}
    config = VllmConfig.model_validate({"executable": vllm, "env": env} | settings)
    adapters = LoraConfig(rank=20) if lora else None
    logs = path / "training"
    async with EngineServing(config, "org/Model-8B", logs, lora=adapters, newest=newest) as serving:
        yield serving


def gone(pids: list[int]) -> bool:
    def is_gone(pid: int) -> bool:
        with suppress(FileNotFoundError, ProcessLookupError):
            return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
        return True

    return all(map(is_gone, pids))


async def until(holds: Callable[[], bool]) -> None:
    async with asyncio.timeout(100):
        while not holds():
            await asyncio.sleep(0.02)


def pids(path: Path) -> list[int]:
    return [int(pid) for pid in (path / "pids").read_text().split()]


@pytest.mark.parametrize("quirk", ["no_dev", "refuses"])
def test_our_server_that_takes_no_weights_is_restarted_with_them_and_after_a_crash_and_leaves_no_process(
    tmp_path: Path, vllm: str, quirk: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("RANK", "WORLD_SIZE", "MASTER_ADDR", "ACCELERATE_USE_FSDP", "TORCHELASTIC_RUN_ID"):
        monkeypatch.setenv(name, "0")  # of a learner under accelerate launch

    async def go() -> None:
        async with ours(vllm, tmp_path, "engine", quirk, restarts=1) as serving:
            watch = asyncio.create_task(serving.watch())
            assert (await reply(serving)).weight_version == "0"
            await serving.publish(saved(tmp_path / "1"), "1")
            assert (await reply(serving)).weight_version == "1"
            for pid in pids(tmp_path)[:2]:
                assert gone([pid]), "the first server is gone, and its engine"
            os.kill(pids(tmp_path)[2], signal.SIGKILL)
            await until(lambda: len(pids(tmp_path)) == 6)
            found = await reply(serving)
            assert (found.policy, found.weight_version) == ("Model-8B", "1")
            assert gone(pids(tmp_path)[2:4])
            os.kill(pids(tmp_path)[4], signal.SIGKILL)
            with pytest.raises(
                TrainingError, match="vllm ended, and was started again 1 times; its log ends"
            ):
                await asyncio.wait_for(watch, 20)
        assert gone(pids(tmp_path))

    asyncio.run(go())
    started = (tmp_path / "training" / "vllm.log").read_text().splitlines()
    first, second, third = (line.split() for line in started if line.startswith("INFO starting"))
    assert first[2:6] == ["serve", "org/Model-8B", "--served-model-name", "webgym-base"]
    assert second[3] == third[3] == str(tmp_path / "1")
    assert second[5] == "webgym-1"
    assert {"processed_logprobs", "--generation-config"} <= set(first)


def test_our_server_goes_on_with_the_newest_weights_and_is_labelled_again_after_a_crash(
    tmp_path: Path, vllm: str
) -> None:
    async def go() -> None:
        newest = (saved(tmp_path / "3"), "3")
        async with ours(vllm, tmp_path, "engine", newest=newest) as serving:
            assert (await reply(serving)).weight_version == "3"
            await serving.publish(tmp_path / "3", "3")
            assert len(pids(tmp_path)) == 2, "it is served already"
        (tmp_path / "pids").unlink()
        async with ours(vllm, tmp_path, "engine") as serving:
            watch = asyncio.create_task(serving.watch())
            await serving.publish(tmp_path / "3", "3")
            assert len(pids(tmp_path)) == 2, "in place"
            os.kill(pids(tmp_path)[0], signal.SIGKILL)
            await until(lambda: len(pids(tmp_path)) == 4)
            assert (await reply(serving)).weight_version == "3"
            watch.cancel()

    asyncio.run(go())


def test_our_server_takes_adapters_and_has_them_again_after_a_crash(tmp_path: Path, vllm: str) -> None:
    async def go() -> None:
        async with ours(vllm, tmp_path, "engine", lora=True) as serving:
            watch = asyncio.create_task(serving.watch())
            await serving.publish(saved(tmp_path / "1"), "1")
            os.kill(pids(tmp_path)[0], signal.SIGKILL)
            await until(lambda: len(pids(tmp_path)) == 4)
            assert (await reply(serving)).weight_version == "1"
            watch.cancel()

    asyncio.run(go())
    started = (tmp_path / "training" / "vllm.log").read_text().splitlines()
    first, _ = (line for line in started if line.startswith("INFO starting"))
    assert "--enable-lora --max-lora-rank 32 --max-loras 2" in first


@pytest.mark.parametrize(
    ("quirk", "settings", "told"),
    [
        ("dies", {}, "vllm ended before it was up; its log ends: RuntimeError: Failed to infer device type"),
        ("hangs", {"start_seconds": 4}, "vllm was not up after 4 s; its log ends: INFO starting serve"),
        ("", {"executable": "no-such-vllm"}, "no command no-such-vllm .install it"),
        ("", {"port": -1}, "cannot listen at 127.0.0.1:"),
    ],
)
def test_a_server_that_does_not_come_up_says_why_in_one_line(
    tmp_path: Path, vllm: str, quirk: str, settings: dict[str, Any], told: str
) -> None:
    async def go() -> None:
        async with ours(vllm, tmp_path, quirk, **settings):
            raise AssertionError("it is up")

    with fake_vllm.running() as other:
        if "port" in settings:
            settings = {"port": int(other.url.rpartition(":")[2].removesuffix("/v1"))}
        with pytest.raises((ConfigError, TrainingError), match=told) as caught:
            asyncio.run(go())
    assert "\n" not in str(caught.value)
    TrainingFolder(tmp_path / "training").refuse_used()  # it can be started again, with other settings


_STARTS = """
import asyncio, sys
from pathlib import Path
from webgym.inference.vllm import ManagedServer
async def go():
    env = {"FAKE_VLLM": "engine hangs", "FAKE_VLLM_PIDS": sys.argv[2]}
    command = [sys.argv[1], "serve", "m", "--served-model-name", "m", "--port", "1"]
    server = await ManagedServer.start(command, env, Path(sys.argv[3]), stop_seconds=1)
    await server.wait()
asyncio.run(go())
"""


def test_who_is_killed_leaves_no_server_and_no_engine(tmp_path: Path, vllm: str) -> None:
    arguments = [vllm, str(tmp_path / "pids"), str(tmp_path / "log")]
    process = subprocess.Popen([sys.executable, "-c", _STARTS, *arguments])
    asyncio.run(until(lambda: (tmp_path / "pids").exists() and len(pids(tmp_path)) == 2))
    process.kill()
    process.wait()
    deadline = time.monotonic() + 100
    while not gone(pids(tmp_path)):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_the_known_screenshot_is_the_same_for_learner_and_server() -> None:
    messages = known_messages()
    test = SelfTest(
        fake_vllm.PROMPT, 7, Greedy([], [], []), Greedy([], [], []), "", is_exact=True, picture=b"p"
    )
    asked, images = test.request()
    assert asked == messages
    assert set(images.values()) == {b"p"}
    assert known_picture() == known_picture()
