"""A policy of your own: begin an attempt, reply in it.

    .venv/bin/python examples/own_policy.py

collects a few trajectories on the offline web with this one, which reads the front page and guesses.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path
from typing import Self

from webgym import Reply, RunConfig, RunReader, Task, Turn, collect
from webgym.agent.prompts import render_reply
from webgym.collection import TaskChoice
from webgym.core.action import Answer, Scroll


class Guesser:
    """Scrolls down twice, then answers with the title of the page."""

    name = "guesser"
    wants_elements = False

    def begin(self, task: Task, seed: int) -> Guesser:
        """One attempt. A policy that remembers returns an object of its own for each."""
        return self

    async def reply(self, turn: Turn) -> Reply:
        """One turn. A model would be asked with ``turn.messages`` and ``turn.images`` here."""
        action = Scroll("down") if turn.index < 2 else Answer(turn.observation.title)
        text = render_reply(action, turn.prompt_format, description="Look around, then guess.")
        return Reply(text=text, policy=self.name)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *exc: object) -> None:
        """Nothing to close."""


async def main(out: Path) -> None:
    """Collect, then read what was collected."""
    summary = await collect(RunConfig(tasks=TaskChoice(split="test", count=5)), out, policy=Guesser())
    for trajectory in RunReader(out).trajectories():
        episode = trajectory.episode
        print(f"{trajectory.outcome:12} {len(episode.steps)} steps  {episode.task_id}: {episode.answer!r}")
    print(f"{summary['attempts']} attempts, {summary['steps_per_second']:.1f} steps/s")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        asyncio.run(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "run"))
