"""Checks of the rubric's rules that need no model (SYSTEM.md 1.4).

A finding of severity ``error`` is refused, and the writer asked again with the finding as the reason; a
``warning`` is reported. Errors are rules that a reader would hardly argue with; where a rule sees only that
something is likely, it warns. ``tests/tasks/test_rules.py`` holds how often they are wrong on good rubrics.
"""

from __future__ import annotations

from typing import Final

from webgym.tasks.rules import form, granularity, task_consistency, wording
from webgym.tasks.rules.rule import Asked, Case, Draft, DraftGroup, Finding, Rule

__all__ = ["RULES", "Asked", "Draft", "DraftGroup", "Finding", "Rule", "check_rubric"]

RULES: Final[tuple[Rule, ...]] = (
    Rule("empty-group", "error", "at least one group, and a fact in every group", form.no_groups),
    Rule("empty-fact", "error", "no blank fact, no None", form.empty_facts),
    Rule("no-description", "error", "every group is described", form.no_description),
    Rule("difficulty", "error", "the difficulty is the number of facts", form.difficulty),
    Rule("group-ids", "error", "groups are numbered 1 to n", form.ids),
    Rule("duplicate", "error", "no fact twice", form.duplicates),
    Rule("restated-task", "error", "no fact is the whole task beside its parts", form.restated_task),
    Rule("too-many-facts", "error", "not more facts than tasks ask for", form.too_many),
    Rule("split-alternatives", "error", "alternatives are one fact", granularity.split_alternatives),
    Rule("several-things", "error", "one thing per fact", wording.several_things),
    Rule("step", "error", "what must hold, not what to do on the way", wording.steps),
    Rule(
        "example-as-fact",
        "error",
        "the task's examples are not asked for",
        task_consistency.examples_as_facts,
    ),
    Rule(
        "unstated-number",
        "error",
        "no number that the task does not state",
        task_consistency.unstated_numbers,
    ),
    Rule(
        "leaked-answer",
        "error",
        "nothing that only the answer or the hints say",
        task_consistency.leaked_answers,
    ),
    Rule("how-to", "error", "instructions are one fact", granularity.steps_of_instructions),
    Rule("purchase", "error", "what is bought, and that it is", granularity.steps_of_purchase),
    Rule("computation", "error", "a computation is one fact", granularity.steps_of_computation),
    Rule("operands", "error", "operands only where they are asked for", granularity.operands),
    Rule("enumerated", "error", "what the task leaves open is one fact", task_consistency.enumerated),
    Rule("hollow", "error", "a fact names what must hold", wording.hollow),
    Rule("no-subject", "error", "a fact says what it is about", task_consistency.stop_words_only),
    Rule("markup", "error", "one line of plain text", wording.markup),
    Rule("endless", "error", "no fact is a paragraph", wording.endless_facts),
    Rule("repetition", "warning", "facts of several groups say which they are about", form.repetitions),
    Rule("or-in-capitals", "warning", "OR in capitals, inside one fact", wording.lower_case_or),
    Rule("examples", "warning", "no such as, no e.g.", wording.examples),
    Rule("several-clauses", "warning", "one statement per fact", wording.several_clauses),
    Rule("several-conditions", "warning", "one condition per fact", wording.several_conditions),
    Rule("several-sentences", "warning", "one sentence per fact", wording.several_sentences),
    Rule("unstated-name", "warning", "no name that the task does not state", task_consistency.unstated_names),
    Rule(
        "unstated-quotation",
        "warning",
        "no quotation that the task does not say",
        task_consistency.unstated_quotations,
    ),
    Rule("off-task", "warning", "a word in common with the task", form.off_task),
    Rule("agent", "warning", "the world, not the agent", wording.agent),
    Rule("question", "warning", "a statement", wording.question),
    Rule("long", "warning", "a short fact", wording.long_facts),
    Rule("many-groups", "warning", "few groups", form.many_groups),
)
"""Every rule, errors first."""


def check_rubric(draft: Draft, asked: Asked) -> list[Finding]:
    """Every place where a rubric breaks a rule that can be seen, errors first.

    Args:
        draft: as the model wrote it; :meth:`Draft.of` takes a finished rubric.
        asked: the task that it is for.
    """
    if endless := list(wording.without_bounds(draft)):
        return [Finding("endless", "error", message) for message in endless]
    case = Case(draft, asked)
    return [Finding(rule.id, rule.severity, message) for rule in RULES for message in rule.look(case)]
