"""Reinforcement learning of a web agent from top to bottom: no trainer, no server, no browser.

    python examples/train_on_one_screen.py --seed 1

A vision-language model of 2.6 million weights attempts tasks on websites that it was never trained on. Then,
four times, it attempts 40 training tasks four times each, and what it did in attempts that went better than
the others at the same task becomes likelier. Then it attempts the first tasks again.

WebGym gives the environment (websites, prompt, parser, judge) and the model (weights, tokenizer, sampling).
``webgym train`` does the same at any size: it overlaps, shards, resumes, and loses no attempt.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import random
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mean, stdev
from typing import Any

import torch
from torch.nn.attention import SDPBackend, sdpa_kernel
from torch.nn.utils.rnn import pad_sequence

import webgym
from webgym.inference.generate import Generated, SamplingParameters, generate
from webgym.inference.model import Loaded, load_model
from webgym.inference.rendering import Encoded

WEIGHTS = Path(webgym.__file__).parent / "study" / "weights"
CONFIG: dict[str, Any] = {
    "server": {"static": True, "pictures": Path(tempfile.gettempdir()) / "webgym-pages"},
    "agent": {"profile": "tiny", "prompt_format": "compact", "rounds": 0},
    "attempt": {"budget_easy": 10, "budget_medium": 20, "budget_hard": 30},
}
EXPLORE = SamplingParameters(max_tokens=64)  # the whole distribution, or ratios of probabilities are wrong
EXPLOIT = SamplingParameters(max_tokens=64, top_k=2, top_p=0.99)


@dataclass
class Attempt:
    """An attempt at a task. Its reward is NaN, never 0, where the environment failed."""

    env: webgym.Environment
    task_id: str
    info: dict[str, Any]
    reward: float = math.nan
    turns: list[tuple[Encoded, Generated]] = field(default_factory=list)


# A request to the model, its reply, and by how much its attempt was better than others at the same task.
Turn = tuple[Encoded, Generated, float]


async def begin(env: webgym.Environment, task_id: str) -> Attempt:
    """Open the task's website."""
    _, info = await env.reset(options={"task_id": task_id})
    return Attempt(env, task_id, info)


async def play(
    envs: Iterable[webgym.Environment],
    task_ids: Sequence[str],
    model: Loaded,
    how: SamplingParameters,
    rng: random.Random,
) -> list[Attempt]:
    """Attempt all tasks at the same time."""
    attempts = await asyncio.gather(*map(begin, envs, task_ids))
    while going := [attempt for attempt in attempts if not attempt.info["is_over"]]:
        # One batch: screenshot and task in, an action in words out.
        requests = [model.renderer.prompt(each.info["messages"], each.info["images"]) for each in going]
        replies = generate(model, requests, [rng.getrandbits(31) for _ in going], how)
        # The websites carry the actions out; at an attempt's end the judge looks at all of it.
        texts = [model.renderer.decode(reply.ids) for reply in replies]
        stepped = await asyncio.gather(*(one.env.step(text) for one, text in zip(going, texts, strict=True)))
        turns = zip(requests, replies, strict=True)
        for attempt, turn, step in zip(going, turns, stepped, strict=True):
            _, attempt.reward, _, _, attempt.info = step
            attempt.turns.append(turn)
    return [attempt for attempt in attempts if not math.isnan(attempt.reward)]


def success(attempts: Sequence[Attempt]) -> str:
    """Success in per cent."""
    return f"{100 * mean(attempt.reward for attempt in attempts):.1f} % of {len(attempts)}"


def compared(attempts: Sequence[Attempt]) -> Iterator[Turn]:
    """All turns with their advantage: (reward - mean of the group) / its standard deviation."""
    for task_id in sorted({attempt.task_id for attempt in attempts}):
        group = [attempt for attempt in attempts if attempt.task_id == task_id]
        rewards = [attempt.reward for attempt in group]
        if len(set(rewards)) > 1:  # if all are right, or all wrong, there is nothing to compare
            for attempt in group:
                advantage = (attempt.reward - mean(rewards)) / stdev(rewards)
                yield from ((*turn, advantage) for turn in attempt.turns)


def log_probabilities(model: Loaded, turns: Sequence[Turn]) -> torch.Tensor:
    """Of all tokens of the replies, one after the other, under the weights of now."""
    rows = [torch.tensor(request.prompt_ids + reply.ids) for request, reply, _ in turns]
    ids = pad_sequence(rows, batch_first=True, padding_value=model.renderer.pad_id)
    place, pixels = torch.arange(ids.shape[1]), [request.pixels for request, _, _ in turns if request.pixels]
    ends = torch.tensor([len(row) for row in rows])[:, None]
    starts = torch.tensor([len(request.prompt_ids) for request, _, _ in turns])[:, None]
    logits = model.model(
        input_ids=ids,
        attention_mask=(place < ends).long(),
        mm_token_type_ids=(ids == model.renderer.image_id).long(),
        pixel_values=torch.cat([each.values for each in pixels]),
        image_grid_thw=torch.cat([each.grid for each in pixels]),
    ).logits
    # A token is predicted at the place before its own.
    found = logits[:, :-1].log_softmax(-1).gather(-1, ids[:, 1:, None]).squeeze(-1)
    return found[((place >= starts) & (place < ends))[:, 1:]]


def surrogate(model: Loaded, turns: Sequence[Turn]) -> torch.Tensor:
    """The loss, a mean over tokens: likelier what went well, and no token by more than a clip (PPO)."""
    old = torch.tensor([logprob for _, reply, _ in turns for logprob in reply.logprobs])
    advantage = torch.tensor([each for _, reply, each in turns for _ in reply.ids])
    ratio = torch.exp(log_probabilities(model, turns) - old)
    loss = -torch.minimum(ratio * advantage, ratio.clamp(0.8, 1.2) * advantage)
    return torch.minimum(loss, 3 * advantage.abs()).mean()


async def main() -> None:
    """Evaluate, learn, evaluate."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--iterations", type=int, default=4)
    parser.add_argument("--tasks", type=int, default=40, help="of an iteration")
    parser.add_argument("--test", type=int, default=200, help="tasks to evaluate")
    told = parser.parse_args()
    attempts_each, passes, batch_size, rate, warm_up = 4, 3, 128, 1e-3, 5
    torch.set_num_threads(1)
    model, rng = load_model(WEIGHTS), random.Random(told.seed)
    model.model.model.visual.requires_grad_(False)
    weights = [weight for weight in model.model.parameters() if weight.requires_grad]
    optimizer = torch.optim.AdamW(weights, lr=rate)
    warming = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: min(1.0, (step + 1) / (warm_up + 1)))
    config = webgym.RunConfig(**CONFIG)
    most = max(told.test, told.tasks * attempts_each)
    async with webgym.make_many(most, "offline-small-v2", split="all", config=config) as envs:
        tasks = envs[0].tasks.values()
        to_learn, to_test = ([task.id for task in tasks if task.split == name] for name in ("train", "test"))
        test = random.Random(0).sample(to_test, told.test)
        attempts = await play(envs, test, model, EXPLOIT, random.Random(0))
        print(f"before  {success(attempts)} unseen tasks", flush=True)
        for iteration in range(1, told.iterations + 1):
            # Collect: each task several times, so that its attempts can be compared.
            drawn = rng.sample(to_learn, told.tasks) * attempts_each
            attempts = await play(envs, drawn, model, EXPLORE, rng)
            turns, losses = list(compared(attempts)), []
            # Learn: each turn some times, in batches.
            for _ in range(passes):
                rng.shuffle(turns)
                for start in range(0, len(turns), batch_size):
                    with sdpa_kernel(SDPBackend.MATH):  # on processors the fastest to learn with
                        loss = surrogate(model, turns[start : start + batch_size])
                        loss.backward()
                    torch.nn.utils.clip_grad_norm_(weights, 1.0)
                    optimizer.step()
                    optimizer.zero_grad()
                    warming.step()
                    losses.append(loss.item())
            learned = f"loss {mean(losses):+.3f} in {len(losses)} steps" if losses else "nothing to compare"
            print(f"{iteration:6}  {success(attempts)} attempts at training tasks; {learned}", flush=True)
        attempts = await play(envs, test, model, EXPLOIT, random.Random(0))
        print(f"after   {success(attempts)} unseen tasks")


if __name__ == "__main__":
    asyncio.run(main())
