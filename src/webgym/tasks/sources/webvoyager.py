"""PAE's tasks, made by a model for the websites of WebVoyager, and WebVoyager's own, which have that shape.

WebVoyager's answers lie beside the tasks in ``reference_answer.json``. A ``golden`` one is the answer; a
``possible`` one is an example, and must not override the judge.
"""

from __future__ import annotations

from typing import NamedTuple

from webgym.core.text import fold
from webgym.tasks.missing_values import is_missing_value
from webgym.tasks.sources.base import OUTDATED_ANSWER, Draft, Source
from webgym.tasks.sources.categories import UNKNOWN, Place, subdomain
from webgym.tasks.sources.companions import Companions
from webgym.tasks.sources.dates import years
from webgym.tasks.sources.fields import Fields, as_text
from webgym.tasks.sources.problems import Unusable

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
"""By ``web_name``. Of the others (a search engine, a map, a dictionary, ...) the task decides."""


class _Answer(NamedTuple):
    text: str
    golden: bool
    question: str | None
    """That it was given to, where the file says."""


def _answers(data: object) -> dict[str, _Answer]:
    """The answers by task, ``"<site>--<id>"``.

    Raises:
        ValueError: the file is no mapping of websites to answers.
    """
    if not isinstance(data, dict):
        raise ValueError("no object of websites")
    found: dict[str, _Answer] = {}
    for site, entry in data.items():
        answers = entry.get("answers") if isinstance(entry, dict) else None
        for each in answers if isinstance(answers, list) else []:
            if not isinstance(each, dict) or is_missing_value(each.get("ans")):
                continue
            try:
                text = as_text(each["ans"], "ans")
            except Unusable:
                continue
            golden = str(each.get("type")).strip().casefold() == "golden"
            asked = next((each[name] for name in _INSTRUCTION if isinstance(each.get(name), str)), None)
            found.setdefault(f"{site}--{each.get('id')}", _Answer(text, golden, asked))
    return found


def _answers_this(answer: _Answer, instruction: str) -> bool:
    """Whether an answer is to this very text. Copies of the tasks move their dates on and keep their ids."""
    if answer.question is not None:
        return fold(answer.question) == fold(instruction)
    return not years(instruction) & _AFTER_THE_ANSWERS


_AFTER_THE_ANSWERS = frozenset(range(2025, 2040))
"""The years that copies of the tasks move on to. Those far ahead are sums ("how many days until 2050")."""


def _draft(fields: Fields, beside: Companions) -> Draft:
    name = fields.text("web_name")
    native_id = fields.native_id("id", "task_id")
    draft = Draft(fields.instruction(*_INSTRUCTION), native_id, fields.website("web", "website", "url"))
    draft.domain, draft.subdomain = _PLACES.get(name or "", UNKNOWN)
    answer = (beside.load(ANSWERS, _answers) or {}).get(native_id or "")
    if answer and not _answers_this(answer, draft.instruction):
        draft.flags.append(OUTDATED_ANSWER)
    elif answer and answer.golden:
        draft.reference_answer = answer.text
    elif answer:
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
    synthetic=True,
    beside=(ANSWERS,),
)
