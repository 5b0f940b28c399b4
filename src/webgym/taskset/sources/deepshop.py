"""DeepShop: shopping on Amazon. ``attribute``, ``filter`` and ``sort`` are hints; some of them are
garbled."""

from __future__ import annotations

import re

from webgym.taskset.sources.base import GARBLED, Draft, Source
from webgym.taskset.sources.categories import subdomain
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, texts

_INSTRUCTION = ("ques", "question", "task")
_REPEATED_WORD = re.compile(r"\b(\w{2,})\s+\1\b", re.IGNORECASE)


def _draft(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_INSTRUCTION), fields.native_id("id", "task_id"))
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


SOURCE = Source(
    name="deepshop",
    paper_tasks=150,
    paper_websites=1,
    licence="CC BY 4.0",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("ques", "attribute", "filter", "sort"),),
)
