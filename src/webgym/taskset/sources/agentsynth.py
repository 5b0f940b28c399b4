"""AgentSynth's web tasks: written by a model that also attempted them, with its actions.

``action_sequence`` contains JSON strings in the full file and objects in the summarised one; some strings are
plain text. A final ``stop`` action has the model's answer: an example, not a reference answer.
"""

from __future__ import annotations

from webgym.tasks.missing_values import is_missing_value
from webgym.taskset.sources.base import GARBLED, Draft, Source
from webgym.taskset.sources.companions import Companions
from webgym.taskset.sources.fields import Fields, as_text, unpacked
from webgym.taskset.sources.problems import Unusable

_INSTRUCTION = ("task", "instruction")


def _draft(fields: Fields, _: Companions) -> Draft:
    draft = Draft(fields.instruction(*_INSTRUCTION), fields.native_id("task_id", "id"))
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


SOURCE = Source(
    name="agentsynth-web",
    paper_tasks=2_086,
    paper_websites=328,
    licence="Apache-2.0",
    instruction=_INSTRUCTION,
    draft=_draft,
    marks=(("action_sequence", "task"), ("thoughts_sequence", "task")),
)
