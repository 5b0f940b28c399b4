"""The prompts of a task set's construction (paper §3, appendix E; SYSTEM.md 1.3 and 1.4).

The rules are in the system message, which is the same for every task, so that endpoints with a prompt cache
charge less for it; the task is in the user message.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Annotated, Final, TypeAlias

import msgspec

from webgym.core.task import FactGroup, Task
from webgym.tasks.sources.base import SourceTask
from webgym.tasks.taxonomy import DOMAIN_OF, DOMAINS

Messages: TypeAlias = list[dict[str, str]]

# The replies: models are sent their JSON schemas.


class WebsiteReply(msgspec.Struct, frozen=True):
    """The website where a task starts, and its subdomain."""

    website: str
    subdomain: Annotated[str, msgspec.Meta(extra_json_schema={"enum": list(DOMAIN_OF)})]


class GroupReply(msgspec.Struct, frozen=True):
    """A fact group of a rubric."""

    id: int
    description: str
    facts: tuple[str, ...]


class RubricReply(msgspec.Struct, frozen=True):
    """A rubric: its fact groups, and the number of facts in them."""

    fact_groups: tuple[GroupReply, ...]
    difficulty: int


class CriticReply(msgspec.Struct, frozen=True):
    """A critic's verdict: whether a rubric or a rewritten task is accepted, and what is wrong with it."""

    ok: bool
    problems: tuple[str, ...]


EXAMPLE_TASK: Final = (
    "On Petal & Post, find a bouquet with tulips or roses for at most €40 that can be delivered on Sunday. "
    "Give its name and how long it keeps. Also find out how to cancel an order."
)
EXAMPLE_RUBRIC: Final = RubricReply(
    (
        GroupReply(
            1,
            "The bouquet",
            (
                "The bouquet is with tulips OR roses",
                "The bouquet costs at most €40",
                "The bouquet can be delivered on Sunday",
                "The name of the bouquet is given",
                "How long the bouquet keeps is given",
            ),
        ),
        GroupReply(2, "Cancelling an order", ("Instructions for cancelling an order are found",)),
    ),
    difficulty=6,
)
"""The example in the prompt; it follows all rules."""

_TAXONOMY: Final = "\n".join(f"- {domain}: {'; '.join(below)}" for domain, below in DOMAINS.items())

_WEBSITE: Final = f"""\
You sort tasks for an agent that works in a web browser. For the task you are given, say on which website
the agent should start, and which kind of task it is.

- website: the address of one real, public website on which the task can be done, such as
  "https://www.example.org/". If the task names a website, take that one. If it needs a search of the open
  web, take a search engine. If the website is given below, repeat it.
- subdomain: one of the following, spelled exactly as here. The part before the colon is the domain, which
  says what its subdomains have in common.

{_TAXONOMY}

Judge by what the task is about, not by how it is done: comparing two laptops to buy is Shopping; reading
how a processor works is Technology & Science; finding an actor's birthday is Films & TV Shows.

Reply with JSON alone: {{"website": "...", "subdomain": "..."}}"""

_RUBRIC_RULES: Final = """\
The rules:
1. One fact is one piece of information that can be verified by itself. "Report the price and the weight
   of the Tarn stove" gives two facts: "The price of the Tarn stove is reported" and "The weight of the
   Tarn stove is reported".
2. A fact is as detailed as the task, and no more. Write nothing that the task does not state: no numbers,
   names, pages or buttons of your own. Every condition in the task becomes a fact: for "a tent under $200
   for four" they are "The tent costs under $200" and "The tent is for four".
3. Facts say what must hold in the end, never how to get there. No clicking, opening, searching or
   scrolling, unless the task asks for just that. Of a purchase they say what is bought, and that it is: not
   the cart, the form and the payment on the way.
4. Alternatives stay together in one fact, joined by OR in capitals: "The room has a bath OR a shower".
   Never one fact per alternative. Bounds are no alternatives: "4 stars or more" stays as it is.
5. A computation is one fact, its result: for "how much longer is the Elbe than the Weser" it is "The
   difference in length between the Elbe and the Weser is found". The numbers it starts from are facts
   only if the task asks for them too.
6. A question how to do something asks for instructions, and that is one fact: "Instructions for descaling
   the Oro kettle are found". Never one fact per step.
7. What the task leaves open stays open: "contact details" is one fact; do not list a telephone number and
   an e-mail address. "Details of the course" is one fact.
8. Examples in the task ("such as", "e.g.") are not asked for. Leave them out of the facts.
9. No fact twice in other words, no fact that repeats the whole task beside its parts, no fact such as
   "The answer is correct", no empty fact.
10. The source's notes, where there are any, were written by someone who had seen the website. They help
    you to understand the task. They may hold the answer: nothing may be taken from them that the task
    itself does not say."""

_RUBRIC: Final = f"""\
You write rubrics for tasks that an agent does in a web browser. A judge will look at the agent's
screenshots and answer and decide, fact by fact, whether the task was done; the task counts as done if
every fact holds.

A rubric is a list of fact groups. A group has an id (1, 2, 3, ...), a short description and one or more
facts. Facts that are about the same thing, or the same part of the task, go into one group. The
difficulty is the number of facts in all groups together.

{_RUBRIC_RULES}

An example. The task: {EXAMPLE_TASK}
{msgspec.json.encode(EXAMPLE_RUBRIC).decode()}

Reply with JSON alone, in that form."""

_REWRITING_RULES: Final = """\
- Keep the website, the setting and the subject of the original: what was about a hotel in Graz stays
  about a hotel in Graz.
- Take what is asked for from the given facts alone. What the original asks for beyond them is gone; add
  nothing, and give no answer away. Every condition in the facts stays, with its numbers and names.
- OR between alternatives stays, as "or" in a natural sentence.
- Write to the agent, as the original does, in the original's language and manner: one short paragraph
  that makes sense to a reader who has not seen the original."""

REWRITING: Final = f"""\
You rewrite tasks for an agent that works in a web browser. You are given a task and some of the facts
that it asks for. Write the task anew so that it asks for exactly these facts: an agent that does all of
your task, and no more, has shown every one of them and nothing else.

{_REWRITING_RULES}

Reply with the text of the new task alone: no title, no introduction, no quotation marks around it, no
JSON, no lists, no markdown."""
"""The system message of every rewriting request."""

_VERDICT: Final = """\
Judge by these rules alone. What they leave open is the writer's choice: the wording, the order, how facts are
grouped. When in doubt, accept.

Reply with JSON alone: {"ok": true, "problems": []}, or {"ok": false, "problems": ["...", ...]} with one
sentence for each problem, which says where it is, which rule is broken, and what to write instead."""

RUBRIC_CRITIC: Final = f"""\
You check rubrics for tasks that an agent does in a web browser. A rubric is a list of fact groups; the task
counts as done if every fact of every group holds. You are given a task and the rubric that somebody wrote.
Say whether the rubric keeps the rules that the writer was given.

{_RUBRIC_RULES}
11. All of the task is asked for: no condition, and nothing that it wants to know or done, is missing.

{_VERDICT}"""
"""The system message of every request to check a rubric."""

REWRITING_CRITIC: Final = f"""\
You check rewritten tasks for an agent that works in a web browser. Somebody was given a task and some of the
facts that it asks for, and rewrote the task to ask for exactly these. Say whether the new task keeps the
rules that the writer was given.

{_REWRITING_RULES}
- It is the text of a task alone: no introduction, no remark, no refusal.

{_VERDICT}"""
"""The system message of every request to check a rewritten task."""


_LONGEST_NOTES: Final = 4_000
"""Most characters of a source's notes in a request; more would cost tokens and add little."""


def for_website(task: SourceTask) -> Messages:
    """The messages that ask for the website, if the source gives none, and for domain and subdomain."""
    given = task.website or "none"
    return _messages(_WEBSITE, [("Task", task.instruction), ("Website given", given)])


def for_rubric(task: SourceTask) -> Messages:
    """The messages that ask for a rubric.

    They contain only what the source gives, nothing inferred, so that no request depends on another's reply.
    """
    return _messages(_RUBRIC, _task_parts(task))


def for_rubric_critic(task: SourceTask, rubric: RubricReply) -> Messages:
    """The messages that ask what is wrong with a rubric."""
    written = msgspec.json.encode(rubric).decode()
    return _messages(RUBRIC_CRITIC, [*_task_parts(task), ("Rubric", written)])


def _task_parts(task: SourceTask) -> list[tuple[str, str]]:
    parts = [("Task", task.instruction)]
    if (website := known_website(task)) is not None:
        parts.append(("Website", website))
    if task.hints:
        notes = "\n".join(f"- {hint}" for hint in task.hints)
        parts.append(("Notes of the source", notes[:_LONGEST_NOTES]))
    return parts


def known_website(task: SourceTask | Task) -> str | None:
    """The website, or ``None`` if it was inferred."""
    return None if task.website_from == "inferred" else task.website


def for_rewriting(task: Task, groups: Sequence[FactGroup]) -> Messages:
    """The messages that ask for the text of a task with only these fact groups."""
    return _messages(REWRITING, _rewriting_parts(task, groups))


def for_rewriting_critic(task: Task, groups: Sequence[FactGroup], text: str) -> Messages:
    """The messages that ask what is wrong with the text of a task with only these fact groups."""
    dropped = [group for group in task.rubric.groups if group not in groups]
    parts = [
        *_rewriting_parts(task, groups),
        ("Facts that it no longer asks for", _listed(dropped)),
        ("New task", text),
    ]
    return _messages(REWRITING_CRITIC, parts)


def _rewriting_parts(task: Task, groups: Sequence[FactGroup]) -> list[tuple[str, str]]:
    return [
        ("Original task", task.instruction),
        ("Website", task.website),
        ("Kind of task", f"{task.domain}, {task.subdomain}"),
        ("Facts that the new task asks for", _listed(groups)),
    ]


def _listed(groups: Iterable[FactGroup]) -> str:
    return "\n".join(
        f"{group.description}\n" + "\n".join(f"- {fact}" for fact in group.facts) for group in groups
    )


def _messages(system: str, parts: Iterable[tuple[str, str]]) -> Messages:
    user = "\n\n".join(f"{title}:\n{text}" for title, text in parts)
    return [{"role": "system", "content": system}, {"role": "user", "content": user}]
