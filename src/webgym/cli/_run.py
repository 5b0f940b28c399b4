"""What ``rollout`` and ``demo`` share: starting a run, showing it, and ending well."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Callable, Coroutine, Mapping
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import Any, TypeVar

import uvloop
import yaml
from pydantic import SecretStr, ValidationError
from rich.console import Console
from rich.markup import escape

from webgym.collection import PolicyChoice, RunConfig, Secrets
from webgym.core.errors import ConfigError
from webgym.llm.config import ChatConfig, Sampling
from webgym.rollout.live import showing
from webgym.rollout.progress import Progress

T = TypeVar("T")

SERVER_TOKEN = "WEBGYM_TOKEN"  # noqa: S105 - a variable's name
SITES_TOKEN = "WEBGYM_SITES_TOKEN"  # noqa: S105 - a variable's name


def run(job: Callable[[], Coroutine[Any, Any, T]]) -> T:
    """Run a coroutine; Ctrl-C and SIGTERM cancel it, so that what is in flight is recorded.

    Raises:
        KeyboardInterrupt: it was cancelled.
    """

    async def guarded() -> T:
        task = asyncio.ensure_future(job())
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, task.cancel)
        try:
            return await task
        except asyncio.CancelledError:
            raise KeyboardInterrupt from None

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        return runner.run(guarded())


def secrets(server_token_file: Path | None = None) -> Secrets:
    """Tokens from a file or the environment, never from the command line, where others could read them.

    Raises:
        ConfigError: the file cannot be read.
    """
    token = os.environ.get(SERVER_TOKEN)
    if server_token_file is not None:
        try:
            token = server_token_file.read_text().strip()
        except OSError as error:
            raise ConfigError(f"cannot read the token file {server_token_file}: {error.strerror}") from error
    sites = os.environ.get(SITES_TOKEN)
    return Secrets(
        server_token=SecretStr(token) if token else None, sites_token=SecretStr(sites) if sites else None
    )


def policy_choice(
    name: str | None,
    mistakes: float,
    base_url: str | None,
    model: str | None,
    sampling: Sampling | None = None,
) -> PolicyChoice:
    """A policy from command line options; an endpoint alone means the openai policy.

    Raises:
        ConfigError: endpoint or model is missing or malformed.
    """
    name = name or ("openai" if base_url else "scripted")
    chat = None
    if name == "openai":
        if not base_url or not model:
            raise ConfigError(
                "the openai policy needs an endpoint and a model", hint="give --base-url and --model"
            )
        try:
            chat = ChatConfig(base_url=base_url, model=model, sampling=sampling or Sampling())
        except ValidationError as error:
            raise ConfigError(f"{base_url} is no base URL: {error.errors()[0]['msg']}") from error
    elif base_url:
        raise ConfigError(f"the {name} policy has no endpoint", hint="leave --base-url out, or --policy")
    return PolicyChoice(name=name, mistakes=mistakes, chat=chat)


def settings(path: Path | None, overrides: Mapping[str, Any]) -> RunConfig:
    """Settings from a YAML file, some of them overridden; ``None`` overrides nothing.

    Raises:
        ConfigError: the file cannot be read, or a setting is unknown or out of range.
    """
    held: Any = {}
    if path is not None:
        try:
            held = yaml.safe_load(path.read_text()) or {}
        except OSError as error:
            raise ConfigError(f"cannot read {path}: {error.strerror}") from error
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
        if not isinstance(held, dict):
            raise ConfigError(f"{path} holds no settings", hint="see configs/ for examples")
    try:
        return RunConfig.model_validate(_merge(held, overrides))
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigError(f"{path or 'options'}: {where}: {first['msg']}") from error


def _merge(held: Mapping[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    merged = dict(held)
    for key, value in overrides.items():
        if isinstance(value, Mapping):
            below = merged.get(key)
            merged[key] = _merge(below if isinstance(below, Mapping) else {}, value)
        elif value is not None:
            merged[key] = value
    return merged


def show_on(console: Console) -> Callable[[Progress], AbstractAsyncContextManager[None]]:
    """Progress on this console."""
    return lambda progress: showing(progress, console)


def tell_on(console: Console) -> Callable[[str], None]:
    """Remarks on this console."""
    return lambda line: console.print(f"[yellow]note[/] {escape(line)}", highlight=False, soft_wrap=True)
