"""Model calls of a task set's construction: website and domain, rubrics, rewritten tasks.

Nothing is taken that a check refuses. The model is shown what it said and why it cannot be used, and asked
again, a bounded number of times. Then :class:`webgym.core.errors.LLMUnusable` says why.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from webgym.core.errors import LLMUnusable
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.websites import host_of
from webgym.llm import Completes, Completion, ask_for
from webgym.tasks import prompts
from webgym.tasks.rewriting import DEFAULT_LIMITS, WritingLimits, refused_rewriting
from webgym.tasks.rules import Asked, Draft, DraftGroup, Finding, check_rubric
from webgym.tasks.rules.wording import with_capital_or
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF

_REASONS: Final = 6
"""Findings that a model is told at once; the others may well go with them."""


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
    model: Completes, task: SourceTask, *, limits: WritingLimits = DEFAULT_LIMITS
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
    """An accepted rubric, and remarks on it.

    Attributes:
        rubric: which keeps the rules of severity ``error``.
        findings: rules of severity ``warning`` that it seems to break.
    """

    rubric: Rubric
    findings: tuple[Finding, ...]


async def write_rubric(
    model: Completes, task: SourceTask, *, limits: WritingLimits = DEFAULT_LIMITS
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
    )
    groups = (
        FactGroup(group.id, _line(group.description), tuple(map(_line, group.facts)))
        for group in _draft(reply).fact_groups
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
    """What the model wrote. Style that can be set right is no reason to ask again: OR gets its capitals."""
    groups = tuple(
        DraftGroup(group.id, group.description, tuple(map(with_capital_or, group.facts)))
        for group in reply.fact_groups
    )
    return Draft(groups, reply.difficulty)


def _line(text: str) -> str:
    return " ".join(text.split())


async def rewrite(
    model: Completes,
    task: Task,
    groups: Sequence[FactGroup],
    *,
    limits: WritingLimits = DEFAULT_LIMITS,
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
    )


async def _ask_for_text(
    model: Completes,
    messages: prompts.Messages,
    *,
    check: Callable[[str], str | None],
    tries: int,
) -> str:
    """As :func:`webgym.llm.ask_for`, for plain text."""
    asked = list(messages)
    replies: list[str] = []
    reason = ""
    for _ in range(tries):
        completion = await model.complete(asked)
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
