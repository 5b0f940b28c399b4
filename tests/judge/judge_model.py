"""A judge model for tests behind a real HTTP endpoint: a function that sees a request as a model would."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from tests.llm.endpoint import Endpoint, serve

from webgym.judge.config import JudgeConfig
from webgym.llm.config import ChatConfig, Retry

_QUOTED = re.compile(r"^<<(\w+) ([0-9a-f]+)>>\n(.*?)\n<<end of \1 \2>>$", re.DOTALL | re.MULTILINE)
_STAGES = {
    "facts": "keypoint",
    "fact": "fact",
    "reference": "reference",
    "pages": "blocking",
    "answer": "response",
}


@dataclass(frozen=True)
class Asked:
    """A request to the judge model.

    Attributes:
        stage: which question it is.
        code: of the request.
        quotes: the quoted texts by label, without their bars.
        shots: ``(label, name)`` of the screenshots.
        body: all of it.
    """

    stage: str
    code: str
    quotes: dict[str, str]
    shots: list[tuple[str, str]]
    body: dict[str, Any]

    @property
    def system(self) -> str:
        return str(self.body["messages"][0]["content"])

    @property
    def said_before(self) -> list[str]:
        """Refused replies to this question."""
        return [message["content"] for message in self.body["messages"] if message["role"] == "assistant"]

    def verdict(self, passed: bool, reason: str = "As the screenshots show.") -> str:
        yes, no = ("SUCCESS", "NOT SUCCESS") if self.stage in ("fact", "response") else ("YES", "NO")
        return f"{reason}\nVERDICT {self.code}: {yes if passed else no}"

    def each(self, kept: Callable[[str], bool]) -> str:
        lines = [
            f"SCREENSHOT {number} {self.code}: {'YES' if kept(name) else 'NO'}"
            for number, (_, name) in enumerate(self.shots, 1)
        ]
        return "\n".join(["Looked at all.", *lines])


def read_request(body: dict[str, Any]) -> Asked:
    content = body["messages"][1]["content"]
    parts = [{"type": "text", "text": content}] if isinstance(content, str) else content
    quotes, codes = {}, set()
    for label, code, text in _QUOTED.findall(parts[0]["text"]):
        codes.add(code)
        assert all(line.startswith("| ") for line in text.split("\n"))
        quotes[label] = "\n".join(line[2:] for line in text.split("\n"))
    shots = []
    for label, picture in zip(parts[1::2], parts[2::2], strict=True):
        data = base64.b64decode(picture["image_url"]["url"].split(",")[1])
        shots.append((label["text"].rstrip(":"), hashlib.sha256(data).hexdigest()))
    stage = next((stage for label, stage in _STAGES.items() if label in quotes), "keypoint")
    (code,) = codes
    return Asked(stage, code, quotes, shots, body)


Answers = Callable[[Asked], str | dict[str, Any]]


class JudgeModel:
    """The endpoint, and every request that it answered."""

    def __init__(self, endpoint: Endpoint, answers: Answers) -> None:
        self.url = endpoint.url("judge")
        self.answers = answers
        self.asked: list[Asked] = []
        self._endpoint = endpoint

    def config(self, **changes: Any) -> JudgeConfig:
        chat = ChatConfig(base_url=self.url, model="judge-1", retry=Retry(tries=1))
        return JudgeConfig(**{"chat": chat} | changes)

    def of(self, stage: str) -> list[Asked]:
        return [asked for asked in self.asked if asked.stage == stage]

    async def answer(self, request: Request) -> Response:
        asked = read_request(await request.json())
        self.asked.append(asked)
        said = self.answers(asked)
        choice = said if isinstance(said, dict) else {"message": {"role": "assistant", "content": said}}
        return JSONResponse(self._endpoint.completion(**choice))


@asynccontextmanager
async def serve_judge(answers: Answers) -> AsyncIterator[JudgeModel]:
    async with serve() as endpoint:
        model = JudgeModel(endpoint, answers)
        endpoint.do_judge = model.answer  # type: ignore[attr-defined]
        yield model
