"""What a run prints when it is over."""

from __future__ import annotations

import io

from rich.console import Console
from tests.rollout.test_summary import TASKS, attempt

from webgym.cli._summary import all_failed, print_summary
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Failure
from webgym.rollout.summary import summarise

REFUSED = Failure("policy_bad_reply", "the endpoint answered 401:\x1b[31m\nwrong [key]")


def test_a_person_is_told_why_attempts_failed() -> None:
    failed = attempt("e", Outcome.POLICY_ERROR, failure=REFUSED)
    said = io.StringIO()
    print_summary(summarise([failed, attempt("m", Outcome.SUCCESS)], TASKS), Console(file=said, width=200))
    line = (
        f"  1 policy_bad_reply: the endpoint answered 401: [31m wrong [key] ({failed.episode.attempt_id})\n"
    )
    assert line in said.getvalue()


def test_a_run_of_errors_alone_has_failed() -> None:
    errors = [
        attempt("e", outcome)
        for outcome in (Outcome.POLICY_ERROR, Outcome.ENVIRONMENT_ERROR, Outcome.JUDGE_ERROR)
    ]
    assert all_failed(summarise(errors, TASKS))
    for outcome in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED, Outcome.BLOCKED, Outcome.CANCELLED):
        assert not all_failed(summarise([*errors, attempt("m", outcome)], TASKS))
    assert not all_failed(summarise([], TASKS))
