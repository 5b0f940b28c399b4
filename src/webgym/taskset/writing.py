"""Model calls of a task set's construction (website, rubrics, rewritten tasks), and what is refused of them.

Every reply is checked (SYSTEM.md 1.3 and 1.4). Refused without a model is what can be seen in any language:
counts, ids, repetitions, an OR outside of a fact, numbers from nowhere, an answer given away. What takes
understanding is asked of a second model, the critic, if there is one: its prompts state the writers' rules
(:mod:`webgym.taskset.prompts`). If a reply is refused, the model is asked again with its reply and the
reason, a limited number of times; then :class:`webgym.core.errors.LLMUnusable` is raised with the last
reason.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.text import fold, says
from webgym.core.websites import host_of, start_url_problem
from webgym.llm.completion import Completes
from webgym.llm.structured import ask_for, ask_for_text
from webgym.tasks.missing_values import is_no_fact
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF
from webgym.taskset import prompts
from webgym.taskset.prompts import GroupReply, RubricReply, known_website

DEFAULT_TRIES: Final = 3
"""Most requests for one website, rubric or text, until the reply is usable."""

_MOST_FACTS: Final = 60
"""Most facts of a rubric; the longest tasks of the sources ask for about 40."""
_LONGEST_FACT_CHARS: Final = 1_000
_REASONS: Final = 6
"""Most reasons that a writer is sent at once; correcting these often corrects the others."""
_SHORTEST_ANSWER_CHARS: Final = 4
"""A shorter answer may stand in a text by chance."""
_SHORTEST_TASK_CHARS: Final = 12
_TIMES_PARENT: Final = 2
_MORE_CHARS: Final = 200
"""A rewritten task has at most ``_TIMES_PARENT`` times the characters of its parent, and these."""

_DANGLING_OR: Final = re.compile(r"^\W*OR\b|[^\s,]\s+OR\W*$")
"""OR at an end of a fact. After a comma it may be Oregon."""
_NUMBER: Final = re.compile(r"\d+(?:[.,]\d+)*")
_MARKDOWN: Final = re.compile(r"(?m)^[ \t]*(?:#{1,6} |```|[-*•] |\d+[.)] |> )|\*\*|```|^[ \t]*\|.*\|[ \t]*$")
_CONTROL: Final = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")
_QUOTATION_MARKS: Final = ('""', "“”", "''", "``", "«»", "‘’")


class Inferred(msgspec.Struct, frozen=True):
    """The inferred website and domain of a task.

    Attributes:
        website: URL where the task starts.
        domain, subdomain: of :data:`webgym.tasks.taxonomy.DOMAINS`.
    """

    website: str
    domain: str
    subdomain: str


async def infer_website(model: Completes, task: SourceTask, *, tries: int = DEFAULT_TRIES) -> Inferred:
    """Infer the domain and subdomain of a task, and its website if it has none.

    Raises:
        LLMUnusable: no reply had a valid website and a subdomain of the taxonomy.
        LLMError: the model gave no reply.
    """

    def check(reply: prompts.WebsiteReply) -> str | None:
        if reply.subdomain not in DOMAIN_OF:
            return f"{reply.subdomain!r} is none of the subdomains in the list."
        return None if task.website is not None else _no_website(reply.website)

    reply = await ask_for(model, prompts.for_website(task), prompts.WebsiteReply, check=check, tries=tries)
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


async def write_rubric(
    model: Completes, task: SourceTask, *, critic: Completes | None = None, tries: int = DEFAULT_TRIES
) -> Rubric:
    """Have a model write a task's rubric.

    Args:
        model: the writer.
        task: the rubric is for.
        critic: a model that checks what the writer says; ``None`` checks its structure alone.
        tries: most requests to each.

    Raises:
        LLMUnusable: no rubric was accepted.
        LLMError: a model gave no reply.
    """

    async def check(reply: prompts.RubricReply) -> str | None:
        if problem := rubric_problem(reply, task):
            return f"{problem}."
        return await criticism(critic, prompts.for_rubric_critic(task, reply), tries=tries)

    reply = await ask_for(model, prompts.for_rubric(task), prompts.RubricReply, check=check, tries=tries)
    return Rubric(
        tuple(
            FactGroup(group.id, _line(group.description), tuple(map(_line, group.facts)))
            for group in reply.fact_groups
        )
    )


def _line(text: str) -> str:
    return " ".join(text.split())


async def rewrite(
    model: Completes,
    task: Task,
    groups: Sequence[FactGroup],
    *,
    critic: Completes | None = None,
    tries: int = DEFAULT_TRIES,
) -> str:
    """Have a model write the instruction of a task with only these fact groups.

    Args:
        model: the writer.
        task: the original.
        groups: of the new task.
        critic: a model that checks what the writer says; ``None`` checks its structure alone.
        tries: most requests to each.

    Raises:
        LLMUnusable: no text was accepted.
        LLMError: a model gave no reply.
    """

    async def check(text: str) -> str | None:
        if problem := text_problem(text, task, groups):
            return problem
        return await criticism(critic, prompts.for_rewriting_critic(task, groups, text), tries=tries)

    return await ask_for_text(model, prompts.for_rewriting(task, groups), check=check, tries=tries)


async def criticism(critic: Completes | None, messages: prompts.Messages, *, tries: int) -> str | None:
    """The critic's reasons to refuse what a model wrote; ``None`` if it has none, or there is no critic.

    Raises:
        LLMUnusable: no reply of the critic was a verdict.
        LLMError: the critic gave no reply.
    """
    if critic is None:
        return None

    def check(reply: prompts.CriticReply) -> str | None:
        consistent = reply.ok != bool(reply.problems)
        return None if consistent else "ok is true if there is no problem, and false if there is one."

    verdict = await ask_for(critic, messages, prompts.CriticReply, check=check, tries=tries)
    return joined(verdict.problems)


def joined(reasons: Sequence[str]) -> str | None:
    """The reasons as one, in one line; ``None`` if there are none."""
    return " ".join("; ".join(reasons[:_REASONS]).split()) or None


# --- structure of rubrics -------------------------------------------------------------------------------


def rubric_problem(reply: RubricReply, task: SourceTask) -> str | None:
    """Why a rubric is refused by its structure; ``None`` if it is not."""
    stated = _numbers(task.instruction, known_website(task) or "")
    problems = [*_of_shape(reply)]
    for group in reply.fact_groups:
        problems += _of_group(group)
        for number, fact in enumerate(group.facts, start=1):
            problems += (
                f"fact {number} of group {group.id} {problem}" for problem in _of_fact(fact, task, stated)
            )
    return joined(problems)


def _of_shape(reply: RubricReply) -> Iterator[str]:
    groups = reply.fact_groups
    if not groups:
        yield "there is no fact group"
    count = sum(len(group.facts) for group in groups)
    if reply.difficulty != count:
        yield f"difficulty is {reply.difficulty}, but there are {count} facts"
    if count > _MOST_FACTS:
        yield f"there are {count} facts; {_MOST_FACTS} is the limit"
    ids = [group.id for group in groups]
    if ids != list(range(1, len(ids) + 1)):
        yield f"the groups have the ids {', '.join(map(str, ids))} instead of 1 to {len(ids)}"
    contents = [(_plain(group.description), *map(_plain, group.facts)) for group in groups]
    for index, content in enumerate(contents):
        if content in contents[:index]:
            yield f"group {groups[index].id} repeats another group"


def _of_group(group: GroupReply) -> Iterator[str]:
    if not group.facts:
        yield f"group {group.id} has no facts"
    if is_no_fact(group.description):
        yield f"group {group.id} has no description"
    facts = [_plain(fact) for fact in group.facts]
    if len(set(facts)) < len(facts):
        yield f"group {group.id} has a fact twice"


def _of_fact(fact: str, task: SourceTask, stated: set[str]) -> Iterator[str]:
    if len(fact) > _LONGEST_FACT_CHARS:
        yield f"has {len(fact):,} characters; {_LONGEST_FACT_CHARS:,} is the limit"
    elif is_no_fact(fact):
        yield "is empty; leave it out"
    elif _DANGLING_OR.search(fact):
        yield "begins or ends with OR; all alternatives stand in one fact"
    elif unstated := _numbers(fact) - stated:
        yield f"has a number that the task does not state: {', '.join(sorted(unstated))}"
    elif _reveals(fact, task):
        yield "has the answer, which the task does not state"


# --- structure of rewritten tasks -----------------------------------------------------------------------


def text_problem(text: str, task: Task, groups: Sequence[FactGroup]) -> str | None:
    """Why a text is refused as the instruction of a task with only these groups; ``None`` if it is not."""
    parent = task.instruction
    return (
        _not_plain(text, parent)
        or _other_numbers(text, task, groups)
        or ("it gives the answer away." if _reveals(text, task) else None)
    )


def _not_plain(text: str, parent: str) -> str | None:
    longest = _TIMES_PARENT * len(parent) + _MORE_CHARS
    if len(text) > longest:
        return f"it has {len(text)} characters; write at most {longest}."
    if text[0] in "{[" and text[-1] in "}]":
        return "it is JSON; write the text of the task alone."
    if text[0] + text[-1] in _QUOTATION_MARKS and text[-1] not in text[1:-1]:
        return "it stands in quotation marks; write the text of the task alone."
    for pattern, name in ((_MARKDOWN, "markdown"), (_CONTROL, "control characters")):
        if pattern.search(text) and not pattern.search(parent):
            return f"it holds {name}; write plain text."
    if "\n" in text and "\n" not in parent:
        return "it has several lines; write one paragraph."
    if _plain(text) == _plain(parent):
        return "it is the original task; write one that asks for the given facts alone."
    if len(text) < _SHORTEST_TASK_CHARS:
        return f"it has {len(text)} characters; that is too short for a task."
    return None


def _other_numbers(text: str, task: Task, groups: Sequence[FactGroup]) -> str | None:
    facts = [part for group in groups for part in (group.description, *group.facts)]
    wanted, original, written = _numbers(*facts), _numbers(task.instruction), _numbers(text)
    if invented := written - wanted - original - _numbers(task.website):
        return (
            f"it states {', '.join(sorted(invented))}, which neither the original task nor the facts state."
        )
    if missing := (wanted & original) - written:
        return f"it leaves out {', '.join(sorted(missing))}, which the facts ask for."
    return None


# --- texts ------------------------------------------------------------------------------------------------


def _reveals(text: str, task: SourceTask | Task) -> bool:
    """Whether a text contains an answer that the task's own does not."""
    answers = (task.reference_answer or "", task.example_answer or "")
    own, folded = fold(task.instruction), fold(text)
    return any(
        len(answer) >= _SHORTEST_ANSWER_CHARS and says(folded, answer) and not says(own, answer)
        for answer in answers
    )


def _numbers(*texts: str) -> set[str]:
    """The numbers of two or more digits, without separators: 1,000 and 1.000 are the same.

    One digit may be a word elsewhere ("four people"), or count groups.
    """
    found = {re.sub(r"[.,]", "", number) for text in texts for number in _NUMBER.findall(fold(text))}
    return {number for number in found if len(number) > 1}


def _plain(text: str) -> str:
    return "".join(filter(str.isalnum, fold(text))) or text
