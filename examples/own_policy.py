"""A policy of your own: begin an attempt, reply in it.

    .venv/bin/python examples/own_policy.py

collects a few trajectories on the offline web with this one, which reads the front page and guesses.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
from pathlib import Path

import webgym


class Guesser(webgym.BasePolicy):
    """Scrolls down twice, then answers with the title of the page."""

    name = "guesser"

    def begin(self, task: webgym.Task, seed: int) -> webgym.PolicySession:
        """One attempt. A policy that remembers returns an object of its own for each."""
        return self

    async def reply(self, turn: webgym.PolicyInput) -> webgym.Reply:
        """One turn. A model would be asked with ``turn.messages`` and ``turn.images`` here."""
        action = webgym.Scroll("down") if turn.index < 2 else webgym.Answer(turn.observation.title)
        text = webgym.render_reply(action, turn.prompt_format, description="Look around, then guess.")
        return webgym.Reply(text=text, policy=self.name)


async def main(out: Path) -> None:
    """Collect, then read what was collected."""
    config = webgym.RunConfig(tasks=webgym.TaskChoice(split="test", count=5))
    summary = await webgym.collect(config, out, policy=Guesser())
    for trajectory in webgym.RunReader(out).trajectories():
        episode = trajectory.episode
        print(f"{trajectory.outcome:12} {len(episode.steps)} steps  {episode.task_id}: {episode.answer!r}")
    print(f"{summary['attempts']} attempts, {summary['steps_per_second']:.1f} steps/s")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        asyncio.run(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(scratch) / "run"))
