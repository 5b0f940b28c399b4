"""Replies from a model in this process: the tokens that are recorded are the tokens that were drawn."""

from __future__ import annotations

import asyncio
import io
import threading
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from PIL import Image

torch = pytest.importorskip("torch")

from tests.agent.test_context import observation  # noqa: E402

from webgym.agent.policy import PolicyInput  # noqa: E402
from webgym.core.errors import ConfigError, PolicyError  # noqa: E402
from webgym.core.task import FactGroup, Rubric, Task  # noqa: E402
from webgym.core.trajectory import ImageRef, Message, TextPart  # noqa: E402
from webgym.inference.generate import SamplingParameters, draw, generate, processed_logprobs  # noqa: E402  # noqa: E402
from webgym.inference.local import LocalConfig, LocalPolicy  # noqa: E402
from webgym.inference.model import Loaded, load_model  # noqa: E402
from webgym.llm.config import Sampling  # noqa: E402
from webgym.study.model import TinyConfig, make_model, save_model  # noqa: E402

WORDS = "say the number of red blue star moon".split()


@pytest.fixture(scope="module")
def loaded() -> Loaded:
    return make_model(WORDS, TinyConfig(width=64, text_layers=2, vision_layers=2), seed=1)


@pytest.fixture(scope="module")
def folder(loaded: Loaded, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "tiny"
    save_model(loaded, path)
    return path


def picture(colour: str) -> bytes:
    data = io.BytesIO()
    Image.new("RGB", (192, 128), colour).save(data, "PNG")
    return data.getvalue()


TASK = Task("t", "say", "http://a.test/", "d", "s", Rubric((FactGroup(1, "x", ("y",)),)), "own")
PICTURES = {"a": picture("red"), "b": picture("blue")}


def messages(text: str, *names: str) -> tuple[Message, ...]:
    shown = tuple(ImageRef(name, 192, 128) for name in names)
    return (
        Message("system", (TextPart("act"),)),
        Message("user", (*shown, TextPart(text))),
    )


REQUESTS = [
    messages("task say the number of the red star", "a"),
    messages("task say the number", "b", "a"),
    messages("task say"),
]


def encoded(loaded: Loaded) -> list[Any]:
    return [loaded.renderer.prompt(request, PICTURES) for request in REQUESTS]


def test_a_batch_says_what_each_request_alone_would_say(loaded: Loaded) -> None:
    draws = SamplingParameters(temperature=1.0, top_p=0.9, max_tokens=8)
    together = generate(loaded, encoded(loaded), [5, 6, 7], draws)
    for request, seed, reply in zip(encoded(loaded), [5, 6, 7], together, strict=True):
        (alone,) = generate(loaded, [request], [seed], draws)
        assert alone.ids == reply.ids
        assert alone.logprobs == pytest.approx(reply.logprobs, abs=1e-4)


def test_log_probabilities_are_those_of_the_whole_sequence(loaded: Loaded) -> None:
    """What is recorded step by step equals what training computes in one forward pass."""
    for request, reply in zip(
        encoded(loaded),
        generate(loaded, encoded(loaded), [1, 2, 3], SamplingParameters(max_tokens=6)),
        strict=True,
    ):
        ids = torch.tensor([[*request.prompt_ids, *reply.ids]])
        vision = {}
        if request.pixels is not None:
            vision = {"pixel_values": request.pixels.values, "image_grid_thw": request.pixels.grid}
        kinds = (ids == loaded.renderer.image_id).int()
        with torch.inference_mode():
            logits = loaded.model(input_ids=ids, mm_token_type_ids=kinds, **vision).logits[0]
        start = len(request.prompt_ids) - 1
        scores = logits[start : start + len(reply.ids)].log_softmax(-1)
        whole = scores.gather(-1, torch.tensor(reply.ids)[:, None]).squeeze(-1)
        assert reply.logprobs == pytest.approx(whole.tolist(), abs=1e-4)


def test_top_k_and_top_p_leave_out_what_they_should() -> None:
    logits = torch.log(torch.tensor([[0.5, 0.3, 0.15, 0.05]]))
    assert processed_logprobs(logits, top_k=2).exp()[0].tolist() == pytest.approx([0.625, 0.375, 0, 0])
    assert processed_logprobs(logits, top_p=0.8).exp()[0].tolist() == pytest.approx([0.625, 0.375, 0, 0])
    assert processed_logprobs(logits, top_p=0.81).exp()[0, 2] > 0
    assert processed_logprobs(logits, top_p=0.01).exp()[0].tolist() == pytest.approx([1, 0, 0, 0])


def test_draws_follow_the_distribution_and_their_own_seed() -> None:
    logprobs = processed_logprobs(torch.log(torch.tensor([[0.6, 0.3, 0.1]])), top_k=2).expand(4000, -1)
    generators = [torch.Generator().manual_seed(seed) for seed in range(4000)]
    drawn = draw(logprobs, generators)
    assert (drawn == 0).float().mean().item() == pytest.approx(2 / 3, abs=0.03)
    assert drawn.max() == 1
    assert draw(logprobs[:1], [torch.Generator().manual_seed(17)]) == drawn[17]


def turn(text: str, *names: str) -> PolicyInput:
    return PolicyInput(
        task=TASK,
        observation=observation(0),
        messages=messages(text, *names),
        images=PICTURES,
        steps=(),
        index=0,
        budget=5,
        mode="coordinates",
        prompt_format="compact",
    )


async def test_many_calls_share_batches_and_carry_their_tokens(folder: Path) -> None:
    policy = LocalPolicy(LocalConfig(path=str(folder), sampling=Sampling(max_tokens=5)))
    async with policy:
        player = policy.begin(turn("task say").task, seed=3)
        replies = await asyncio.gather(*(player.reply(turn("task say the number", "a")) for _ in range(9)))
        assert len({reply.text for reply in replies}) == 1, "one seed says one thing"
        reply = replies[0]
        assert reply.tokens is not None
        expected = policy._loaded.renderer.prompt(turn("task say the number", "a").messages, PICTURES)
        assert reply.tokens.prompt_ids == expected.prompt_ids
        assert policy._loaded.renderer.decode(reply.tokens.reply_ids) == reply.text
        assert reply.tokens.reply_logprobs is not None
        assert reply.weight_version == "0"
        assert reply.completion_tokens == len(reply.tokens.reply_ids) <= 5


async def test_a_turn_with_its_own_sampling_is_replied_to_with_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An evaluation beside collection: one model, two ways to sample, never in one batch."""
    config = LocalConfig(path=str(folder), sampling=Sampling(max_tokens=4))
    greedy = Sampling(temperature=0.0, extra_body={"top_k": 2})
    async with LocalPolicy(config) as policy:
        batches: list[int] = []
        generated = policy._generate

        def counted(requests: Any, *given: Any) -> Any:
            batches.append(len(requests))
            return generated(requests, *given)

        monkeypatch.setattr(policy, "_generate", counted)
        plain = turn("task say the number", "a")
        turns = [plain, replace(plain, sampling=greedy)] * 3
        replies = await asyncio.gather(*(policy.reply(each, seed) for seed, each in enumerate(turns)))
    assert max(batches) <= 3
    assert sum(batches) == 6
    own = policy._sampling.body()
    assert [reply.sampling for reply in replies] == [own, own | greedy.body()] * 3
    assert len({reply.text for reply in replies[1::2]}) == 1, "the likeliest tokens, whatever the seed"


async def test_published_weights_reply_from_then_on(folder: Path, tmp_path: Path) -> None:
    other = make_model(WORDS, TinyConfig(width=64, text_layers=2, vision_layers=2), seed=2)
    save_model(other, tmp_path)
    config = LocalConfig(path=str(folder), sampling=Sampling(max_tokens=4, temperature=0.0))
    async with LocalPolicy(config) as policy:
        asked = turn("task say the number", "a")
        before = await policy.reply(asked, 1)
        await policy.publish(tmp_path, "1")
        after = await policy.reply(asked, 1)
        assert after.weight_version == "1"
        request = other.renderer.prompt(asked.messages, PICTURES)
        (expected,) = generate(other, [request], [1], SamplingParameters(temperature=0, max_tokens=4))
        assert after.tokens is not None
        assert after.tokens.reply_ids == expected.ids
        assert before.weight_version == "0"
        with pytest.raises(ConfigError, match="cannot publish"):
            await policy.publish(tmp_path / "none", "2")
        assert (await policy.reply(asked, 1)).weight_version == "1", "a failed publish changes nothing"


def test_published_weights_are_not_on_the_models_device_a_second_time(folder: Path) -> None:
    """They are float32 for training; 8B of them have no place beside the model on a GPU that it shares."""
    policy = LocalPolicy(LocalConfig(path=str(folder), device="cuda"))
    policy._loaded = load_model(folder)  # as if that were the device: there is none here
    policy._load_weights(folder, "1")
    assert policy.weight_version == "1"


async def test_a_request_that_cannot_be_rendered_fails_alone(folder: Path) -> None:
    placeholder = (Message("system", (TextPart("<|image_pad|>"),)), *messages("task"))
    async with LocalPolicy(LocalConfig(path=str(folder), sampling=Sampling(max_tokens=2))) as policy:
        good, bad = await asyncio.gather(
            policy.reply(turn("task say", "a"), 1),
            policy.reply(replace(turn("task"), messages=placeholder), 2),
            return_exceptions=True,
        )
        assert isinstance(bad, PolicyError)
        assert not isinstance(good, BaseException)


async def test_whoever_waits_is_told_that_the_policy_is_closed(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = LocalConfig(path=str(folder), sampling=Sampling(max_tokens=2), most_at_once=1)
    begun, may_end = threading.Event(), threading.Event()
    async with LocalPolicy(config) as policy:

        def slow(*given: Any) -> Any:
            begun.set()
            may_end.wait(100)
            return [], ""

        monkeypatch.setattr(policy, "_generate", slow)
        calls = [asyncio.create_task(policy.reply(turn("task say"), seed)) for seed in range(2)]
        await asyncio.to_thread(begun.wait, 100)
        asyncio.get_running_loop().call_later(0.05, may_end.set)
    for end in await asyncio.wait_for(asyncio.gather(*calls, return_exceptions=True), 100):
        assert isinstance(end, PolicyError)
    with pytest.raises(PolicyError, match="not open"):
        await policy.reply(turn("task say"), 1)


def test_sampling_that_would_not_be_applied_is_refused() -> None:
    with pytest.raises(ValueError, match="without min_p, stop"):
        LocalConfig(path="m", sampling=Sampling(extra_body={"top_k": 2, "min_p": 0.1, "stop": ["a"]}))
    LocalConfig(path="m", sampling=Sampling(extra_body={"top_k": 2, "min_p": None}))


async def test_a_model_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot load the model"):
        async with LocalPolicy(LocalConfig(path=str(tmp_path / "none"))):
            pass


@pytest.mark.parametrize("path", ["no/such/folder", "no such folder"])
async def test_a_path_is_not_told_the_rules_of_hub_ids(path: str) -> None:
    with pytest.raises(ConfigError, match="there is no such folder"):
        async with LocalPolicy(LocalConfig(path=path)):
            pass


@pytest.mark.parametrize("device", ["gpu", "cuda:99"])
async def test_a_device_that_is_not_there_is_one_line(device: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="torch cannot use the device") as error:
        async with LocalPolicy(LocalConfig(path=str(tmp_path), device=device)):
            pass
    assert "\n" not in str(error.value)
