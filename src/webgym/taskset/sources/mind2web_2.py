"""Mind2Web-2: long searches over many websites; some tasks have a companion file with a verification tree."""

from __future__ import annotations

from collections.abc import Iterator

from webgym.taskset.sources.base import Draft, Source
from webgym.taskset.sources.categories import named
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, texts

_INSTRUCTION = ("task_description", "confirmed_task", "task", "query")
_MAX_DEPTH = 64
"""Most levels of a tree that are read; the published ones have about six."""


def _draft(fields: Fields, companions: Companions) -> Draft:
    native_id = fields.native_id("task_id", "id")
    draft = Draft(fields.instruction(*_INSTRUCTION), native_id, fields.website("website"))
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


SOURCE = Source(
    name="mind2web-2",
    paper_tasks=130,
    paper_websites=44,
    licence="MIT",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("task_description",), ("rubric_path",)),
    beside=("*_rubric.json", "taxonomy.json"),
)
