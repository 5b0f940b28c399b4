"""The agent: one policy, one way to ask it, many attempts at once."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Self

import msgspec

from webgym.agent.config import AgentConfig
from webgym.agent.context import Now, Round, build_request, picture_names, thinking_of
from webgym.agent.images import fit
from webgym.agent.memory import merge
from webgym.agent.parser import ParsedReply, ParseError, parse_reply
from webgym.agent.policy import Policy, Turn
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.core.action import Mode
from webgym.core.errors import PolicyBadReply, PolicyError
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Reply, Revision, Step


class Agent:
    """A policy and how it is asked. Entering it enters the policy.

    Args:
        policy: who replies.
        config: prompt format, window, limits.
        profile: of the policy's family of models, in place of the one that the config and the policy's name
            lead to.

    Attributes:
        mode: how targets are named.

    Raises:
        ConfigError: the config names a profile that is not there.
    """

    def __init__(
        self, policy: Policy, config: AgentConfig | None = None, profile: Profile | None = None
    ) -> None:
        self.policy = policy
        self.config = config or AgentConfig()
        self.profile = profile or choose_profile(self.config.profile, policy.name, self.config.mode)
        self.mode: Mode = self.profile.mode

    @property
    def wants_elements(self) -> bool:
        """Whether observations must carry ``elements`` and ``text``."""
        return self.policy.wants_elements or self.mode == "marks"

    def begin(self, task: Task, seed: int, budget: int) -> Conversation:
        """A new attempt.

        Args:
            task: what to do.
            seed: of everything random in the policy's play.
            budget: how many turns the attempt may take; the agent is told, the caller keeps to it.

        Raises:
            PolicyError: the policy cannot play this task.
        """
        return Conversation(self, task, seed, budget)

    async def __aenter__(self) -> Self:
        await self.policy.__aenter__()
        return self

    async def __aexit__(self, *exc: Any) -> None:
        await self.policy.__aexit__(*exc)


class Conversation:
    """One attempt, seen from the agent: observations go in, steps come out, one after the other.

    Keeps the records of all steps, but pictures of the last rounds only.

    Attributes:
        memory: what the agent has remembered.
        progress: its latest statement of progress.
        revisions: by step index, where a reply's memory broke the append-only rule.
    """

    def __init__(self, agent: Agent, task: Task, seed: int, budget: int) -> None:
        self._agent = agent
        self._task = task
        self._budget = budget
        self._rounds: list[Round] = []
        self._images: dict[str, bytes] = {}
        with _policy_errors(agent.policy.name):
            self._player = agent.policy.begin(task, seed)
        self.memory: dict[str, Any] = {}
        self.progress: dict[str, Any] = {}
        self.revisions: dict[int, Revision] = {}

    @property
    def steps(self) -> Sequence[Step]:
        """All steps so far; ``changed`` is known for all but the last."""
        return [past.step for past in self._rounds]

    async def turn(self, observation: Observation, image: bytes, at: float) -> Step:
        """Ask the policy what to do about this observation.

        Args:
            observation: what there is to see.
            image: its picture, encoded.
            at: seconds from the start of the attempt to the observation.

        Returns:
            The step, with the exact request and reply, and the action or why there is none. ``changed``
            is ``None``: only the next observation tells.

        Raises:
            PolicyError: the policy gave no reply. The conversation stands as it did before the call,
                so the same observation may be tried again.
        """
        config, profile = self._agent.config, self._agent.profile
        past = _with_effect(self._rounds, observation)
        index = len(past)
        revision = self.revisions.get(index - 1, Revision())
        now = Now(observation, index, self._budget, self.memory, revision, self.progress)
        request = build_request(self._task, past, now, config, profile)
        sent = profile.picture_size(observation.viewport, config.image_max_side)
        if observation.screenshot not in self._images and sent != observation.viewport:
            image = await asyncio.to_thread(fit, image, sent)
        held = {observation.screenshot: image} | self._images
        turn = Turn(
            task=self._task,
            observation=observation,
            messages=request.messages,
            images={name: held[name] for name in picture_names(request.messages)},
            steps=tuple(earlier.step for earlier in past),
            index=index,
            budget=self._budget,
            mode=profile.mode,
            prompt_format=config.prompt_format,
            screen=profile.screen(sent),
            space=config.actions,
        )
        reply = await self._ask(turn)
        parsed = self._parse(reply, turn)
        # A compact reply lists what is new only.
        unseen = list(self.memory)[: request.cut.entries]
        if config.prompt_format == "compact":
            unseen = list(self.memory)
        revision = self._remember(parsed, unseen)
        if revision:
            self.revisions[index] = revision
        step = Step(
            index,
            observation,
            request.messages,
            reply,
            at=at,
            revision=revision or None,
            **_meaning(parsed),
        )
        self._rounds = [*past, Round(step, parsed)]
        self._images = {name: held[name] for name in self._in_sight()}
        return step

    def _in_sight(self) -> set[str]:
        """The pictures that the next request may show again."""
        first = max(0, len(self._rounds) - self._agent.config.rounds)
        return {past.step.observation.screenshot for past in self._rounds[first:]}

    def _parse(self, reply: Reply, turn: Turn) -> ParsedReply | ParseError:
        parsed = parse_reply(
            reply.text,
            turn.mode,
            turn.prompt_format,
            screen=turn.screen,
            thinking=thinking_of(reply, self._agent.profile),
            space=turn.space,
        )
        if isinstance(parsed, ParseError) and reply.finish_reason == "length":
            return ParseError(parsed.kind, f"{parsed.message}; it was too long and was cut off")
        return parsed

    async def _ask(self, turn: Turn) -> Reply:
        name = self._agent.policy.name
        with _policy_errors(name):
            reply = await self._player.reply(turn)
        try:
            reply.text.encode()
        except UnicodeEncodeError as error:
            raise PolicyBadReply(f"{name} replied with text that is no Unicode") from error
        return reply

    def _remember(self, parsed: ParsedReply | ParseError, unseen: Sequence[str]) -> Revision:
        """Take in a reply's memory and progress; how its memory had to be mended."""
        revision = Revision()
        if isinstance(parsed, ParseError):
            return revision
        if parsed.memory is not None:
            limit = self._agent.config.memory_max_chars
            self.memory, revision = merge(self.memory, parsed.memory, max_chars=limit, unseen=unseen)
        if parsed.progress is not None:
            self.progress = parsed.progress
        return revision


def _with_effect(rounds: list[Round], observation: Observation) -> list[Round]:
    """The rounds, the last one now knowing whether it changed the screen."""
    if not rounds:
        return []
    last = rounds[-1]
    changed = last.step.observation.screenshot != observation.screenshot
    step = msgspec.structs.replace(last.step, changed=changed)
    return [*rounds[:-1], Round(step, last.parsed)]


def _meaning(parsed: ParsedReply | ParseError) -> dict[str, Any]:
    if isinstance(parsed, ParseError):
        return {"parse_error": str(parsed)}
    return {"action": parsed.action}


@contextmanager
def _policy_errors(name: str) -> Iterator[None]:
    """Whatever a policy raises is the policy's error; what it raised stays the cause."""
    try:
        yield
    except PolicyError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:300]
        message = f"the policy {name} failed: {type(error).__name__}: {said}"
        raise PolicyError(message, hint="this is a fault in the policy's own code") from error
