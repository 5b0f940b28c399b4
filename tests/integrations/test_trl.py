"""TRL trains on episodes in browsers: a real step of its trainer, whose replies alone come from a list."""

from __future__ import annotations

import asyncio
import json
import warnings
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import torch
from tests.inference.tiny import tiny_image_processor, tiny_model, tiny_tokenizer
from tests.integrations.engine import example

from webgym import Action, Answer, RunConfig, Scroll
from webgym.core.errors import JudgeError, UsageError
from webgym.core.verdict import Verdict
from webgym.testing import Adapted, Told, check_adapter, stand_in_pool
from webgym.testing.environments import StandInJudge

pytest.importorskip("trl", reason="trl is not installed")

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # of its imports
    from datasets import Dataset
    from transformers import Qwen3VLProcessor
    from trl import GRPOConfig, GRPOTrainer
    from trl.chat_template_utils import qwen3_vl_chat_template

    from webgym.integrations.trl import Browsers, BrowserTools


class Judge(StandInJudge):
    """Fails at the answer ``broken``."""

    async def judge(self, task: Any, episode: Any, pictures: Any) -> Verdict:
        if episode.answer == "broken":
            raise JudgeError("no verdict for this one")
        return await super().judge(task, episode, pictures)


@pytest.fixture
def browsers(tmp_path: Path) -> Iterator[Browsers]:
    made = Browsers(**{**stand_in_pool(tmp_path), "judge": Judge()})
    yield made
    made.close()


def played(tools: BrowserTools, answer: str | None) -> float | None:
    first = tools.reset(task_id="check-3", prompt="not looked at")
    assert [part["type"] for part in first] == ["image", "text"]
    second = tools.scroll("down")
    assert second[0]["image"].size == first[0]["image"].size
    assert second[0]["image"].tobytes() != first[0]["image"].tobytes()
    if answer is not None:
        assert tools.answer(answer) == tools.click(1, 1) == [{"type": "text", "text": "The episode is over."}]
    return tools.get_reward()


@asynccontextmanager
async def adapter(given: dict[str, Any]) -> AsyncIterator[Adapted]:
    browsers = Browsers(**given)
    free: list[BrowserTools] = []

    def play(task_id: str, actions: Sequence[Action | str]) -> Told:
        tools = free.pop() if free else browsers()
        tools.reset(task_id=task_id)
        for action in actions:
            match action:
                case Scroll(direction="up" | "down" as direction):
                    tools.scroll(direction)
                case Answer(text=text):
                    tools.answer(text)
        reward = tools.get_reward()  # TRL asks once, at the end
        free.append(tools)
        return Told([] if reward is None else [reward])

    def begin(task_id: str) -> BrowserTools:
        tools = browsers()
        tools.reset(task_id=task_id)
        return tools

    try:
        yield Adapted(
            lambda task_id, actions: asyncio.to_thread(play, task_id, actions),
            lambda task_id: asyncio.to_thread(begin, task_id),
        )
    finally:
        await asyncio.to_thread(browsers.close)


async def test_it_keeps_the_environments_promises() -> None:
    def rows(name: str, config: RunConfig) -> list[str]:
        browsers = Browsers(name, size=1, split="all")
        drawn = [row["task_id"] for row in browsers.rows(split="all", count=6, config=config)]
        browsers.close()
        return drawn

    assert await check_adapter(adapter, rows=rows, cancels=False) == []


def test_a_reward_is_the_judges_and_a_fault_is_none(browsers: Browsers) -> None:
    tools = browsers()
    assert [played(tools, answer) for answer in ("right", "wrong", None, "broken")] == [1.0, 0.0, 0.0, None]
    assert (browsers.begun, browsers.unanswered) == (4, 1)
    judge: Any = browsers.pool._first._judge
    judge.fault = "blocked"
    assert [played(tools, answer) for answer in ("wrong", None)] == [None, None]
    opened: Any = browsers.pool._first._browsers
    opened.fails = True
    tools.reset(task_id="check-3")
    assert tools.scroll("down") == [{"type": "text", "text": "The episode is over."}]
    assert tools.get_reward() is None
    assert not opened.open_now


def test_rows_are_of_tasks_that_the_browsers_have(browsers: Browsers) -> None:
    """The stand-ins' tasks have no split; the default one would have none of them."""
    (row,) = browsers.rows(count=1)
    assert browsers().reset(**row)[0]["type"] == "image"


def test_an_error_that_the_model_would_be_shown_is_refused() -> None:
    with pytest.raises(UsageError, match="on_fault"):
        Browsers("offline-small-v2", on_fault="raise")


def test_more_episodes_than_browsers_are_refused(browsers: Browsers) -> None:
    held = [browsers() for _ in range(4)]
    with pytest.raises(RuntimeError, match="more than 4 concurrent episodes"):
        browsers()
    held.clear()  # a trainer that is dropped
    held.append(browsers())


class Processor(Qwen3VLProcessor):
    """Without a processor of videos, which needs torchvision."""

    def check_argument_for_proper_class(self, argument_name: str, argument: Any) -> type:
        del argument_name
        return type(argument)


class _NoVideos:
    merge_size = 2
    model_input_names = ()


def call(name: str, **arguments: Any) -> str:
    told = json.dumps({"name": name, "arguments": arguments})
    return f"<tool_call>\n{told}\n</tool_call>"


class Trainer(GRPOTrainer):
    """Samples from a list in place of a model; everything else is TRL's."""

    says: list[list[str]]
    read: list[list[list[int]]]

    def _generate_single_turn(
        self, prompt_ids: list[list[int]], *more: Any, **named: Any
    ) -> tuple[list[list[int]], None]:
        self.read.append([list(ids) for ids in prompt_ids])
        texts = self.says.pop(0)
        assert len(texts) == len(prompt_ids)
        tokenizer = self.processing_class.tokenizer
        return [[*tokenizer(text)["input_ids"], tokenizer.eos_token_id] for text in texts], None

    def _generate_and_score_completions(self, inputs: Any) -> Any:
        self.batch = super()._generate_and_score_completions(inputs)
        return self.batch


def tiny() -> tuple[Any, Any]:
    """A model, and its processor."""
    tokenizer = tiny_tokenizer(qwen3_vl_chat_template)
    processor = Processor(
        tiny_image_processor(), tokenizer, _NoVideos(), chat_template=qwen3_vl_chat_template
    )
    model = tiny_model()
    model.config.text_config.max_position_embeddings = 65536
    return model, processor


def settings(folder: Path, episodes: int) -> Any:
    """Of one step on the CPU."""
    return GRPOConfig(
        output_dir=str(folder / "out"),
        per_device_train_batch_size=episodes,
        num_generations=episodes,
        max_completion_length=20000,
        max_steps=1,
        learning_rate=1e-2,
        logging_steps=1,
        report_to=[],
        use_cpu=True,
        save_strategy="no",
        beta=0.0,
    )


@pytest.mark.browser
@pytest.mark.filterwarnings("ignore")  # of its own
def test_the_example(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, processor = tiny()
    says = [[call("scroll", direction="down")] * 2, [call("answer", text="no idea")] * 2, ["Done."] * 2]
    Trainer.says, Trainer.read = says, []
    made = example("trl_grpo").main(
        model,
        "offline-small-v2",
        count=2,
        trainer=Trainer,
        args=settings(tmp_path, 2),
        processing_class=processor,
    )
    logged = next(row for row in made.state.log_history if "rewards/BrowserTools/mean" in row)
    assert logged["rewards/BrowserTools/mean"] == 0.0
    assert "2 episodes, 0 of them ended by TRL before an answer" in capsys.readouterr().out


@pytest.mark.filterwarnings("ignore")  # of its own
def test_a_step_of_its_trainer_learns_from_rewards_and_nothing_from_a_fault(
    browsers: Browsers, tmp_path: Path
) -> None:
    model, processor = tiny()
    tokenizer = processor.tokenizer
    before = {name: value.clone() for name, value in model.named_parameters()}
    config = settings(tmp_path, 4)
    rows = browsers.rows(split="all", count=2)
    assert rows[0].keys() == {"task_id", "prompt"}
    trainer = Trainer(
        model=model,
        args=config,
        train_dataset=Dataset.from_list(rows),
        processing_class=processor,
        environment_factory=browsers,
    )
    trainer.read = []
    trainer.says = [
        [call("scroll", direction="down")] * 4,
        [call("answer", text=text) for text in ("right", "wrong", "broken", "right")],
        ["Done."] * 4,
    ]
    trainer.train()
    advantages = trainer.batch["advantages"].tolist()
    assert advantages[0] == advantages[3] > 0 > advantages[1]
    assert advantages[2] == 0.0
    logged = next(row for row in trainer.state.log_history if "rewards/BrowserTools/mean" in row)
    assert logged["rewards/BrowserTools/mean"] == pytest.approx(2 / 3)
    # What is trained on is what was read and said, the answers of tools left out.
    reply = tokenizer(call("scroll", direction="down"))["input_ids"]
    ids, mask = trainer.batch["completion_ids"][0].tolist(), trainer.batch["tool_mask"][0].tolist()
    assert ids[: len(reply)] == reply
    second = trainer.read[1][0][len(trainer.read[0][0]) :]
    assert ids[: len(second)] == second
    said = [token for token, ours in zip(ids, mask, strict=True) if ours]
    assert tokenizer.decode(said).count("<tool_call>") == 2
    image = tokenizer.convert_tokens_to_ids("<|image_pad|>")
    assert second.count(image) > 0 == said.count(image)
    assert "pixel_values" in trainer.batch
    changed = [name for name, value in model.named_parameters() if not torch.equal(value, before[name])]
    assert any("visual" in name for name in changed)
    assert any("language_model" in name for name in changed)
