"""Benchmarks of tasks on given websites: InSTA, WebVoyager, Mind2Web-Live, Online-Mind2Web, DeepShop."""

from __future__ import annotations

import re
from typing import NamedTuple
from urllib.parse import urlsplit

from webgym.core.task import reference_of
from webgym.core.text import fold
from webgym.taskset.sources.base import GARBLED, OUTDATED_ANSWER, Draft, Source
from webgym.taskset.sources.categories import UNKNOWN, Place, named, subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.dates import years
from webgym.taskset.sources.fields import Fields, as_text, texts
from webgym.taskset.sources.problems import Unusable

# InSTA: tasks that a model proposed for the hosts of a web crawl. v3 has steps and criteria, v1 does not.

_INSTA_INSTRUCTION = ("instruction", "task")


def _draft_insta(fields: Fields, _: Companions) -> Draft:
    # The field of the host is "domain" in v1 and "website" in v3.
    draft = Draft(fields.instruction(*_INSTA_INSTRUCTION), fields.native_id("task_id", "id"))
    draft.website = fields.website("website", "domain")
    hints: list[str] = []
    for name, word in (("steps", "step"), ("criteria", "criterion")):
        try:
            hints += (f"{word}: {text}" for text in texts(fields.packed(name)))
        except Unusable:
            draft.flags.append(GARBLED)
    draft.hints = tuple(hints)
    return draft


INSTA = Source(
    name="insta-v3",
    paper_tasks=146_441,
    paper_websites=146_348,
    licence="MIT",
    instruction=_INSTA_INSTRUCTION,
    draft=_draft_insta,
    marks=(("steps", "criteria"), ("instruction", "website"), ("domain", "task")),
)


# PAE's tasks, written by a model for the websites of WebVoyager, and WebVoyager's own in the same format.
#
# WebVoyager's answers are in the companion file ``reference_answer.json``. A ``golden`` one is a reference
# answer; a ``possible`` one is an example, and must not override the judge.

ANSWERS = "reference_answer.json"

_WEBVOYAGER_INSTRUCTION = ("ques", "question")
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
                (answer[name] for name in _WEBVOYAGER_INSTRUCTION if isinstance(answer.get(name), str)), None
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


def _draft_webvoyager(fields: Fields, companions: Companions) -> Draft:
    name = fields.text("web_name")
    native_id = fields.native_id("id", "task_id")
    draft = Draft(
        fields.instruction(*_WEBVOYAGER_INSTRUCTION), native_id, fields.website("web", "website", "url")
    )
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


WEBVOYAGER = Source(
    name="pae-webvoyager",
    paper_tasks=128_499,
    paper_websites=13,
    licence="CC BY-NC 4.0",
    instruction=_WEBVOYAGER_INSTRUCTION,
    draft=_draft_webvoyager,
    marks=(("web_name", "ques"),),
    beside=(ANSWERS,),
)


# Mind2Web-Live: tasks with key nodes, states that a correct trajectory passes through.
#
# The records have no website: the task starts on the host of the first key node's URL.

_MIND2WEB_LIVE_INSTRUCTION = ("task", "confirmed_task")


def _draft_mind2web_live(fields: Fields, _: Companions) -> Draft:
    draft = Draft(
        fields.instruction(*_MIND2WEB_LIVE_INSTRUCTION),
        fields.native_id("index", "task_id", "annotation_id", "id"),
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


MIND2WEB_LIVE = Source(
    name="mind2web-live",
    paper_tasks=542,
    paper_websites=76,
    licence="MIT",
    instruction=_MIND2WEB_LIVE_INSTRUCTION,
    draft=_draft_mind2web_live,
    marks=(("task", "evaluation"), ("task", "reference_task_length")),
)


# Online-Mind2Web: 300 tasks on live websites. The companion file ``human_label.json`` has human labels.

_ONLINE_MIND2WEB_INSTRUCTION = ("confirmed_task", "task", "task_description")


def _draft_online_mind2web(fields: Fields, _: Companions) -> Draft:
    draft = Draft(
        fields.instruction(*_ONLINE_MIND2WEB_INSTRUCTION), fields.native_id("task_id", "annotation_id", "id")
    )
    draft.website = fields.website("website", "url", "web")
    draft.domain, draft.subdomain = named(fields.value("subdomain"), fields.value("domain"))
    return draft


ONLINE_MIND2WEB = Source(
    name="online-mind2web",
    paper_tasks=300,
    paper_websites=139,
    licence="CC BY 4.0",
    instruction=_ONLINE_MIND2WEB_INSTRUCTION,
    draft=_draft_online_mind2web,
    marks=(("confirmed_task",),),
    beside=("human_label*.json",),
)


# DeepShop: shopping on Amazon. ``attribute``, ``filter`` and ``sort`` are hints; some of them are
# garbled.

_DEEPSHOP_INSTRUCTION = ("ques", "question", "task")
_REPEATED_WORD = re.compile(r"\b(\w{2,})\s+\1\b", re.IGNORECASE)


def _draft_deepshop(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_DEEPSHOP_INSTRUCTION), fields.native_id("id", "task_id"))
    draft.website = fields.website("web", "website", "url")
    # Its own categories (Electronics, Fashion, Books, ...) are departments of one shop.
    draft.domain, draft.subdomain = subdomain("Shopping")
    hints: list[str] = []
    for name in ("attribute", "filter", "sort"):
        value = fields.value(name)
        if value is None:
            continue
        if cleaned := [clean for text in texts(value) if (clean := _clean(text))]:
            hints += (f"{name}: {text}" for text in cleaned)
        else:
            draft.flags.append(GARBLED)
    draft.hints = tuple(hints)
    return draft


def _clean(text: str) -> str | None:
    """The text without Markdown for bold type; ``None`` if it is garbled.

    A garbled value is a mixture of two texts, with an odd number of ``**``, ``**`` in the middle, or repeated
    words.
    """
    marks = text.count("**")
    if not marks:
        return text.strip()
    if marks != 2 or not text.lstrip().startswith("**") or _REPEATED_WORD.search(text):
        return None
    return text.replace("**", "").strip()


DEEPSHOP = Source(
    name="deepshop",
    paper_tasks=150,
    paper_websites=1,
    licence="CC BY 4.0",
    instruction=_DEEPSHOP_INSTRUCTION,
    draft=_draft_deepshop,
    marks=(("ques", "attribute", "filter", "sort"),),
)
