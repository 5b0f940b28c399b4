"""Judges against people: known answers, an independent implementation, the figures of the real replies."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from tests.documented import documented
from tests.judge.scenes import TASK, episode, pictures
from tests.judge.test_webjudge import REAL

from webgym.cli import main
from webgym.core.errors import ConfigError, UsageError
from webgym.core.task import LEVELS, WHOLE_TASK, Task
from webgym.core.trajectory import Episode
from webgym.judge.agreement import (
    METRICS,
    AgreementConfig,
    Case,
    Confusion,
    Estimate,
    Metric,
    agreement,
    draw_agreement,
    rates,
)
from webgym.judge.config import JudgeChoice
from webgym.judge.factory import name_of, open_judge
from webgym.judge.panel import PREFIX

QUICK = AgreementConfig(resamples=200)


def measured(pairs: Sequence[tuple[bool, bool | None]], **options: object) -> dict[Metric, float | None]:
    config = AgreementConfig.model_validate({"resamples": 100, **options})
    found = agreement(["j"], [Case(human, (verdict,)) for human, verdict in pairs], config)
    return {name: estimate.value for name, estimate in found.judges["j"]["overall"].metrics.items()}


# --- metrics -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("counts", "expected"),
    [
        # Cohen's own layout of 50 proposals read by two readers: kappa 0.4.
        ((20, 5, 10, 15), (0.7, 0.8, 2 / 3, 8 / 11, 0.4)),
        ((10, 0, 0, 10), (1.0, 1.0, 1.0, 1.0, 1.0)),
        ((0, 5, 5, 0), (0.0, 0.0, 0.0, 0.0, -1.0)),
        ((25, 25, 25, 25), (0.5, 0.5, 0.5, 0.5, 0.0)),
        # Nothing passed: there is no precision; recall and kappa are 0 because people passed some.
        ((0, 0, 4, 6), (0.6, None, 0.0, 0.0, 0.0)),
        # People passed nothing: there is no recall.
        ((0, 3, 0, 7), (0.7, 0.0, None, 0.0, 0.0)),
        # All alike: chance alone would agree, so there is no kappa; without positives, no F1 either.
        ((0, 0, 0, 9), (1.0, None, None, None, None)),
        ((9, 0, 0, 0), (1.0, 1.0, 1.0, 1.0, None)),
        ((0, 0, 0, 0), (None, None, None, None, None)),
    ],
)
def test_known_answers(counts: tuple[int, int, int, int], expected: tuple[float | None, ...]) -> None:
    assert rates(Confusion(*counts)) == pytest.approx(dict(zip(METRICS, expected, strict=True)))


def naive(pairs: Sequence[tuple[bool, bool]]) -> dict[Metric, float | None]:
    """The definitions, in words other than ours."""

    def share(part: int, whole: int) -> float | None:
        return part / whole if whole else None

    total = len(pairs)
    hits = [human for human, verdict in pairs if verdict]
    wanted = [verdict for human, verdict in pairs if human]
    accuracy = share(len([1 for human, verdict in pairs if human is verdict]), total)
    precision, recall = share(hits.count(True), len(hits)), share(wanted.count(True), len(wanted))
    f1 = None
    if hits or wanted:
        p, r = precision or 0.0, recall or 0.0
        f1 = 2 * p * r / (p + r) if p + r else 0.0
    kappa = None
    if total and accuracy is not None:
        a, b = len(wanted) / total, len(hits) / total
        chance = a * b + (1 - a) * (1 - b)
        kappa = (accuracy - chance) / (1 - chance) if chance < 1 - 1e-12 else None
    return {"accuracy": accuracy, "precision": precision, "recall": recall, "f1": f1, "kappa": kappa}


@given(st.lists(st.tuples(st.booleans(), st.none() | st.booleans()), max_size=30))
@settings(deadline=None)
def test_as_an_independent_implementation_has_it(pairs: list[tuple[bool, bool | None]]) -> None:
    clear = [(human, verdict) for human, verdict in pairs if verdict is not None]
    assert measured(pairs) == pytest.approx(naive(clear), abs=1e-12)
    as_failures = [(human, bool(verdict)) for human, verdict in pairs]
    assert measured(pairs, no_verdict="failure") == pytest.approx(naive(as_failures), abs=1e-12)


# --- groups, missing verdicts, intervals ---------------------------------------------------------------


def cases(count: int = 90) -> list[Case]:
    """Two judges of which the second is better, and is silent now and then."""
    made = []
    for number in range(count):
        human = number % 2 == 0
        one, other = human ^ (number % 4 == 1), human ^ (number % 10 == 9)
        silent = number % 15 == 14
        made.append(Case(human, (one, None if silent else other), LEVELS[number % 3], f"t{number // 2}"))
    return made


def test_groups_add_up_and_missing_verdicts_are_counted() -> None:
    found = agreement(["one", "other"], cases(), QUICK)
    assert found.cases == {"overall": 90, "easy": 30, "medium": 30, "hard": 30}
    for by_group in found.judges.values():
        for count in ("both", "judge_only", "human_only", "neither"):
            levels = sum(getattr(by_group[level].confusion, count) for level in LEVELS)
            assert levels == getattr(by_group["overall"].confusion, count)
    other = found.judges["other"]["overall"]
    assert other.no_verdict == 6
    assert other.confusion.total == 84
    counted = agreement(["one", "other"], cases(), AgreementConfig(resamples=100, no_verdict="failure"))
    assert counted.judges["other"]["overall"].confusion.total == 90
    assert counted.judges["other"]["overall"].no_verdict == 6
    (difference,) = found.differences
    assert (difference.judge, difference.baseline) == ("other", "one")
    assert difference.cases["overall"] == 84  # those that both have a verdict on


def test_a_group_without_cases_is_left_out_and_an_unknown_level_is_in_the_whole() -> None:
    found = agreement(["j"], [Case(True, (True,), "easy"), Case(False, (False,))], QUICK)
    assert found.cases == {"overall": 2, "easy": 1}
    assert set(found.judges["j"]) == {"overall", "easy"}


def test_intervals_hold_the_value_and_are_the_same_for_a_seed() -> None:
    found = agreement(["one", "other"], cases(), QUICK)
    for figures in (group for judge in found.judges.values() for group in judge.values()):
        for estimate in figures.metrics.values():
            assert estimate.value is not None
            if estimate.value < 1:
                assert estimate.low is not None
                assert estimate.high is not None
                assert estimate.low <= estimate.value <= estimate.high
    assert agreement(["one", "other"], cases(), QUICK) == found
    assert agreement(["one", "other"], cases(), AgreementConfig(resamples=200, seed=1)) != found


def test_the_interval_of_a_proportion_is_about_that_of_the_binomial() -> None:
    pairs = [Case(True, (number < 70,)) for number in range(100)]
    estimate = agreement(["j"], pairs).judges["j"]["overall"].metrics["accuracy"]
    assert estimate.value == 0.7
    assert estimate.low == pytest.approx(0.61, abs=0.011)
    assert estimate.high == pytest.approx(0.79, abs=0.011)


def test_attempts_at_one_task_stand_and_fall_together() -> None:
    def width(task: str) -> float:
        made = [Case(True, (number % 40 < 28,), None, task.format(number % 40)) for number in range(400)]
        estimate = agreement(["j"], made).judges["j"]["overall"].metrics["accuracy"]
        assert estimate.low is not None
        assert estimate.high is not None
        return estimate.high - estimate.low

    # Ten attempts at each of 40 tasks that all end alike say as much as 40 attempts, not 400.
    assert width("task {}") == pytest.approx(width("") * 10**0.5, rel=0.1)


def test_paired_differences_are_narrower_than_the_judges_apart() -> None:
    made = [
        Case(number % 3 == 0, (number % 7 > 1, number % 7 > 1 or number % 29 == 0), None, "")
        for number in range(300)
    ]
    found = agreement(["one", "other"], made)
    paired = found.differences[0].metrics["overall"]["accuracy"]
    alone = [found.judges[judge]["overall"].metrics["accuracy"] for judge in found.judges]
    assert paired.value == pytest.approx((alone[1].value or 0) - (alone[0].value or 0))

    def width(estimate: Estimate) -> float:
        assert estimate.low is not None
        assert estimate.high is not None
        return estimate.high - estimate.low

    assert width(paired) < 0.5 * min(map(width, alone))


def test_what_resamples_say_nothing_about_has_no_interval() -> None:
    always = agreement(["j"], [Case(True, (True,)) for _ in range(5)], QUICK).judges["j"]["overall"]
    assert always.metrics["accuracy"] == Estimate(1.0)
    rare = [Case(number == 0, (False,)) for number in range(20)]  # most resamples lack the one success
    assert agreement(["j"], rare, QUICK).judges["j"]["overall"].metrics["recall"] == Estimate(0.0)


def test_verdicts_must_fit_the_judges() -> None:
    with pytest.raises(ValueError, match="2 verdicts"):
        agreement(["a", "b"], [Case(True, (True,))])
    with pytest.raises(ValueError, match="same name"):
        agreement(["a", "a"], [])
    assert agreement(["a"], []).cases == {"overall": 0}


# --- the figure and the command -------------------------------------------------------------------------


def test_the_figure_is_drawn_and_is_the_same_twice(tmp_path: Path) -> None:
    found = agreement(["qwen", f"{PREFIX}qwen"], cases(), QUICK)
    for name in ("one.png", "one.svg", "two.svg"):
        draw_agreement(found, tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()
    with Image.open(tmp_path / "one.png") as picture:
        assert picture.width == 2100  # 7 inches at 300 dots
        colours = {colour for _, colour in picture.convert("RGB").getcolors(2**24) or []}
    assert (0x00, 0x72, 0xB2) in colours
    with pytest.raises(UsageError, match="format"):
        draw_agreement(found, tmp_path / "one.doc")
    undefined = agreement(["silent"], [Case(False, (False,))], QUICK)
    draw_agreement(undefined, tmp_path / "undefined.pdf")
    assert (tmp_path / "undefined.pdf").read_bytes().startswith(b"%PDF")


Command: TypeAlias = Callable[..., tuple[int, str]]


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """``webgym judge agreement`` in this process: exit code, and all that was printed."""

    def run(*options: object) -> tuple[int, str]:
        with pytest.raises(SystemExit) as ended:
            main(["judge", "agreement", *map(str, options)])
        printed = capsys.readouterr()
        return int(ended.value.code or 0), printed.out + printed.err

    return run


def replies(path: Path, *records: dict[str, object]) -> Path:
    path.write_text("\ufeff" + "".join(json.dumps(record) + "\n" for record in records) + "not JSON\n")
    return path


def test_a_cut_off_reply_is_no_verdict_and_a_broken_line_is_told(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    human = [{"annotator": "A", "success": "Successful"}]
    common = {"judge": "j", "benchmark": "b", "agent": "a", "human": human}
    file = replies(
        tmp_path / "webjudge_replies_o4_mini.jsonl",
        common | {"task_id": 1, "judge_response": "x\nStatus: success", "judge_status": "success"},
        # What the study took for a pass does not count where the reply ends half-way.
        common | {"task_id": 2, "judge_response": "it went well. Status: succ", "judge_status": "success"},
        common | {"task_id": 3, "judge_response": "x\nStatus: failure", "judge_status": "failure"},
        common | {"task_id": 3, "judge_response": "x\nStatus: failure", "judge_status": "failure"},
    )
    code, said = command("--webjudge", file, "--no-verdict", "left_out", "--json")
    assert code == 0
    told = json.loads(said)
    for judge in ("j", "j, as recorded"):
        overall = told["judges"][judge]["overall"]
        assert overall["confusion"] == {"both": 1, "judge_only": 0, "human_only": 2, "neither": 0}
        assert overall["no_verdict"] == 1
    assert any("line 5" in note for note in told["notes"])
    monkeypatch.chdir(tmp_path)
    page = documented("webgym judge agreement --webjudge webjudge_replies_o4_mini.jsonl")
    code, said = command(*page[2:])
    assert code == 0
    assert "counts as a failure" in said
    assert "0.250" in said


def test_webjudges_own_results_are_joined_with_labels_of_tasks(tmp_path: Path, command: Command) -> None:
    def result(task: int, status: str, **more: Any) -> dict[str, Any]:
        details = {"response": f"Thoughts: looked.\nStatus: {status}"}
        return {"task_id": f"t{task}", "evaluation_details": details} | more

    file = replies(
        tmp_path / "results.json",
        result(1, "success", predicted_label=1),
        result(2, "failure", predicted_label=0),
        result(3, "failure", predicted_label=0),
        result(4, "success", predicted_label=1),
    )
    labels = tmp_path / "human_label.json"
    given = {"t1": "1", "t2": "0", "t3": "1", "t4": "2"}
    labels.write_text(
        json.dumps([{"task_id": task, "Crab_human_label": said} for task, said in given.items()])
    )
    code, said = command("--webjudge", file, "--labels", labels, "--json")
    assert code == 0, said
    overall = json.loads(said)["judges"]["WebJudge"]["overall"]
    assert overall["confusion"] == {"both": 1, "judge_only": 0, "human_only": 1, "neither": 1}

    two = [{"task_id": "t1", "Crab_human_label": "1", "Newt_human_label": "0"}]
    labels.write_text(json.dumps(two))
    code, said = command("--webjudge", file, "--labels", labels)
    assert code == 2
    assert "--agent is one of Crab, Newt" in said
    code, said = command("--webjudge", file, "--labels", labels, "--agent", "Newt", "--json")
    confusion = json.loads(said)["judges"]["WebJudge"]["overall"]["confusion"]
    assert confusion == {"both": 0, "judge_only": 1, "human_only": 0, "neither": 0}

    # The other judge's results of the same attempts are told by the file's name, and have its form.
    seen = {"task_id": "t1", "evaluation_details": {"response": "It is there.\nNOT SUCCESS"}}
    other = replies(tmp_path / "WebVoyager_eval_o4-mini.json", seen | {"predicted_label": 0})
    files = ("--webjudge", file, "--webjudge", other, "--labels", labels, "--agent", "Newt")
    code, said = command(*files, "--json")
    told = json.loads(said)["judges"]
    assert told["WebJudge"]["overall"]["confusion"]["judge_only"] == 1
    assert told["WebVoyager"]["overall"]["confusion"]["neither"] == 1

    code, said = command("--webjudge", replies(tmp_path / "other.jsonl", {"foo": 1}))
    assert code == 2
    assert "neither judge_response nor evaluation_details" in said


def test_what_cannot_be_measured_is_said_in_a_line(tmp_path: Path, command: Command) -> None:
    for options in ((), ("run", "--webjudge", "x"), ("--webjudge", "x", "--json", "--markdown")):
        code, said = command(*options)
        assert code == 2, said
        assert said.startswith("webgym: ")
    empty = tmp_path / "empty.jsonl"
    empty.write_text("")
    code, said = command("--webjudge", empty)
    assert code == 2
    assert "there are no labels" in said


@pytest.mark.skipif(not REAL.exists(), reason=f"{REAL} is not there")
def test_the_figures_of_the_real_replies(command: Command, tmp_path: Path) -> None:
    code, said = command("--webjudge", REAL, "--markdown", "--figure", tmp_path / "f.png")
    assert code == 0
    assert (tmp_path / "f.png").stat().st_size > 10_000
    row = next(line for line in said.splitlines() if line.startswith("| webjudge_o4_mini, as recorded | o"))
    cells = [cell.strip().split(" ")[0] for cell in row.strip("|").split("|")]
    # SOURCES.md: first annotator, parsed verdict.
    assert cells[2:6] == ["498", "0.833", "0.847", "0.550"]
    read = next(line for line in said.splitlines() if line.startswith("| webjudge_o4_mini | o"))
    assert [cell.strip().split(" ")[0] for cell in read.strip("|").split("|")][3:6] == [
        "0.835",
        "0.848",
        "0.556",
    ]


async def test_the_offline_judge_needs_the_rubric() -> None:
    with pytest.raises(ConfigError, match="without rubric"):
        async with open_judge(JudgeChoice(without_rubric=True)):
            raise AssertionError("it was opened")


def passes(task: Task, episode: Episode) -> bool:
    assert task.rubric == WHOLE_TASK
    return True


async def test_a_judge_of_any_kind_can_be_asked_without_rubric() -> None:
    choice = JudgeChoice(name="tests.judge.test_agreement:passes", without_rubric=True)
    async with open_judge(choice) as judge:
        assert judge.name == name_of(choice)
        found = await judge.judge(TASK, episode(), pictures)
    assert found.judge == judge.name
    assert judge.name.startswith(PREFIX)
    assert found.reward == 1
