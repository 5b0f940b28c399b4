"""What a run prints when it is over."""

from __future__ import annotations

import io

import msgspec
from rich.console import Console
from tests.rollout.test_summary import TASKS, attempt

from webgym.cli._summary import all_failed, print_retry, print_summary
from webgym.core.action import Wait
from webgym.core.outcome import Outcome
from webgym.core.trajectory import Failure
from webgym.results.summary import summarise

REFUSED = Failure("policy_bad_reply", "the endpoint answered 401:\x1b[31m\nwrong [key]")


def test_a_person_is_told_why_attempts_failed() -> None:
    failed = attempt("e", Outcome.POLICY_ERROR, failure=REFUSED)
    said = io.StringIO()
    print_summary(summarise([failed, attempt("m", Outcome.SUCCESS)], TASKS), Console(file=said, width=200))
    told = "the endpoint answered 401:\N{REPLACEMENT CHARACTER}[31m wrong [key]"
    assert f"  1 policy_bad_reply: {told} ({failed.episode.attempt_id})\n" in said.getvalue()


def test_rates_stand_beside_what_they_are_of() -> None:
    ended = [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.FAILURE, Outcome.POLICY_ERROR]
    said = io.StringIO()
    found = summarise([attempt("e", outcome) for outcome in ended], [TASKS[0]] * 4)
    print_summary(found, Console(file=said, width=200))
    overall = next(line for line in said.getvalue().splitlines() if line.startswith("overall")).split()
    assert (overall[1], overall[3]) == ("66.7%", "3")
    assert (overall[4], overall[6]) == ("50.0%", "4")
    assert overall[7] == "2"
    assert "median" in said.getvalue()


def test_whoever_reads_an_oracles_figures_is_told() -> None:
    said = io.StringIO()
    print_summary(summarise([attempt("e", Outcome.SUCCESS)], TASKS), Console(file=said, width=200))
    assert "the scripted policy is an oracle: it plays known solutions and uses no model" in said.getvalue()


def test_hosts_that_kept_the_agent_out_are_named() -> None:
    said = io.StringIO()
    found = summarise([attempt("e", Outcome.SUCCESS)], TASKS)
    found["blocked_hosts"] = {f"s{number}.example": 9 - number for number in range(7)}
    found["invalid_reply_rate"] = 0.5
    print_summary(found, Console(file=said, width=200))
    assert "  blocked by s0.example (9), s1.example (8), " in said.getvalue()
    assert "s4.example (5), and 2 others\n" in said.getvalue()
    assert said.getvalue().endswith(" ms (p95), 50.0% of replies invalid\n")
    assert str(found).split() == said.getvalue().split(), "print() shows the same in Python"


def test_what_errors_took_can_be_attempted_again() -> None:
    said = io.StringIO()
    lost = summarise([attempt("e", Outcome.POLICY_ERROR), attempt("m", Outcome.SUCCESS)], TASKS)
    print_retry(lost, "webgym rollout --resume r", Console(file=said, width=200))
    assert said.getvalue() == (
        "errors   1 sample ended in an error; retry with: webgym rollout --resume r --retry-errors\n"
    )
    said = io.StringIO()
    print_retry(summarise([attempt("m", Outcome.BLOCKED)], TASKS), "", Console(file=said))
    assert not said.getvalue()


def test_attempts_without_a_verdict_can_be_judged_again() -> None:
    said = io.StringIO()
    unjudged = summarise([attempt("e", Outcome.JUDGE_ERROR), attempt("m", Outcome.SUCCESS)], TASKS)
    print_retry(unjudged, "webgym rollout --resume r", Console(file=said, width=200))
    assert said.getvalue() == "unjudged 1 attempt has no verdict; judge with: webgym rollout --resume r\n"


def test_the_share_of_invalid_replies_is_always_told() -> None:
    said = io.StringIO()
    valid = attempt("e", Outcome.SUCCESS, steps=2)
    steps = tuple(msgspec.structs.replace(step, action=Wait(1)) for step in valid.episode.steps)
    valid = msgspec.structs.replace(valid, episode=msgspec.structs.replace(valid.episode, steps=steps))
    print_summary(summarise([valid], TASKS), Console(file=said, width=200))
    assert said.getvalue().rstrip().endswith(", 0.0% of replies invalid")


def test_a_run_of_errors_alone_has_failed() -> None:
    errors = [
        attempt("e", outcome)
        for outcome in (Outcome.POLICY_ERROR, Outcome.ENVIRONMENT_ERROR, Outcome.JUDGE_ERROR)
    ]
    assert all_failed(summarise(errors, TASKS))
    for outcome in (Outcome.SUCCESS, Outcome.FAILURE, Outcome.TRUNCATED, Outcome.BLOCKED, Outcome.CANCELLED):
        assert not all_failed(summarise([*errors, attempt("m", outcome)], TASKS))
    assert not all_failed(summarise([], TASKS))
