"""The benchmarks that tasks are taken from, with the form of their records (SOURCES.md)."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
import unicodedata
from collections.abc import Iterator
from functools import cache
from typing import Final, NamedTuple, TypeAlias
from urllib.parse import urlsplit

from webgym.core.task import LEVELS, Level, reference_of
from webgym.core.text import fold
from webgym.core.websites import site_of
from webgym.tasks.files import NO_FACTS
from webgym.tasks.missing_values import is_missing_value
from webgym.tasks.published import task_of
from webgym.tasks.sources.base import (
    ENCRYPTED_SOURCE,
    GARBLED,
    NEEDS_FILE,
    OUTDATED_ANSWER,
    PLACEHOLDER_WEBSITE,
    Draft,
    Source,
)
from webgym.tasks.sources.dates import years
from webgym.tasks.sources.fields import Companions, Fields, Unusable, as_text, texts, unpacked, website_url
from webgym.tasks.taxonomy import DOMAIN_OF

Place: TypeAlias = tuple[str, str]
"""Domain and subdomain; empty if they have to be inferred."""

UNKNOWN: Final[Place] = ("", "")


def subdomain(name: str) -> Place:
    """A subdomain of the taxonomy, with its domain."""
    return DOMAIN_OF[name], name


def named(*names: object) -> Place:
    """The subdomain that one of a record's own categories names, ignoring case and punctuation; else unknown.

    A domain alone is not used, because a model infers both or none.

    Args:
        names: the record's subdomain, domain or category, the most specific first.
    """
    for name in names:
        if isinstance(name, str) and (place := _places().get(_folded(name))):
            return place
    return UNKNOWN


@cache
def _places() -> dict[str, Place]:
    return {_folded(name): (domain, name) for name, domain in DOMAIN_OF.items()}


def _folded(name: str) -> str:
    return "".join(letter for letter in name.casefold().replace("&", "and") if letter.isalnum())


def _level(value: object) -> Level | None:
    """A level that a record states; ``None`` if it is none of ours."""
    return next((level for level in LEVELS if level == str(value).strip().casefold()), None)


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
_WEBVOYAGER_PLACES: dict[str, Place] = {
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
    draft.domain, draft.subdomain = _WEBVOYAGER_PLACES.get(name or "", UNKNOWN)
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
    draft.level = _level(fields.value("level"))
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
    draft.level = _level(fields.value("difficulty"))
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


# AgentSynth's web tasks: written by a model that also attempted them, with its actions.
#
# ``action_sequence`` contains JSON strings in the full file and objects in the summarised one; some strings
# are plain text. A final ``stop`` action has the model's answer: an example, not a reference answer.

_AGENTSYNTH_INSTRUCTION = ("task", "instruction")


def _draft_agentsynth(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_AGENTSYNTH_INSTRUCTION), fields.native_id("task_id", "id"))
    draft.website = fields.website("website")
    try:
        draft.example_answer = _final_answer(fields.packed("action_sequence"))
    except Unusable:
        draft.flags.append(GARBLED)
    return draft


def _final_answer(actions: object) -> str | None:
    """The answer of the last action, if that is a ``stop`` with an answer.

    Raises:
        Unusable: the last action cannot be read.
    """
    if not isinstance(actions, list) or not actions:
        return None
    last = actions[-1]
    if isinstance(last, str):
        last = unpacked(last, "action_sequence")
    if not isinstance(last, dict):
        raise Unusable("the last action is not an object")
    if last.get("action_key") != "stop":
        return None
    given = last.get("action_kwargs")
    if isinstance(given, str):
        given = unpacked(given, "action_kwargs")
    answer = given.get("answer") if isinstance(given, dict) else None
    return None if is_missing_value(answer) else as_text(answer, "answer")


AGENTSYNTH = Source(
    name="agentsynth-web",
    paper_tasks=2_086,
    paper_websites=328,
    licence="Apache-2.0",
    instruction=_AGENTSYNTH_INSTRUCTION,
    draft=_draft_agentsynth,
    marks=(("action_sequence", "task"), ("thoughts_sequence", "task")),
)


# BrowseComp: short answers that are hard to find. Published encrypted, to keep them out of crawls.
#
# Every task has the flag :data:`~webgym.tasks.sources.base.ENCRYPTED_SOURCE`: it is not written to a file
# unless the user requests the source by name. No message quotes the tasks.

_BROWSECOMP_INSTRUCTION = ("problem", "question")
_BROWSECOMP_PLACES: dict[str, Place] = {
    "tv shows & movies": subdomain("Films & TV Shows"),
    "music": subdomain("Music"),
    "video games": subdomain("Gaming & Virtual Worlds"),
    "sports": subdomain("Sports & Fitness"),
    "science & technology": subdomain("Technology & Science"),
}
"""Taxonomy by ``problem_topic``. The other topics (art, geography, history, ...) match no single
subdomain."""


def decrypt(cipher: str, canary: str) -> str:
    """Decrypt a field: XOR with the SHA-256 of the canary, repeated.

    Raises:
        Unusable: it cannot be decrypted: the canary is of another row, or the field is damaged or not
            encrypted.
    """
    try:
        data = base64.b64decode("".join(cipher.split()), validate=True)
    except (binascii.Error, ValueError) as error:
        raise Unusable("it is not encrypted as in BrowseComp: it is not base64") from error
    digest = hashlib.sha256(canary.encode()).digest()
    key = digest * (len(data) // len(digest) + 1)
    try:
        plain = bytes(a ^ b for a, b in zip(data, key, strict=False)).decode()
    except UnicodeDecodeError as error:
        raise Unusable("it does not decrypt with its canary") from error
    if any(unicodedata.category(letter) == "Cc" and letter not in "\t\r\n" for letter in plain):
        raise Unusable("it does not decrypt with its canary")
    return plain.strip()


def _draft_browsecomp(fields: Fields, _: Companions) -> Draft:
    cipher = fields.instruction(*_BROWSECOMP_INSTRUCTION)
    # Not stripped: the key is the hash of all these characters.
    canary = fields.value("canary")
    if not isinstance(canary, str):
        raise Unusable("no 'canary' to decrypt with")
    question = decrypt(cipher, canary)
    if not question:
        raise Unusable("'problem' is empty")
    draft = Draft(question, fields.native_id("id"), flags=[ENCRYPTED_SOURCE])
    answer = fields.text("answer")
    draft.reference_answer = (decrypt(answer, canary) or None) if answer else None
    topic = fields.value("problem_topic")
    draft.domain, draft.subdomain = _place(topic)
    return draft


def _place(topic: object) -> Place:
    if not isinstance(topic, str):
        return UNKNOWN
    return _BROWSECOMP_PLACES.get(topic.strip().casefold().replace(" and ", " & "), named(topic))


BROWSECOMP = Source(
    name="browsecomp",
    paper_tasks=1_266,
    paper_websites=7,
    licence="MIT (code)",
    instruction=_BROWSECOMP_INSTRUCTION,
    draft=_draft_browsecomp,
    marks=(("problem", "canary"),),
    timeless=True,
)


# TravelPlanner: trips to plan within constraints. Its nested columns are Python literals, not JSON.
#
# ``reference_information`` (tables for a planner without a browser) is not read: an agent finds them on the
# web. ``plan`` of the JSON lines was written by a model, so it is no example of a good answer;
# ``annotated_plan`` of the CSV was written by a person.

_TRAVELPLANNER_INSTRUCTION = ("query",)
_CHAT = "messages"
_CONSTRAINTS = (
    ("org", "from"),
    ("dest", "to"),
    ("days", "days"),
    ("visiting_city_number", "cities to visit"),
    ("people_number", "people"),
    ("budget", "budget in dollars"),
)


def _draft_travelplanner(fields: Fields, _: Companions) -> Draft:
    query = _query_in_chat(fields.value(_CHAT))
    draft = Draft(query or fields.instruction(*_TRAVELPLANNER_INSTRUCTION), fields.native_id("idx"))
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


TRAVELPLANNER = Source(
    name="travelplanner",
    paper_tasks=1_225,
    paper_websites=1,
    licence="CC BY 4.0",
    instruction=(*_TRAVELPLANNER_INSTRUCTION, _CHAT),
    draft=_draft_travelplanner,
    marks=(("query", "plan"), ("query", "org", "dest"), ("query", "local_constraint"), (_CHAT,)),
)


# Mind2Web-2: long searches over many websites; some tasks have a companion file with a verification tree.

_MIND2WEB_2_INSTRUCTION = ("task_description", "confirmed_task", "task", "query")
_MAX_DEPTH = 64
"""Most levels of a tree that are read; the published ones have about six."""


def _draft_mind2web_2(fields: Fields, companions: Companions) -> Draft:
    native_id = fields.native_id("task_id", "id")
    draft = Draft(fields.instruction(*_MIND2WEB_2_INSTRUCTION), native_id, fields.website("website"))
    draft.domain, draft.subdomain = named(
        fields.value("subdomain"), fields.value("category"), fields.value("domain")
    )
    path = fields.value("rubric_path")
    if isinstance(path, str):
        draft.hints = companions.load(path, _leaves) or ()
    elif native_id:
        draft.hints = companions.load(f"{native_id}_rubric.json", _leaves) or ()
    return draft


def _leaves(data: object) -> tuple[str, ...]:
    """The descriptions of the leaves of a verification tree.

    Raises:
        ValueError: the data have no verification tree.
    """
    breakdown = data.get("eval_breakdown") if isinstance(data, dict) else None
    first = breakdown[0] if isinstance(breakdown, list) and breakdown else data
    root = first.get("verification_tree", first) if isinstance(first, dict) else None
    if not isinstance(root, dict) or "children" not in root:
        raise ValueError("no verification tree")
    return tuple(dict.fromkeys(_walk(root, 0)))


def _walk(node: dict[object, object], depth: int) -> Iterator[str]:
    children = node.get("children")
    inner = [child for child in children if isinstance(child, dict)] if isinstance(children, list) else []
    if depth == _MAX_DEPTH or not inner:
        word = "must hold" if node.get("critical") is True else "counts"
        # The field is "claim" in older trees, "desc" in newer ones.
        yield from (f"{word}: {text}" for text in texts(node.get("desc") or node.get("claim")))
        return
    for child in inner:
        yield from _walk(child, depth + 1)


MIND2WEB_2 = Source(
    name="mind2web-2",
    paper_tasks=130,
    paper_websites=44,
    licence="MIT",
    instruction=_MIND2WEB_2_INSTRUCTION,
    draft=_draft_mind2web_2,
    marks=(("task_description",), ("rubric_path",)),
    beside=("*_rubric.json", "taxonomy.json"),
)


# GAIA's web tasks: short exact answers. The website of every record is a search engine, as a placeholder.

_GAIA_INSTRUCTION = ("ques", "Question", "task")
_PLACEHOLDER = "google.com"
_WITHHELD = "?"
"""The answer field of tasks in GAIA's test set, whose answers are not published."""


def _draft_gaia(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_GAIA_INSTRUCTION), fields.native_id("task_id", "id"))
    website = fields.website("web", "website")
    url = website_url(website) if website else None
    if url and site_of(url) == _PLACEHOLDER:
        draft.flags.append(PLACEHOLDER_WEBSITE)
    else:
        draft.website = website
    answer = fields.answer("Final answer", "answer")
    draft.reference_answer = None if answer == _WITHHELD else answer
    if fields.value("file_name", "file_path"):
        draft.flags.append(NEEDS_FILE)
    return draft


GAIA = Source(
    name="gaia-web",
    paper_tasks=87,
    paper_websites=1,
    licence="gated",
    instruction=_GAIA_INSTRUCTION,
    draft=_draft_gaia,
    marks=(("Final answer",), ("ques", "Level")),
    timeless=True,
)


# WebGym's published set (SYSTEM.md 1.7): tasks with rubrics.

_WEBGYM = "webgym"
_WEBGYM_INSTRUCTION = ("task_name",)
_PLACEHOLDERS = {"task_id": "-", "website": "https://website.invalid/", "evaluator_reference": None}
"""Placeholders for columns that :func:`task_of` requires and records of a source may lack; not used
further."""
_EXTRA_COLUMNS = ("benchmark_name",)
"""Columns kept in ``extra``, because :class:`SourceTask` has no field for them."""


def _draft_webgym(fields: Fields, _: Companions) -> Draft:
    instruction = fields.instruction(*_WEBGYM_INSTRUCTION)
    given = {name: value for name, value in fields.record.items() if not is_missing_value(value)}
    try:
        task = task_of(_PLACEHOLDERS | given)
    except (ValueError, TypeError) as error:
        raise Unusable(str(error)) from error
    return Draft(
        instruction,
        task.id.removeprefix(f"{_WEBGYM}/") if "task_id" in given else None,
        fields.website("website"),
        domain=task.domain,
        subdomain=task.subdomain,
        reference_answer=task.reference_answer,
        rubric=None if NO_FACTS in task.flags else task.rubric,
        native_parent_id=task.parent_id and task.parent_id.removeprefix(f"{_WEBGYM}/"),
        split=task.split,
        flags=list(task.flags),
        extra=task.extra | {name: given[name] for name in _EXTRA_COLUMNS if name in given},
    )


PUBLISHED = Source(
    name=_WEBGYM,
    paper_tasks=292_092 + 1_167,  # training and test set
    paper_websites=127_645 + 1_167,
    licence="CDLA-Permissive-2.0",
    instruction=_WEBGYM_INSTRUCTION,
    draft=_draft_webgym,
    marks=(("task_name", "evaluator_reference"),),
    is_split=True,
)


SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        INSTA,
        WEBVOYAGER,
        AGENTSYNTH,
        BROWSECOMP,
        TRAVELPLANNER,
        MIND2WEB_LIVE,
        ONLINE_MIND2WEB,
        DEEPSHOP,
        MIND2WEB_2,
        GAIA,
        PUBLISHED,
    )
}
"""By name, in the order of the paper's Table 1; the published set comes last."""
