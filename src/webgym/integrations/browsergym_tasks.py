"""WebGym's tasks as BrowserGym's (tested with browsergym-core 0.14.3)::

    from webgym.integrations.browsergym_tasks import register_tasks

    names = register_tasks("small", split="test")
    env = gymnasium.make(names[0])  # browsergym/webgym.small.…

Browser, actions and observations are BrowserGym's; the offline websites and the judge are WebGym's. A message
to the user is the answer and ends the episode, as does an exhausted step budget. The reward is then 1.0 or
0.0. An episode without a reward (the website blocked the agent, or websites or judge failed) raises
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
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial
from http import HTTPStatus
from http.client import HTTPConnection, HTTPException
from typing import Any, Final, Literal
from urllib.parse import urlsplit

import msgspec
from browsergym.core.registration import register_task
from browsergym.core.task import AbstractBrowserTask
from gymnasium.envs.registration import WrapperSpec
from playwright.sync_api import Error

from webgym import Episode, OfflineJudge, OfflineWeb, RunConfig, Task, WebGymError
from webgym.integrations.shared import NoReward

Collection = Literal["large", "small"]

_VISITOR: Final = "webgym_visitor"
_TIMEOUT_SECONDS: Final = 60.0
"""Longest time for a website's response, seconds."""
_STOP_SECONDS: Final = 10
"""How long the offline web may take to end."""
_READ_ATTEMPTS: Final = 10
_CLICK: Final = {"name": "left_click", "target": {"coordinate": (0, 0)}}
"""Stands for what requested a page other than ``page.goto``: BrowserGym does not tell."""
_CLOSED_WHEN_DROPPED: Final = WrapperSpec(
    "ClosedWhenDropped", "webgym.integrations.browsergym:ClosedWhenDropped", {}
)

# The text visible in the viewport, which is the judge's evidence, and the page that it belongs to. They are
# read at once: the next page may come at any time. What fields hold is left out: the agent may have typed it.
_VIEW: Final = """() => {
    const seen = [];
    const shown = (box) => box.width > 0 && box.height > 0 && box.bottom > 0 && box.right > 0
        && box.top < innerHeight && box.left < innerWidth;
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const node = walker.currentNode, parent = node.parentElement, range = document.createRange();
        range.selectNodeContents(node);
        if (node.data.trim() && !parent.isContentEditable
            && parent.checkVisibility({visibilityProperty: true, opacityProperty: true})
            && [...range.getClientRects()].some(shown)) seen.push(node.data.trim());
    }
    return {text: seen.join("\\n"), title: document.title, url: location.href};
}"""


class _Sites:
    """The offline web, served by a child process until this process ends."""

    def __init__(self, collection: Collection, per_family: int | None) -> None:
        self.token = secrets.token_hex(16)
        program = [
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
        command = [sys.executable, "-m", "webgym.core.child", str(_STOP_SECONDS), *program]
        command += ["--per-family", str(per_family)] if per_family else []
        environment = os.environ | {"WEBGYM_SITES_TOKEN": self.token}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        atexit.register(self.stop)
        assert self._process.stdout is not None
        first = self._process.stdout.readline().split()
        if not first:
            raise NoReward("the offline web did not start")
        self._address = first[-1]

    def stop(self) -> None:
        """Stop the child process. May be called twice."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()

    def ask(
        self, method: str, target: str, headers: Mapping[str, str], body: bytes | None = None
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of a website's response.

        Raises:
            OSError, HTTPException: there is none.
        """
        with closing(HTTPConnection(self._address, timeout=_TIMEOUT_SECONDS)) as connection:
            connection.request(method, target, body, dict(headers))
            response = connection.getresponse()
            found = {name: ", ".join(response.headers.get_all(name, ())) for name in response.headers}
            return response.status, found, response.read()

    def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a website for a visitor; ``None`` if there is none."""
        headers = {"authorization": f"Bearer {self.token}"}
        status, _, body = self.ask("GET", f"/visitors/{visitor}/{host}", headers)
        if status == HTTPStatus.NOT_FOUND:
            return None
        if status != HTTPStatus.OK:
            raise HTTPException(status)
        state_of_visitor: dict[str, Any] = msgspec.json.decode(body)
        return state_of_visitor


_sites: dict[tuple[Collection, int | None], _Sites] = {}
"""The servers of this process, shared because BrowserGym creates a task object for every episode."""


class WebGymTask(AbstractBrowserTask):
    """A task of the offline web.

    Args:
        seed: BrowserGym's seed, which has no influence.
        task: the task of WebGym.
        collection: collection of its website.
        per_family: number of websites per family with which the task was made.
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
        self._observations: list[dict[str, Any]] = []
        self._opening = ""
        self._request: dict[str, Any] | None = None
        self._requests: list[dict[str, Any] | None] = []  # what each observation followed

    def setup(self, page: Any) -> tuple[str, dict[str, Any]]:
        """Open the start page.

        Args:
            page: the Playwright page.

        Returns:
            The instruction, and a dict with the task's id.

        Raises:
            NoReward: the offline web cannot be started, or does not serve the page.
        """
        if self._key not in _sites:
            _sites[self._key] = _Sites(*self._key)
        page.context.route("**/*", self._serve)
        page.context.on("page", self._watch)
        self._watch(page)
        page.goto(self.task.website)
        self._record(page)
        return self.task.instruction, {"task_id": self.task.id}

    def validate(self, page: Any, chat_messages: list[Any]) -> tuple[float, bool, str, dict[str, Any]]:
        """Record the page, and judge the episode at its end.

        Args:
            page: the Playwright page.
            chat_messages: BrowserGym's chat; the assistant's first message after the instruction is the
                answer.

        Returns:
            The reward, whether the episode is over, an empty message, and at the end a dict with the verdict.

        Raises:
            NoReward: the episode has no reward.
        """
        roles = [message["role"] for message in chat_messages]
        after_task = chat_messages[roles.index("user") :] if "user" in roles else []
        answers = [message["message"] for message in after_task if message["role"] == "assistant"]
        if not answers:
            self._record(page)
            if len(self._observations) <= self.budget:
                return 0.0, False, "", {}
        return self._judge(answers[0] if answers else None)

    def teardown(self) -> None:
        """Does nothing: the websites are kept for the next episode."""

    def _watch(self, page: Any) -> None:
        page.on("crash", self._close_crashed)
        page.goto = partial(self._goto, page.goto)  # a request looks the same when the page itself reloads

    def _goto(self, goto: Callable[..., Any], url: str, **options: Any) -> Any:
        self._opening = url
        try:
            return goto(url, **options)
        finally:
            self._opening = ""

    def _close_crashed(self, page: Any) -> None:
        self._fault = "the page crashed"
        page.close()  # calls that wait for it never end otherwise; BrowserGym goes on with an empty page

    def _serve(self, route: Any, request: Any) -> None:
        parts = urlsplit(request.url)
        host = parts.hostname or ""
        if not host.endswith(".webgym.test"):
            route.abort()  # only the offline web is reachable
            return
        headers = {"host": host, "cookie": f"{_VISITOR}={self._visitor}"}
        if kind := request.headers.get("content-type"):
            headers["content-type"] = kind
        target = f"{parts.path}?{parts.query}" if parts.query else parts.path
        try:
            status, found, body = _sites[self._key].ask(
                request.method, target, headers, request.post_data_buffer
            )
        except (OSError, HTTPException) as error:
            self._fault = f"the offline web does not respond: {type(error).__name__}"
            route.abort()
            return
        if status >= HTTPStatus.INTERNAL_SERVER_ERROR:  # the offline web has none by itself
            self._fault = f"{request.url}: HTTP status {status}"
        if request.is_navigation_request() and _is_of_main_frame(request):
            self._statuses[request.url] = status
            if self._opening:
                self._request = {"name": "navigate", "url": self._opening}
            elif self._request is None:
                self._request = _CLICK
        route.fulfill(status=status, headers=found, body=body)

    def _record(self, page: Any) -> None:
        if self._fault:
            raise NoReward(self._fault)
        try:
            view = _view(page)
        except Error as error:
            raise NoReward(self._fault or f"the page cannot be read: {error.message}") from error
        self._observations.append(
            {
                "screenshot": hashlib.sha256(f"{view['url']}\n{view['text']}".encode()).hexdigest(),
                "viewport": (self.viewport["width"], self.viewport["height"]),
                "status": self._statuses.get(view["url"]),
                **view,
            }
        )
        self._requests.append(self._request)
        self._request = None

    def _judge(self, answer: str | None) -> tuple[float, bool, str, dict[str, Any]]:
        if self._fault:
            raise NoReward(self._fault)
        assert self.task.truth is not None
        *before, last = self._observations
        observations = self._observations if answer is not None else before
        try:
            state = _sites[self._key].state(self._visitor, self.task.truth.host)
        except (OSError, HTTPException) as error:
            raise NoReward(f"the state of the offline web cannot be read: {type(error).__name__}") from error
        record = {
            "attempt_id": f"{self.task.id}#0.0",
            "task_id": self.task.id,
            "sample": 0,
            "retry": 0,
            "seed": 0,
            "policy": "browsergym",
            "started_at": 0.0,
            "seconds": 0.0,
            "steps": [
                {
                    "index": index,
                    "observation": observation,
                    "messages": [],
                    "reply": {"text": "", "policy": ""},
                    "action": action,
                }
                for index, (observation, action) in enumerate(
                    zip(observations, [*self._requests[1:], None], strict=False)
                )
            ],
            "ending": "budget_spent" if answer is None else "answered",
            "final": last if answer is None else None,
            "answer": answer,
            "final_state": state,
        }
        episode = msgspec.convert(record, Episode)
        try:  # Playwright has an event loop in this thread
            with ThreadPoolExecutor(1) as pool:
                verdict = pool.submit(
                    asyncio.run, OfflineJudge().judge(self.task, episode, _no_picture)
                ).result()
        except WebGymError as error:
            raise NoReward(f"the judge gives no verdict: {error.message}") from error
        if verdict.reward is None:
            raise NoReward("the website blocked the agent")
        return float(verdict.reward), True, "", {"verdict": msgspec.to_builtins(verdict)}


async def _no_picture(name: str) -> bytes:
    raise LookupError(f"the screenshot {name} is not available")


def _is_of_main_frame(request: Any) -> bool:
    try:
        return request.frame.parent_frame is None
    except Error:  # the first request of a new tab has no frame yet
        return True


def env_name(task_id: str) -> str:
    """The name of a task in BrowserGym.

    Args:
        task_id: id of the task in WebGym.

    Returns:
        ``webgym.`` and the id, with slashes replaced by dots and characters that Gymnasium forbids by
        underscores.
    """
    return "webgym." + re.sub(r"[^\w.-]", "_", task_id.replace("/", "."))


def register_tasks(
    collection: Collection = "large",
    *,
    split: Literal["train", "test"] = "train",
    count: int | None = None,
    per_family: int | None = None,
) -> list[str]:
    """Register tasks of the offline web with Gymnasium.

    Args:
        collection: ``large``, of ``offline-v2``, or ``small``, of ``offline-small-v2``.
        split: of the tasks.
        count: number of tasks to register, from the first on; ``None`` for all.
        per_family: number of websites per family; ``None`` for all of the collection.

    Returns:
        The ids of the environments: ``browsergym/`` and the name.
    """
    names: list[str] = []
    for task in OfflineWeb(per_family=per_family, collection=collection).tasks(split):
        if len(names) == count:
            break
        name = env_name(task.id)
        given = {"task": task, "collection": collection, "per_family": per_family}
        register_task(name, WebGymTask, task_kwargs=given, additional_wrappers=(_CLOSED_WHEN_DROPPED,))
        names.append(f"browsergym/{name}")
    return names


def _view(page: Any) -> dict[str, str]:
    """Text, title and address of the page that is shown.

    Raises:
        NoReward: it navigates whenever it is read.
    """
    for _ in range(_READ_ATTEMPTS):
        page.wait_for_load_state()
        try:
            view: dict[str, str] = page.evaluate(_VIEW)
            return view
        except Error as error:  # the click's page came while this one was read
            if "context was destroyed" not in str(error):
                raise
    raise NoReward("the page never stopped navigating")
