"""Pages made from the code whenever the documentation is built: commands, settings, errors.

:func:`write` puts them into ``docs/generated/``, which git ignores; ``commands.md``, ``settings.md`` and
``errors.md`` include them.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import typer
from pydantic import BaseModel, SecretStr
from pydantic.fields import FieldInfo

from webgym import cli
from webgym.core.errors import UsageError, WebGymError
from webgym.core.settings import field_docstring

ROOTS = {
    "webgym.run.config.RunConfig": "`webgym rollout` and `webgym eval`; `rollout` of a training",
    "webgym.train.loop.TrainConfig": "`webgym train`",
    "webgym.study.recipe.RecipeConfig": "`webgym pretrain`",
    "webgym.study.conditions.StudyConfig": "`webgym study`",
    "webgym.taskset.construction.config.BuildConfig": "`webgym tasks build`",
    "webgym.simulate.sizing.Questions": "`webgym simulate`",
    "webgym.server.config.ServerConfig": "`webgym serve`, by its options",
    "webgym.server.config.GatewayConfig": "`webgym serve` of several processes",
    "webgym.server.config.RayConfig": "`webgym serve --ray`",
    "webgym.report.config.ReportConfig": "`webgym report`, by its options",
    "webgym.report.config.ViewConfig": "`webgym view`, by its options",
}
"""Settings that somebody gives, and to what; those that they hold follow them."""


def write(folder: Path) -> None:
    """Write every page into a folder."""
    folder.mkdir(exist_ok=True)
    for name, lines in {"commands": commands(), "settings": settings(), "errors": errors()}.items():
        (folder / f"{name}.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def _summary(of: type) -> str:
    return (of.__doc__ or "").split("\n\n")[0]


def _cell(text: str) -> str:
    """Plain text in a table of Markdown, on one line."""
    text = re.sub(r":\w+:`(?:~?[\w.]*\.)?(\w+)`", r"`\1`", " ".join(text.split())).replace("``", "`")
    return re.sub(r"(?<!\\)([|<])", r"\\\1", text)


# --- commands -------------------------------------------------------------------------------------------


def commands() -> Iterator[str]:
    """Every command with its arguments and options, as its own ``--help`` has them."""
    for verb in cli.VERBS:
        group: Any = typer.main.get_command(cli.build(verb.name))
        yield from _command(f"webgym {verb.name}", group.commands[verb.name])


def _command(path: str, command: Any) -> Iterator[str]:
    context = command.make_context(path, [], resilient_parsing=True)
    yield from (f"### `{path}`", "", command.help or "", "")
    if hasattr(command, "commands"):
        for name in command.commands:
            yield from _command(f"{path} {name}", command.get_command(context, name))
        return
    yield from ("```text", re.sub(r"^Usage: ", "", command.get_usage(context)), "```", "")
    told = [each.get_help_record(context) for each in command.params if each.name != "help"]
    if rows := [
        f"| `{name.replace('|', chr(92) + '|')}` | {_cell(text)} |" for name, text in filter(None, told)
    ]:
        yield from ("| option | what it does |", "| --- | --- |", *rows, "")


# --- settings -------------------------------------------------------------------------------------------


def settings() -> Iterator[str]:
    """Every class of settings that a file, an option or a public name takes: its keys, types and defaults."""
    seen: set[type[BaseModel]] = set()
    for name, where in ROOTS.items():
        module, _, attribute = name.rpartition(".")
        root: type[BaseModel] = getattr(importlib.import_module(module), attribute)
        for model in _held(root):
            if model not in seen:
                seen.add(model)
                yield from _model(model, where if model is root else "")


def _held(model: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """A class of settings, and those that its fields hold."""
    yield model
    for field in model.model_fields.values():
        for inner in _models(field.annotation):
            yield from _held(inner)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


def _model(model: type[BaseModel], where: str) -> Iterator[str]:
    yield from (f"({_anchor(model)})=", f"### `{model.__name__}`", "")
    text = _cell(_summary(model))
    yield from (f"{text} *Of* {where}." if where else text, "")
    yield from ("| key | type | default | what it is |", "| --- | --- | --- | --- |")
    for name, field in model.model_fields.items():
        about = field_docstring(model, name) or next(
            (_summary(each) for each in _models(field.annotation)), ""
        )
        assert about, f"{model.__name__}.{name} has no docstring"
        yield f"| `{name}` | {_type(field)} | {_default(field)} | {_cell(about)} |"
    yield ""


def _anchor(model: type[BaseModel]) -> str:
    return f"settings-{model.__module__}-{model.__name__}".replace("_", "-").replace(".", "-").lower()


def _type(field: FieldInfo) -> str:
    told = getattr(field.annotation, "__name__", "") if not get_args(field.annotation) else ""
    text = re.sub(r"\b(?:[a-z_]\w*\.)+(?=\w)", "", told or str(field.annotation))
    text = re.sub(r"Annotated\[(\w+), FieldInfo\(.*?metadata=\[.*?\]\)\]", r"\1", text)
    limits = [str(each) for each in field.metadata if type(each).__module__ == "annotated_types"]
    links = [f"[{each.__name__}](#{_anchor(each)})" for each in dict.fromkeys(_models(field.annotation))]
    if len(links) == 1 and told:
        return links[0]
    shown = ", ".join([text, *(re.sub(r"^(\w+)\(.*?=(.*)\)$", _limit, each) for each in limits)])
    return " ".join([f"`{shown.replace('|', chr(92) + '|')}`", *links])


def _limit(found: re.Match[str]) -> str:
    signs = {"Ge": "≥", "Gt": ">", "Le": "≤", "Lt": "<", "MinLen": "length ≥", "MaxLen": "length ≤"}
    return f"{signs.get(found[1], found[1])} {found[2]}"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**required**"
    value = field.get_default(call_default_factory=True, validated_data={})
    if isinstance(value, BaseModel):
        set_here = ", ".join(f"{key}: {each}" for key, each in value.model_dump(exclude_unset=True).items())
        return f"`{set_here}`" if set_here else ""
    if isinstance(value, SecretStr):
        return ""
    return f"`{_cell(str(value) if not isinstance(value, str) else repr(value))}`"


# --- errors ---------------------------------------------------------------------------------------------


def errors() -> Iterator[str]:
    """Every error with its code, the exit code of a command that ends with it, and what to do about it."""
    yield from ("| error | code | exit code | meaning |", "| --- | --- | ---: | --- |")
    for error in _tree(WebGymError):
        code = cli.EXIT_USAGE if issubclass(error, UsageError) else cli.EXIT_FAILED
        hint = f" *Hint:* {error.usual_hint}." if error.usual_hint else ""
        meaning = _cell(_summary(error) + hint)
        yield f"| `{error.__name__}` | `{error.code}` | {code} | {meaning} |"


def _tree(error: type[WebGymError]) -> Iterator[type[WebGymError]]:
    yield error
    for child in error.__subclasses__():
        if child.__module__ == WebGymError.__module__:  # others are private to a module
            yield from _tree(child)
