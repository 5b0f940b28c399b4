"""The agent: asks one policy for the actions of many concurrent attempts."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Self

from webgym.agent.config import AgentConfig
from webgym.agent.context import AttemptPosition, Round, build_request, picture_names, thinking_of
from webgym.agent.image_codec import fit
from webgym.agent.memory import merge
from webgym.agent.parser import ParsedReply, ParseError, parse_reply
from webgym.agent.policy import Policy, PolicyInput
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


class Dialogue:
    """One attempt, seen from whoever replies: views go in as requests, replies come back as steps.

    Keeps the records of all steps, but pictures of the last rounds only.

    Args:
        task: what to do.
        budget: how many turns the attempt may take; the agent is told, the caller keeps to it.
        config: prompt format, window, limits.
        profile: of the model that replies.

    Attributes:
        memory: what the agent has remembered.
        progress: its latest statement of progress.
        revisions: by step index, where a reply's memory broke the append-only rule.
    """

    def __init__(self, task: Task, budget: int, config: AgentConfig, profile: Profile) -> None:
        self._task = task
        self._budget = budget
        self._config = config
        self._profile = profile
        self._rounds: list[Round] = []
        self._images: dict[str, bytes] = {}
        self._asked: _Asked | None = None
        self.memory: dict[str, Any] = {}
        self.progress: dict[str, Any] = {}
        self.revisions: dict[int, Revision] = {}

    @property
    def steps(self) -> Sequence[Step]:
        """All steps so far; ``changed`` is known for all but the last."""
        return [past.step for past in self._rounds]

    async def request(self, observation: Observation, image: bytes) -> PolicyInput:
        """What to ask about this observation. Asking again, for the same or another, takes this one's place.

        Args:
            observation: what there is to see.
            image: its picture, encoded.
        """
        config, profile = self._config, self._profile
        past = _with_effect(self._rounds, observation)
        index = len(past)
        revision = self.revisions.get(index - 1, Revision())
        now = AttemptPosition(observation, index, self._budget, self.memory, revision, self.progress)
        request = build_request(self._task, past, now, config, profile)
        sent = profile.picture_size(observation.viewport, config.image_max_side)
        if observation.screenshot not in self._images and sent != observation.viewport:
            image = await asyncio.to_thread(fit, image, sent)
        held = {observation.screenshot: image} | self._images
        turn = PolicyInput(
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
        # A compact reply lists what is new only.
        unseen = list(self.memory)
        if config.prompt_format != "compact":
            unseen = unseen[: request.cut.entries]
        self._asked = _Asked(turn, past, held, unseen)
        return turn

    def receive(self, reply: Reply, at: float) -> Step:
        """Take in the reply to the last request.

        Args:
            reply: whole.
            at: seconds from the start of the attempt to the observation.

        Returns:
            The step, with the exact request and reply, and the action or why there is none. ``changed``
            is ``None``: only the next observation tells.

        Raises:
            PolicyBadReply: the reply is no text.
        """
        assert self._asked is not None, "request comes first"
        asked, turn = self._asked, self._asked.turn
        try:
            reply.text.encode()
        except UnicodeEncodeError as error:
            raise PolicyBadReply(f"{reply.policy} replied with text that is no Unicode") from error
        parsed = self._parse(reply, turn)
        revision = self._remember(parsed, asked.unseen)
        if revision:
            self.revisions[turn.index] = revision
        step = Step(
            turn.index,
            turn.observation,
            turn.messages,
            reply,
            at=at,
            revision=revision or None,
            **_meaning(parsed),
        )
        self._rounds = [*asked.past, Round(step, parsed)]
        self._images = {name: asked.images[name] for name in self._in_sight()}
        self._asked = None
        return step

    def _in_sight(self) -> set[str]:
        """The pictures that the next request may show again."""
        first = max(0, len(self._rounds) - self._config.rounds)
        return {past.step.observation.screenshot for past in self._rounds[first:]}

    def _parse(self, reply: Reply, turn: PolicyInput) -> ParsedReply | ParseError:
        parsed = parse_reply(
            reply.text,
            turn.mode,
            turn.prompt_format,
            screen=turn.screen,
            thinking=thinking_of(reply, self._profile),
            space=turn.space,
        )
        if isinstance(parsed, ParseError) and reply.finish_reason == "length":
            return ParseError(parsed.kind, f"{parsed.message}; it was too long and was cut off")
        return parsed

    def _remember(self, parsed: ParsedReply | ParseError, unseen: Sequence[str]) -> Revision:
        """Take in a reply's memory and progress; how its memory had to be corrected."""
        revision = Revision()
        if isinstance(parsed, ParseError):
            return revision
        if parsed.memory is not None:
            limit = self._config.memory_max_chars
            self.memory, revision = merge(self.memory, parsed.memory, max_chars=limit, unseen=unseen)
        if parsed.progress is not None:
            self.progress = parsed.progress
        return revision


@dataclass(frozen=True)
class _Asked:
    """A request that waits for its reply: with the rounds before it, the pictures at hand, and the entries of
    memory that it does not show."""

    turn: PolicyInput
    past: list[Round]
    images: dict[str, bytes]
    unseen: list[str]


class Conversation(Dialogue):
    """An attempt of the agent's: observations go in, steps come out, one after the other."""

    def __init__(self, agent: Agent, task: Task, seed: int, budget: int) -> None:
        super().__init__(task, budget, agent.config, agent.profile)
        self._name = agent.policy.name
        with _policy_errors(self._name):
            self._player = agent.policy.begin(task, seed)

    async def turn(self, observation: Observation, image: bytes, at: float) -> Step:
        """Ask the policy what to do about this observation: see :meth:`request` and :meth:`receive`.

        Raises:
            PolicyError: the policy gave no reply. The conversation stands as it did before the call,
                so the same observation may be tried again.
        """
        turn = await self.request(observation, image)
        with _policy_errors(self._name):
            reply = await self._player.reply(turn)
        return self.receive(reply, at)


def _with_effect(rounds: list[Round], observation: Observation) -> list[Round]:
    """The rounds, the last one now knowing whether it changed the screen."""
    if not rounds:
        return []
    *earlier, last = rounds
    return [*earlier, Round(last.step.followed_by(observation), last.parsed)]


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
