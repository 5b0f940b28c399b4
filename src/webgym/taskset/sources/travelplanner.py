"""TravelPlanner: trips to plan within constraints. Its nested columns are Python literals, not JSON.

``reference_information`` (tables for a planner without a browser) is not read: an agent finds them on the
web. ``plan`` of the JSON lines was written by a model, so it is no example of a good answer;
``annotated_plan`` of the CSV was written by a person.
"""

from __future__ import annotations

import json
import re

from webgym.tasks.missing_values import is_missing_value
from webgym.taskset.sources.base import GARBLED, Draft, Source
from webgym.taskset.sources.categories import subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, as_text, texts
from webgym.taskset.sources.problems import Unusable

_INSTRUCTION = ("query",)
_CHAT = "messages"
_CONSTRAINTS = (
    ("org", "from"),
    ("dest", "to"),
    ("days", "days"),
    ("visiting_city_number", "cities to visit"),
    ("people_number", "people"),
    ("budget", "budget in dollars"),
)


def _draft(fields: Fields, _: Companions) -> Draft:
    query = _query_in_chat(fields.value(_CHAT))
    draft = Draft(query or fields.instruction(*_INSTRUCTION), fields.native_id("idx"))
    draft.domain, draft.subdomain = subdomain("Travel & Accommodation")
    hints = [f"{word}: {value}" for name, word in _CONSTRAINTS for value in texts(fields.value(name))]
    dates = _literal(fields, "date", draft)
    draft.dates = texts(dates)
    hints += (f"date: {date}" for date in draft.dates)
    wishes = _literal(fields, "local_constraint", draft)
    if isinstance(wishes, dict):
        hints += (
            f"{name}: {value}"
            for name, wish in wishes.items()
            if not is_missing_value(wish)
            for value in texts(wish)
        )
    draft.hints = tuple(hints)
    plan = fields.value("annotated_plan")
    if isinstance(plan, (str, list)):
        draft.example_answer = plan if isinstance(plan, str) else json.dumps(plan, ensure_ascii=False)
    return draft


def _query_in_chat(messages: object) -> str | None:
    """The query in the conversations of the training split, without the prompt around it; ``None`` if there
    is none.

    The assistant's message, a plan written by a model, is not read.
    """
    turns = [turn for turn in messages if isinstance(turn, dict)] if isinstance(messages, list) else []
    for message in turns:
        content = message.get("content")
        if message.get("role") == "user" and isinstance(content, list):
            content = "\n".join(texts([part.get("text") for part in content if isinstance(part, dict)]))
        if message.get("role") == "user" and isinstance(content, str):
            query = _PROMPT_END.sub("", content.rpartition("Query:")[2]).strip()
            return as_text(query, "messages") or None
    return None


_PROMPT_END = re.compile(r"\n?\s*(?:Travel Plan|Plan|Output)\s*:\s*$")


def _literal(fields: Fields, name: str, draft: Draft) -> object:
    try:
        return fields.packed(name)
    except Unusable:
        draft.flags.append(GARBLED)
        return None


SOURCE = Source(
    name="travelplanner",
    paper_tasks=1_225,
    paper_websites=1,
    licence="CC BY 4.0",
    instruction=(*_INSTRUCTION, _CHAT),
    draft=_draft,
    marks=(("query", "plan"), ("query", "org", "dest"), ("query", "local_constraint"), (_CHAT,)),
)
