"""The agent: asks one policy for the actions of many concurrent attempts."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Self

from webgym.agent.config import AgentConfig
from webgym.agent.context import AttemptPosition, Round, picture_names, thinking_of
from webgym.agent.formats import build_request, format_of, parse_reply
from webgym.agent.image_codec import fit
from webgym.agent.memory import merge
from webgym.agent.parser import CALL_TAGS, ParsedReply, ParseError
from webgym.agent.policy import Policy, PolicyInput
from webgym.agent.profile import Profile
from webgym.agent.profiles import choose_profile
from webgym.core.action import Mode, Space
from webgym.core.background import is_cancelled
from webgym.core.errors import PolicyBadReply, PolicyError
from webgym.core.observation import Observation
from webgym.core.task import Task
from webgym.core.trajectory import Reply, Revision, Step, ended_by, refuse_untyped, was_cut_off


class AgentTraits(NamedTuple):
    """What the environment must know of an agent.

    Attributes:
        policy: name of the policy, for the record.
        mode: how targets are named.
        space: the action space.
        elements: whether observations must contain ``elements`` and ``text``.
    """

    policy: str
    mode: Mode
    space: Space = "paper"
    elements: bool = False


class Agent:
    """A policy with the settings for querying it. Entering the agent enters the policy.

    Args:
        policy: the policy that replies.
        config: prompt format, window, limits.
        profile: profile of the policy's model family; by default chosen by the config and the policy's name.

    Attributes:
        mode: how targets are named: by coordinates or by marks.

    Raises:
        ConfigError: the config names an unknown profile.
    """

    def __init__(
        self, policy: Policy, config: AgentConfig | None = None, profile: Profile | None = None
    ) -> None:
        self.policy = policy
        self.config = config or AgentConfig()
        self.profile = profile or choose_profile(self.config.profile, policy.name, self.config.mode)
        self.mode: Mode = self.profile.mode

    @property
    def traits(self) -> AgentTraits:
        """What the environment must know of it."""
        elements = self.policy.wants_elements or self.mode == "marks"
        return AgentTraits(self.policy.name, self.mode, self.config.actions, elements)

    def begin(self, task: Task, seed: int, budget: int) -> Conversation:
        """Start a new attempt.

        Args:
            task: the task to attempt.
            seed: seed of everything random in the policy.
            budget: number of turns that the attempt may take. It is stated in the prompt; the caller
                enforces it.

        Raises:
            PolicyError: the policy cannot attempt this task.
        """
        return Conversation(self, task, seed, budget)

    async def __aenter__(self) -> Self:
        await self.policy.__aenter__()
        return self

    async def __aexit__(self, *exc: Any) -> None:
        await self.policy.__aexit__(*exc)


class Dialogue:
    """One attempt without its policy: turns observations into requests, and replies into steps.

    Keeps the records of all steps, but only the pictures that the next request may show.

    Args:
        task: the task to attempt.
        budget: number of turns that the attempt may take. It is stated in the prompt; the caller enforces it.
        config: prompt format, window, limits.
        profile: profile of the model that replies.

    Attributes:
        memory: the agent's memory.
        progress: the agent's latest statement of progress.
        revisions: corrections to a reply's memory, by step index.
    """

    def __init__(self, task: Task, budget: int, config: AgentConfig, profile: Profile) -> None:
        self._task = task
        self._budget = budget
        self._config = config
        self._profile = profile
        self._rounds: list[Round] = []
        self._images: dict[str, bytes] = {}
        self._pending: _PendingRequest | None = None
        self.memory: dict[str, Any] = {}
        self.progress: dict[str, Any] = {}
        self.revisions: dict[int, Revision] = {}

    @property
    def steps(self) -> Sequence[Step]:
        """All steps so far; ``changed`` is known for all but the last."""
        return [past.step for past in self._rounds]

    async def request(self, observation: Observation, image: bytes) -> PolicyInput:
        """Build the request for this observation. It replaces an earlier request that has no reply yet.

        Args:
            observation: the current observation.
            image: its screenshot, encoded.
        """
        config, profile = self._config, self._profile
        past = list(self._rounds)
        if past:
            past[-1] = Round(past[-1].step.followed_by(observation), past[-1].parsed)
        index = len(past)
        revision = self.revisions.get(index - 1, Revision())
        now = AttemptPosition(observation, index, self._budget, self.memory, revision, self.progress)
        request = build_request(self._task, past, now, config, profile)
        sent = profile.picture_size(observation.picture_size, config.image_max_side)
        if observation.screenshot not in self._images and sent != observation.picture_size:
            image = await asyncio.to_thread(fit, image, sent)
        available = {observation.screenshot: image} | self._images
        turn = PolicyInput(
            task=self._task,
            observation=observation,
            messages=request.messages,
            images={name: available[name] for name in picture_names(request.messages)},
            steps=tuple(earlier.step for earlier in past),
            index=index,
            budget=self._budget,
            mode=profile.mode,
            prompt_format=config.prompt_format,
            screen=profile.screen(sent),
            space=config.actions,
            sampling=config.sampling,
        )
        # What a reply need not repeat is not dropped by being left out.
        unseen = list(self.memory)
        if not format_of(config.prompt_format).adds_memory:
            unseen = unseen[: request.cut.entries]
        self._pending = _PendingRequest(turn, past, available, unseen)
        return turn

    def receive(self, reply: Reply, at: float) -> Step:
        """Process the reply to the last request.

        Args:
            reply: the complete reply.
            at: seconds from the start of the attempt to the observation.

        Returns:
            The step, with the exact request and reply, and the action or the reason why there is none.
            ``changed`` is ``None``: it follows from the next observation.

        Raises:
            PolicyBadReply: the reply is not valid Unicode, or it was the endpoint that ended it.
            PolicyError: it is no reply, or a part of it is of the wrong type.
        """
        assert self._pending is not None, "request comes first"
        pending, turn = self._pending, self._pending.turn
        try:
            refuse_untyped(reply, Reply)
            if min(reply.seconds, reply.prompt_tokens, reply.completion_tokens) < 0:
                raise ValueError("its seconds or tokens are negative")
        except (TypeError, ValueError, OverflowError) as error:
            raise PolicyError(f"the reply cannot be recorded: {error}", hint=_OWN_BUG) from error
        try:
            reply.text.encode()
        except UnicodeEncodeError as error:
            raise PolicyBadReply(f"{reply.policy} replied with text that is not valid Unicode") from error
        parsed = self._parse(reply, turn)
        ended = ended_by(reply.finish_reason)
        if ended in ("engine", "filter") or (ended == "unknown" and isinstance(parsed, ParseError)):
            raise PolicyBadReply(
                f"the endpoint ended the reply of {reply.policy}: finish_reason {reply.finish_reason!r}",
                hint="look at the endpoint's log, or its content filter",
            )
        revision = self._remember(parsed, pending.unseen)
        if revision:
            self.revisions[turn.index] = revision
        read: dict[str, Any] = (
            {"parse_error": str(parsed)} if isinstance(parsed, ParseError) else {"action": parsed.action}
        )
        step = Step(
            turn.index, turn.observation, turn.messages, reply, at=at, revision=revision or None, **read
        )
        self._rounds = [*pending.past, Round(step, parsed)]
        window = self._rounds[max(0, len(self._rounds) - self._config.rounds) :]
        shown_again = {past.step.observation.screenshot for past in window}
        self._images = {name: pending.images[name] for name in shown_again}
        self._pending = None
        return step

    def _parse(self, reply: Reply, turn: PolicyInput) -> ParsedReply | ParseError:
        parsed = parse_reply(
            reply.text,
            turn.mode,
            turn.prompt_format,
            screen=turn.screen,
            thinking=thinking_of(reply, self._profile),
            space=turn.space,
        )
        is_cut = was_cut_off(reply.finish_reason)
        if isinstance(parsed, ParseError):
            if reply.reasoning and not reply.text.strip():
                parsed = ParseError(parsed.kind, "the reply holds nothing but thinking")
            note = "; it was too long and was cut off" if is_cut else ""
            return ParseError(parsed.kind, parsed.message + note)
        has_end = format_of(turn.prompt_format).has_end
        # What is left of an action without an end of its own may be another action.
        if not has_end and (is_cut or ended_by(reply.finish_reason) == "unknown"):
            return ParseError("unclosed_tool_call", "the reply was too long and was cut off")
        # A family that no profile knows may think without a tag: then this call is a draft.
        if is_cut and has_end and not reply.text.rstrip().endswith(CALL_TAGS[1]):
            return ParseError(
                "unfinished_thinking", "the reply went on after its tool call, was too long and was cut off"
            )
        return parsed

    def _remember(self, parsed: ParsedReply | ParseError, unseen: Sequence[str]) -> Revision:
        """Update memory and progress from a reply; returns the corrections to its memory."""
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
class _PendingRequest:
    """A request that waits for its reply.

    Attributes:
        turn: the request.
        past: the rounds before it.
        images: pictures of the window, by name.
        unseen: keys of memory entries that the request does not show.
    """

    turn: PolicyInput
    past: list[Round]
    images: dict[str, bytes]
    unseen: list[str]


class Conversation(Dialogue):
    """One attempt of an agent: takes observations and returns steps, one after the other."""

    def __init__(self, agent: Agent, task: Task, seed: int, budget: int) -> None:
        super().__init__(task, budget, agent.config, agent.profile)
        self._name = agent.policy.name
        with _policy_errors(self._name):
            self._session = agent.policy.begin(task, seed)

    async def turn(self, observation: Observation, image: bytes, at: float) -> Step:
        """Get the policy's next step for this observation: :meth:`request`, the reply, :meth:`receive`.

        Raises:
            PolicyError: the policy gave no reply, or none that counts as its own. The conversation is
                as it was before the call, so the same observation may be tried again.
        """
        turn = await self.request(observation, image)
        for is_last in (False, True):
            with _policy_errors(self._name):
                reply = await self._session.reply(turn)
            try:
                return self.receive(reply, at)
            except PolicyBadReply:
                if is_last or ended_by(reply.finish_reason) != "unknown":
                    raise
        raise AssertionError("the last reply is returned or raises")


_OWN_BUG: Final = "this is a bug in the policy's own code"


@contextmanager
def _policy_errors(name: str) -> Iterator[None]:
    """Turn any exception of a policy into a :class:`PolicyError`, with the exception as its cause."""
    try:
        yield
    except PolicyError:
        raise
    except (Exception, asyncio.CancelledError) as error:
        if is_cancelled(error):
            raise
        detail = " ".join(str(error).split())[:300]
        message = f"the policy {name} failed: {type(error).__name__}: {detail}"
        raise PolicyError(message, hint=_OWN_BUG) from error
