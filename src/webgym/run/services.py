"""The services that runs use: browsers and the offline web, started here or reached elsewhere."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping, Sequence, Set
from contextlib import (
    AsyncExitStack,
    asynccontextmanager,
)
from dataclasses import replace
from importlib import import_module
from typing import Any, Final, TypeAlias, TypeVar
from urllib.parse import urlsplit

import msgspec
from pydantic import SecretStr

from webgym.browser.config import Cookie
from webgym.core.calls import CallQueue
from webgym.core.errors import ConfigError, Unauthorized
from webgym.core.task import Task
from webgym.core.websites import host_or_text
from webgym.offline.app import SitesClient, serving
from webgym.offline.web import OfflineWeb
from webgym.rollout.config import CollectorConfig
from webgym.rollout.driver import Browsers, SiteState
from webgym.rollout.sessions import patiently
from webgym.run.config import RunConfig, Secrets, ServerChoice, Tell, say
from webgym.server.client import BrowserClient
from webgym.server.config import Admission, ServerConfig
from webgym.server.worker import running_server

T = TypeVar("T")

_STATIC_BROWSERS: Final = ("webgym.study.static_browsers", "StaticBrowsers")
"""Module and class of browsers without Chromium. They stand beside runs, for studies: no run needs them."""


@asynccontextmanager
async def open_services(
    config: RunConfig,
    secrets: Secrets,
    tasks: Sequence[Task],
    tell: Tell | None,
    calls: dict[str, CallQueue],
    *,
    attempts: int | None = None,
    are_recorded: bool = False,
) -> AsyncIterator[tuple[SiteState | None, Browsers]]:
    """The websites and browsers of a run, or static browsers for both, open until the block ends.

    Args:
        config: of the run.
        secrets: tokens of servers that run elsewhere.
        tasks: the run's.
        tell: called with each line that the user should read, such as a warning.
        calls: queues that limit concurrent calls, by kind of call.
        attempts: how many there are, if that is known: no more browsers are started.
        are_recorded: the tasks are those of a run that is resumed. What it has reached before is waited for.

    Raises:
        WebGymError: they cannot be started or reached, or do not serve these tasks.
    """
    patience = (config.collector if are_recorded else None, tell)
    are_recorded = are_recorded or config.tasks.file is not None
    if config.server.static:
        if config.sites.collection != "small" or config.tasks.file is not None:
            raise ConfigError(
                "only attempts at the small websites can be made without browsers",
                hint="set sites.collection to small, or server.static to false",
            )
        web = OfflineWeb(config.sites.seed, per_family=config.sites.per_family, collection="small")
        if are_recorded:
            await asyncio.to_thread(_check_truths, web, tasks)
        module, name = _STATIC_BROWSERS
        async with getattr(import_module(module), name)(web, config.server.pictures) as browsers:
            yield browsers, browsers
        return
    async with (
        _sites(config, secrets, tasks, patience, are_recorded=are_recorded) as (site_state, allowed),
        _browsers(config, secrets, allowed, patience, attempts, calls) as client,
    ):
        yield site_state, client


@asynccontextmanager
async def services(config: RunConfig, secrets: Secrets) -> AsyncIterator[tuple[ServerChoice, Secrets]]:
    """Browsers, and the offline web if the tasks are on it, started once for many runs.

    Yields:
        The ``config.server`` and secrets with which :func:`~webgym.run.collect.collect` uses them. Services
        that run elsewhere are passed on unchanged.
    """
    if config.server.url is not None or config.server.static:
        yield config.server, secrets
        return
    async with AsyncExitStack() as stack:
        choice, allowed = config.server, tuple[str, ...]()
        if config.tasks.file is None and choice.sites_url is None:
            sites = await stack.enter_async_context(serving(config.sites))
            choice = choice.model_copy(update={"sites_url": sites.url})
            secrets = replace(secrets, sites_token=SecretStr(sites.token))
            allowed = tuple(sites.allowed_hosts)
        else:
            allowed = _rules_for_sites_elsewhere(config)
        serve = ServerConfig(
            slots=config.collector.sessions,
            browser=config.browser.allowing(*allowed),
            admission=Admission(queues=config.server.queues),
        )
        server = await stack.enter_async_context(running_server(serve))
        choice = choice.model_copy(update={"url": server.url})
        token = server.token if isinstance(server.token, SecretStr) else SecretStr(server.token)
        yield choice, replace(secrets, server_token=token)


_Patience: TypeAlias = tuple[CollectorConfig | None, Tell | None]
"""For how long services elsewhere are waited for, not at all if ``None``, and who is told."""


async def _reached(call: Callable[[], Awaitable[T]], patience: _Patience) -> T:
    """The first answer of a service that runs elsewhere."""
    config, tell = patience
    if config is None:
        return await call()
    return await patiently(
        call, config, tell=lambda problem: say(tell, f"waiting: {problem}") if problem else None
    )


class ServedState:
    """The :class:`SiteState` of a served offline web.

    Args:
        sites: a client of its administration API.
    """

    def __init__(self, sites: SitesClient) -> None:
        self._sites = sites

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        """The cookie that makes a browser this visitor."""
        name, value, domain = self._sites.visitor_cookie(visitor)
        return (Cookie(name, value, domain),)

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        """The state of a website for this visitor; ``None`` if there is none."""
        return await self._sites.state(visitor, host)


@asynccontextmanager
async def _sites(
    config: RunConfig, secrets: Secrets, tasks: Sequence[Task], patience: _Patience, *, are_recorded: bool
) -> AsyncIterator[tuple[SiteState | None, tuple[str, ...]]]:
    """The offline web, here or elsewhere, and the egress rules that let browsers reach it."""
    if not any(task.truth for task in tasks):
        yield None, ()
    elif config.server.sites_url is not None:
        if secrets.sites_token is None:
            raise ConfigError(
                "the offline web's token is missing",
                hint="set WEBGYM_SITES_TOKEN to what it was started with",
            )
        token = secrets.sites_token.get_secret_value()
        async with SitesClient(config.server.sites_url, token) as client:
            # Fails now, in one line, rather than once per attempt.
            websites = await _reached(client.websites, patience)
            served = {site["host"]: site.get("digest") for site in websites}
            _check_served(tasks, served.keys())
            _check_digests(config, tasks, served)
            if are_recorded:
                web = _web(config)
                specs = web.specs
                ours = {host for host in served if host in specs and specs[host].digest == served[host]}
                known = [task for task in tasks if task.truth and task.truth.hosts <= ours]
                await asyncio.to_thread(_check_truths, web, known)
            yield ServedState(client), _rules_for_sites_elsewhere(config)
    elif config.server.url is not None:
        raise ConfigError(
            "these tasks are on the offline web, and the browser server runs elsewhere",
            hint="start webgym sites serve where its browsers run, the server with the rules it prints, "
            "and give its URL with --sites, or as server.sites_url",
        )
    elif config.browser.remote is not None:
        raise ConfigError("these tasks are on the offline web, which a remote browser does not reach")
    else:
        async with serving(config.sites) as sites, SitesClient(sites.url, sites.token) as client:
            _check_served(tasks, sites.web.specs.keys())
            if are_recorded:
                await asyncio.to_thread(_check_truths, sites.web, tasks)
            yield ServedState(client), tuple(sites.allowed_hosts)


def _rules_for_sites_elsewhere(config: RunConfig) -> tuple[str, ...]:
    """The egress rules that let browsers that are started here reach an offline web that is not."""
    if config.server.url is not None or config.server.sites_url is None:
        return ()
    url, web = urlsplit(config.server.sites_url), _web(config)
    return tuple(web.allowed_hosts(f"{url.hostname}:{url.port or 80}"))


def _check_served(tasks: Sequence[Task], hosts: Set[str]) -> None:
    """Refuse tasks whose websites are not served: every attempt would end as an error of the environment."""
    for task in tasks:
        if task.truth is not None and (missing := sorted(task.truth.hosts - hosts)):
            raise ConfigError(
                f"the task {task.id} is on {missing[0]}, which is not served",
                hint="sites.collection, seed and per_family, or the options of webgym sites serve, must be "
                "what the tasks were made with",
            )


def _check_digests(config: RunConfig, tasks: Sequence[Task], served: Mapping[str, str | None]) -> None:
    """Refuse websites that have only their names in common with those that the tasks were made for: every
    attempt would fail."""
    if config.tasks.file is not None:
        return  # it does not say what its tasks were made for
    web = _web(config)
    for host in sorted({host for task in tasks if task.truth is not None for host in task.truth.hosts}):
        if host in web.specs and web.specs[host].digest != served[host]:
            raise ConfigError(
                f"{host} is another website on the offline web at {config.server.sites_url} than here",
                hint="start webgym sites serve with sites.seed, and in the same version of WebGym",
            )


def _web(config: RunConfig) -> OfflineWeb:
    """The offline web of the config's settings, as this version of WebGym makes it."""
    sites = config.sites
    return OfflineWeb(sites.seed, per_family=sites.per_family, collection=sites.collection)


def _check_truths(web: OfflineWeb, tasks: Sequence[Task]) -> None:
    """Refuse tasks that say otherwise than their websites, as those of another version of WebGym or another
    seed: right answers would be failures."""
    hosts = {host_or_text(task.website) for task in tasks if task.truth is not None}
    made = {task.id: task for host in sorted(hosts & web.specs.keys()) for task in web.tasks_of(host)}
    for task in tasks:
        if task.truth is None or task.id not in made:  # a task of the user's own
            continue
        if msgspec.json.encode(task.truth) != msgspec.json.encode(made[task.id].truth):
            raise ConfigError(
                f"the task {task.id} was made for another {host_or_text(task.website)} than is served",
                hint="take the version of WebGym and the sites.seed that it was made with, or make the tasks "
                "and the run anew",
            )


@asynccontextmanager
async def _browsers(
    config: RunConfig,
    secrets: Secrets,
    allowed: tuple[str, ...],
    patience: _Patience,
    attempts: int | None,
    calls: dict[str, CallQueue],
) -> AsyncIterator[BrowserClient]:
    """A client of the configured browser server, or of one started here with as many slots as needed."""
    sessions, (_, tell) = config.collector.sessions, patience
    if attempts is not None:
        sessions = max(1, min(sessions, attempts))
    if config.server.url is not None:
        token = secrets.server_token
        if token is None:
            raise Unauthorized(
                "the browser server's token is missing", hint="set WEBGYM_TOKEN to what it was started with"
            )
        async with BrowserClient(
            config.server.url, token=token.get_secret_value(), limits=config.limits, calls=calls
        ) as client:
            info = await _reached(client.info, patience)
            if sessions > info.slots:
                say(
                    tell, f"the server has {info.slots} slots so far, for {sessions} sessions: some will wait"
                )
            yield client
        return
    say(tell, f"starting the browser server for {sessions} sessions, which takes some seconds")
    browser = config.browser.allowing(*allowed)
    admission = Admission(queues=config.server.queues)
    async with (
        running_server(ServerConfig(slots=sessions, browser=browser, admission=admission)) as server,
        BrowserClient(server.url, token=server.token, limits=config.limits, calls=calls) as client,
    ):
        info = await client.info()
        for line in info.without:
            say(tell, f"the browser is a remote one, without {line}")
        if not info.sandboxed and not info.without:
            say(tell, "browsers run without a sandbox here: open only pages that you trust")
        yield client
