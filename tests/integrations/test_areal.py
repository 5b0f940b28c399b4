"""AReaL gets what its engine sampled, a row per step, and nothing for an episode without a reward."""

from __future__ import annotations

import functools
import types
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.inference.tiny import tiny_renderer
from tests.integrations.conformance import check_in_browsers
from tests.integrations.engine import Engine, example, reply_text, texts_of

from webgym import Action, Answer, Scroll

pytest.importorskip("areal", reason="areal is not installed")

from areal.api.cli_args import GenerationHyperparameters
from areal.api.io_struct import ModelRequest, ModelResponse
from areal.infra import workflow_context

from webgym.integrations.areal import WebGymWorkflow
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

renderer = functools.cache(tiny_renderer)  # by the first test that needs it
RIGHT = (reply_text(Scroll("down")), reply_text(Answer("right")))


class InferenceEngine:
    """Speaks AReaL's types, samples what it is told to, with a version per token."""

    def __init__(self, texts: Sequence[str] = RIGHT) -> None:
        self._engine = Engine(renderer(), texts)
        self._texts = texts
        self.requests: list[ModelRequest] = []
        self.reads: Callable[[list[int]], list[int]] = list
        self.ended = "stop"

    async def agenerate(self, request: ModelRequest) -> ModelResponse:
        ids, logprobs = self._engine.sample(self._texts[len(self.requests)])
        self.requests.append(request)
        versions = [3] * (len(ids) - 1) + [4]
        return ModelResponse(self.reads(request.input_ids), ids, logprobs, versions, self.ended)


def workflow(folder: Path, **more: Any) -> WebGymWorkflow:
    return workflow_on(stand_in_pool(folder, **more))


def workflow_on(given: dict[str, Any]) -> WebGymWorkflow:
    processor = types.SimpleNamespace(image_processor=renderer().image_processor)
    return WebGymWorkflow(GenerationHyperparameters(n_samples=4), renderer().tokenizer, processor, **given)


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    flow = workflow_on(given)

    async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
        found = await flow.arun_episode(InferenceEngine(texts_of(actions)), {"task_id": task_id})
        return Told([] if found is None else found["rewards"].tolist())

    async with flow.pool:
        yield Adapted(play)


async def test_it_keeps_the_environments_promises() -> None:
    assert await check_adapter(adapter) == []


@pytest.mark.browser
async def test_in_real_browsers() -> None:
    assert [set(told.final) for told in await check_in_browsers(adapter)] == [{1.0}, {0.0}]


async def test_an_episode_is_tensors_of_what_was_sampled(tmp_path: Path) -> None:
    engine, flow = InferenceEngine(), workflow(tmp_path)
    async with flow.pool:
        found = await flow.arun_episode(engine, {"task_id": "check-3"})
    assert found is not None
    assert found["rewards"].tolist() == [1.0, 1.0]
    for place, (request, text) in enumerate(zip(engine.requests, RIGHT, strict=True)):
        ids, logprobs = engine._engine.sample(text)
        whole = int(found["attention_mask"][place].sum())
        prompt = whole - len(ids)
        assert found["input_ids"][place, :whole].tolist() == [*request.input_ids, *ids]
        assert found["loss_mask"][place, :whole].tolist() == [0] * prompt + [1] * len(ids)
        assert found["logprobs"][place, prompt:whole].tolist() == pytest.approx(logprobs)
        assert found["versions"][place, :whole].tolist() == [-1] * prompt + [3] * (len(ids) - 1) + [4]
        assert request.gconfig.n_samples == 1
        assert request.image_data
        grid = found["multi_modal_input"][place]["image_grid_thw"]
        images = int((found["mm_token_type_ids"][place] == 1).sum())
        assert images == int(grid.prod(1).sum()) // 4 > 0
    assert flow.dropped == {}


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
async def test_an_episode_without_a_reward_is_rejected(tmp_path: Path, fault: dict[str, Any]) -> None:
    flow = workflow(tmp_path, **fault)
    async with flow.pool:
        assert await flow.arun_episode(InferenceEngine(), {"task_id": "check-3"}) is None
    assert flow.dropped["no_reward"] >= 1


async def test_a_reply_that_the_engine_broke_off_is_no_action_of_the_agents(tmp_path: Path) -> None:
    engine, flow = InferenceEngine(), workflow(tmp_path)
    engine.ended = "abort"
    async with flow.pool:
        assert await flow.arun_episode(engine, {"task_id": "check-3"}) is None
    assert not any(flow.dropped.values()), "it is no step at all"


async def test_rows_that_the_engine_read_otherwise_are_dropped_and_counted(tmp_path: Path) -> None:
    engine, flow = InferenceEngine(), workflow(tmp_path)
    engine.reads = lambda ids: ids[:5]
    async with flow.pool:
        assert await flow.arun_episode(engine, {"task_id": "check-3"}) is None
    assert flow.dropped == {"image_tokens": 2}


async def test_replies_of_another_distribution_may_be_evaluated_and_not_trained_on(tmp_path: Path) -> None:
    flow = workflow(tmp_path)
    flow.gconfig = flow.gconfig.new(top_p=0.8)
    async with flow.pool:
        assert await flow.arun_episode(InferenceEngine(), {"task_id": "check-3"}) is None
        workflow_context.set(workflow_context.WorkflowContext(is_eval=True))
        found = await flow.arun_episode(InferenceEngine(), {"task_id": "check-3"})
    assert found is not None
    assert flow.dropped == {"altered_sampling": 2}


@pytest.mark.browser
async def test_the_example(capsys: pytest.CaptureFixture[str]) -> None:
    engine = InferenceEngine(texts_of([Scroll("down"), Answer("no idea")]))
    processor = types.SimpleNamespace(image_processor=renderer().image_processor)
    found = await example("areal_episode").main(engine, renderer().tokenizer, processor)
    assert found["rewards"].tolist() == [0.0, 0.0]
    assert capsys.readouterr().out.startswith("2 rows of ")
