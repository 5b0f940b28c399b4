"""Error rates of the rules for rubrics and for rewritten tasks, on data with known answers.

    .venv/bin/python benchmarks/rubric_rules.py
    .venv/bin/python benchmarks/rubric_rules.py --data ../shared/data --every 10

The rubrics of the offline web are composed from truths: none may be rejected. Its derived tasks ask for their
own facts: they must be accepted with their own text and rejected with that of a sibling. Key points that a
judge listed for real tasks, from ``--data``, are checked as rubrics.
"""

from __future__ import annotations

import argparse
import json
import re
from collections import Counter
from itertools import pairwise
from pathlib import Path

from webgym.core.task import Task
from webgym.offline.web import OfflineWeb
from webgym.tasks.rewriting import refused_rewriting
from webgym.tasks.rules import Asked, Draft, DraftGroup, check_rubric

REPLIES = "judge-labels/webjudge_replies_o4_mini.jsonl"


def of_rubrics(tasks: list[Task]) -> None:
    """Print how many rubrics of the offline web are rejected, and how many get a remark."""
    refused = remarked = 0
    remarks: Counter[str] = Counter()
    for task in tasks:
        answers = () if task.reference_answer is None else (task.reference_answer,)
        asked = Asked(task.instruction, task.website, answers=answers, derived=task.parent_id is not None)
        findings = check_rubric(Draft.of(task.rubric), asked)
        refused += any(finding.severity == "error" for finding in findings)
        remarked += bool(findings)
        remarks.update({finding.rule for finding in findings})
    print(
        f"rubrics of the offline web: {_share(refused, tasks)} rejected, "
        f"{_share(remarked, tasks)} with remarks"
    )
    print("  " + ", ".join(f"{rule} {count:,}" for rule, count in remarks.most_common()))


def of_derived(tasks: list[Task]) -> None:
    """Print how many derived tasks are rejected with their own text, and accepted with that of a sibling."""
    parents = {task.id: task for task in tasks if task.parent_id is None}
    derived = [task for task in tasks if task.parent_id in parents]
    own = [
        task
        for task in derived
        if refused_rewriting(task.instruction, parents[task.parent_id or ""], task.rubric.groups)
    ]
    siblings = [
        (one, other)
        for one, other in pairwise(derived)
        if one.parent_id == other.parent_id and one.rubric != other.rubric
    ]
    taken = [
        one
        for one, other in siblings
        if not refused_rewriting(one.instruction, parents[one.parent_id or ""], other.rubric.groups)
    ]
    print(f"derived tasks with their own text: {_share(len(own), derived)} rejected")
    print(f"derived tasks with a sibling's text: {_share(len(taken), siblings)} accepted")


def of_keypoints(path: Path) -> None:
    """Print how many lists of key points are rejected."""
    points: dict[str, tuple[str, tuple[str, ...]]] = {}
    for record in map(json.loads, path.read_text("utf-8").splitlines()):
        listed = (re.sub(r"^\d+[.)]\s*", "", line).strip() for line in record["key_points"].splitlines())
        points.setdefault(record["task_id"], (record["goal"].strip(), tuple(filter(None, listed))))
    lists = [(goal, facts) for goal, facts in points.values() if facts]
    rules: Counter[str] = Counter()
    refused = 0
    for goal, facts in lists:
        findings = check_rubric(Draft((DraftGroup(1, "a group", facts),), len(facts)), Asked(goal))
        errors = {finding.rule for finding in findings if finding.severity == "error"}
        refused += bool(errors)
        rules.update(errors)
    print(f"key points of a judge, checked as rubrics: {_share(refused, lists)} rejected")
    print("  " + ", ".join(f"{rule} {count}" for rule, count in rules.most_common()))


def _share(count: int, of: list[Task] | list[tuple[Task, Task]] | list[tuple[str, tuple[str, ...]]]) -> str:
    return f"{count:,} of {len(of):,} ({count / max(1, len(of)):.1%})"


def main() -> None:
    """Print all results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder of source files")
    parser.add_argument("--every", type=int, default=1, help="only every n-th website of the offline web")
    args = parser.parse_args()
    web = OfflineWeb()
    tasks = [task for host in list(web.specs)[:: args.every] for task in web.tasks_of(host)]
    of_rubrics(tasks)
    of_derived(tasks)
    if (path := args.data / REPLIES).exists():
        of_keypoints(path)


if __name__ == "__main__":
    main()
