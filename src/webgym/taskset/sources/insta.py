"""InSTA: tasks that a model proposed for the hosts of a web crawl. v3 has steps and criteria, v1 does not."""

from __future__ import annotations

from webgym.taskset.sources.base import GARBLED, Draft, Source
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, texts
from webgym.taskset.sources.problems import Unusable

_INSTRUCTION = ("instruction", "task")


def _draft(fields: Fields, _: Companions) -> Draft:
    # The field of the host is "domain" in v1 and "website" in v3.
    draft = Draft(fields.instruction(*_INSTRUCTION), fields.native_id("task_id", "id"))
    draft.website = fields.website("website", "domain")
    hints: list[str] = []
    for name, word in (("steps", "step"), ("criteria", "criterion")):
        try:
            hints += (f"{word}: {text}" for text in texts(fields.packed(name)))
        except Unusable:
            draft.flags.append(GARBLED)
    draft.hints = tuple(hints)
    return draft


SOURCE = Source(
    name="insta-v3",
    paper_tasks=146_441,
    paper_websites=146_348,
    licence="MIT",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("steps", "criteria"), ("instruction", "website"), ("domain", "task")),
)
