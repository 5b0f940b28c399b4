"""The collector of a campaign, in a process of its own: ``python -m benchmarks.faults.collector RUN``.

RUN is the run folder; ``config.json`` beside it holds the run's settings. While a file ``policy`` or
``judge`` lies beside it, that endpoint does not answer.
"""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.agent.scripted import ScriptedPolicy, ScriptedSession
from webgym.core.errors import JudgeError, PolicyUnreachable
from webgym.core.task import Task
from webgym.core.trajectory import Episode, Reply
from webgym.core.verdict import Verdict
from webgym.judge.base import Pictures
from webgym.judge.offline import OfflineJudge
from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig, Secrets
from webgym.store.files import CONFIG

FOLDER = "WEBGYM_FAULTS"
"""Variable that names the folder of the run's settings."""
WRONG_SHARE = 0.5


def _is_away(endpoint: str) -> bool:
    return (Path(os.environ[FOLDER]) / endpoint).exists()


class CoinPolicy(BasePolicy):
    """Solves every task, and gives a wrong answer to half of them: a coin per task and sample, which is the
    same in every retry and in every run of the same seed."""

    name = "coin"
    wants_elements = True

    def __init__(self) -> None:
        self._policy = ScriptedPolicy(WRONG_SHARE, mistakes=("wrong_answer",))

    def begin(self, task: Task, seed: int) -> _Session:
        """A session that is right or wrong by its coin."""
        return _Session(self._policy.begin(task, seed))


class _Session:
    def __init__(self, session: ScriptedSession) -> None:
        self._session = session

    async def reply(self, turn: PolicyInput) -> Reply:
        if _is_away("policy"):
            raise PolicyUnreachable("the campaign took the policy's endpoint away")
        return await self._session.reply(turn)


async def judge(task: Task, episode: Episode, pictures: Pictures) -> Verdict:
    """The judge of the offline web, unless its endpoint is away."""
    if _is_away("judge"):
        raise JudgeError("the campaign took the judge's endpoint away")
    return await OfflineJudge().judge(task, episode, pictures)


async def _main(run: Path) -> None:
    policy, secrets = CoinPolicy(), Secrets()
    if (run / CONFIG).is_file():
        await resume(run, policy=policy, secrets=secrets)
    else:
        config = RunConfig.model_validate_json((run.parent / "config.json").read_bytes())
        await collect(config, run, policy=policy, secrets=secrets)


if __name__ == "__main__":
    asyncio.run(_main(Path(sys.argv[1])))
