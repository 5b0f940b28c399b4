"""PAE's tasks, written by a model for the websites of WebVoyager, and WebVoyager's own in the same format.

WebVoyager's answers are in the companion file ``reference_answer.json``. A ``golden`` one is a reference
answer; a ``possible`` one is an example, and must not override the judge.
"""

from __future__ import annotations

from typing import NamedTuple

from webgym.core.task import reference_of
from webgym.core.text import fold
from webgym.taskset.sources.base import OUTDATED_ANSWER, Draft, Source
from webgym.taskset.sources.categories import UNKNOWN, Place, subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.dates import years
from webgym.taskset.sources.fields import Fields, as_text
from webgym.taskset.sources.problems import Unusable

ANSWERS = "reference_answer.json"

_INSTRUCTION = ("ques", "question")
_PLACES: dict[str, Place] = {
    "Allrecipes": subdomain("Food & Cooking"),
    "Amazon": subdomain("Shopping"),
    "ArXiv": subdomain("Research & Academia"),
    "BBC News": subdomain("News"),
    "Booking": subdomain("Travel & Accommodation"),
    "Coursera": subdomain("Education & Learning"),
    "ESPN": subdomain("Sports & Fitness"),
    "GitHub": subdomain("Technology & Science"),
    "Google Flights": subdomain("Travel & Accommodation"),
    "Huggingface": subdomain("Technology & Science"),
}
"""Taxonomy by ``web_name``. On the others (a search engine, a map, a dictionary, ...) it depends on the
task."""


class _Answer(NamedTuple):
    text: str
    golden: bool
    question: str | None
    """The question that it answers, if the file has it."""


def _answers(data: object) -> dict[str, _Answer]:
    """The answers by task id, ``"<site>--<id>"``.

    Raises:
        ValueError: the file is not a mapping of websites to answers.
    """
    if not isinstance(data, dict):
        raise ValueError("not an object with a key per website")
    by_task: dict[str, _Answer] = {}
    for site, entry in data.items():
        answers = entry.get("answers") if isinstance(entry, dict) else None
        for answer in answers if isinstance(answers, list) else []:
            if not isinstance(answer, dict):
                continue
            try:
                text = reference_of(as_text(answer.get("ans"), "ans"))
            except Unusable:
                continue
            if text is None:
                continue
            golden = str(answer.get("type")).strip().casefold() == "golden"
            instruction = next(
                (answer[name] for name in _INSTRUCTION if isinstance(answer.get(name), str)), None
            )
            by_task.setdefault(f"{site}--{answer.get('id')}", _Answer(text, golden, instruction))
    return by_task


def _answers_this(answer: _Answer, instruction: str) -> bool:
    """Whether an answer belongs to this text. Copies of the tasks have later dates but the same ids."""
    if answer.question is not None:
        return fold(answer.question) == fold(instruction)
    return not years(instruction) & _YEARS_AFTER_ANSWERS


_YEARS_AFTER_ANSWERS = frozenset(range(2025, 2040))
"""Years in copies of the tasks with later dates. Years further ahead occur in the original tasks, too."""


def _draft(fields: Fields, companions: Companions) -> Draft:
    name = fields.text("web_name")
    native_id = fields.native_id("id", "task_id")
    draft = Draft(fields.instruction(*_INSTRUCTION), native_id, fields.website("web", "website", "url"))
    draft.domain, draft.subdomain = _PLACES.get(name or "", UNKNOWN)
    answer = (companions.load(ANSWERS, _answers) or {}).get(native_id or "")
    if answer and not _answers_this(answer, draft.instruction):
        draft.flags.append(OUTDATED_ANSWER)
    elif answer:
        draft.joined = answer.question is None
        if answer.golden:
            draft.reference_answer = answer.text
        else:
            draft.example_answer = answer.text
    return draft


SOURCE = Source(
    name="pae-webvoyager",
    paper_tasks=128_499,
    paper_websites=13,
    licence="CC BY-NC 4.0",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("web_name", "ques"),),
    beside=(ANSWERS,),
)
