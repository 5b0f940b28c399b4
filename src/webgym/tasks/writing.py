"""Model calls of a task set's construction: website and domain, rubrics, rewritten tasks.

Every reply is checked. If it is refused, the model is asked again with its reply and the reason, a limited
number of times; then :class:`webgym.core.errors.LLMUnusable` is raised with the last reason.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from webgym.core.errors import LLMUnusable
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.text import THOUGHT, THOUGHT_END
from webgym.core.trajectory import ended_by, was_cut_off
from webgym.core.websites import host_of, start_url_problem
from webgym.llm.completion import Completes, Completion
from webgym.llm.structured import ask_for
from webgym.tasks import prompts
from webgym.tasks.rewriting import DEFAULT_LIMITS, WritingLimits, refused_rewriting
from webgym.tasks.rules import Asked, Draft, DraftGroup, Finding, check_rubric
from webgym.tasks.rules.wording import LONGEST_FACT_CHARS, with_capital_or
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF

_REASONS: Final = 6
"""Most findings that a model is sent at once; fixing these often fixes the others."""


class Inferred(msgspec.Struct, frozen=True):
    """The inferred website and domain of a task.

    Attributes:
        website: URL where the task starts.
        domain, subdomain: of :data:`webgym.tasks.taxonomy.DOMAINS`.
    """

    website: str
    domain: str
    subdomain: str


async def infer_website(
    model: Completes, task: SourceTask, *, limits: WritingLimits = DEFAULT_LIMITS
) -> Inferred:
    """Infer the domain and subdomain of a task, and its website if it has none.

    Raises:
        LLMUnusable: no reply had a valid website and a subdomain of the taxonomy.
        LLMError: the model gave no reply.
    """

    def check(reply: prompts.WebsiteReply) -> str | None:
        if reply.subdomain not in DOMAIN_OF:
            return f"{reply.subdomain!r} is none of the subdomains in the list."
        return None if task.website is not None else _no_website(reply.website)

    reply = await ask_for(
        model, prompts.for_website(task), prompts.WebsiteReply, check=check, tries=limits.tries
    )
    website = task.website if task.website is not None else _url(reply.website)
    return Inferred(website, DOMAIN_OF[reply.subdomain], reply.subdomain)


def _no_website(address: str) -> str | None:
    """Why a text is not the address of a public website; ``None`` if it is."""
    address = address.strip()
    try:
        host = host_of(address)
    except ValueError:
        return f"{address!r} is no address of a website."
    if " " in address or not address.isprintable():
        return f"{address!r} is more than the address of a website."
    if problem := start_url_problem(address):
        return f"{problem}."
    is_number = host.rpartition(".")[2][:1].isdigit()  # an IP address
    is_public = "." in host and not is_number and not host.endswith((".local", ".test"))
    return None if is_public else f"{address!r} is no public website."


def _url(address: str) -> str:
    address = address.strip()
    return address if address.lower().startswith(("http://", "https://")) else f"https://{host_of(address)}/"


class Written(msgspec.Struct, frozen=True):
    """An accepted rubric, and its warnings.

    Attributes:
        rubric: breaks no rule of severity ``error``.
        findings: of severity ``warning``.
    """

    rubric: Rubric
    findings: tuple[Finding, ...]


async def write_rubric(
    model: Completes, task: SourceTask, *, limits: WritingLimits = DEFAULT_LIMITS
) -> Written:
    """Have a model write a task's rubric, which must break no rule of severity ``error``
    (:mod:`webgym.tasks.rules`).

    Raises:
        LLMUnusable: no reply was a rubric that follows the rules.
        LLMError: the model gave no reply.
    """
    asked = _asked_by(task)
    findings: list[Finding] = []

    def check(reply: prompts.RubricReply) -> str | None:
        findings[:] = check_rubric(_draft(reply), asked)
        errors = [finding.message for finding in findings if finding.severity == "error"]
        return "; ".join(errors[:_REASONS]) + "." if errors else None

    reply = await ask_for(
        model, prompts.for_rubric(task), prompts.RubricReply, check=check, tries=limits.tries
    )
    groups = (
        FactGroup(group.id, _line(group.description), tuple(map(_line, group.facts)))
        for group in _draft(reply).fact_groups
    )
    return Written(Rubric(tuple(groups)), tuple(findings))


def review(task: SourceTask | Task, rubric: Rubric) -> list[Finding]:
    """The findings of the rules in an existing rubric."""
    return check_rubric(Draft.of(rubric), _asked_by(task))


def _asked_by(task: SourceTask | Task) -> Asked:
    answers = tuple(answer for answer in (task.reference_answer, task.example_answer) if answer)
    hints = task.hints if isinstance(task, SourceTask) else ()
    return Asked(
        task.instruction, prompts.known_website(task) or "", hints, answers, task.parent_id is not None
    )


def _draft(reply: prompts.RubricReply) -> Draft:
    """The model's rubric, with OR in capitals: what can be corrected is no reason to ask again."""
    groups = tuple(
        DraftGroup(
            group.id,
            group.description,
            tuple(fact if len(fact) > LONGEST_FACT_CHARS else with_capital_or(fact) for fact in group.facts),
        )
        for group in reply.fact_groups
    )
    return Draft(groups, reply.difficulty)


def _line(text: str) -> str:
    return " ".join(text.split())


async def rewrite(
    model: Completes, task: Task, groups: Sequence[FactGroup], *, limits: WritingLimits = DEFAULT_LIMITS
) -> str:
    """Have a model write the instruction of a task with only these fact groups.

    Raises:
        LLMUnusable: no reply passed the checks.
        LLMError: the model gave no reply.
    """
    messages = prompts.for_rewriting(task, groups)
    return await _ask_for_text(
        model, messages, check=lambda text: refused_rewriting(text, task, groups, limits), tries=limits.tries
    )


async def _ask_for_text(
    model: Completes, messages: prompts.Messages, *, check: Callable[[str], str | None], tries: int
) -> str:
    """As :func:`webgym.llm.structured.ask_for`, for plain text."""
    conversation = list(messages)
    replies: list[str] = []
    reason = ""
    for _ in range(tries):
        completion = await model.complete(conversation)
        reply = completion.text or completion.refusal
        text = _without_thinking(reply)
        reason = _no_text(completion, text) or check(text) or ""
        if not reason:
            return text
        replies.append(reply)
        conversation += [
            {"role": "assistant", "content": reply or "(nothing)"},
            {"role": "user", "content": f"This reply cannot be used: {reason}\nAnswer again, in full."},
        ]
    raise LLMUnusable(
        f"the model was asked {tries} times and wrote no usable text: {reason}",
        hint="another model may do better",
        reason=reason,
        replies=tuple(replies),
    )


def _without_thinking(text: str) -> str:
    text = THOUGHT_END.split(text)[-1].strip()  # the chat template may have begun the thinking
    return "" if THOUGHT.match(text) else text


def _no_text(completion: Completion, text: str) -> str | None:
    if completion.refusal or ended_by(completion.finish_reason) == "filter":
        return "it is a refusal, not the text of a task."
    if was_cut_off(completion.finish_reason):
        return "it was cut off before its end. Be briefer."
    return None if text else "it is empty."
