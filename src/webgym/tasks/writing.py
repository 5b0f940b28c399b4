"""What a model writes when a task set is built: website and domain, rubrics, rewritten tasks.

Nothing is taken that a check refuses. The model is shown what it said and why it cannot be used, and asked
again, a bounded number of times. Then :class:`webgym.core.errors.LLMUnusable` says why.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Final

import msgspec
from pydantic import BaseModel, ConfigDict, Field

from webgym.core.errors import LLMUnusable
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.text import fold, says
from webgym.core.websites import host_of
from webgym.llm import Completes, Completion, Sampling, ask_for
from webgym.tasks import prompts
from webgym.tasks.rules import Asked, Draft, DraftGroup, Finding, check_rubric
from webgym.tasks.rules.reading import Text
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF

_REASONS: Final = 6
"""Findings that a model is told at once; the others may well go with them."""


class WritingLimits(BaseModel):
    """How often to ask, and what a rewritten task may look like."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    tries: int = Field(default=3, ge=1)
    """How often a model is asked for one thing, in all."""

    shortest_chars: int = Field(default=12, ge=1)
    """A rewritten task has at least so many characters."""

    times_parent: float = Field(default=2.0, gt=0)
    """A rewritten task has at most so many times its parent's characters, and ``more_chars`` on top."""

    more_chars: int = Field(default=200, ge=0)
    """What short parents leave for their children's own words, in characters."""

    def longest(self, parent: str) -> int:
        """Characters that a task made from this one may have."""
        return int(self.times_parent * len(parent)) + self.more_chars


_USUAL: Final = WritingLimits()


class Inferred(msgspec.Struct, frozen=True):
    """Where a task starts, and what kind it is.

    Attributes:
        website: URL.
        domain, subdomain: of :data:`webgym.tasks.taxonomy.DOMAINS`.
    """

    website: str
    domain: str
    subdomain: str


async def infer_website(
    model: Completes, task: SourceTask, *, sampling: Sampling | None = None, limits: WritingLimits = _USUAL
) -> Inferred:
    """The website of a task that has none, and its domain and subdomain. A website that is given stays.

    Raises:
        LLMUnusable: no reply named a website and a subdomain of the taxonomy.
        LLMError: the model gave no reply.
    """

    def check(reply: prompts.WebsiteReply) -> str | None:
        if reply.subdomain not in DOMAIN_OF:
            return f"{reply.subdomain!r} is none of the subdomains in the list."
        return None if task.website is not None else _no_website(reply.website)

    reply = await ask_for(
        model,
        prompts.for_website(task),
        prompts.WebsiteReply,
        check=check,
        tries=limits.tries,
        sampling=sampling,
    )
    website = task.website if task.website is not None else _url(reply.website)
    return Inferred(website, DOMAIN_OF[reply.subdomain], reply.subdomain)


def _no_website(said: str) -> str | None:
    """Why this is no public website, if it is none."""
    try:
        host = host_of(said)
    except ValueError:
        return f"{said!r} is no address of a website."
    is_public = "." in host and not host.replace(".", "").isdigit() and not host.endswith((".local", ".test"))
    return None if is_public else f"{said!r} is no public website."


def _url(said: str) -> str:
    said = said.strip()
    return said if said.lower().startswith(("http://", "https://")) else f"https://{host_of(said)}/"


class Written(msgspec.Struct, frozen=True):
    """A rubric that was taken, and what was remarked on it.

    Attributes:
        rubric: which keeps the rules of severity ``error``.
        findings: rules of severity ``warning`` that it seems to break.
    """

    rubric: Rubric
    findings: tuple[Finding, ...]


async def write_rubric(
    model: Completes, task: SourceTask, *, sampling: Sampling | None = None, limits: WritingLimits = _USUAL
) -> Written:
    """A task's rubric. What breaks a rule of severity ``error`` (:mod:`webgym.tasks.rules`) is not taken.

    Raises:
        LLMUnusable: no reply was a rubric that keeps the rules.
        LLMError: the model gave no reply.
    """
    asked = _asked_by(task)
    findings: list[Finding] = []

    def check(reply: prompts.RubricReply) -> str | None:
        findings[:] = check_rubric(_draft(reply), asked)
        errors = [finding.message for finding in findings if finding.severity == "error"]
        return "; ".join(errors[:_REASONS]) + "." if errors else None

    reply = await ask_for(
        model,
        prompts.for_rubric(task),
        prompts.RubricReply,
        check=check,
        tries=limits.tries,
        sampling=sampling,
    )
    groups = (
        FactGroup(group.id, _line(group.description), tuple(map(_line, group.facts)))
        for group in reply.fact_groups
    )
    return Written(Rubric(tuple(groups)), tuple(findings))


def review(task: SourceTask | Task, rubric: Rubric) -> list[Finding]:
    """What the rules find in a rubric that is there already."""
    return check_rubric(Draft.of(rubric), _asked_by(task))


def _asked_by(task: SourceTask | Task) -> Asked:
    answers = tuple(answer for answer in (task.reference_answer, task.example_answer) if answer)
    is_derived = isinstance(task, Task) and task.parent_id is not None
    hints = task.hints if isinstance(task, SourceTask) else ()
    return Asked(task.instruction, prompts.known_website(task) or "", hints, answers, is_derived)


def _draft(reply: prompts.RubricReply) -> Draft:
    groups = tuple(DraftGroup(group.id, group.description, group.facts) for group in reply.fact_groups)
    return Draft(groups, reply.difficulty)


def _line(text: str) -> str:
    return " ".join(text.split())


async def rewrite(
    model: Completes,
    task: Task,
    groups: Sequence[FactGroup],
    *,
    sampling: Sampling | None = None,
    limits: WritingLimits = _USUAL,
) -> str:
    """The text of the task that asks for these of a task's groups alone.

    Raises:
        LLMUnusable: no reply was such a text.
        LLMError: the model gave no reply.
    """
    messages = prompts.for_rewriting(task, groups)
    return await _ask_for_text(
        model,
        messages,
        check=lambda text: refused_rewriting(text, task, groups, limits),
        tries=limits.tries,
        sampling=sampling,
    )


async def _ask_for_text(
    model: Completes,
    messages: prompts.Messages,
    *,
    check: Callable[[str], str | None],
    tries: int,
    sampling: Sampling | None,
) -> str:
    """As :func:`webgym.llm.ask_for`, for plain text."""
    asked = list(messages)
    replies: list[str] = []
    reason = ""
    for _ in range(tries):
        completion = await model.complete(asked, sampling)
        said = completion.text or completion.refusal
        text = _without_thinking(said)
        reason = _no_text(completion, text) or check(text) or ""
        if not reason:
            return text
        replies.append(said)
        asked += [
            {"role": "assistant", "content": said or "(nothing)"},
            {"role": "user", "content": f"This reply cannot be used: {reason}\nAnswer again, in full."},
        ]
    raise LLMUnusable(
        f"the model was asked {tries} times and wrote no usable text: {reason}",
        hint="another model may do better",
        reason=reason,
        replies=tuple(replies),
    )


def _without_thinking(text: str) -> str:
    text = text.strip()
    if text.startswith("<think>"):
        text = text.partition("</think>")[2]
    return text.strip()


def _no_text(completion: Completion, text: str) -> str | None:
    if completion.refusal or completion.finish_reason == "content_filter":
        return "it is a refusal, not the text of a task."
    if completion.finish_reason == "length":
        return "it was cut off before its end. Be briefer."
    return None if text else "it is empty."


# --- what a rewritten task must be ------------------------------------------------------------------------

_PREAMBLE: Final = re.compile(
    r"(?:sure|certainly|of course|okay|absolutely)\b[,.!:]|here(?:'s| is| are)\b.{0,60}"
    r"\b(?:task|version|rewrit)"
    r"|(?:the |a )?(?:new|rewritten|revised|simplified) (?:task|version|instruction)\b.{0,40}:"
    r"|(?:task|instruction|rewrite|output|answer|response)\s*:",
    re.IGNORECASE,
)
_REFUSAL: Final = re.compile(
    r"(?:i'm sorry|i am sorry|sorry\b|i can(?:no|')t\b|i'm (?:unable|not able)|i am (?:unable|not able)"
    r"|as an ai\b)",
    re.IGNORECASE,
)
_MARKDOWN: Final = re.compile(r"(?m)^\s*(?:#{1,6} |```|[-*•] |\d+[.)] |> )|\*\*|```|^\s*\|.*\|\s*$")
_WRAPPED: Final = (('"', '"'), ("“", "”"), ("'", "'"), ("`", "`"), ("«", "»"), ("‘", "’"))
_SHORTEST_ANSWER: Final = 4


def refused_rewriting(
    text: str, task: Task, groups: Sequence[FactGroup], limits: WritingLimits = _USUAL
) -> str | None:
    """Why a text cannot stand for the task that asks for these groups alone; ``None`` if it can."""
    return _ill_formed(text, task.instruction, limits) or _untrue(text, task, groups)


def _ill_formed(text: str, parent: str, limits: WritingLimits) -> str | None:
    folded = fold(text)
    if _REFUSAL.match(folded):
        return "it is a refusal, not the text of a task."
    if _PREAMBLE.match(folded):
        return "it begins with an introduction; write the text of the task alone."
    if text[0] in "{[" and text[-1] in "}]":
        return "it is JSON; write the text of the task alone."
    if any(
        len(text) > 1 and text[0] == first and text[-1] == last and last not in text[1:-1]
        for first, last in _WRAPPED
    ):
        return "it stands in quotation marks; write the text of the task alone."
    if _MARKDOWN.search(text) and not _MARKDOWN.search(parent):
        return "it holds markdown; write plain text."
    if "\n" in text and "\n" not in parent:
        return "it has several lines; write one paragraph."
    if _plain(text) == _plain(parent):
        return "it is the original task; write one that asks for the given facts alone."
    if len(text) < limits.shortest_chars:
        return f"it has {len(text)} characters; that is too short for a task."
    if len(text) > limits.longest(parent):
        return f"it has {len(text)} characters; write at most {limits.longest(parent)}."
    return None


def _untrue(text: str, task: Task, groups: Sequence[FactGroup]) -> str | None:
    """Whether the numbers are those of the given facts, and no answer is told."""
    said, parent, site = Text(text), Text(task.instruction), Text(task.website).counts
    wanted = Text("\n".join(fact for group in groups for fact in group.facts))
    ids = {group.id for group in groups}
    others = [group for group in task.rubric.groups if group.id not in ids]
    unwanted = Text("\n".join(fact for group in others for fact in group.facts))
    if invented := said.numbers - parent.counts - wanted.counts - site:
        return f"it states {_listed(invented)}, which neither the original task nor the facts state."
    if lost := (wanted.numbers & parent.counts) - said.counts:
        return f"it leaves out {_listed(lost)}, which the facts ask for."
    if kept := (said.numbers & unwanted.numbers) - wanted.counts - site:
        return f"it still asks for {_listed(kept)}, which only facts say that were not given."
    answers = [answer for answer in (task.reference_answer, task.example_answer) if answer]
    told = [answer for answer in answers if len(answer) >= _SHORTEST_ANSWER and says(said.folded, answer)]
    if any(not says(parent.folded, answer) for answer in told):
        return "it gives the answer away."
    return None


def _plain(text: str) -> str:
    return "".join(filter(str.isalnum, fold(text)))


def _listed(numbers: frozenset[str]) -> str:
    return ", ".join(sorted(numbers))
