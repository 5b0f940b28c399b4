"""GAIA's web tasks: short exact answers. The website of every record is a search engine, as a placeholder."""

from __future__ import annotations

from webgym.core.websites import site_of
from webgym.taskset.sources.base import NEEDS_FILE, PLACEHOLDER_WEBSITE, Draft, Source
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, website_url

_INSTRUCTION = ("ques", "Question", "task")
_PLACEHOLDER = "google.com"
_WITHHELD = "?"
"""The answer field of tasks in GAIA's test set, whose answers are not published."""


def _draft(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_INSTRUCTION), fields.native_id("task_id", "id"))
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


SOURCE = Source(
    name="gaia-web",
    paper_tasks=87,
    paper_websites=1,
    licence="gated",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("Final answer",), ("ques", "Level")),
    timeless=True,
)
