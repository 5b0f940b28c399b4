"""The record of an attempt. Its unit for training is the step: exact request, exact reply."""

from __future__ import annotations

from typing import Any, Final, Literal, TypeAlias

import msgspec

from webgym.core.action import Action
from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.tokens import ReplyTokens
from webgym.core.verdict import Verdict


class ImageRef(msgspec.Struct, frozen=True, omit_defaults=True, tag_field="type", tag="image"):
    """A picture in a message, by its name in the run's screenshots.

    Attributes:
        screenshot: the picture's name.
        width, height: size at which it was sent, pixels.
        detail: the API's ``detail`` of the picture (``high``, ``low``); empty if it was not set.
    """

    screenshot: str
    width: int
    height: int
    detail: str = ""


class TextPart(msgspec.Struct, frozen=True, tag_field="type", tag="text"):
    """A piece of text in a message."""

    text: str


class Message(msgspec.Struct, frozen=True):
    """One message of the request that a policy answered."""

    role: str
    content: tuple[TextPart | ImageRef, ...]


EndedBy: TypeAlias = Literal["model", "engine", "filter", "unknown"]
_CUT_OFF: Final = ("length", "max_tokens", "max_output_tokens", "model_length")
_ENDED_BY: Final[dict[EndedBy, tuple[str, ...]]] = {
    "model": (
        *("", "stop", "eos", "eos_token", "stop_sequence", "end_turn", "tool_calls", "function_call"),
        *_CUT_OFF,
    ),
    "engine": (
        *("abort", "aborted", "cancelled", "canceled", "error", "failed"),
        *("insufficient_system_resource", "engine_overloaded"),
    ),
    "filter": ("content_filter", "safety", "recitation", "prohibited_content", "blocklist", "spii"),
}


def ended_by(finish_reason: str) -> EndedBy:
    """What ended a reply, in any case of letters and whatever detail follows a colon.

    A reply is the model's own if it ended it itself or at the token limit. One that the endpoint's engine or
    filter ended is the endpoint's fault, and the engine's may pass. Under an unknown word, a reply that can
    be read is the model's, and any other is the endpoint's.
    """
    word = _word(finish_reason)
    return next((ended for ended, words in _ENDED_BY.items() if word in words), "unknown")


def was_cut_off(finish_reason: str) -> bool:
    """Whether a reply ended at the token limit, read as by :func:`ended_by`."""
    return _word(finish_reason) in _CUT_OFF


def _word(finish_reason: str) -> str:
    return finish_reason.partition(":")[0].strip().casefold()


class Reply(msgspec.Struct, frozen=True, omit_defaults=True):
    """A policy's complete reply.

    Attributes:
        text: the exact reply.
        reasoning: thinking that the endpoint itself separated from the reply; empty if there was none.
        finish_reason: as the endpoint gave it (``stop``, ``length``, ...).
        policy: name and version of the policy that replied.
        sampling: the exact sampling parameters of the request.
        prompt_tokens, completion_tokens: as the endpoint counted them; 0 if it did not.
        seconds: wall time from request to the last byte.
        tokens: the tokens that were read and sampled, which training uses unchanged; ``None`` if the endpoint
            does not return them.
        weight_version: version of the weights that replied; empty if the endpoint does not return it.
        separated: whether the endpoint separates thinking, even if it found none in this reply.
    """

    text: str
    policy: str
    finish_reason: str = "stop"
    sampling: dict[str, Any] = {}
    prompt_tokens: int = 0
    completion_tokens: int = 0
    seconds: float = 0.0
    reasoning: str = ""
    tokens: ReplyTokens | None = None
    weight_version: str = ""
    separated: bool = False

    @property
    def whole(self) -> str:
        """The text after the reasoning, as chat templates write them and models sample them."""
        if not self.reasoning:
            return self.text
        if self.reasoning.endswith("\n") or self.text.startswith("\n"):  # split without stripping
            return f"<think>\n{self.reasoning}</think>{self.text}"
        return f"<think>\n{self.reasoning}\n</think>\n\n{self.text}"


class Revision(msgspec.Struct, frozen=True, omit_defaults=True):
    """Corrections to a reply's memory that violated the append-only rule.

    Attributes:
        dropped: keys that the reply left out; they are kept.
        rewritten: keys whose value the reply replaced; both values are kept.
        refused: keys that did not fit into the memory.
    """

    dropped: tuple[str, ...] = ()
    rewritten: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.dropped or self.rewritten or self.refused)


class Step(msgspec.Struct, frozen=True, omit_defaults=True):
    """One turn: the observation, the request, the reply, and the action that it means.

    Attributes:
        index: from 0.
        observation: what the agent saw before it replied.
        messages: the exact request; pictures by name.
        reply: the policy's reply.
        action: what the reply meant; ``None`` if it held no action.
        parse_error: why the reply held no action; empty if it did.
        changed: whether the next screenshot differs, see :meth:`followed_by`; ``None`` after the last step.
        at: seconds from the start of the attempt to the observation.
        revision: corrections to the memory in the reply; ``None`` if there were none.
    """

    index: int
    observation: Observation
    messages: tuple[Message, ...]
    reply: Reply
    action: Action | None = None
    parse_error: str = ""
    changed: bool | None = None
    at: float = 0.0
    revision: Revision | None = None

    def followed_by(self, observation: Observation) -> Step:
        """This step with ``changed`` set from the next observation. ``changed`` is set nowhere else.

        Args:
            observation: of the step after it, or the last one of the episode.
        """
        return msgspec.structs.replace(self, changed=observation.screenshot != self.observation.screenshot)


class Failure(msgspec.Struct, frozen=True):
    """The error that ended an attempt, as data."""

    code: str
    message: str


DeadCode: TypeAlias = Literal["name_gone", "tls", "no_answer", "server_error", "region", "parked", "robots"]
"""Why a website is dead: the codes of :class:`webgym.core.errors.SiteDead`'s kinds, without ``site_``."""


class Arrival(msgspec.Struct, frozen=True, omit_defaults=True):
    """What the environment found at the task's website before the agent acted.

    Attributes:
        state: ``open``: the attempt began. ``refused``: the start page was refused twice. ``dead``: there is
            none.
        code: why it is dead; else empty.
        why: the same, or why it was refused, for people.
        has_login_wall: whether it asks for an account: 401, or a redirect to a form for one.
        seconds: from the request to the observation of the page; the longest time, if there were several.
        identity: who the browser said that it was (:attr:`webgym.core.identity.Identity.label`).
        route: the way that its connections took.
    """

    state: Literal["open", "refused", "dead"]
    code: DeadCode | Literal[""] = ""
    why: str = ""
    has_login_wall: bool = False
    seconds: float = 0.0
    identity: str = ""
    route: str = "direct"


class Episode(msgspec.Struct, frozen=True, omit_defaults=True):
    """The record of one attempt at one task, before it is judged.

    Attributes:
        attempt_id: ``"<task id>#<sample>.<retry>"``; unique in a run.
        task_id: the task.
        sample: which of the planned samples of this task, from 0.
        retry: how many earlier attempts at this sample ended without a reward.
        seed: seed of everything random in the attempt.
        policy: name of the policy.
        started_at: Unix time, seconds.
        seconds: wall time.
        steps: all turns in order.
        ending: why it stopped.
        final: the observation after the last action; ``None`` if the last turn did not act on the page (an
            answer), or the page could not be observed any more.
        answer: the final answer, if there was one.
        final_state: the state of this attempt on the offline website's server at its end; ``None`` if it was
            not queried.
        failure: the error that stopped it.
        session: lease and slot, for tracing a fault.
        arrival: what was found at the start page; ``None`` if no browser came so far.
    """

    attempt_id: str
    task_id: str
    sample: int
    retry: int
    seed: int
    policy: str
    started_at: float
    seconds: float
    steps: tuple[Step, ...]
    ending: Ending
    final: Observation | None = None
    answer: str | None = None
    final_state: dict[str, Any] | None = None
    failure: Failure | None = None
    session: str = ""
    arrival: Arrival | None = None

    @property
    def observations(self) -> list[Observation]:
        """All observations in order. Index i < len(steps) is the observation of step i."""
        before_steps = [step.observation for step in self.steps]
        return before_steps if self.final is None else [*before_steps, self.final]


class Trajectory(msgspec.Struct, frozen=True, omit_defaults=True):
    """An episode with its outcome and verdict: the record that the run store keeps.

    Attributes:
        episode: the attempt.
        outcome: how the attempt ended.
        verdict: the judge's verdict; ``None`` if the episode was not judged.
        judge_failure: why the judge gave no verdict.
        judge_seconds: wall time of judging.
    """

    episode: Episode
    outcome: Outcome
    verdict: Verdict | None = None
    judge_failure: Failure | None = None
    judge_seconds: float = 0.0

    @property
    def is_judged(self) -> bool:
        """Whether the attempt has, or may yet get, a verdict: it ended regularly, and is not retried."""
        return self.episode.ending.is_regular and not self.outcome.is_retried


def refuse_untyped(record: object, kind: type[msgspec.Struct]) -> None:
    """Refuse a record that would not be read again: structs take values of any type.

    Raises:
        TypeError: it is of another kind, or holds what no record can.
        ValueError: a value is of another type; the message says which.
        OverflowError: a number is too large.
    """
    if not isinstance(record, kind):
        raise TypeError(f"this is a {type(record).__name__}, not a {kind.__name__}")
    try:
        body = msgspec.json.encode(record)
    except UnicodeEncodeError:  # lone surrogates are replaced where it is stored
        msgspec.convert(msgspec.to_builtins(record), kind)
    else:
        msgspec.json.decode(body, type=kind)
