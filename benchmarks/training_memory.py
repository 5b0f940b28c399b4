"""Host memory and time of the training samples of an update: pictures stay compressed files until used.

    python benchmarks/training_memory.py        2,000 steps; pixels of 30 of them are made
    python benchmarks/training_memory.py --steps 500 --used 30

Each step's request has four pictures of 1280 x 768 and 2,500 words, as the workload of the estimate has it.
The pages are drawn, 80 different ones, and no model is loaded: tokenizer and chat template are the tiny
policy's.
"""

from __future__ import annotations

import argparse
import asyncio
import hashlib
import io
import random
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from pathlib import Path

import psutil
from PIL import Image, ImageDraw

from webgym.core.action import LeftClick, Target
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import WHOLE_TASK, Task
from webgym.core.trajectory import Episode, ImageRef, Message, Reply, Step, TextPart, Trajectory
from webgym.inference.model import load_renderer
from webgym.store.runs import RunWriter
from webgym.train.folder import TrainingFolder
from webgym.train.logprobs import batches_ahead
from webgym.train.replay import Counts, ReplaySample, StepRef
from webgym.train.samples import SampleMaker
from webgym.train.update import samples_of

SIZE, PICTURES, PER_ATTEMPT = (1280, 768), 4, 20
TASK = Task("bench/1", "read", "http://a.test/", "Shopping", "Books", WHOLE_TASK, "bench", split="train")


@cache
def page(number: int) -> bytes:
    """A page full of words and some blocks of colour, PNG."""
    rng = random.Random(number)
    picture = Image.new("RGB", SIZE, "white")
    draw = ImageDraw.Draw(picture)
    for _ in range(6):
        left, top = rng.randrange(SIZE[0]), rng.randrange(SIZE[1])
        draw.rectangle((left, top, left + 300, top + 150), fill=tuple(rng.randrange(256) for _ in range(3)))
    for line in range(0, SIZE[1], 14):
        draw.text((10, line), " ".join(f"{rng.getrandbits(24):x}" for _ in range(28)), fill="black")
    data = io.BytesIO()
    picture.save(data, "PNG", compress_level=1)
    return data.getvalue()


def attempts(count: int) -> Iterator[tuple[dict[str, bytes], Trajectory]]:
    """Attempts of twenty steps each, with their new pictures."""
    for attempt in range(count // PER_ATTEMPT):
        data = [page(attempt % 4 * PER_ATTEMPT + index) for index in range(PER_ATTEMPT)]
        pictures = {hashlib.sha256(each).hexdigest(): each for each in data}
        names, steps = list(pictures), []
        for index in range(PER_ATTEMPT):
            shown = [names[max(0, index - back)] for back in reversed(range(PICTURES))]
            words = TextPart(" ".join(f"{attempt * index + word:x}" for word in range(2500)))
            request = (Message("user", (words, *(ImageRef(name, *SIZE) for name in shown))),)
            seen = Observation(names[index], TASK.website, "A", SIZE)
            click = LeftClick(Target(coordinate=(1.0, 2.0)))
            steps.append(Step(index, seen, request, Reply("click " * 300, "p"), click, changed=True))
        id = f"{TASK.id}#{attempt}.0"
        episode = Episode(id, TASK.id, attempt, 0, 7, "p", 100.0, 2.5, tuple(steps), Ending.ANSWERED)
        yield pictures, Trajectory(episode, Outcome.SUCCESS)


async def write(run: Path, count: int) -> None:
    async with await RunWriter.create(run, {"seed": 7}, [TASK]) as writer:
        for pictures, trajectory in attempts(count):
            for name, data in pictures.items():
                await writer.put_image(name, data)
            await writer.append(trajectory)


def mib() -> float:
    """Memory of this process."""
    return float(psutil.Process().memory_info().rss) / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--used", type=int, default=30)
    parser.add_argument("--micro-batch", type=int, default=3)
    given = parser.parse_args()

    renderer = load_renderer(Path(str(files("webgym.study") / "weights")))
    renderer.image_processor.size = {"shortest_edge": 1024, "longest_edge": 2**24}
    with tempfile.TemporaryDirectory() as temporary:
        folder = TrainingFolder(Path(temporary))
        folder.iteration(1).mkdir(parents=True)
        asyncio.run(write(folder.run(1), given.steps))
        stored = sum(each.stat().st_size for each in folder.path.rglob("*") if each.is_file()) / 2**20
        ids = [f"{TASK.id}#{attempt}.0" for attempt in range(given.steps // PER_ATTEMPT)]
        refs = tuple(StepRef(1, id, index) for id in ids for index in range(PER_ATTEMPT))
        before, started = mib(), time.perf_counter()
        samples = samples_of(
            ReplaySample(refs, Counts(), len(refs), 0, {}),
            folder,
            SampleMaker(renderer, cutoff_tokens=10**6),
        )
        read, after = time.perf_counter() - started, mib()
        print(f"samples    {len(samples)} with {len(samples[0])} tokens, {stored:,.0f} MiB on disk")
        print(f"memory     {after - before:,.0f} MiB for all samples, read in {read:.0f} s")
        groups = [
            samples[start : start + given.micro_batch] for start in range(0, given.used, given.micro_batch)
        ]
        started, most = time.perf_counter(), 0.0
        for batch in batches_ahead(groups, renderer, off_policy=False):
            assert batch.pixel_values is not None
            pixels, most = batch.pixel_values.nbytes / 2**20, max(most, mib())
        seconds = (time.perf_counter() - started) / given.used
        print(f"pixels     {most - after:,.0f} MiB at most for {given.used} samples, {pixels:.0f} a batch")
        print(f"time       {seconds:.2f} s a sample")


if __name__ == "__main__":
    main()
