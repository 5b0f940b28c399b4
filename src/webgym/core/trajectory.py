"""The record of an attempt. Its unit for training is the step: exact request, exact reply."""

from __future__ import annotations

from typing import Any

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
        detail: how closely the endpoint was asked to look (``high``, ``low``); empty if it was not told.
    """

    screenshot: str
    width: int
    height: int
    detail: str = ""


class TextPart(msgspec.Struct, frozen=True, tag_field="type", tag="text"):
    """A text in a message."""

    text: str


class Message(msgspec.Struct, frozen=True):
    """One message of the request that a policy answered."""

    role: str
    content: tuple[TextPart | ImageRef, ...]


class Reply(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a policy said, whole.

    Attributes:
        text: the exact reply.
        reasoning: thinking that the endpoint itself had taken out of the reply; empty if there was none.
        finish_reason: as the endpoint gave it (``stop``, ``length``, ...).
        policy: name and version of the policy that replied.
        sampling: the exact sampling parameters of the request.
        prompt_tokens, completion_tokens: as the endpoint counted them; 0 if it did not.
        seconds: wall time from request to the last byte.
        tokens: exactly what was read and sampled, where the endpoint tells; training uses it as it is.
        weight_version: of the weights that replied, where the endpoint tells; else empty.
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


class Revision(msgspec.Struct, frozen=True, omit_defaults=True):
    """How a reply's memory broke the append-only rule, and so what was corrected.

    Attributes:
        dropped: keys that the reply left out; kept.
        rewritten: keys whose value it replaced; both values are kept.
        refused: keys for which there was no room.
    """

    dropped: tuple[str, ...] = ()
    rewritten: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.dropped or self.rewritten or self.refused)


class Step(msgspec.Struct, frozen=True, omit_defaults=True):
    """One turn: what was seen, what was asked, what was said, what it meant.

    Attributes:
        index: from 0.
        observation: what the agent saw before it replied.
        messages: the exact request; pictures by name.
        reply: the policy's reply.
        action: what the reply meant; ``None`` if it held no action.
        parse_error: why the reply held no action; empty if it did.
        changed: whether the next screenshot differs, see :meth:`followed_by`; ``None`` after the last step.
        at: seconds from the start of the attempt to the observation.
        revision: how the memory in the reply had to be corrected; ``None`` if it kept to the rule.
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
        """This step with ``changed`` filled in from the next observation. Nothing else decides it."""
        return msgspec.structs.replace(self, changed=observation.screenshot != self.observation.screenshot)


class Failure(msgspec.Struct, frozen=True):
    """The error that ended an attempt, as data."""

    code: str
    message: str


class Episode(msgspec.Struct, frozen=True, omit_defaults=True):
    """What happened in one attempt at one task, before anybody has judged it.

    Attributes:
        attempt_id: ``"<task id>#<sample>.<retry>"``; unique in a run.
        task_id: the task.
        sample: which of the planned samples of this task, from 0.
        retry: how many earlier attempts at this sample ended without a reward.
        seed: of everything random in the attempt.
        policy: name of the policy.
        started_at: Unix time, seconds.
        seconds: wall time.
        steps: all turns in order.
        ending: why it stopped.
        final: the observation after the last action; ``None`` where the last turn changed nothing
            (an answer) or could not be looked at any more.
        answer: the final answer, if there was one.
        final_state: what the offline website's server held for this attempt at its end; ``None`` if
            it was not asked.
        failure: the error that stopped it.
        session: lease and slot, for tracing a fault.
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

    @property
    def observations(self) -> list[Observation]:
        """Everything that was seen, in order. Index i < len(steps) is what step i saw."""
        seen = [step.observation for step in self.steps]
        return seen if self.final is None else [*seen, self.final]


class Trajectory(msgspec.Struct, frozen=True, omit_defaults=True):
    """An episode and what became of it: the record that the run store keeps.

    Attributes:
        episode: what happened.
        outcome: how the attempt ended.
        verdict: the judge's finding; ``None`` if the episode was not judged.
        judge_failure: why a judge had no verdict.
        judge_seconds: wall time of judging.
    """

    episode: Episode
    outcome: Outcome
    verdict: Verdict | None = None
    judge_failure: Failure | None = None
    judge_seconds: float = 0.0
