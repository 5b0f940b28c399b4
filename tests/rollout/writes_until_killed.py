"""Writes trajectories to a run until it is killed; prints the id of each once it counts.

    python writes_until_killed.py RUN SEED

Opens the run again where it exists and goes on after what is there.
"""

from __future__ import annotations

import asyncio
import hashlib
import random
import sys
from pathlib import Path

from webgym.core.action import Answer
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.trajectory import Episode, Reply, Step, Trajectory
from webgym.store import runs
from webgym.store.runs import RunWriter

WRITERS = 3
runs.SHARD_BYTES = 4_000_000


def record(number: int, rng: random.Random) -> tuple[Trajectory, dict[str, bytes]]:
    pictures = [rng.randbytes(rng.randrange(1_000, 200_000)) for _ in range(2)]
    names = [hashlib.sha256(picture).hexdigest() for picture in pictures]
    steps = tuple(
        Step(
            index=index,
            observation=Observation(screenshot=name, url="http://a.test/", title="A", viewport=(1280, 768)),
            messages=(),
            reply=Reply(text="x" * rng.randrange(1_000, 700_000), policy="p"),
            action=Answer(text=str(number)),
        )
        for index, name in enumerate(names)
    )
    episode = Episode(
        attempt_id=f"kill/{number}#0.0",
        task_id=f"kill/{number}",
        sample=0,
        retry=0,
        seed=number,
        policy="p",
        started_at=0.0,
        seconds=1.0,
        steps=steps,
        ending=Ending.ANSWERED,
        answer=str(number),
    )
    return Trajectory(episode=episode, outcome=Outcome.FAILURE), dict(zip(names, pictures, strict=True))


async def write(writer: RunWriter, number: int, rng: random.Random) -> None:
    while True:
        trajectory, pictures = record(number, rng)
        for name, data in pictures.items():
            await writer.put_image(name, data)
        await writer.append(trajectory)
        sys.stdout.write(trajectory.episode.attempt_id + "\n")
        sys.stdout.flush()
        number += WRITERS


async def main(run: Path, seed: int) -> None:
    if (run / "config.yaml").exists():
        writer = await RunWriter.reopen(run)
    else:
        writer = await RunWriter.create(run, {"seed": seed}, [])
    first = 1 + max((int(entry.task_id.split("/")[1]) for entry in writer.attempts.values()), default=-1)
    async with writer, asyncio.TaskGroup() as group:
        for number in range(WRITERS):
            group.create_task(write(writer, first + number, random.Random(seed + number)))


if __name__ == "__main__":
    asyncio.run(main(Path(sys.argv[1]), int(sys.argv[2])))
