"""New weights arrive whole and read the known screenshot as they should: in this process, and over HTTP."""

from __future__ import annotations

import base64
import io
import shutil
from pathlib import Path
from typing import Any

import msgspec
import pytest
import torch
from PIL import Image
from pydantic import SecretStr
from safetensors.torch import load_file, save_file
from tests.inference.tiny import write_tiny_model
from tests.train import fake_vllm
from tests.train.making import NAMES, PICTURES, request, step
from tests.train.updating import CASES, samples, updater

from webgym.agent.openai_policy import OpenAIPolicy
from webgym.core.errors import PublishError
from webgym.core.trajectory import ImageRef, Message, Reply, TextPart
from webgym.inference.generate import SamplingParameters, generate
from webgym.inference.local import LocalConfig, LocalPolicy
from webgym.inference.model import load_model
from webgym.inference.vllm import VllmApi, VllmConfig
from webgym.llm.config import ChatConfig
from webgym.llm.health import watch_clients
from webgym.train.config import LoraConfig
from webgym.train.engine_serving import EnginePolicy, EngineServing, Served
from webgym.train.logprobs import ReplyLogProbs, collate
from webgym.train.samples import SampleMaker
from webgym.train.selftest import EXACT_TOLERANCE, GREEDY, SELFTEST, TOLERANCE, read_selftest
from webgym.train.serving import KeptOpen, LocalServing


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``model``, and what an update made of it: ``all_weights``, and ``adapters``."""
    path = tmp_path_factory.mktemp("made")
    write_tiny_model(path / "model")
    for name in ("all_weights", "adapters"):
        settings, objective = CASES[name]
        learner = updater(path / "model", objective, **settings)
        learner.update(samples(objective), version="0")
        learner.save(path / name)
    return path


async def ask(serving: LocalServing, weights: Path) -> Reply:
    """The likeliest reply to the known request, whatever is served."""
    kept = serving.policy
    assert isinstance(kept, KeptOpen)
    local = kept._policy
    assert isinstance(local, LocalPolicy)
    test = read_selftest(weights)
    assert test is not None
    return await local.ask(*test.request(), GREEDY)


@pytest.mark.parametrize("kind", ["all_weights", "adapters"])
async def test_what_an_update_saved_passes_its_self_test(made: Path, kind: str) -> None:
    test = read_selftest(made / kind)
    assert test is not None
    assert test.after != test.before
    assert test.is_exact
    async with LocalServing(LocalConfig(path=str(made / "model"))) as serving:
        before = await ask(serving, made / kind)
        await serving.publish(made / kind, "3")
        after = await ask(serving, made / kind)
    assert (before.weight_version, after.weight_version) == ("0", "3")
    for reply, greedy in ((before, test.before), (after, test.after)):
        assert reply.tokens is not None
        assert reply.tokens.reply_ids == greedy.ids
        assert reply.tokens.reply_logprobs == pytest.approx(greedy.logprobs, abs=EXACT_TOLERANCE / 10)


async def test_a_server_that_missed_an_update_takes_the_next(made: Path, tmp_path: Path) -> None:
    settings, objective = CASES["all_weights"]
    learner = updater(made / "model", objective, **settings)
    for since, name in (("0", "1"), ("1", "2")):
        learner.update(samples(objective), version=since)
        learner.save(tmp_path / name)
    first = read_selftest(tmp_path / "1")
    assert first is not None
    assert EXACT_TOLERANCE < first.moved < TOLERANCE, "else one start could not be mistaken for the other"
    async with LocalServing(LocalConfig(path=str(made / "model"))) as serving:
        await serving.publish(tmp_path / "2", "2")
        assert (await ask(serving, tmp_path / "2")).weight_version == "2"


async def test_a_copy_has_weights_of_its_own(made: Path) -> None:
    async with LocalServing(LocalConfig(path=str(made / "model"))) as serving, serving.copy() as copy:
        before = await ask(copy, made / "all_weights")
        await serving.publish(made / "all_weights", "3")
        after, published = await ask(copy, made / "all_weights"), await ask(serving, made / "all_weights")
    assert (after.weight_version, published.weight_version) == ("0", "3")
    assert after.tokens == before.tokens != published.tokens


@pytest.mark.parametrize(
    ("harm", "told"),
    [
        ("old", "are not in use|off by"),
        ("half", "off by"),
        ("shape", "1 weights have another shape"),
        ("torn", "cannot publish"),
    ],
)
async def test_weights_that_are_not_what_was_saved_are_refused(
    made: Path, tmp_path: Path, harm: str, told: str
) -> None:
    shutil.copytree(made / "all_weights", tmp_path / "weights")
    path = tmp_path / "weights" / "model.safetensors"
    weights = load_file(path)
    name = "model.language_model.layers.1.self_attn.q_proj.weight"
    if harm == "old":
        shutil.copy(made / "model" / "model.safetensors", path)
    elif harm == "half":
        save_file({each: value * (1 + (each > name)) for each, value in weights.items()}, path)
    elif harm == "shape":
        save_file(weights | {name: weights[name][1:].clone()}, path)
    else:
        path.write_bytes(path.read_bytes()[:-100])
    async with LocalServing(LocalConfig(path=str(made / "model"))) as serving:
        before = await ask(serving, tmp_path / "weights")
        with pytest.raises(PublishError, match=told) as caught:
            await serving.publish(tmp_path / "weights", "1")
        assert "\n" not in str(caught.value)
        if harm in ("shape", "torn"):
            after = await ask(serving, tmp_path / "weights")
            assert (after.weight_version, after.tokens) == ("0", before.tokens), "nothing was overwritten"


async def test_weights_that_no_update_saved_are_served_untested(made: Path) -> None:
    assert (made / "all_weights" / SELFTEST).is_file()
    async with LocalServing(LocalConfig(path=str(made / "model"))) as serving:
        await serving.publish(made / "model", "base")
        assert (await ask(serving, made / "all_weights")).weight_version == "base"


# --- over HTTP --------------------------------------------------------------------------------------------


class ServesWeights(fake_vllm.FakeVllm):
    """With a model in it: what it reads and says is what its weights make of the request."""

    def completion(self, body: dict[str, Any], weights: str) -> dict[str, Any]:
        loaded, pictures = load_model(weights), dict[str, bytes]()
        messages = [Message(each["role"], self.parts(each["content"], pictures)) for each in body["messages"]]
        prompt = loaded.renderer.prompt(messages, pictures)
        draws = SamplingParameters(
            body["temperature"], body["top_p"], max(body["top_k"], 0), body["max_tokens"]
        )
        (made,) = generate(loaded, [prompt], [1], draws)
        choice = {
            "message": {"role": "assistant", "content": loaded.renderer.decode(made.ids)},
            "finish_reason": "length" if made.is_cut else "stop",
            "logprobs": {"content": [{"token": "t", "logprob": each} for each in made.logprobs]},
            "token_ids": made.ids,
        }
        usage = {"prompt_tokens": len(prompt.prompt_ids)}
        prompt_ids = {"prompt_token_ids": prompt.prompt_ids}
        return {"model": body["model"], "choices": [choice], "usage": usage} | prompt_ids

    def parts(self, content: Any, pictures: dict[str, bytes]) -> tuple[TextPart | ImageRef, ...]:
        found: list[TextPart | ImageRef] = []
        listed: list[Any] = [{"type": "text", "text": content}] if isinstance(content, str) else content
        for part in listed:
            if part["type"] == "text":
                found.append(TextPart(part["text"]))
                continue
            name = f"picture {len(pictures)}"
            pictures[name] = base64.b64decode(part["image_url"]["url"].partition(",")[2])
            found.append(ImageRef(name, *Image.open(io.BytesIO(pictures[name])).size))
        return tuple(found)


@pytest.mark.parametrize(("kind", "quirk"), [("all_weights", "dev"), ("adapters", "lora")])
async def test_what_is_said_over_http_is_what_the_learner_trains_on(
    made: Path, tmp_path: Path, kind: str, quirk: str
) -> None:
    """The token contract, end to end: ids and log-probabilities that were served are the learner's own."""
    config = {"sampling": {"temperature": 1.0, "top_p": 1.0, "max_tokens": 5}}
    lora = LoraConfig() if kind == "adapters" else None
    with fake_vllm.running(quirk, of=ServesWeights, weights=str(made / "model")) as fake:
        settings = VllmConfig.model_validate({"base_url": fake.url} | config)
        async with EngineServing(settings, str(made / "model"), tmp_path, lora=lora) as serving:
            await serving.publish(made / kind, "1")
            assert isinstance(serving.policy, EnginePolicy)
            assert serving.policy.served is not None
            reply = await serving.policy.served.policy.ask(request(1), {NAMES[1]: PICTURES[NAMES[1]]})
            shutil.copytree(made / kind, tmp_path / "other")
            test = read_selftest(made / kind)
            assert test is not None
            other = msgspec.structs.replace(test, after=test.before, before=test.after)
            (tmp_path / "other" / SELFTEST).write_bytes(msgspec.json.encode(other))
            with pytest.raises(PublishError, match=r"are not in use|off by"):
                await serving.publish(tmp_path / "other", "2")
    loaded = load_model(made / kind)
    maker = SampleMaker(loaded.renderer, off_policy=True)
    sample = maker.of(step(reply=reply, messages=request(1)), PICTURES.__getitem__)
    assert (maker.stored, len(sample.reply_ids)) == (1, 5)
    with torch.no_grad():
        own = ReplyLogProbs(loaded.model, 100)(collate([sample], loaded.renderer, off_policy=True))
    assert sample.logprobs is not None
    assert sample.logprobs.tolist() == pytest.approx(own.tolist(), abs=1e-3)


async def test_a_run_sees_what_holds_the_served_policy_up(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its client was opened before the run, once for the whole training."""
    policy = EnginePolicy("tiny")
    client = OpenAIPolicy(ChatConfig(base_url="http://127.0.0.1:9/v1", model="tiny"))
    monkeypatch.setattr(OpenAIPolicy, "problem", property(lambda _: "the endpoint is busy"))
    with watch_clients() as problem:
        async with policy:
            assert problem() == "replies wait for new weights"
            api = VllmApi("http://127.0.0.1:9/v1", SecretStr(""))
            policy.switch(Served(api, "tiny", "1", client))
            assert problem() == "the endpoint is busy"
            await api.close()
