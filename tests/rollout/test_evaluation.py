"""Success on a test set: what counts, with which interval, and the command from end to end."""

from __future__ import annotations

import io
import json
import shutil
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from tests.conftest import Calls
from tests.rollout.test_summary import attempt, task

from webgym.core.errors import RunFolderError
from webgym.core.observation import Observation
from webgym.core.outcome import Outcome
from webgym.core.tables import put
from webgym.core.task import LEVELS, Level
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.offline import OfflineJudge
from webgym.results.evaluation import (
    GROUPS,
    EvaluationConfig,
    Sample,
    compare,
    evaluate,
    notes,
    rows_of,
    tables,
)
from webgym.results.rates import wilson
from webgym.results.summary import summarise
from webgym.run.collect import _software
from webgym.server.client import BrowserClient
from webgym.server.messages import EgressInfo, ServerInfo
from webgym.store.runs import RunReader, RunWriter
from webgym.store.verdicts import Judged, VerdictLog

QUICK = EvaluationConfig(resamples=500)
GOOD, BAD = Outcome.SUCCESS, Outcome.FAILURE


def attempts(level: Level, *by_task: str) -> list[Sample]:
    """A word per task, a letter per sample: success, failure, truncated, blocked, judge error."""
    letters = {
        "s": GOOD,
        "f": BAD,
        "t": Outcome.TRUNCATED,
        "b": Outcome.BLOCKED,
        "j": Outcome.JUDGE_ERROR,
    }
    return [
        Sample(f"{level}-{number}", level, letters[letter], 10)
        for number, word in enumerate(by_task)
        for letter in word
    ]


def drawn(**numbers: int) -> list[tuple[str, Level]]:
    """So many tasks of each level, as :func:`attempts` names them."""
    return [(f"{level}-{number}", level) for level in LEVELS for number in range(numbers.get(level, 0))]


# --- rates and intervals --------------------------------------------------------------------------------


def test_one_sample_per_task_has_wilsons_interval() -> None:
    samples = [*attempts("easy", *"sssf"), *attempts("medium", *"stbj"), *attempts("hard", *"ff")]
    rows = rows_of(samples, drawn(easy=4, medium=4, hard=3), 1, QUICK)
    assert {group: (row.successes, row.attempts) for group, row in rows.items()} == {
        "easy": (3, 4),
        "medium": (1, 2),
        "hard": (0, 2),
        "overall": (4, 8),
    }
    for row in rows.values():
        assert row.method == "wilson"
        assert row.interval == wilson(row.successes, row.attempts)
    assert rows["hard"].rate == 0.0
    assert rows["medium"].no_reward == {"blocked": 1, "judge_error": 1}
    assert rows["hard"].missing == rows["overall"].missing == 1
    assert rows["overall"].tasks == 11
    # Blocked, judge error and missing are no success of all that was planned.
    told = {group: (row.rate_of_planned, row.interval_of_planned) for group, row in rows.items()}
    won = {"easy": (3, 4), "medium": (1, 4), "hard": (0, 3), "overall": (4, 11)}
    assert told == {group: (wins / of, wilson(wins, of)) for group, (wins, of) in won.items()}


def test_nothing_rewarded_is_no_rate() -> None:
    rows = rows_of(attempts("easy", "b", "j"), drawn(easy=2), 1, QUICK)
    for group in GROUPS:
        assert rows[group].rate is None
        assert rows[group].interval is None
        assert rows[group].steps is None
    assert rows_of([], [], 1, QUICK)["overall"].attempts == 0


def test_samples_of_one_task_are_one_piece_of_evidence() -> None:
    words = ["ssss" if number % 2 else "ffff" for number in range(40)]
    repeated = rows_of(attempts("easy", *words), drawn(easy=40), 4)["easy"]
    once = rows_of(attempts("easy", *(word[0] for word in words)), drawn(easy=40), 1)["easy"]
    assert repeated.method == "bootstrap"
    assert repeated.interval is not None
    assert once.interval is not None
    widths = [row.interval[1] - row.interval[0] for row in (repeated, once) if row.interval]
    assert widths[0] == pytest.approx(widths[1], rel=0.1)  # four samples that all say the same add nothing
    assert repeated.solved == (20, 40)
    assert repeated.interval_of_planned == pytest.approx(repeated.interval, abs=0.02)
    assert rows_of(attempts("easy", *words), drawn(easy=40), 4) == rows_of(
        attempts("easy", *words), drawn(easy=40), 4
    )


def test_where_all_tasks_end_alike_the_interval_counts_tasks() -> None:
    row = rows_of(attempts("hard", "fff", "fff"), drawn(hard=2), 3, QUICK)["hard"]
    assert (row.rate, row.method, row.interval) == (0.0, "wilson", wilson(0, 2))
    row = rows_of(attempts("hard", "sffff", "sffff"), drawn(hard=2), 5, QUICK)["hard"]
    assert (row.rate, row.method, row.interval) == (0.2, "wilson", wilson(0.4, 2))  # not wilson(0, 2)


@given(
    st.lists(
        st.tuples(st.sampled_from(LEVELS), st.integers(0, 6), st.sampled_from(list(Outcome))), max_size=25
    )
)
def test_the_levels_add_up_and_intervals_hold_the_rate(ended: list[tuple[Level, int, Outcome]]) -> None:
    samples = [Sample(f"{level}-{task}", level, outcome, 3) for level, task, outcome in ended]
    rows = rows_of(samples, drawn(easy=7, medium=7, hard=7), 5, EvaluationConfig(resamples=100))
    for name in ("tasks", "attempts", "successes", "missing"):
        assert sum(getattr(rows[level], name) for level in LEVELS) == getattr(rows["overall"], name)
    for row in rows.values():
        assert row.rate_of_planned is not None
        assert row.interval_of_planned is not None
        low, high = row.interval_of_planned
        assert low - 1e-9 <= row.rate_of_planned <= high + 1e-9
        assert row.rate_of_planned == row.successes / row.planned
        assert row.attempts + sum(row.no_reward.values()) + row.missing == row.planned
        assert (row.rate is None) == (row.attempts == 0) == (row.interval is None)
        if row.rate is not None and row.interval is not None:
            assert row.interval[0] - 1e-9 <= row.rate <= row.interval[1] + 1e-9 or row.method == "wilson"


# --- of a run --------------------------------------------------------------------------------------------


def test_a_run_as_its_summary_has_it(run: Path) -> None:
    found = evaluate(run, config=QUICK)
    summary = RunReader(run).summary
    assert summary is not None
    for group in GROUPS:
        assert found.rows[group].rate == summary["success_rate"][group]
        assert found.rows[group].rate_of_planned == summary["success_rate_of_planned"][group]
    overall = found.rows["overall"]
    assert overall.no_reward == {
        "blocked": 1,
        "environment_error": 1,
        "policy_error": 1,
        "judge_error": 1,
    }
    assert overall.missing == 1  # the one that was cancelled has not been made
    assert (found.policy, found.judge, found.seed) == ("scripted", OfflineJudge.name, 7)


async def test_a_task_that_was_drawn_twice_is_one_piece_of_evidence(tmp_path: Path) -> None:
    tasks = [task(f"e{number}", 1) for number in range(3)] * 2
    async with await RunWriter.create(tmp_path / "run", {"samples": 2}, tasks) as writer:
        for number, each in enumerate(tasks * 2):
            await writer.append(attempt(each.id, GOOD if number else BAD, steps=0))
    row = evaluate(tmp_path / "run").rows["easy"]
    assert (row.tasks, row.planned, row.missing, row.solved) == (6, 12, 0, (3, 3))
    assert row.rate_of_planned == row.rate == 11 / 12
    assert row.interval_of_planned == row.interval == (0.75, 1.0)
    summary = summarise(RunReader(tmp_path / "run").trajectories(), tasks, 2)
    for name in ("success_interval", "success_interval_of_planned"):
        assert summary[name]["easy"] == summary[name]["overall"] == row.interval
    assert summary["by_domain"]["Shopping"]["success_interval"] == row.interval
    assert summary["by_website"]["http://a.test/"]["success_interval_of_planned"] == row.interval


async def test_what_other_collectors_took_of_a_shared_list_is_not_missing(tmp_path: Path) -> None:
    tasks = [task("e0", 1), task("e1", 1), task("h", 8)]
    ended = [attempt(id, outcome, steps=0) for id, outcome in (("e0", GOOD), ("e0", BAD), ("e1", GOOD))]
    summary = summarise(ended, tasks, 2, elsewhere={"e1": 1, "h": 2})
    async with await RunWriter.create(tmp_path / "run", {"samples": 2}, tasks) as writer:
        for each in ended:
            await writer.append(each)
        await writer.write_summary(summary)
    rows = evaluate(tmp_path / "run", config=QUICK).rows
    assert {group: (row.planned, row.missing) for group, row in rows.items()} == {
        "easy": (3, 0),
        "medium": (0, 0),
        "hard": (0, 0),
        "overall": (3, 0),
    }
    assert {group: row.rate_of_planned for group, row in rows.items()} == summary["success_rate_of_planned"]
    assert rows["overall"].interval_of_planned == (0.5, 1.0)


def test_another_judge_gives_another_rate(run: Path) -> None:
    with VerdictLog(run, "strict/1") as book:
        for entry in RunReader(run).attempts.values():
            if entry.outcome is GOOD:
                verdict = Verdict("strict/1", 0, (), Judgement(False, "no"))
                book.append(Judged(entry.attempt_id, "strict/1", BAD, 0.0, 0.1, verdict))
    found = evaluate(run, "strict")
    assert found.judge == "strict/1"
    assert found.rows["overall"].rate == 0.0
    assert found.rows["overall"].missing == 1 + 5  # cancelled, and what this judge has not judged
    with pytest.raises(RunFolderError, match="no judge"):
        evaluate(run, "lenient")


def test_records_that_are_in_no_figure_are_told(run: Path, tmp_path: Path) -> None:
    broken = shutil.copytree(run, tmp_path / "broken")
    tasks = (broken / "tasks.jsonl").read_bytes().splitlines(keepends=True)
    (broken / "tasks.jsonl").write_bytes(b"".join(tasks[:-1]))
    shard = next((broken / "trajectories").iterdir())
    records = shard.read_bytes().splitlines(keepends=True)
    shard.write_bytes(b"".join([records[0].replace(b"a", b"b", 1), *records[1:]]))
    notes = tuple(
        f"{what}: 1 left out; webgym verify names them"
        for what in ("damaged records", "attempts at tasks that the run does not hold")
    )
    assert evaluate(broken, config=QUICK).notes[-2:] == notes
    assert compare(broken, run).notes[-3:-1] == tuple(f"broken: {note}" for note in notes)


# --- the command -----------------------------------------------------------------------------------------


@pytest.mark.browser
def test_an_evaluation_from_end_to_end(tmp_path: Path, calls: Calls) -> None:
    settings = tmp_path / "settings.yaml"
    settings.write_text("sites: {per_family: 2, latency: 0}\ncollector: {sessions: 2}\n")
    options = ("--policy", "scripted", "--config", settings, "--limit", 3, "--no-report")
    said = calls.printed("eval", *options, "--out", tmp_path / "run", "--budget", "12,20,40")
    assert "95 % intervals: Wilson's" in said
    assert "at most 12 / 20 / 40 steps" in said
    reader = RunReader(tmp_path / "run")
    assert all(task.split == "test" for task in reader.tasks.values())
    assert reader.config["tasks"]["split"] == "test"  # said in the run, for whoever would train on it
    assert reader.summary is not None
    assert reader.summary["split"] == "test"
    assert reader.config["collector"]["straggler_share"] == 1.0
    assert reader.config["attempt"]["longest_seconds"] == 3600.0

    again = calls.printed("eval", "--resume", tmp_path / "run", "--no-report", "--json")
    told = json.loads(again[again.index("{\n") : again.rindex("}") + 1])
    assert told["rows"]["overall"]["tasks"] == 3
    assert told["rows"]["overall"]["missing"] == 0
    assert len(reader.attempts) == len(RunReader(tmp_path / "run").attempts)  # nothing was made again
    manifest = told["manifest"]
    assert manifest["webgym"] == version("webgym-rl")
    assert manifest["browser"].partition("/")[2][0].isdigit()
    assert manifest["judges"] == ["offline/9"]
    assert manifest["budget"] == [12, 20, 40]
    assert manifest["split"] == "test"
    assert manifest["server"] == "here"
    assert manifest["egress"]["ports"] == [80, 443, 8080, 8443]
    assert manifest["viewport"] == reader.config["attempt"]["viewport"]
    assert manifest["tasks_sha256"] == sha256((tmp_path / "run" / "tasks.jsonl").read_bytes()).hexdigest()
    assert [len(digest) for digest in manifest["prompts"]] == [64]
    assert manifest["planned"] == 3
    assert manifest["began"] <= manifest["ended"]


class ClientElsewhere(BrowserClient):
    """Of a server that tells what pages may connect to."""

    async def info(self) -> ServerInfo:
        egress = EgressInfo(("intranet.example",), (443,), 5.0, ("zurich",))
        more: dict[str, Any] = {"egress": egress, "without": ("freezing",)}
        return ServerInfo("0.1", 1, "Chrome/1", "", sandboxed=True, sandbox_reason="", **more)


async def test_a_server_elsewhere_tells_what_pages_could_connect_to(tmp_path: Path) -> None:
    software = await _software(ClientElsewhere("http://browsers.example", token="x" * 20), is_ours=False)
    # Of servers that the run starts itself.
    browser: dict[str, Any] = {"egress": {"allow": [], "ports": [80], "rate": 20.0}}
    config = {"software": software, "browser": browser, "server": {"url": "http://browsers.example"}}
    browser["identity"] = {"time_zone": "Asia/Tokyo", "webdriver": True}
    made = attempt("e0", Outcome.SUCCESS, steps=0)
    seen = Observation(
        sha256(b"picture").hexdigest(), "https://shop.example/", "", (800, 600), route="zurich"
    )
    made = msgspec.structs.replace(made, episode=msgspec.structs.replace(made.episode, final=seen))
    async with await RunWriter.create(tmp_path / "run", config, [task("e0", 1)]) as writer:
        await writer.put_image(seen.screenshot, b"picture")
        await writer.append(made)
    manifest = evaluate(tmp_path / "run", config=QUICK).manifest
    assert manifest.server == "elsewhere"
    egress = {"allow": ["intranet.example"], "ports": [443], "rate": 5.0, "upstream": ["zurich"]}
    assert (manifest.egress, manifest.without) == (egress, ["freezing"])
    assert (manifest.identity, manifest.routes) == ({"time_zone": "Asia/Tokyo"}, {"zurich": 1})


def test_what_a_run_does_not_record_is_not_made_up(run: Path) -> None:
    """This one was written without the collector: it tells its seed, and nothing of how it was made."""
    manifest = evaluate(run, config=QUICK).manifest
    unknown = ("webgym", "budget", "weights", "agent", "browser", "sandboxed", "viewport", "server", "egress")
    for name in (*unknown, "without", "routes"):
        assert getattr(manifest, name) is None, name
    assert (manifest.seed, manifest.planned, manifest.judged, manifest.missing) == (7, 12, 7, 1)
    # A sample is counted once, however it ended.
    lost = sum(sum(codes.values()) for codes in manifest.invalid.values())
    assert manifest.judged + lost + manifest.missing == manifest.planned
    assert {name: sum(codes.values()) for name, codes in manifest.invalid.items()} == {
        "blocked": 1,
        "environment_error": 1,
        "policy_error": 1,
        "judge_error": 1,
    }
    assert sum(manifest.blocked_websites.values()) == 1


def test_conditions_stand_beside_the_score(run: Path, calls: Calls) -> None:
    said = calls.printed("eval", "--of", run, "--of", run, "--markdown")
    rows = [line.strip("| ").split(" | ") for line in said.partition("**Conditions**")[2].splitlines()[2:]]
    told = {row[0]: row[1:] for row in rows}
    assert told["browser"] == ["not recorded"] * 2
    assert (told["judged"], told["successes"]) == (["7"] * 2, ["4"] * 2)
    assert all("judge_error" in cell for cell in told["invalid"])


def test_several_samples_per_task_fit_a_terminal_and_are_explained(run: Path) -> None:
    samples = attempts("easy", *["ssss"] * 300, *["sssf"] * 300)
    rows = rows_of(samples, drawn(easy=600), 4, QUICK)
    result = msgspec.structs.replace(evaluate(run, config=QUICK), samples=4, rows=rows)
    said = io.StringIO()
    put(next(tables([result])), Console(file=said, width=80, force_terminal=True, color_system=None))
    assert max(map(len, said.getvalue().splitlines())) <= 80
    assert "86.4, 88.5" in said.getvalue()
    assert "…" not in said.getvalue()
    assert any(note.startswith("95 % intervals over tasks: bootstrap") for note in notes(result))
    assert any(note.startswith("ever:") for note in notes(result))
    assert not any(note.startswith("ever:") for note in notes(result, alone=False))
    alike = rows_of(attempts("easy", "ssss", "ssss"), drawn(easy=2), 4, QUICK)
    assert any("over tasks" in note for note in notes(msgspec.structs.replace(result, rows=alike)))


def test_tables_of_runs(run: Path, calls: Calls) -> None:
    said = calls.printed("eval", "--of", run, "--markdown")
    overall = next(line for line in said.splitlines() if line.startswith("| overall"))
    assert overall.startswith("| overall | 12 | 7 | 57.1 | 25.0, 84.2 | 33.3 | 13.8, 60.9 | "), overall
    assert "1 sample is missing" in said
    assert f"unjudged 1 attempt has no verdict; judge with: webgym eval --resume {run}\n" in said
    assert "**Success of scripted (oracle) by difficulty" in said
    said = calls.printed("eval", "--of", run, "--of", run, "--latex")
    assert said.count("& scripted (oracle) &") == 4
    assert said.count("57.1 [25.0, 84.2]") == 2
    assert said.count("33.3 [13.8, 60.9]") == 2
    assert r"environment\_error" in said
    for options in (("--of", run, "--out", "x"), ("--split", "dev"), ("--budget", "30,50")):
        assert calls.printed("eval", *options, code=2).startswith("webgym: ")
