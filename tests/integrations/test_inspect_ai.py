"""inspect_ai evaluates our agent, and leaves what has no reward unscored."""

from __future__ import annotations

import asyncio
import math
import types
import warnings
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from tests.integrations.engine import example, reply_text, texts_of

import webgym
from webgym import Action, Answer, RunConfig, Scroll
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool

pytest.importorskip("inspect_ai", reason="inspect_ai is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from inspect_ai import eval as evaluate
    from inspect_ai import eval_async
    from inspect_ai.log import EvalLog
    from inspect_ai.model import ChatMessage, ContentImage, ModelOutput, ModelUsage, get_model
    from inspect_ai.solver import TaskState

    from webgym.integrations import inspect_ai
    from webgym.integrations.inspect_ai import webgym_task

pytestmark = pytest.mark.filterwarnings("ignore")  # its own


def said(text: str, ended: Any = "stop") -> ModelOutput:
    """What the mock model says; its tokens are counted, or inspect would download a tokenizer."""
    output = ModelOutput.from_content("mockllm/model", text, stop_reason=ended)
    output.usage = ModelUsage(input_tokens=1, output_tokens=1, total_tokens=2)
    return output


def run(folder: Path, answers: list[str], **more: Any) -> tuple[EvalLog, list[list[ChatMessage]], Any]:
    """One sample after another: a scroll, and the next of the answers."""
    given = stand_in_pool(folder, 1, **more)
    given["browsers_"] = given.pop("browsers")
    asked: list[list[ChatMessage]] = []
    left = list(answers)

    def say(messages: list[ChatMessage], *_: Any) -> ModelOutput:
        asked.append(messages)
        seen = sum(isinstance(part, ContentImage) for message in messages for part in message.content)
        action = Scroll("down") if seen == 1 else Answer(left.pop(0))
        if isinstance(action, Answer) and action.text == "filtered":
            return said("", "content_filter")
        if isinstance(action, Answer) and action.text == "nothing":
            output = said("")
            output.usage = ModelUsage(input_tokens=1, output_tokens=0, total_tokens=1)
            return output
        return said(reply_text(action))

    browsers = given.pop("browsers_")
    given.pop("size")

    def made(name: str, **named: Any) -> Any:
        return webgym.EnvironmentPool(name, **named, browsers=browsers)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect_ai, "EnvironmentPool", made)
        task = webgym_task(given.pop("name"), count=len(answers), browsers=1, **given)
        model = get_model("mockllm/model", custom_outputs=say)
        (log,) = evaluate(task, model=model, max_samples=1, display="none", log_dir=str(folder / "logs"))
    return log, asked, browsers


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    one_at_a_time = asyncio.Lock()  # as inspect wants it
    stand_ins = {key: given[key] for key in ("browsers", "judge", "config")}

    def made(name: str, **named: Any) -> Any:
        return webgym.EnvironmentPool(name, **{**named, **stand_ins})

    async def play(task_id: str, actions: Sequence[Action | str]) -> Told:
        outputs = [said(text) for text in texts_of(actions)]
        async with one_at_a_time:
            (log,) = await eval_async(
                webgym_task(given["name"], split="all", count=12, browsers=1),
                model=get_model("mockllm/model", custom_outputs=outputs),
                sample_id=task_id,
                log_dir=str(Path(given["name"]).parent / "logs"),
            )
        assert log.status == "success", log.error
        (sample,) = log.samples or []
        score = (sample.scores or {})["web_judge"].as_float()
        return Told([] if math.isnan(score) else [score])

    async def begin(task_id: str) -> asyncio.Future[TaskState]:
        asked = asyncio.Event()

        async def hang(messages: list[ChatMessage]) -> None:
            asked.set()
            await asyncio.Event().wait()

        pool = (webgym_task(given["name"], split="all", browsers=1).metadata or {})["webgym"]
        state = TaskState("mockllm/model", task_id, 1, "", [])
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(inspect_ai, "get_model", lambda: types.SimpleNamespace(generate=hang))
            solving = asyncio.ensure_future(inspect_ai.web_agent(pool)(state, None))
            await asked.wait()
        return solving

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inspect_ai, "EnvironmentPool", made)
        yield Adapted(play, begin)


async def test_it_keeps_the_environments_promises() -> None:
    def rows(name: str, config: RunConfig) -> list[str]:
        task = webgym_task(name, split="all", count=6, config=config)
        inspect_ai._pools.clear()
        return [str(sample.id) for sample in task.dataset]

    assert await check_adapter(adapter, rows=rows, cancels=False) == []


def test_samples_are_scored_by_our_judge(tmp_path: Path) -> None:
    log, asked, browsers = run(tmp_path, ["right", "wrong", "right", "wrong"])
    assert log.status == "success", log.error
    assert log.results is not None
    assert log.results.scores[0].metrics["success_rate"].value == 0.5
    assert log.samples is not None
    assert sorted(each.scores["web_judge"].answer for each in log.samples if each.scores) == [
        "right",
        "right",
        "wrong",
        "wrong",
    ]
    pictures = [part for part in asked[0][-1].content if isinstance(part, ContentImage)]
    assert pictures
    assert pictures[0].image.startswith("data:image/png;base64,")
    assert not browsers.open_now
    assert not inspect_ai._pools


@pytest.mark.parametrize("fault", [{"fails": True}, {"fault": "judge"}, {"fault": "blocked"}])
def test_what_has_no_reward_is_unscored(tmp_path: Path, fault: dict[str, Any]) -> None:
    log, _, browsers = run(tmp_path, ["right", "right"], **fault)
    assert log.status == "success", log.error
    assert log.results is not None
    assert log.samples is not None
    scores = [each.scores["web_judge"] for each in log.samples if each.scores]
    assert len(scores) == 2
    assert all(math.isnan(each.as_float()) for each in scores)
    assert math.isnan(log.results.scores[0].metrics["success_rate"].value)
    assert not browsers.open_now


@pytest.mark.parametrize("said", ["filtered", "nothing"])
def test_a_reply_that_the_endpoint_withheld_is_unscored(tmp_path: Path, said: str) -> None:
    log, _, _ = run(tmp_path, [said])
    assert log.status == "success", log.error
    assert log.samples is not None
    assert [math.isnan(each.scores["web_judge"].as_float()) for each in log.samples if each.scores] == [True]


@pytest.mark.browser
def test_the_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texts = texts_of([Scroll("down"), Answer("no idea")])
    model = get_model("mockllm/model", custom_outputs=[said(text) for text in texts])
    main = example("inspect_eval").main
    assert main(model, count=1, browsers=1, display="none", log_dir=str(tmp_path / "logs")) == 0.0
    assert "1 of 1 samples have a score: success rate 0.00" in capsys.readouterr().out
