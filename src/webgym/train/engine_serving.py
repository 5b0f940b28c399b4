"""Serves the policy with a vLLM or SGLang server, started here or elsewhere, and publishes weights.

lora      Adapters: loads a new one under a new name, tests it, and uses it from then on; the old one is
          unloaded after its last reply. No request waits, and a failure changes nothing.
in_place  All weights: holds new requests, drains those in progress, pauses the server, which reads the
          weights from a common folder or gets them by NCCL, and tests it. After a failure the old weights are
          restored; where even that fails, no request is sent again.
restart   For a server of ours that cannot do that: it is restarted with the new weights.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import logging
import os
import secrets
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, Self

import msgspec
from pydantic import SecretStr

from webgym.agent.openai_policy import OpenAIPolicy, as_policy_error
from webgym.agent.policy import BasePolicy, Policy, PolicyInput
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.core.errors import ConfigError, LLMError, PolicyBadReply, PolicyError, PublishError, TrainingError
from webgym.core.trajectory import Reply
from webgym.inference.nccl import api_of
from webgym.inference.vllm import EXPLICIT, HOST, ManagedServer, PublishMethod, VllmApi, VllmConfig, free_port
from webgym.llm.health import register_client
from webgym.train.config import LoraConfig
from webgym.train.selftest import (
    GREEDY,
    TOLERANCE,
    Greedy,
    SelfTest,
    check,
    check_checksums,
    known_request,
    read_selftest,
    tolerance_of,
)

log = logging.getLogger(__name__)

LOG: Final = "vllm.log"
_BASE: Final = "webgym-base"
"""Name of the initial weights at a server of ours; later ones are named after their version."""
_MOST_FOREIGN: Final = 5
"""Number of replies with other weights than the published ones, after which the training stops."""


@dataclass(eq=False)
class Served:
    """Weights on a server.

    Attributes:
        api: the server's API.
        model: name of the weights in requests, which replies must have too.
        version: version of the weights, for the records of replies.
        policy: the client.
        is_labelled: whether the server has this version as its label, so that it can be compared.
        is_adapter: whether the name is that of an adapter, which is to be unloaded later.
        retest: tests the weights again, where neither a label nor the name would tell that the server was
            started anew without them. Raises :class:`ForeignReply`.
        idle: set while no request is in flight.
    """

    api: VllmApi
    model: str
    version: str
    policy: OpenAIPolicy
    is_labelled: bool = False
    is_adapter: bool = False
    retest: Callable[[], Awaitable[None]] | None = None
    idle: asyncio.Event = field(default_factory=asyncio.Event)
    _in_flight: int = field(default=0, init=False)
    _retesting: asyncio.Lock = field(default_factory=asyncio.Lock, init=False)
    _interruptions: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.idle.set()

    @contextmanager
    def in_use(self) -> Iterator[None]:
        """Count a request in flight during the block."""
        self._in_flight += 1
        self.idle.clear()
        try:
            yield
        finally:
            self._in_flight -= 1
            if not self._in_flight:
                self.idle.set()

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply to a turn, checked by :meth:`checked`."""
        return await self.checked(await self.policy.reply(turn))

    async def checked(self, reply: Reply) -> Reply:
        """The reply, if it is of these weights, as far as the server reports that.

        Raises:
            ForeignReply: it is of other weights.
            PolicyError: the server's label could not be queried.
        """
        if reply.policy != self.model:
            raise ForeignReply(f"the endpoint replied with the model {reply.policy!r}, not {self.model!r}")
        if self.is_labelled:
            try:
                version = reply.weight_version or await self.api.weight_version()
            except LLMError as error:
                raise as_policy_error(error) from error
            if version != self.version:
                raise ForeignReply(f"the endpoint replied with the weights {version!r}, not {self.version!r}")
        if self.retest is not None:
            async with self._retesting:
                if (interruptions := self.policy.interruptions) != self._interruptions:
                    await self.retest()
                    self._interruptions = interruptions
        return reply


class ForeignReply(PolicyBadReply):
    """The endpoint replied with other weights than were published."""


class AnotherFailed(PublishError):
    """The weights were taken, and given back because another server did not take them."""


class EnginePolicy(BasePolicy):
    """Replies with the current weights of a server; during a change of weights, callers wait.

    Args:
        name: name of the model in records, the same for all of its weights.

    Attributes:
        name: as given.
        served: the current weights.
        lost: set while the server is away, so that what was sent to it is lost.
        distrusted: set when the server replied with other weights a few times.
        why: the message of the last such reply.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.served: Served | None = None
        self.lost = asyncio.Event()
        self.distrusted = asyncio.Event()
        self.why = ""
        self._foreign = 0
        self._open = asyncio.Event()

    def switch(self, served: Served) -> Served | None:
        """Reply with these weights from now on. Returns the previous ones, which may have requests in
        flight."""
        previous, self.served = self.served, served
        self._foreign = 0
        self._open.set()
        self.lost.clear()
        return previous

    async def close(self) -> None:
        """Hold back further requests, and wait for those in flight."""
        self._open.clear()
        if self.served is not None:
            await self.served.idle.wait()

    def hold(self) -> None:
        """Hold back further requests. Those in flight are lost, and will be sent again."""
        self._open.clear()
        self.lost.set()

    @property
    def problem(self) -> str:
        """Why requests are delayed at this moment; empty if they are not."""
        if not self._open.is_set():
            return "replies wait for new weights"
        return self.served.policy.problem if self.served is not None else ""

    async def __aenter__(self) -> Self:
        register_client(self)  # for each run; its client stays open for longer
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        """The model's reply. A request that was lost because the server ended is sent again.

        Raises:
            PolicyError: the request failed, or the reply is of other weights than the published ones.
        """
        while True:
            await self._open.wait()
            served = self.served
            assert served is not None
            try:
                with served.in_use():
                    reply = await served.reply(turn)
            except ForeignReply as error:
                self._foreign += 1
                self.why = error.message
                if self._foreign >= _MOST_FOREIGN:
                    self.distrusted.set()
                raise
            except PolicyError:
                if self.served is served and self._open.is_set():
                    raise
                continue
            return msgspec.structs.replace(reply, policy=self.name, weight_version=served.version)


class EngineServing:
    """See :class:`webgym.train.serving.Serving`.

    Args:
        config: of the server.
        model: that learning starts from, folder or hub id.
        logs: folder for the server's log.
        log: name of the log.
        lora: of the learner, if it trains adapters.
        profile: of the model's family; by default chosen by the model's name.
        newest: weights and version of a resumed training, with which a server is started.

    Attributes:
        replies: the policy.
    """

    def __init__(
        self,
        config: VllmConfig,
        model: str,
        logs: Path,
        *,
        log: str = LOG,
        lora: LoraConfig | None = None,
        profile: Profile | None = None,
        newest: tuple[Path, str] | None = None,
    ) -> None:
        self._config = config
        self._first = model
        self._is_ours = config.base_url is None
        self._log = logs / log
        self._lora = lora
        self._profile = profile or choose_profile(None, Path(model).name)
        self._method: PublishMethod = "in_place" if lora is None else "lora"
        self._newest = (newest[0].resolve(), newest[1]) if newest else None
        # Weights that a server elsewhere may hold already; ``None`` once it is known which weights it holds.
        self._maybe_served = self._newest if self._method == "in_place" and not self._is_ours else None
        self.replies = EnginePolicy(Path(model).name)
        self.policy: Policy = self.replies
        self._api_of = api_of(config, lora=lora is not None)
        self._api: VllmApi | None = None
        self._server: ManagedServer | None = None
        self._weights: Path | None = None  # the served weights; None for the initial ones
        self._earlier: Reply | None = None  # reply to the self-test before the weights change
        # The server's reply to the self-test with weights that it has certainly loaded, and the learner's;
        # the latter is ``None`` for the weights that learning starts from.
        self._certain: tuple[Greedy | None, Reply] | None = None
        self._checksums: dict[str, dict[str, str]] = {}  # of the served weights
        self._together: asyncio.Barrier | None = None  # of a publication to several servers
        self._restarts = 0
        self._busy = asyncio.Lock()

    # --- from outside -------------------------------------------------------------------------------------

    async def publish(self, weights: Path, version: str, together: asyncio.Barrier | None = None) -> None:
        """See :class:`webgym.train.serving.Serving`.

        Args:
            weights: a folder that an update wrote.
            version: recorded in replies.
            together: waited at before the first reply; if it breaks, the old weights are kept.
        """
        weights = await asyncio.to_thread(weights.resolve)  # absolute, for the server's working directory
        async with self._busy:
            if self._server is not None and not self._server.is_alive:
                await self._revive()
            served, self._together = self.replies.served, together
            try:
                with _as_publish_error(version):
                    if served is not None and (served.version, self._weights) == (version, weights):
                        await self._test(served, weights)
                        await self._agreed()
                    else:
                        await self._change(served, weights, version)
            finally:
                self._together = None
            self._weights, self._maybe_served, self._restarts = weights, None, 0

    async def is_up(self) -> bool:
        """Whether the server answers."""
        return self._api is not None and await self._api.is_up()

    async def recover(self, weights: Path | None, version: str) -> None:
        """Serve weights after the server was away, as :meth:`publish` does.

        Args:
            weights: a folder that an update wrote; ``None`` for the initial weights.
            version: recorded in replies.
        """
        if weights is not None:
            resolved = await asyncio.to_thread(weights.resolve)
            if not self._is_ours:  # if it was started anew, it has none of those that it had
                self._maybe_served, self._weights, self._checksums = (resolved, version), None, {}
            await self.publish(weights, version)
        elif not self._is_ours and (served := self.replies.served) is not None:
            with _as_publish_error(version):
                await self._switch(await self._tested(served.model, version, None))

    async def _agreed(self) -> None:
        """Wait until the other servers of a publication have taken the weights, too.

        Raises:
            AnotherFailed: one of them did not.
        """
        if self._together is None:
            return
        try:
            await self._together.wait()
        except asyncio.BrokenBarrierError as error:
            raise AnotherFailed("another server did not take the weights") from error

    def copy(self) -> None:
        """See :class:`webgym.train.serving.Serving`: a server has one set of weights."""

    async def watch(self) -> None:
        """See :class:`webgym.train.serving.Serving`."""
        while True:
            waits: set[asyncio.Task[Any]] = {asyncio.create_task(self.replies.distrusted.wait())}
            if self._server is not None:
                waits.add(asyncio.create_task(self._server.wait()))
            try:
                await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in waits:
                    task.cancel()
            if self.replies.distrusted.is_set():
                raise TrainingError(
                    f"the policy's model was changed by others: {self.replies.why}",
                    hint="no such replies were kept: keep others off the server, then webgym train --resume",
                )
            async with self._busy:
                if self._server is not None and not self._server.is_alive:
                    await self._revive()

    async def __aenter__(self) -> Self:
        try:
            if self._is_ours:
                self._log.parent.mkdir(parents=True, exist_ok=True)
                first = self._newest if self._method == "in_place" else None
                await self._start(*(first or (None, "0")))
            else:
                await self._connect()
        except BaseException:
            await self._close()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self._close()

    async def _close(self) -> None:
        served = self.replies.served
        if served is not None:
            await served.policy.__aexit__(None, None, None)
            if served.is_adapter and not self._is_ours:
                with contextlib.suppress(LLMError):
                    await served.api.unload_adapter(served.model)
        await self._stop()

    # --- a server of ours ---------------------------------------------------------------------------------

    async def _start(self, weights: Path | None, version: str) -> None:
        """Start a server and wait until it replies. Requests are held until this returns.

        Args:
            weights: to serve; ``None`` for the initial ones.
            version: of the weights.
        """
        config = self._config
        method: PublishMethod = "in_place" if self._lora is None else "lora"
        await self._stop()
        port, key = free_port(HOST, config.port), SecretStr(secrets.token_hex(16))
        name = _BASE if weights is None or method == "lora" else f"webgym-{version}"
        model = (config.model or self._first) if weights is None or method == "lora" else str(weights)
        rank = self._lora.rank if self._lora else 0
        command = self._api_of.command(config, model, name, port, method, rank, key, self._log)
        self._server = await ManagedServer.start(command, config.environment(key, method), self._log)
        self._api = self._api_of(f"http://{HOST}:{port}/v1", key)
        await self._server.until(self._api.is_up, config.start_seconds)
        self._weights, self._checksums = weights, {}
        if weights is not None and method == "lora":
            await self._hot_load(weights, version)
            return
        if method == "in_place":
            self._method = "restart" if await self._missing(self._api, method) else method
            if self._method == method:
                await self._api.prepare()
            await self._api.label(version)
        await self._switch(await self._tested(name, version, weights))

    async def _stop(self) -> None:
        if self._api is not None:
            await self._api.close()
        if self._server is not None:
            await self._server.stop()

    async def _revive(self) -> None:
        """Restart a server that ended unexpectedly, with the weights that it served."""
        assert self._server is not None
        self.replies.hold()
        version = self.replies.served.version if self.replies.served else "0"
        self._restarts += 1
        if self._restarts > self._config.restarts:
            raise self._server.failure(f"ended, and was started again {self._config.restarts} times")
        log.warning("%s", self._server.failure("ended; it is started again").message)
        with _as_publish_error(version):
            await self._start(self._weights, version)

    # --- somebody else's ----------------------------------------------------------------------------------

    async def _connect(self) -> None:
        config = self._config
        assert isinstance(config.base_url, str)
        key = SecretStr(os.environ.get(config.api_key_env, "").strip())
        self._api = api = self._api_of(config.base_url, key)
        try:
            names = await api.models()
            missing = await self._missing(api, self._method)
            if self._method == "lora":
                await self._unload_leftovers(api)
            elif not missing:
                await api.prepare()
        except LLMError as error:
            raise ConfigError(
                error.message, hint=f"is {config.engine} running there, and the key right?"
            ) from error
        if missing:
            raise ConfigError(
                f"the server {config.base_url} does not offer {missing[0]}, so it takes no new weights",
                hint=f"start it with {api.flags[self._method]}, or leave vllm.base_url out: one starts here",
            )
        name = config.model or (names[0] if len(names) == 1 else None)
        if name not in names:
            raise ConfigError(
                f"the server {config.base_url} has the models {', '.join(names) or '(none)'}",
                hint="set vllm.model to the one that learning starts from",
            )
        if self._method == "in_place" and self._newest is None and await api.is_paused():
            raise ConfigError(
                f"the server {config.base_url} is paused, as after weights that were cut off",
                hint="restart it, or continue the training that published them: webgym train --resume",
            )
        if self._method == "in_place" and await api.offers(api.labels):
            label = await api.weight_version()
            if self._newest is None and label not in ("", "default", "0"):
                raise ConfigError(
                    f"the server {config.base_url} has other weights than learning starts from: {label!r}",
                    hint="restart it, or continue the training that published them: webgym train --resume",
                )
            await api.label("0")
        await self._switch(await self._tested(name, "0", None))

    async def _unload_leftovers(self, api: VllmApi) -> None:
        """Unload the adapters of this training that a process left which was killed."""
        ours = await asyncio.to_thread(self._log.parent.resolve)
        for name, folder in (await api.adapters()).items():
            if folder.is_relative_to(ours):
                await api.unload_adapter(name)

    @staticmethod
    async def _missing(api: VllmApi, method: PublishMethod) -> list[str]:
        """The endpoints that are needed to publish by a method, and that the server does not offer."""
        return [path for path in api.needed[method] if not await api.offers(path)]

    # --- new weights --------------------------------------------------------------------------------------

    async def _change(self, served: Served | None, weights: Path, version: str) -> None:
        test = read_selftest(weights)
        if test and served and served.version == test.since and self._maybe_served is None:
            self._earlier = await served.policy.ask(*test.request(), GREEDY)
        try:
            await (self._hot_load if self._method == "lora" else self._drained)(weights, version)
        finally:
            self._earlier = None

    async def _hot_load(self, weights: Path, version: str) -> None:
        assert self._api is not None
        name = f"webgym-{version}-{secrets.token_hex(3)}"  # a name is never reused
        try:
            in_requests = await self._api.load_adapter(name, str(weights))
            served = await self._tested(in_requests, version, weights)
        except BaseException:
            with contextlib.suppress(LLMError):
                await self._api.unload_adapter(name)
            raise
        before = await self._switch(served)
        if before is not None and before.is_adapter:
            with contextlib.suppress(LLMError):  # gone already, after a restart
                await self._api.unload_adapter(before.model)

    async def _drained(self, weights: Path, version: str) -> None:
        """Hold new requests, drain those in progress, change and test the weights, and release requests."""
        assert self._api is not None
        await self.replies.close()
        if self._method == "restart":
            await self._start(weights, version)
            return
        before = self.replies.served
        assert before is not None
        try:
            if before.is_labelled:
                self._refuse_foreign(before, await self._api.weight_version())
            self._checksums = self._checksums or await self._api.checksums()
            await self._api.update_weights(str(weights), version)
            checksums = await self._checked_checksums(weights)
            served = await self._tested(before.model, version, weights)
            self._checksums = checksums
        except (LLMError, PolicyError, PublishError) as error:
            if not self._is_ours or isinstance(error, AnotherFailed):
                await self._restore(before)
                raise
            log.warning("vLLM did not take the weights %s, and is restarted: %s", version, error.message)
            await self._start(weights, version)
            return
        await self._switch(served)

    def _refuse_foreign(self, before: Served, label: str) -> None:
        """Refuse to replace weights of others; a server that was started anew gets them again.

        Raises:
            TrainingError: the label is that of others.
        """
        assert self._api is not None
        if label not in ("", "default", before.version):
            raise TrainingError(
                f"the server {self._api.base_url} has the weights {label!r} of others, not "
                f"{before.version!r}: they are left there",
                hint="use one server per training, then webgym train --resume",
            )

    async def _checked_checksums(self, weights: Path) -> dict[str, dict[str, str]]:
        """The checksums of the new weights; empty if the server has none to give.

        Raises:
            PublishError: by them, the new weights are not in use everywhere.
        """
        assert self._api is not None
        checksums = await self._api.checksums()
        if self._maybe_served is None and (test := read_selftest(weights)) is not None:
            check_checksums(test, self._checksums, checksums)
        return checksums

    async def _restore(self, before: Served) -> None:
        """Restore the previous weights after a failed update. If that fails too, no request is sent again."""
        assert self._api is not None
        with contextlib.suppress(LLMError, PolicyError, PublishError):
            self._earlier, weights, known = None, self._weights, self._checksums
            if self._maybe_served is not None:
                known, (weights, version) = {}, self._maybe_served
                before = dataclasses.replace(before, version=version)
            await self._api.update_weights(str(weights or self._first), before.version)
            if weights is not None:
                await self._test(before, weights)
            if not known or await self._api.checksums() == known:
                self.replies.switch(before)

    async def _tested(self, name: str, version: str, weights: Path | None) -> Served:
        """A model of the server by name, once it, and the other servers of a publication, have passed the
        self-test of the weights."""
        assert self._api is not None
        chat = self._config.chat(self._api.base_url, name)
        sampling = chat.sampling.over(self._profile.sampling).over(EXPLICIT)
        policy = OpenAIPolicy(
            # EnginePolicy itself checks the model of every reply, and ends the training.
            chat.model_copy(update={"sampling": sampling, "any_model": True}),
            self._profile,
            api_key=self._api.key,
            processed_logprobs=self._is_ours and self._api_of.processed_logprobs,
        )
        is_labelled = self._method == "in_place" and await self._api.offers(self._api.labels)
        is_adapter = self._method == "lora" and weights is not None
        served = Served(self._api, name, version, await policy.__aenter__(), is_labelled, is_adapter)
        try:
            if weights is not None:
                await self._test(served, weights)
                if self._method == "in_place" and not is_labelled:
                    served.retest = partial(self._retest, policy, weights)
                await self._agreed()
            elif self._certain is None and self._maybe_served is None:
                self._certain = (None, await policy.ask(*known_request(), GREEDY))
        except BaseException:
            await policy.__aexit__(None, None, None)
            raise
        return served

    async def _switch(self, served: Served) -> Served | None:
        """Send requests to these weights; returns the previous ones, after their last request."""
        before = self.replies.switch(served)
        if before is not None:
            await before.idle.wait()
            await before.policy.__aexit__(None, None, None)
        return before

    async def _test(self, served: Served, weights: Path) -> None:
        test = read_selftest(weights)
        if test is None:
            return
        reply = await served.checked(await served.policy.ask(*test.request(), GREEDY))
        check(test, reply, tolerance=self._tolerance(test), earlier=self._earlier)
        self._certain = self._certain or (test.after, reply)

    async def _retest(self, policy: OpenAIPolicy, weights: Path) -> None:
        """See :attr:`Served.retest`."""
        if (test := read_selftest(weights)) is None:
            return
        try:
            reply = await policy.ask(*test.request(), GREEDY)
            check(test, reply, tolerance=self._tolerance(test))
        except PublishError as error:
            raise ForeignReply(error.message) from error

    def _tolerance(self, test: SelfTest) -> float:
        if self._certain is None:
            return TOLERANCE
        expected, reply = self._certain
        return tolerance_of(test, expected or test.first, reply)


@contextmanager
def _as_publish_error(version: str) -> Iterator[None]:
    """Convert the server's errors to a :class:`PublishError`."""
    try:
        yield
    except (LLMError, PolicyError) as error:
        raise PublishError(
            f"cannot publish the weights {version}: {error.message}", hint=error.hint
        ) from error
