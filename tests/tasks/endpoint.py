"""An endpoint whose model goes by rule: what it says follows from the request alone. It also misbehaves.

It tells what it is asked for by the system message. What the first reply about a task looks like is decided
by a hash of the task: most are good, some broken, and a few tasks are never answered well. Some requests are
answered late, or with 429 the first time.
"""

from __future__ import annotations

import asyncio
import hashlib
import json
import re
from collections import Counter
from contextlib import AbstractAsyncContextManager

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from tests.serving import serving

from webgym.tasks.taxonomy import DOMAIN_OF

HOSTS = [f"https://www.inferred-{number}.org/" for number in range(40)]
_SUBDOMAINS = list(DOMAIN_OF)
_WORD = re.compile(r"[A-Za-zÀ-ÿ0-9]+")
_DULL = frozenset(
    """
    and or the a an of on in at to for with from by is are be it its that this which who what when where how
    find search click navigate scroll visit go use type enter press tap hover such as e.g eg each all any both
    give report provide state show list identify locate check return please me my i you your first either
    """.split()
)


def draw(*parts: object) -> int:
    """A number that follows from these."""
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:6], "big")


class Endpoint:
    """The endpoint: its address, and an account of what it was asked.

    Attributes:
        paid: how often each request was answered, by a hash of its body.
        misbehaves: whether it does.
        stubborn: whether a few tasks are never answered well.
        hold_after: answered requests after which it answers no more, until it is ``None``.
        holding: set once it holds.
        answering: requests that are being answered.
    """

    def __init__(self, port: int) -> None:
        self.port = port
        self.misbehaves = True
        self.stubborn = True
        self.hold_after: int | None = None
        self.holding = asyncio.Event()
        self.paid: Counter[str] = Counter()
        self.kinds: Counter[str] = Counter()
        self.status: int | None = None
        self.answering = 0
        self._busy: set[str] = set()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}/v1"

    async def answer(self, request: Request) -> Response:
        self.answering += 1
        try:
            return await self._answer(request)
        finally:
            self.answering -= 1

    async def _answer(self, request: Request) -> Response:
        body = await request.body()
        name = hashlib.sha256(body).hexdigest()
        if self.status is not None:
            return JSONResponse({"error": {"message": "so it goes"}}, self.status)
        if self.misbehaves and draw(name) % 10 == 0 and name not in self._busy:
            self._busy.add(name)
            return JSONResponse({"error": {"message": "slow down"}}, 429, headers={"Retry-After": "0"})
        if self.misbehaves and draw(name) % 10 == 1:
            await asyncio.sleep(0.02)
        if self.hold_after is not None and sum(self.paid.values()) >= self.hold_after:
            self.holding.set()
            while (await request.receive())["type"] != "http.disconnect":
                pass
            return Response()
        self.paid[name] += 1
        text, reason = self.reply(json.loads(body)["messages"])
        choice = {"index": 0, "finish_reason": reason, "message": {"role": "assistant", "content": text}}
        usage = {"prompt_tokens": len(body) // 4, "completion_tokens": len(text) // 4 + 1}
        return JSONResponse({"model": "by-rule", "choices": [choice], "usage": usage})

    def reply(self, messages: list[dict[str, str]]) -> tuple[str, str]:
        """What the model says, and why it stopped."""
        system, asked = messages[0]["content"], messages[1]["content"]
        tries = sum(message["role"] == "assistant" for message in messages)
        task = asked.split(":\n", 1)[1].split("\n\nWebsite:", 1)[0].split("\n\nNotes of", 1)[0]
        task = task.split("\n\nWebsite given:", 1)[0].split("\n\nAnswer with JSON", 1)[0]
        mood = draw(task, "mood") % 12 if self.misbehaves else 11
        bad = tries == 0 or (self.stubborn and draw(task, "stubborn") % 9 == 0)
        if system.startswith("You sort"):
            self.kinds["website"] += 1
            return self._website(task, mood if bad else 11), "stop"
        if system.startswith("You check"):
            self.kinds["critic"] += 1
            return self._criticised(asked, mood if bad else 11), "stop"
        if system.startswith("You write rubrics"):
            self.kinds["rubric"] += 1
            return self._rubric(task, mood if bad else 11)
        self.kinds["rewriting"] += 1
        facts = re.findall(r"^- (.*)$", asked.split("Facts that the new task asks for:\n")[1], re.MULTILINE)
        return self._rewritten(task, facts, mood if bad else 11)

    def _website(self, task: str, mood: int) -> str:
        if mood == 0:
            return "I would start with a search engine."
        subdomain = "Astrology" if mood == 1 else _SUBDOMAINS[draw(task, "domain") % len(_SUBDOMAINS)]
        website = "nowhere" if mood == 2 else HOSTS[draw(task, "host") % len(HOSTS)]
        return json.dumps({"website": website, "subdomain": subdomain})

    def _criticised(self, asked: str, mood: int) -> str:
        """What the critic says of a rubric or a text: of one in three, the first version is bad."""
        if mood == 0:
            return json.dumps({"ok": True, "problems": ["one"]})
        ok = draw(asked) % 3 > 0 or not self.misbehaves
        return json.dumps({"ok": ok, "problems": [] if ok else ["no good"]})

    def _rubric(self, task: str, mood: int) -> tuple[str, str]:
        words = list(dict.fromkeys(word for word in _WORD.findall(plain(task)) if word.lower() not in _DULL))
        count = min(1 + draw(task, "facts") % 9, max(1, len(words) // 2 - 1))
        size = max(1, min(3, len(words) // (count + 1)))
        facts = [" ".join(words[start : start + size]) for start in range(0, count * size, size)]
        large = 3 + draw(task, "group") % 2
        groups = [facts[:large], facts[large:]] if len(facts) > large else [facts]
        rubric = {
            "fact_groups": [
                {
                    "id": number,
                    "description": f"Part {number}",
                    "facts": [f"What is asked of {fact}" for fact in group],
                }
                for number, group in enumerate(groups, start=1)
            ],
            "difficulty": len(facts),
        }
        text = json.dumps(rubric, ensure_ascii=False)
        if mood == 0:
            return text[:-20], "stop"
        if mood == 1:
            return json.dumps(rubric | {"difficulty": len(facts) + 1}), "stop"
        if mood == 2:
            return json.dumps(rubric | {"fact_groups": [{"id": 1, "description": "x", "facts": []}]}), "stop"
        if mood == 3:
            return text[: len(text) // 2], "length"
        if mood == 4:
            return "I cannot help with that.", "stop"
        if mood == 5:
            return f"Here you are:\n{text}", "stop"
        if mood == 6:
            return "", "content_filter"
        if mood == 7:
            return f"```json\n{text}\n```", "stop"
        return text, "stop"

    def _rewritten(self, task: str, facts: list[str], mood: int) -> tuple[str, str]:
        text = f"On the website, take care of this: {'; '.join(fact[17:] for fact in facts)}."
        if mood == 0:
            return f"{text} Pay $4711.", "stop"
        if mood == 1:
            return f'"{text}"', "stop"
        if mood == 2:
            return task, "stop"
        if mood == 3:
            return text[:20], "length"
        if mood == 4:
            return f"# Task\n{text}", "stop"
        if mood == 5:
            return json.dumps({"task": text}), "stop"
        if mood == 6:
            return "", "stop"
        return text, "stop"


def plain(task: str) -> str:
    """A task without its examples, which must not become facts."""
    return re.split(r"\b(?:such as|for example|for instance|e\.\s?g\.?)", task, maxsplit=1)[0]


def serve() -> AbstractAsyncContextManager[Endpoint]:
    return serving(
        Endpoint,
        lambda endpoint: Starlette(routes=[Route("/v1/chat/completions", endpoint.answer, methods=["POST"])]),
    )
