"""The blocks of Python in README and docs run, a page after the other, each page's in one namespace.

What a block takes for given (a model, a trainer's tokenizer, tasks) is a stand-in, said below page by page. A
block that cannot run here has a line before it, ``<!-- not run: why; the test that has it -->``.
"""

from __future__ import annotations

import ast
import asyncio
import inspect
import re
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any, TypeAlias

import msgspec
import pytest
from tests.documented import PAGES, ROOT
from tests.integrations.engine import Engine, reply_text
from tests.llm.endpoint import serve

import webgym
from webgym.core.action import Answer
from webgym.testing import stand_in_environment, stand_in_pool

Names: TypeAlias = dict[str, Any]

ELSEWHERE = {
    "run-folder.md": "tests/rollout/test_foreign_readers.py",
    "task-files.md": "tests/tasks/test_task_readers.py",
}
"""Pages whose blocks run in a test of their own."""
PASTED = {"README.md", "tutorial.md"}
"""Pages whose first block is given no name: it can be pasted as it is."""
BLOCK = re.compile(r"(<!-- not run: .+? -->\n\n?)?^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)
SMALL = {"sites": {"collection": "small", "per_family": 3}, "server": {"static": True}}
"""A run without browsers."""


async def answers(*_: object) -> str:
    """A model that knows the answer without looking."""
    return reply_text(Answer("right"))


@asynccontextmanager
async def nothing(_: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    yield {}


@asynccontextmanager
async def readme(patch: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """The run is of two small tasks without browsers; the environment's browsers and judge are stand-ins."""
    given = webgym.RunConfig.model_validate({"tasks": {"count": 2}, **SMALL})
    patch.setattr("webgym.run.config.RunConfig", lambda: given)
    patch.setattr("webgym.env.environment.make", lambda *_, **__: stand_in_environment())
    yield {}


@asynccontextmanager
async def environment(patch: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """Browsers, judge, model and engine are stand-ins; an adapter that changes nothing."""
    from tests.inference.tiny import tiny_image_processor, tiny_renderer, tiny_tokenizer

    patch.setattr("webgym.env.environment.make", lambda *_, **__: stand_in_environment())
    real = webgym.EnvironmentPool

    def pool(*_: object, **given: Any) -> webgym.EnvironmentPool:
        return real(**(given if "browsers" in given else stand_in_pool(Path(), given.get("size", 1))))

    patch.setattr("webgym.env.pool.EnvironmentPool", pool)
    sampled, logprobs = Engine(tiny_renderer(), ["-"]).sample(await answers())
    made = SimpleNamespace(ids=sampled, logprobs=logprobs, version="1")

    async def generate(*_: object) -> Any:
        return made

    held: Names = {
        "webgym": webgym,
        "my_model": answers,
        "tokenizer": tiny_tokenizer(),
        "image_processor": tiny_image_processor(),
        "engine": SimpleNamespace(generate=generate),
        "task_id": "check-3",
        "MyAdapter": lambda env: env,
    }
    yield held
    assert [len(held["rollout"].rows), held["rollout"].reward, held["rollout"].dropped] == [1, 1.0, {}]
    held["envs"].close()


@asynccontextmanager
async def models(patch: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """The endpoint is a server of this test's."""
    from webgym.llm.client import ChatClient
    from webgym.llm.config import ChatConfig
    from webgym.llm.structured import ask_for

    async with serve() as served:
        served.text = '{"name": "Ada", "years": 36}'
        config = ChatConfig(base_url=served.url(), model="my-model")
        patch.setattr(
            "webgym.llm.config.ChatConfig", lambda **given: ChatConfig(**given | {"base_url": served.url()})
        )
        async with ChatClient(config) as client:
            yield {
                "msgspec": msgspec,
                "ask_for": ask_for,
                "messages": [{"role": "user", "content": "Who?"}],
                "client": client,
            }


@asynccontextmanager
async def tasks(_: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """Tasks of the small websites, and a source of one task."""
    held = list(webgym.OfflineWeb(1, per_family=3, collection="small").tasks())
    webgym.write_tasks(Path("tasks.jsonl"), held)
    Path("data/deepshop").mkdir(parents=True)
    Path("data/deepshop/tasks.jsonl").write_text(
        '{"id": 1, "ques": "Find a red kettle", "web": "https://www.amazon.com/"}\n'
    )
    yield {"path": Path("tasks.jsonl")}


@asynccontextmanager
async def small_websites(_: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """One of our families."""
    from webgym.offline.small import FAMILIES

    yield {"webgym": __import__("webgym.testing"), "MyFamily": FAMILIES[0]}


@asynccontextmanager
async def run(_: pytest.MonkeyPatch) -> AsyncIterator[Names]:
    """A run made of a few steps."""
    from tests.train.making import Made, trajectory

    from webgym.agent.openai_policy import request_of

    folder = Path("runs/iteration-0")
    await asyncio.to_thread(Made([trajectory(number) for number in range(3)]).write, folder)
    yield {"RunReader": webgym.RunReader, "run": folder, "request_of": request_of}


GIVEN: dict[str, Callable[[pytest.MonkeyPatch], AbstractAsyncContextManager[Names]]] = {
    "README.md": readme,
    "agent.md": run,
    "environment.md": environment,
    "models.md": models,
    "task-set.md": tasks,
    "tiny-policy.md": small_websites,
    "tutorial.md": readme,
}


def with_python() -> list[Any]:
    """Pages that have a block to run."""
    return [
        pytest.param(page, id=page.name)
        for page in PAGES
        if page.name not in ELSEWHERE and any(not told for told, _ in BLOCK.findall(page.read_text()))
    ]


@pytest.mark.browser
@pytest.mark.parametrize("page", with_python())
async def test_blocks_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = page.read_text()
    async with GIVEN.get(page.name, nothing)(monkeypatch) as names:
        given = names | {"__name__": page.stem}
        if page.name in PASTED:
            names.clear()
        else:
            names.update(given)
        for block in BLOCK.finditer(text):
            if block[1] is None:
                lines = "\n" * text.count("\n", 0, block.start(2))  # so that a traceback has the page's
                await execute(
                    compile(lines + block[2], str(page), "exec", ast.PyCF_ALLOW_TOP_LEVEL_AWAIT), names
                )
                names.update(given)  # what the block called the same is over


async def execute(code: Any, names: Names) -> None:
    """In this loop what awaits; in a thread, where no loop runs, what does not."""
    if code.co_flags & inspect.CO_COROUTINE:
        await eval(code, names)
    else:
        await asyncio.to_thread(exec, code, names)


def test_the_readme_begins_with_an_episode_in_ten_lines() -> None:
    code = next(block[2] for block in BLOCK.finditer((ROOT / "README.md").read_text()))
    assert code.startswith("import webgym\n")
    assert len(code.splitlines()) <= 10
    assert re.search(r"\.reset\(.*\.step\(.*print\(reward", code, re.DOTALL)


def used_by(test: Path) -> set[str]:
    """The names that a test imports or uses, itself or in an example that it plays."""
    text = test.read_text()
    examples = (ROOT / "examples").rglob("*.py")
    names = set[str]()
    for path in [test, *(each for each in examples if f'"{each.stem}"' in text)]:
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.alias(name=name) | ast.Attribute(attr=name) | ast.Name(id=name):
                    names.add(name)
    return names


def not_run() -> list[Any]:
    """Blocks that do not run, with what is said of them."""
    return [
        pytest.param(block[1], block[2], id=f"{page.name}:{text.count(chr(10), 0, block.start()) + 1}")
        for page in PAGES
        for text in [page.read_text()]
        for block in BLOCK.finditer(text)
        if block[1]
    ]


@pytest.mark.parametrize(("told", "code"), not_run())
def test_a_block_that_does_not_run_names_a_test_that_uses_its_names(told: str, code: str) -> None:
    [name] = re.findall(r"tests/[\w/]+\.py", told)
    ours = {
        each.name
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "webgym"
        for each in node.names
    }
    assert ours - used_by(ROOT / name) == set()
