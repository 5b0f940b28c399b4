"""slime gets what SGLang sampled, a sample per step, and no number for an episode without a reward.

slime is not on the package index: the class of its samples is written here, with the fields that are filled.
"""

from __future__ import annotations

import functools
import importlib
import json
import types
from collections.abc import AsyncIterator, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import Receive, Scope, Send
from tests.inference.tiny import tiny_renderer
from tests.integrations.conformance import check_in_browsers
from tests.integrations.engine import Engine, example, reply_text, texts_of
from tests.serving import serving

import webgym
from webgym import Action, Answer, Scroll
from webgym.integrations import slime
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

renderer = functools.cache(tiny_renderer)  # by the first test that needs it
ABORTED = ("", "<tool_call>")
"""Replies that the engine aborted."""
RIGHT = (reply_text(Scroll("down")), reply_text(Answer("right")))


@dataclass
class Sample:
    """The fields of slime's that we read or fill."""

    class Status(Enum):
        PENDING = "pending"
        COMPLETED = "completed"
        TRUNCATED = "truncated"
        ABORTED = "aborted"

    index: int = 0
    rollout_id: int | None = None
    tokens: list[int] = field(default_factory=list)
    multimodal_inputs: dict[str, Any] | None = None
    multimodal_train_inputs: dict[str, Any] | None = None
    response: str = ""
    response_length: int = 0
    reward: float | None = None
    loss_mask: list[int] | None = None
    weight_versions: list[str] = field(default_factory=list)
    rollout_log_probs: list[float] | None = None
    remove_sample: bool = False
    status: Status = Status.PENDING
    metadata: dict[str, Any] = field(default_factory=dict)


class SGLang:
    """An HTTP server that answers ``/generate``, and samples what it is told to."""

    def __init__(self, texts: Sequence[str] = RIGHT) -> None:
        self.engine, self._texts = Engine(renderer(), texts), texts
        self.requests: list[dict[str, Any]] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        asked = await Request(scope, receive).json()
        text = self._texts[len(self.requests)]
        ids, logprobs = self.engine.sample(text)
        self.requests.append(asked)
        told = {
            "output_token_logprobs": [
                [value, token, None] for value, token in zip(logprobs, ids, strict=True)
            ],
            "finish_reason": {"type": "abort" if text in ABORTED else "stop"},
            "weight_version": "12",
        }
        response: Response = JSONResponse({"text": "", "meta_info": told})
        await response(scope, receive, send)


async def generated(
    servers: AsyncExitStack, texts: Sequence[str], task_id: str, sample: Sample | None = None, **more: Any
) -> tuple[SGLang, list[Sample]]:
    ports: list[int] = []

    def engine(port: int) -> SGLang:
        ports.append(port)
        return SGLang(texts)

    served = await servers.enter_async_context(serving(engine, lambda one: one))
    args = types.SimpleNamespace(
        hf_checkpoint="model", sglang_router_ip="127.0.0.1", sglang_router_port=ports[0]
    )
    sample = sample or Sample(index=5, metadata={"task_id": task_id})
    made = await slime.generate(args, sample, {"temperature": 1.0, **more}, evaluation="top_p" in more)
    return served, made if isinstance(made, list) else [made]


@asynccontextmanager
async def process(given: dict[str, Any]) -> AsyncIterator[AsyncExitStack]:
    """The pool and the renderer that slime's process would have; what is given closes servers."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(slime, "_renderers", {"model": renderer()})
        async with webgym.EnvironmentPool(**given) as pool, AsyncExitStack() as servers:
            patch.setattr(slime, "_pool", pool)
            yield servers


async def played(folder: Path, texts: Sequence[str] = RIGHT, **more: Any) -> tuple[SGLang, list[Sample]]:
    async with process(stand_in_pool(folder, **more)) as servers:
        return await generated(servers, texts, "check-3")


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    async with process(given) as servers:

        async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
            _, samples = await generated(servers, texts_of(actions), task_id)
            assert slime.has_rewards(None, samples) != any(each.remove_sample for each in samples)
            return Told([each.reward for each in samples if each.reward is not None])

        yield Adapted(play)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # aiohttp's session, forgotten
async def test_it_keeps_the_environments_promises() -> None:
    assert await check_adapter(adapter) == []


@pytest.mark.browser
async def test_in_real_browsers() -> None:
    assert [set(told.final) for told in await check_in_browsers(adapter)] == [{1.0}, {0.0}]


async def test_an_episode_is_samples_of_what_was_sampled(tmp_path: Path) -> None:
    server, samples = await played(tmp_path)
    assert len(samples) == 2
    for sample, request, text in zip(samples, server.requests, RIGHT, strict=True):
        ids, logprobs = server.engine.sample(text)
        assert sample.multimodal_inputs is not None
        assert sample.multimodal_train_inputs is not None
        assert sample.loss_mask is not None
        images = request["input_ids"].count(renderer().image_id)
        assert images == len(request["image_data"]) == len(sample.multimodal_inputs["images"])
        grid = sample.multimodal_train_inputs["image_grid_thw"]
        prompt = renderer().expanded(request["input_ids"], (grid.prod(1) // 4).tolist())
        assert sample.tokens == [*prompt, *ids]
        assert sample.response_length == len(ids) == sum(sample.loss_mask)
        assert sample.rollout_log_probs == pytest.approx(logprobs)
        assert (sample.reward, sample.weight_versions) == (1.0, ["12"])
        assert (sample.rollout_id, sample.status) == (5, Sample.Status.COMPLETED)
    assert slime.has_rewards(None, [samples, samples])


async def test_steps_that_do_not_hold_together_are_dropped_and_counted(tmp_path: Path) -> None:
    wrong = tuple(f"<|image_pad|>{text}" for text in RIGHT)  # an image token without a picture
    server, [sample] = await played(tmp_path, (wrong[0], RIGHT[1]))
    ids, _ = server.engine.sample(RIGHT[1])
    assert (sample.reward, sample.tokens[-len(ids) :], sample.metadata["step"]) == (1.0, ids, 1)
    assert sample.metadata["dropped"] == {"image_in_reply": 1}
    _, [sample] = await played(tmp_path, wrong)
    assert (sample.reward, sample.remove_sample, sample.status) == (None, True, Sample.Status.ABORTED)
    assert sample.metadata["dropped"] == {"image_in_reply": 2}


async def test_replies_of_another_distribution_may_be_evaluated_and_not_trained_on(tmp_path: Path) -> None:
    async with process(stand_in_pool(tmp_path)) as servers:
        _, [sample] = await generated(servers, RIGHT, "check-3", top_k=20)
        assert (sample.remove_sample, sample.metadata["dropped"]) == (True, {"altered_sampling": 2})
        _, samples = await generated(servers, RIGHT, "check-3", top_k=20, top_p=0.8)  # an evaluation's
    assert [each.reward for each in samples] == [1.0, 1.0]


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
async def test_an_episode_without_a_reward_has_no_number_and_drops_its_group(
    tmp_path: Path, fault: dict[str, Any]
) -> None:
    _, samples = await played(tmp_path, **fault)
    assert [(each.reward, each.remove_sample, each.status) for each in samples] == [
        (None, True, Sample.Status.ABORTED)
    ]
    assert not slime.has_rewards(None, [[Sample(reward=1.0)], samples])


@pytest.mark.parametrize("text", ABORTED)
async def test_an_aborted_reply_is_no_step_and_its_sample_may_be_tried_again(
    tmp_path: Path, text: str
) -> None:
    async with process(stand_in_pool(tmp_path)) as servers:
        server, [sample] = await generated(servers, (RIGHT[0], text, RIGHT[1]), "check-3")
        assert len(server.requests) == 2, "the episode is over"
        assert (sample.reward, sample.remove_sample, sample.status) == (None, True, Sample.Status.ABORTED)
        assert (sample.response, sample.metadata["outcome"]) == ("", "policy_error")
        _, samples = await generated(servers, RIGHT, "check-3", sample)
    assert [(each.reward, each.remove_sample) for each in samples] == [(1.0, False)] * 2


def test_the_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = stand_in_pool(tmp_path)
    example("slime_prompts").main(str(tmp_path / "prompts.jsonl"), given["name"], split="all", count=3)
    lines = [json.loads(line) for line in (tmp_path / "prompts.jsonl").read_text().splitlines()]
    assert [line["prompt"] for line in lines] == [
        f"Find number {line['metadata']['task_id'].removeprefix('check-')}" for line in lines
    ]
    printed = capsys.readouterr().out
    for flag in ("custom-generate-function-path", "dynamic-sampling-filter-path"):
        module, _, name = printed.split(f"--{flag} ")[1].split()[0].rpartition(".")
        assert callable(getattr(importlib.import_module(module), name))
