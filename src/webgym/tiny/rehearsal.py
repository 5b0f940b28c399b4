"""Attempts at small websites without browser slots: the real agent and the real pages, at ten times the pace.

A page without scripts needs a browser only to be drawn, and each page needs to be drawn only once. What a
policy is asked, what it sees and what it does are the same as in a run with browsers; only what a browser
adds is missing: time, failures, everything that a page could do by itself.
"""

from __future__ import annotations

from urllib.parse import urlsplit

import msgspec

from webgym.agent.agent import Agent
from webgym.core.action import Answer
from webgym.core.observation import Observation
from webgym.core.outcome import Ending
from webgym.core.task import StepBudget, Task
from webgym.core.trajectory import Episode, Step
from webgym.offline.static_browser import StaticBrowser, read_page
from webgym.offline.web import OfflineWeb
from webgym.rehearsal import Drawings
from webgym.tiny.lessons import Signs, signs_of


class Stage:
    """Where attempts are rehearsed.

    Args:
        web: the websites.
        drawings: of their pages; ``None`` where the policy looks at elements alone.
        budget: steps per attempt.

    Attributes:
        signs: what every picture shows that was looked at.
    """

    def __init__(self, web: OfflineWeb, drawings: Drawings | None, budget: StepBudget) -> None:
        self._web = web
        self._drawings = drawings
        self._budget = budget
        self.signs: dict[str, Signs] = {}

    async def rehearse(self, agent: Agent, task: Task, seed: int, *, sample: int = 0) -> Episode:
        """An attempt, as a collector would have recorded it.

        Args:
            agent: decides.
            task: of the websites.
            seed: of the policy's play.
            sample: which attempt at this task it is.

        Raises:
            PolicyError: the policy gave no reply.
        """
        site = self._web.website(urlsplit(task.website).hostname or "")
        assert site is not None, task.website
        browser = StaticBrowser(site, self._web.collection.viewport)
        conversation = agent.begin(task, seed, self._budget.for_task(task))
        steps, answer = list[Step](), None
        seen, image = await self._look(browser)
        for _ in range(self._budget.for_task(task)):
            step = await conversation.turn(seen, image, 0.0)
            steps.append(step)
            if isinstance(step.action, Answer):
                answer = step.action.text
                break
            if step.action is not None:
                browser.act(step.action)
            seen, image = await self._look(browser)
            changed = seen.screenshot != step.observation.screenshot
            steps[-1] = msgspec.structs.replace(step, changed=changed)
        return Episode(
            attempt_id=f"{task.id}#{sample}.0",
            task_id=task.id,
            sample=sample,
            retry=0,
            seed=seed,
            policy=agent.policy.name,
            started_at=0.0,
            seconds=0.0,
            steps=tuple(steps),
            ending=Ending.BUDGET_SPENT if answer is None else Ending.ANSWERED,
            final=seen if answer is None else None,
            answer=answer,
            final_state=site.report(browser.state),
        )

    async def _look(self, browser: StaticBrowser) -> tuple[Observation, bytes]:
        seen = browser.observe()
        if self._drawings is None:
            return seen, b""
        name, png = await self._drawings.of(browser.body)
        if name not in self.signs:
            shown = read_page(browser.body).signs
            self.signs[name] = signs_of(name, shown, seen.viewport)
        return msgspec.structs.replace(seen, screenshot=name), png
