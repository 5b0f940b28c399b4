"""Benchmarks of searches on any website: AgentSynth, BrowseComp, TravelPlanner, Mind2Web-2, GAIA."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import re
import unicodedata
from collections.abc import Iterator

from webgym.core.websites import site_of
from webgym.tasks.missing_values import is_missing_value
from webgym.taskset.sources.base import (
    ENCRYPTED_SOURCE,
    GARBLED,
    NEEDS_FILE,
    PLACEHOLDER_WEBSITE,
    Draft,
    Source,
)
from webgym.taskset.sources.categories import UNKNOWN, Place, named, subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, as_text, texts, unpacked, website_url
from webgym.taskset.sources.problems import Unusable

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
# Every task has the flag :data:`~webgym.taskset.sources.base.ENCRYPTED_SOURCE`: it is not written to a file
# unless the user requests the source by name. No message quotes the tasks.

_BROWSECOMP_INSTRUCTION = ("problem", "question")
_PLACES: dict[str, Place] = {
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
    return _PLACES.get(topic.strip().casefold().replace(" and ", " & "), named(topic))


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
