"""Mind2Web-Live: tasks with key nodes, states that a correct trajectory passes through.

The records have no website: the task starts on the host of the first key node's URL.
"""

from __future__ import annotations

from urllib.parse import urlsplit

from webgym.taskset.sources.base import GARBLED, Draft, Source
from webgym.taskset.sources.categories import named
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, texts
from webgym.taskset.sources.problems import Unusable

_INSTRUCTION = ("task", "confirmed_task")


def _draft(fields: Fields, _: Companions) -> Draft:
    draft = Draft(
        fields.instruction(*_INSTRUCTION), fields.native_id("index", "task_id", "annotation_id", "id")
    )
    draft.domain, draft.subdomain = named(fields.value("subdomain"), fields.value("domain"))
    try:
        nodes = fields.packed("evaluation")
    except Unusable:
        nodes = None
        draft.flags.append(GARBLED)
    contents = [
        (node.get("match_function_name"), node["content"])
        for node in (nodes if isinstance(nodes, list) else [])
        if isinstance(node, dict) and isinstance(node.get("content"), dict)
    ]
    given = fields.website("website")
    if given:
        draft.website = given
    else:
        draft.website = next(filter(None, (_origin(content.get("url")) for _, content in contents)), None)
        draft.website_from = "derived"
    draft.hints = tuple(_hints(contents))
    return draft


def _origin(url: object) -> str | None:
    """Scheme and host of a URL."""
    if not isinstance(url, str):
        return None
    try:
        parts = urlsplit(url.strip())
    except ValueError:
        return None
    return f"{parts.scheme}://{parts.netloc}/" if parts.scheme in ("http", "https") and parts.netloc else None


def _hints(contents: list[tuple[object, dict[str, object]]]) -> list[str]:
    """Key nodes as text, without element paths, which say nothing about the task."""
    conditions = []
    for match, content in contents:
        if isinstance(match, str) and not match.startswith("element_path"):
            for answer in texts(content.get("reference_answer")):
                key = "".join(texts(content.get("key")))
                conditions.append(f"{match.replace('_', ' ')}: {f'{key}={answer}' if key else answer}")
    return conditions


SOURCE = Source(
    name="mind2web-live",
    paper_tasks=542,
    paper_websites=76,
    licence="MIT",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("task", "evaluation"), ("task", "reference_task_length")),
)
