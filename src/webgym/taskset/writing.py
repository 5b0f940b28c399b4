"""Model calls of a task set's construction: website and domain, rubrics, rewritten tasks.

Every reply is checked. If it is refused, the model is asked again with its reply and the reason, a limited
number of times; then :class:`webgym.core.errors.LLMUnusable` is raised with the last reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec

from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.websites import host_of, start_url_problem
from webgym.llm.completion import Completes
from webgym.llm.structured import ask_for, ask_for_text
from webgym.tasks.taxonomy import DOMAIN_OF
from webgym.taskset import prompts
from webgym.taskset.rubric_check import criticism, rubric_problem, text_problem
from webgym.taskset.sources.base import SourceTask

DEFAULT_TRIES: Final = 3
"""Most requests for one website, rubric or text, until the reply is usable."""


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
