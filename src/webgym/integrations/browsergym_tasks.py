"""WebGym's tasks as BrowserGym's (tested with browsergym-core 0.14.3)::

    from webgym.integrations.browsergym_tasks import register_tasks

    names = register_tasks("small", split="test")
    env = gymnasium.make(names[0])  # browsergym/webgym.small.…

Browser, actions and observations are BrowserGym's; the offline websites and the judge are WebGym's. A message
to the user is the answer and ends the episode, and so does a budget that is spent. The reward comes then: 1.0
or 0.0. An episode without one (the website blocked the agent, or websites or judge failed) raises
:class:`NoReward`.
"""

from __future__ import annotations

import asyncio
import atexit
import hashlib
import os
import re
import secrets
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, Literal
from urllib.parse import urlsplit

import httpx
import msgspec
from browsergym.core.registration import register_task
from browsergym.core.task import AbstractBrowserTask

from webgym import Episode, OfflineJudge, OfflineWeb, RunConfig, Task, WebGymError

Collection = Literal["large", "small"]

_VISITOR: Final = "webgym_visitor"
_SECONDS: Final = 60.0
"""How long a website may take to answer."""

# What can be read in the viewport: the judge's evidence.
_TEXT: Final = """() => {
    const seen = [];
    const shown = (box) => box.width > 0 && box.height > 0 && box.bottom > 0 && box.right > 0
        && box.top < innerHeight && box.left < innerWidth;
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const node = walker.currentNode, parent = node.parentElement, range = document.createRange();
        range.selectNodeContents(node);
        if (node.data.trim() && parent.checkVisibility({visibilityProperty: true})
            && [...range.getClientRects()].some(shown)) seen.push(node.data.trim());
    }
    for (const field of document.querySelectorAll("input:not([type=hidden]), textarea"))
        if (field.value && shown(field.getBoundingClientRect())) seen.push(field.value);
    return seen.join("\\n");
}"""


class NoReward(WebGymError):
    """The website blocked the agent, or websites or judge failed: no success, and no failure."""

    code = "no_reward"


class _Sites:
    """The offline web in a process of its own, until this one ends."""

    def __init__(self, collection: Collection, per_family: int | None) -> None:
        self.token = secrets.token_hex(16)
        command = [
            sys.executable,
            "-m",
            "webgym",
            "sites",
            "serve",
            "--port",
            "0",
            "--collection",
            collection,
        ]
        command += ["--per-family", str(per_family)] if per_family else []
        environment = os.environ | {"WEBGYM_SITES_TOKEN": self.token}
        self._process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        atexit.register(self.stop)
        assert self._process.stdout is not None
        first = self._process.stdout.readline().split()
        if not first:
            raise NoReward("the offline web did not start")
        self.http = httpx.Client(base_url=f"http://{first[-1]}", timeout=_SECONDS, trust_env=False)

    def stop(self) -> None:
        """Safe to call twice."""
        self._process.terminate()
        self._process.wait()

    def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """What a website's server holds for a visitor."""
        headers = {"authorization": f"Bearer {self.token}"}
        answered = self.http.get(f"/visitors/{visitor}/{host}", headers=headers)
        if answered.status_code == httpx.codes.NOT_FOUND:
            return None
        found: dict[str, Any] = answered.raise_for_status().json()
        return found


_sites: dict[tuple[Collection, int | None], _Sites] = {}
"""Of this process: BrowserGym makes a task for every episode."""


class WebGymTask(AbstractBrowserTask):
    """A task of the offline web.

    Args:
        seed: of BrowserGym; a task is the same for all.
        task: of WebGym.
        collection: of its website.
        per_family: websites of a family, as the task was made with.
    """

    def __init__(
        self, seed: int, task: Task, collection: Collection = "large", per_family: int | None = None
    ) -> None:
        super().__init__(seed)
        self.task = task
        size = OfflineWeb(per_family=1, collection=collection).collection.viewport
        self.viewport, self.slow_mo = {"width": size[0], "height": size[1]}, 0
        attempt = RunConfig().attempt
        self.budget: int = getattr(attempt, f"budget_{task.level}")
        self._key = (collection, per_family)
        self._visitor = secrets.token_hex(8)
        self._statuses: dict[str, int] = {}
        self._fault = ""
        self._seen: list[dict[str, Any]] = []

    def setup(self, page: Any) -> tuple[str, dict[str, Any]]:
        """Open the start page.

        Args:
            page: of Playwright.

        Returns:
            The instruction, and the task's id.

        Raises:
            NoReward: the offline web does not serve it.
        """
        if self._key not in _sites:
            _sites[self._key] = _Sites(*self._key)
        page.context.route("**/*", self._serve)
        page.goto(self.task.website)
        self._look(page)
        return self.task.instruction, {"task_id": self.task.id}

    def validate(self, page: Any, chat_messages: list[Any]) -> tuple[float, bool, str, dict[str, Any]]:
        """Look at the page, and judge at the end.

        Args:
            page: of Playwright.
            chat_messages: of BrowserGym; what the assistant says after the instruction is the answer.

        Returns:
            Reward, whether the episode is over, no message, and at the end the verdict's criteria.

        Raises:
            NoReward: there is none.
        """
        roles = [each["role"] for each in chat_messages]
        said = chat_messages[roles.index("user") :] if "user" in roles else []
        answers = [each["message"] for each in said if each["role"] == "assistant"]
        if not answers:
            self._look(page)
            if len(self._seen) <= self.budget:
                return 0.0, False, "", {}
        return self._judged(answers[0] if answers else None)

    def teardown(self) -> None:
        """Nothing to do: the websites stay for the next episode."""

    def _serve(self, route: Any, request: Any) -> None:
        parts = urlsplit(request.url)
        host = parts.hostname or ""
        if not host.endswith(".webgym.test"):
            route.abort()  # nothing else is there
            return
        headers = {"host": host, "cookie": f"{_VISITOR}={self._visitor}"}
        if kind := request.headers.get("content-type"):
            headers["content-type"] = kind
        target = f"{parts.path}?{parts.query}" if parts.query else parts.path
        try:
            answered = _sites[self._key].http.request(
                request.method, target, headers=headers, content=request.post_data_buffer
            )
        except httpx.HTTPError as error:
            self._fault = f"the offline web does not answer: {type(error).__name__}"
            route.abort()
            return
        if request.is_navigation_request():
            self._statuses[request.url] = answered.status_code
        route.fulfill(status=answered.status_code, headers=dict(answered.headers), body=answered.content)

    def _look(self, page: Any) -> None:
        if self._fault:
            raise NoReward(self._fault)
        text = page.evaluate(_TEXT)
        self._seen.append(
            {
                "screenshot": hashlib.sha256(f"{page.url}\n{text}".encode()).hexdigest(),
                "url": page.url,
                "title": page.title(),
                "viewport": (self.viewport["width"], self.viewport["height"]),
                "status": self._statuses.get(page.url),
                "text": text,
            }
        )

    def _judged(self, answer: str | None) -> tuple[float, bool, str, dict[str, Any]]:
        if self._fault:
            raise NoReward(self._fault)
        assert self.task.truth is not None
        *before, last = self._seen
        shown = self._seen if answer is not None else before
        try:
            state = _sites[self._key].state(self._visitor, self.task.truth.host)
        except httpx.HTTPError as error:
            raise NoReward(f"the offline web does not say its state: {type(error).__name__}") from error
        told = {
            "attempt_id": f"{self.task.id}#0.0",
            "task_id": self.task.id,
            "sample": 0,
            "retry": 0,
            "seed": 0,
            "policy": "browsergym",
            "started_at": 0.0,
            "seconds": 0.0,
            "steps": [
                {"index": index, "observation": seen, "messages": [], "reply": {"text": "", "policy": ""}}
                for index, seen in enumerate(shown)
            ],
            "ending": "budget_spent" if answer is None else "answered",
            "final": last if answer is None else None,
            "answer": answer,
            "final_state": state,
        }
        episode = msgspec.convert(told, Episode)
        try:  # Playwright has an event loop in this thread
            with ThreadPoolExecutor(1) as pool:
                verdict = pool.submit(
                    asyncio.run, OfflineJudge().judge(self.task, episode, _no_picture)
                ).result()
        except WebGymError as error:
            raise NoReward(f"the judge gives no verdict: {error.message}") from error
        if verdict.reward is None:
            raise NoReward("the website kept the agent out")
        return float(verdict.reward), True, "", {"verdict": msgspec.to_builtins(verdict)}


async def _no_picture(name: str) -> bytes:
    raise LookupError(f"the picture {name} is not at hand")


def env_name(task_id: str) -> str:
    """What a task is called in BrowserGym.

    Args:
        task_id: of WebGym.

    Returns:
        ``webgym.`` and the id, with a dot for each slash and an underscore for what Gymnasium forbids.
    """
    return "webgym." + re.sub(r"[^\w.-]", "_", task_id.replace("/", "."))


def register_tasks(
    collection: Collection = "large",
    *,
    split: Literal["train", "test"] = "test",
    count: int | None = None,
    per_family: int | None = None,
) -> list[str]:
    """Make tasks of the offline web known to Gymnasium.

    Args:
        collection: ``large``, of ``offline-v1``, or ``small``, of ``offline-small-v1``.
        split: of the tasks.
        count: the first so many; by default all.
        per_family: websites of a family; by default all of the collection's.

    Returns:
        Their ids: ``browsergym/`` and the name.
    """
    names: list[str] = []
    for task in OfflineWeb(per_family=per_family, collection=collection).tasks(split):
        if len(names) == count:
            break
        name = env_name(task.id)
        given = {"task": task, "collection": collection, "per_family": per_family}
        register_task(name, WebGymTask, task_kwargs=given)
        names.append(f"browsergym/{name}")
    return names
