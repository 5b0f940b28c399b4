"""Blocks in README and docs: names exist, commands are taken. ``test_docs_run.py`` runs the Python."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml
from docs import reference
from tests.documented import PAGES, ROOT, SHELL, blocks_of, calls

import webgym
from webgym import cli
from webgym.cli import serve
from webgym.core import errors
from webgym.core.settings import field_docstring, load_settings
from webgym.judge.config import JudgeChoice
from webgym.llm.prices import Prices
from webgym.simulate.sizing import read_questions
from webgym.tasks.formats import read_tasks
from webgym.taskset.construction.config import read_config
from webgym.train.start import load_train_config


def blocks(*kinds: str) -> list[Any]:
    """The blocks of these languages, named by page and line."""
    return [
        pytest.param(code, id=f"{page.name}:{line}")
        for page in PAGES
        for line, code in blocks_of(page, *kinds)
    ]


@cache
def names_in(module: str) -> frozenset[str]:
    """What a module of ours holds at its top, without importing it; empty if there is none."""
    path = ROOT / "src" / Path(*module.split("."))
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if not file.is_file():
        return frozenset()
    names = {each.stem for each in path.glob("*")}
    for node in ast.parse(file.read_text()).body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            names.add(node.name)
        elif isinstance(node, ast.Import | ast.ImportFrom):
            names |= {each.asname or each.name for each in node.names}
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names |= {each.id for each in targets if isinstance(each, ast.Name)}
    return frozenset(names | set(webgym.__all__ if module == "webgym" else ()))


def foreign(code: str) -> Iterator[str]:
    """What a block of Python names and we have not."""
    tree = compile(code, "block", "exec", ast.PyCF_ONLY_AST | ast.PyCF_ALLOW_TOP_LEVEL_AWAIT)
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module)) if module.split(".")[0] == "webgym":
                held = names_in(module)
                yield from (f"{module}.{each.name}" for each in node.names if each.name not in held)
            case ast.Import():
                ours = [each.name for each in node.names if each.name.split(".")[0] == "webgym"]
                yield from (name for name in ours if not names_in(name))
            case ast.Attribute(value=ast.Name(id="webgym")) if node.attr not in names_in("webgym"):
                yield f"webgym.{node.attr}"


@pytest.mark.parametrize("code", blocks("python"))
def test_python(code: str) -> None:
    assert list(foreign(code)) == []


def agent_loops(file: Path) -> None:
    entries = yaml.safe_load(file.read_text())
    assert entries
    for entry in entries:
        agent_loop(entry)


def agent_loop(entry: dict[str, Any]) -> None:
    module, _, name = entry["_target_"].rpartition(".")
    assert name in names_in(module)
    source = ROOT / "src" / Path(*module.split(".")).with_suffix(".py")
    loops: list[Any] = ast.parse(source.read_text()).body
    [loop] = [each for each in loops if getattr(each, "name", "") == name]
    [init] = [each for each in loop.body if getattr(each, "name", "") == "__init__"]
    taken = {each.arg for each in [*init.args.args, *init.args.kwonlyargs]}
    assert entry.keys() - {"name", "_target_"} <= taken


def scraped(file: Path) -> None:
    """Prometheus asks our port."""
    [job] = yaml.safe_load(file.read_text())["scrape_configs"]
    assert job["static_configs"] == [{"targets": [f"gateway:{serve._PORT}"]}]


def training(file: Path) -> None:
    """With what a file of its own leaves to the one before it."""
    before = file.with_name("before.yaml")
    before.write_text("learn: {model: m}\n")
    load_train_config([before, file])


READERS: dict[str, list[Callable[[Path], object]]] = {
    "integrations.md": [agent_loops],
    "live-web.md": [lambda file: load_settings(webgym.RunConfig, [file], hint="")] * 2,
    "judge.md": [lambda file: load_settings(JudgeChoice, [file], hint="")],
    "models.md": [Prices.read],
    "scaling.md": [scraped],
    "settings.md": [lambda file: load_settings(webgym.RunConfig, [file], hint="")],
    "simulate.md": [lambda file: read_questions([file])],
    "task-files.md": [read_tasks],
    "task-set.md": [lambda file: read_config(file, {"sources": {"deepshop": "a.jsonl"}})],
    "training.md": [training] * 5,
}
"""What reads a page's blocks of YAML and JSON, in their order."""


def settings_blocks() -> list[Any]:
    return [
        pytest.param(code, READERS[page.name][number], id=f"{page.name}:{line}")
        for page in PAGES
        for number, (line, code) in enumerate(blocks_of(page, "yaml", "json"))
    ]


@pytest.mark.parametrize(("code", "read"), settings_blocks())
def test_what_they_are_for_reads_blocks_of_settings(
    code: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    file = tmp_path / ("block.jsonl" if read is read_tasks else "block.yaml")
    file.write_text(code + "\n")
    read(file)


@cache
def targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def wrong(call: list[str]) -> str:
    """What a command would not take, by its own parser; empty if it takes all."""
    name, *words = call
    if name == "make":
        unknown = {word for word in words if "=" not in word} - targets()
        return f"make {min(unknown)}" if unknown else ""
    if name == "python" and words[0] == "-m" and words[1].startswith(("benchmarks.", "tests.")):
        there = (ROOT / words[1].replace(".", "/") / "__main__.py").is_file()
        return "" if there else f"python -m {words[1]}"
    if name.rpartition("/")[2] != "webgym" or not words or words[0].startswith("-"):
        return ""
    if words[0] not in {verb.name for verb in cli.VERBS}:
        return f"webgym {words[0]}"
    command: Any = typer.main.get_command(cli.build(words[0]))
    path = "webgym"
    while hasattr(command, "commands"):
        if path == "webgym judge" and words[0] not in command.commands:
            words.insert(0, "run")  # which may be left out
        if not words or words[0] not in command.commands:
            return "" if "--help" in words else " ".join([path, *words[:1]])
        path, command, words = f"{path} {words[0]}", command.get_command(None, words[0]), words[1:]
    try:
        command.make_context(path, words) if "--help" not in words else None
    except Exception as error:  # Typer's releases take their errors from different packages
        return f"{path}: {getattr(error, 'format_message', error.__str__)()}"
    return ""


@pytest.mark.parametrize("code", blocks(*SHELL))
def test_shell(code: str) -> None:
    assert [found for found in map(wrong, calls(code)) if found] == []


def test_every_public_name_is_on_the_page_of_names() -> None:
    told = re.findall(r"^\.\. auto\w+:: webgym\.(\w+)$", (ROOT / "docs" / "api.md").read_text(), re.MULTILINE)
    assert sorted(told) == sorted(set(webgym.__all__) - {"__version__"})


def test_pages_made_from_the_code_hold_all_of_it() -> None:
    commands = "\n".join(reference.commands())
    assert all(f"### `webgym {verb.name}`" in commands for verb in cli.VERBS)
    assert "### `webgym tasks show`" in commands
    assert commands.count("| `--out <path>` |") > 5
    rows = dict(re.findall(r"^\| `(\w+)` \| `\w+` \| (\d) ", "\n".join(reference.errors()), re.MULTILINE))
    assert set(rows) == {name for name, held in vars(errors).items() if isinstance(held, type)}
    assert (rows["ConfigError"], rows["StoreFull"]) == ("2", "1")


def public_callables() -> Iterator[tuple[str, Any, str]]:
    """Functions and methods that ``webgym`` exports, with what documents their arguments."""
    for name in set(webgym.__all__) - {"__version__"}:
        held = getattr(webgym, name)
        if inspect.isfunction(held):
            yield name, held, held.__doc__ or ""
        elif inspect.isclass(held):
            for member, found in vars(held).items():
                method = getattr(found, "__func__", found)
                makes = member in ("__init__", "__post_init__")
                if inspect.isfunction(method) and (makes or member[0] != "_"):
                    about = held if makes else method
                    if method.__module__.startswith("webgym"):  # not what typing and msgspec make
                        yield f"{name}.{member}", method, about.__doc__ or ""


def untold(method: Any, text: str) -> list[str]:
    """Arguments and errors that a docstring does not tell; one that says ``See :meth:`` need not."""
    if re.match(r"See :meth:", text):
        return []
    method = inspect.unwrap(method)
    names = [name.lstrip("_") for name in inspect.signature(method).parameters if name not in ("self", "cls")]
    written = method.__code__.co_filename != "<string>"  # and not made by dataclasses
    source = inspect.getsource(method) if written else ""
    raised = set(re.findall(r"raise (\w+)\(", source)) & {"ValueError", *vars(errors)}
    for name in method.__code__.co_names:  # what it calls raises, by the docstring
        called = method.__globals__.get(name)
        if inspect.isfunction(called) and called.__module__.startswith("webgym"):
            told_there = (called.__doc__ or "").partition("Raises:")[2]
            raised |= set(re.findall(r"^ +(\w+): ", told_there, re.MULTILINE)) & set(vars(errors))
    return untold_names(names, text) + [
        name for name in sorted(raised) if name not in text.partition("Raises:")[2]
    ]


def untold_names(names: Iterable[str], text: str) -> list[str]:
    """Arguments or fields without a line in a docstring."""
    told = re.search(r"^ *(?:Args|Attributes):\n(.*)", text, re.DOTALL | re.MULTILINE)
    return [
        name for name in names if not told or not re.search(rf"^ +[\w, ]*\b{name}\b[\w, ]*: ", told[1], re.M)
    ]


def untold_fields(held: Any) -> list[str]:
    """Fields of a struct that its docstring does not tell, and settings without a docstring of their own."""
    settings = getattr(held, "model_fields", {})
    structs = getattr(held, "__struct_fields__", ())
    return [name for name in settings if not field_docstring(held, name)] + untold_names(
        structs, held.__doc__ or ""
    )


def test_public_docstrings_tell_arguments_and_errors() -> None:
    found = {name: untold(method, text) for name, method, text in public_callables()}
    assert len(found) > 60
    assert {name: missing for name, missing in found.items() if missing} == {}


def test_public_docstrings_tell_fields() -> None:
    found = {
        name: untold_fields(held) for name in webgym.__all__ if inspect.isclass(held := getattr(webgym, name))
    }
    assert {name: missing for name, missing in found.items() if missing} == {}
