"""The labelling page: in a real browser, over HTTP, and what lies on disk afterwards."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import msgspec
import pytest
from playwright.async_api import Browser, expect
from tests.judge.scenes import TASK
from tests.report.conftest import HOST, asking, build_run
from tests.report.test_pages import CONTRAST, opened, viewed

from webgym.core.errors import UsageError
from webgym.core.outcome import Outcome
from webgym.core.task import FactGroup, Rubric
from webgym.core.verdict import Judgement, Verdict
from webgym.judge.labels import read_labels
from webgym.report.config import ViewConfig
from webgym.report.live import view_app
from webgym.results.labels import HumanLabel, LabelStore, labels_path, sample_to_label
from webgym.store.records import Entry
from webgym.store.runs import RunReader
from webgym.store.verdicts import Judged, VerdictLog


@pytest.fixture(scope="module")
def large_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return asyncio.run(build_run(tmp_path_factory.mktemp("runs") / "run", 60, 3))


@pytest.fixture
async def client(run: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with asking(view_app(run)) as client:
        yield client


async def token_of(client: httpx.AsyncClient) -> str:
    found = re.search(r'"token":"([^"]+)"', (await client.get("/label")).text)
    assert found is not None
    return found[1]


async def queue_of(client: httpx.AsyncClient, annotator: str = "ann") -> list[str]:
    told = (await client.get("/api/labels", params={"annotator": annotator})).json()
    return [one["id"] for one in told["queue"]]


def said(attempt_id: str, **changes: str) -> dict[str, str]:
    return {"id": attempt_id, "annotator": "ann", "label": "success", "note": "", **changes}


# --- which attempts -----------------------------------------------------------------------------------


def run_of(counts: dict[int, tuple[int, int]]) -> RunReader:
    """A run with so many successes and failures by difficulty, each at a task of its own."""
    tasks, attempts = {}, {}
    for difficulty, (won, lost) in counts.items():
        facts = tuple(f"fact {number}" for number in range(difficulty))
        for number in range(won + lost):
            outcome = Outcome.SUCCESS if number < won else Outcome.FAILURE
            task_id = f"{difficulty}/{number}"
            tasks[task_id] = msgspec.structs.replace(
                TASK, id=task_id, rubric=Rubric((FactGroup(1, "", facts),))
            )
            attempts[f"{task_id}#0.0"] = Entry(f"{task_id}#0.0", task_id, 0, 0, outcome, "", 0, 0)
    return cast(RunReader, SimpleNamespace(tasks=tasks, attempts=attempts))


def drawn(reader: RunReader, chosen: list[str]) -> tuple[Counter[int], Counter[int]]:
    """How many were chosen by difficulty, and how many of them succeeded."""
    all_, won = Counter[int](), Counter[int]()
    for attempt_id in chosen:
        difficulty = reader.tasks[reader.attempts[attempt_id].task_id].difficulty
        all_[difficulty] += 1
        won[difficulty] += reader.attempts[attempt_id].outcome is Outcome.SUCCESS
    return all_, won


PAPER = {**dict.fromkeys(range(1, 7), 10), **dict.fromkeys(range(7, 11), 5)}


def test_the_sample_is_drawn_as_in_the_paper_and_the_same_for_everybody() -> None:
    reader = run_of(dict.fromkeys(range(1, 14), (40, 60)))
    chosen = sample_to_label(reader, 80, 0)
    by_difficulty, won = drawn(reader, chosen)
    assert by_difficulty == PAPER
    assert won.total() == 40
    assert all(abs(won[each] - PAPER[each] / 2) < 1 for each in PAPER)
    assert sample_to_label(reader, 80, 0) == chosen
    assert sample_to_label(reader, 80, 1) != chosen
    early, _ = drawn(reader, chosen[:40])  # whoever stops early has labelled alike, too
    assert all(abs(early[each] - PAPER[each] / 2) <= 1 for each in PAPER)
    halves = [drawn(reader, part)[1].total() for part in (chosen[:40], chosen[40:])]
    assert min(halves) > 10  # neither kind comes first: the order tells nothing
    twice, _ = drawn(reader, sample_to_label(reader, 160, 0))
    assert twice == {each: 2 * count for each, count in PAPER.items()}


def test_what_a_difficulty_lacks_others_make_up_for() -> None:
    # Hard tasks are rarely solved, easy ones rarely not: half of all are successes still.
    solved = {1: (100, 3), 2: (80, 20), 3: (50, 50), 4: (40, 60), 5: (30, 70), 6: (20, 80)}
    reader = run_of(solved | {7: (3, 90), 8: (1, 90), 9: (0, 90), 10: (0, 90)})
    by_difficulty, won = drawn(reader, sample_to_label(reader, 80, 0))
    assert by_difficulty == PAPER
    assert won.total() == 40
    assert all(won[each] <= 8 for each in range(2, 7))  # no level is turned over to one of the two
    # Too few at a difficulty, or beyond the paper's: the count is kept as long as there are any.
    reader = run_of({1: (2, 1), 2: (30, 30), 12: (5, 40)})
    by_difficulty, _ = drawn(reader, sample_to_label(reader, 80, 0))
    assert by_difficulty == {1: 3, 2: 60, 12: 17}
    assert len(sample_to_label(reader, 1000, 0)) == len(reader.attempts)
    assert sample_to_label(run_of({}), 80, 0) == []
    assert len(sample_to_label(run_of({3: (0, 9)}), 4, 0)) == 4


def test_only_attempts_that_ended_of_their_own_are_labelled(large_run: Path) -> None:
    reader = RunReader(large_run)
    whole = sample_to_label(reader, 1000, 0)
    ended = [one for one, entry in reader.attempts.items() if not entry.outcome.is_retried]
    assert sorted(whole) == sorted(ended)


def test_a_second_attempt_at_a_task_comes_after_all_first_ones(large_run: Path) -> None:
    reader = RunReader(large_run)
    tasks = [reader.attempts[one].task_id for one in sample_to_label(reader, 1000, 0)]
    assert len(set(tasks[:3])) == 3


# --- over HTTP ----------------------------------------------------------------------------------------


async def test_the_verdict_is_not_sent_before_there_is_a_label(client: httpx.AsyncClient, run: Path) -> None:
    queue = await queue_of(client)
    with VerdictLog(run, "other/1") as book:
        verdict = Verdict("other/1", 1, (), Judgement(False, "not blocked at all"))
        book.append(Judged(queue[0], "other/1", Outcome.SUCCESS, 0.0, 1.0, verdict))
    for attempt_id in queue:
        params = {"id": attempt_id, "annotator": "ann"}
        hidden = (await client.get("/api/labels/trajectory", params=params)).json()
        assert hidden["blind"]
        assert hidden["outcome"] is hidden["verdict"] is hidden["judgeFailure"] is None
        assert hidden["others"] == []
        facts = [fact for group in hidden["groups"] for fact in group["facts"]]
        assert facts
        assert all(fact.keys() == {"text", "passed"} and fact["passed"] is None for fact in facts)
    headers = {"Origin": HOST, "X-WebGym-Token": await token_of(client)}
    reply = await client.post("/api/labels", json=said(queue[0]), headers=headers)
    assert reply.status_code == 200
    params = {"id": queue[0], "annotator": "ann"}
    shown = (await client.get("/api/labels/trajectory", params=params)).json()
    assert shown["outcome"] is not None
    assert [other["judge"] for other in shown["others"]] == ["other/1"]
    params["annotator"] = "bob"  # who has said nothing yet
    assert (await client.get("/api/labels/trajectory", params=params)).json()["blind"]


async def test_labels_are_taken_from_our_own_page_alone(client: httpx.AsyncClient, run: Path) -> None:
    token = await token_of(client)
    (first, *_) = await queue_of(client)
    good = {"Origin": HOST, "X-WebGym-Token": token}
    for headers in (
        {"X-WebGym-Token": token},
        {**good, "Origin": "null"},
        {**good, "Origin": "https://evil.example"},
        {**good, "Origin": "http://127.0.0.1:9999"},
        {"Origin": HOST},
        {**good, "X-WebGym-Token": "guessed"},
        {**good, "Content-Type": "text/plain"},
        {**good, "Content-Type": "application/x-www-form-urlencoded"},
    ):
        reply = await client.post(
            "/api/labels",
            content=json.dumps(said(first)),
            headers={"Content-Type": "application/json", **headers},
        )
        assert reply.status_code == 403, headers
    evil = {**good, "Host": "evil.example", "Origin": "http://evil.example"}
    assert (await client.post("/api/labels", json=said(first), headers=evil)).status_code == 400
    assert not labels_path(run).exists()
    assert (await client.put("/api/labels", json=said(first), headers=good)).status_code == 405
    assert "frame-ancestors 'none'" in (await client.get("/label")).headers["content-security-policy"]


async def test_what_is_no_label_is_refused(client: httpx.AsyncClient, run: Path) -> None:
    headers = {"Origin": HOST, "X-WebGym-Token": await token_of(client)}
    (first, *_) = await queue_of(client)
    for body, status in (
        (said("nothing#0.0"), 404),
        (said(first, label="maybe"), 400),
        (said(first, annotator="  "), 400),
        (said(first, note="x" * 70_000), 400),
        ([], 400),
    ):
        reply = await client.post("/api/labels", json=body, headers=headers)
        assert reply.status_code == status
    assert not labels_path(run).exists()
    hostile = said(first, annotator=" a\n b ", note='=1+1,"x"\r\nlabel;')
    assert (await client.post("/api/labels", json=hostile, headers=headers)).status_code == 200
    (label,) = read_labels(labels_path(run)).labels
    assert (label.annotator, label.note) == ("a b", '=1+1,"x" label;')


# --- on disk -----------------------------------------------------------------------------------------


def test_a_book_keeps_what_others_wrote(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    one, other = LabelStore(path), LabelStore(path)
    one.put(HumanLabel("success", "a#0.0", "a", "ann"))
    other.put(HumanLabel("failure", "a#0.0", "a", "bob"))
    one.put(HumanLabel("failure", "a#0.0", "a", "ann", "looked again"))
    assert one.labels() == other.labels()
    assert {(label.annotator, label.label) for label in one.labels()} == {
        ("ann", "failure"),
        ("bob", "failure"),
    }
    as_json = LabelStore(tmp_path / "labels.json")
    as_json.put(HumanLabel("unsure", "a#0.0", "a", "ann"))
    assert json.loads((tmp_path / "labels.json").read_text())[0]["label"] == "unsure"


@pytest.mark.parametrize("text", ["attempt_id,label\na,maybe\n", "attempt_id,label,seconds\na,success,3\n"])
def test_a_file_that_would_lose_something_is_left_alone(tmp_path: Path, text: str) -> None:
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(UsageError, match="cannot write labels"):
        LabelStore(path)
    assert path.read_text() == text


async def test_a_file_that_cannot_be_used_is_said(client: httpx.AsyncClient, run: Path) -> None:
    labels_path(run).write_text("attempt_id,label\na,maybe\n")
    reply = await client.get("/api/labels", params={"annotator": "ann"})
    assert reply.status_code == 409
    assert "maybe" in reply.text
    assert (await client.get("/")).status_code == 200


def test_kill_9_loses_no_label_that_was_acknowledged(tmp_path: Path) -> None:
    script = (
        "import sys; from pathlib import Path; from webgym.results.labels import *\n"
        "book = LabelStore(Path(sys.argv[1]))\n"
        "for n in range(10_000):\n"
        "    book.put(HumanLabel('success', f'{n}#0.0', str(n), 'ann')); print(n, flush=True)\n"
    )
    path = tmp_path / "labels.csv"
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        for _ in range(20):
            process.stdout.readline()
        os.kill(process.pid, signal.SIGKILL)
        acknowledged = 20 + len(process.stdout.readlines())
    read = read_labels(path)
    assert not read.broken
    assert len(read.labels) in (acknowledged, acknowledged + 1)
    LabelStore(path).put(HumanLabel("failure", "0#0.0", "0", "ann"))
    assert len(read_labels(path).labels) == len(read.labels)


# --- in a browser ---------------------------------------------------------------------------------------


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
async def test_trajectories_are_labelled_with_keys_and_the_work_is_taken_up_again(
    browser: Browser, run: Path
) -> None:
    async with viewed(run) as url, opened(browser, f"{url}label") as page:
        await page.get_by_label("Your name").fill("ann")
        await page.keyboard.press("Enter")
        await expect(page.locator("#progress")).to_contain_text("0 of 9 labelled")
        await expect(page.locator(".stage img")).to_have_js_property("naturalWidth", 1280)
        assert await page.locator(".verdict-badge, .finding .sign.yes, .finding .sign.no").count() == 0
        queue = sample_to_label(RunReader(run), 80, 0)
        await expect(page.locator("#where")).to_have_text("1 of 9")

        await page.get_by_placeholder("Note").fill("the price is there")
        await page.keyboard.press("Enter")
        await page.keyboard.press("s")
        await expect(page.locator("#said")).to_have_text("Saved: success")
        await expect(page.locator(".verdict-badge")).to_be_visible()  # now it may be seen
        await expect(page.locator("[data-label=success]")).to_have_attribute("aria-pressed", "true")
        await page.keyboard.press("f")  # on second thoughts
        await expect(page.locator("#said")).to_have_text("Saved: failure")
        (label,) = read_labels(labels_path(run)).labels
        assert label == HumanLabel(
            "failure", queue[0], queue[0].rpartition("#")[0], "ann", "the price is there"
        )

        await page.keyboard.press("n")
        await expect(page.locator("#where")).to_have_text("2 of 9")
        await expect(page.locator("#place .task-head")).to_be_visible()
        assert await page.locator(".verdict-badge").count() == 0
        await page.keyboard.press("ArrowRight")
        await expect(page.locator(".now .count")).to_have_text(re.compile("Step 2"))
        await page.keyboard.press("u")
        await expect(page.locator("#progress")).to_contain_text("2 of 9 labelled")
        await expect(page.locator(".now .count")).to_have_text(re.compile("Step 2"))  # still where it was
        await page.keyboard.press("p")
        await expect(page.locator("#where")).to_have_text("1 of 9")
        await page.keyboard.press("n")
        await expect(page.locator("#where")).to_have_text("3 of 9")  # the second has a label

    async with viewed(run) as url, opened(browser, f"{url}label") as page:  # the viewer was started anew
        await page.get_by_label("Your name").fill("ann")
        await page.get_by_role("button", name="Start").click()
        await expect(page.locator("#where")).to_have_text("3 of 9")
        for _ in queue[2:]:
            await expect(page.locator("#place .task-head")).to_be_visible()
            before = await page.locator("#progress").inner_text()
            await page.get_by_role("button", name="Success").click()
            await expect(page.locator("#progress")).not_to_have_text(before)
            await expect(page.locator(".verdict-badge")).to_be_visible()
            await page.keyboard.press("n")
        await expect(page.locator("#finished")).to_be_visible()
    assert len(read_labels(labels_path(run)).labels) == 9


@pytest.mark.browser
@pytest.mark.asyncio(loop_scope="package")
@pytest.mark.parametrize("scheme", ["light", "dark"])
async def test_the_page_is_readable_and_hostile_text_is_inert(
    browser: Browser, run: Path, scheme: Any
) -> None:
    reader = RunReader(run)
    hostile = next(one for one, entry in reader.attempts.items() if entry.sample == 1)
    async with viewed(run) as url, opened(browser, f"{url}label", color_scheme=scheme) as page:
        assert await page.evaluate(CONTRAST) == []
        await page.get_by_label("Your name").fill("<b>ann</b>")
        await page.keyboard.press("Enter")
        await expect(page.locator("#annotator")).to_have_text("<b>ann</b>")
        for _ in range(9):
            if hostile in (await page.evaluate("decodeURIComponent(location.hash)")):
                break
            where = await page.locator("#where").inner_text()
            await page.keyboard.press("n")
            await expect(page.locator("#where")).not_to_have_text(where)
        await expect(page.locator("#place h1")).to_contain_text("</script><script>window.pwned=1")
        assert await page.evaluate(CONTRAST) == []
        nameless = "e => e.filter(e => !(e.ariaLabel || e.textContent.trim() || e.labels?.length)).length"
        assert await page.locator("button, a[href], input, select").evaluate_all(nameless) == 0


async def test_attempts_of_a_file_elsewhere(run: Path, tmp_path: Path) -> None:
    config = ViewConfig(labels=tmp_path / "mine.json", label_count=4, label_seed=3)
    async with asking(view_app(run, config)) as client:
        queue = await queue_of(client)
        assert queue == sample_to_label(RunReader(run), 4, 3)
        headers = {"Origin": HOST, "X-WebGym-Token": await token_of(client)}
        assert (await client.post("/api/labels", json=said(queue[0]), headers=headers)).status_code == 200
    assert len(read_labels(tmp_path / "mine.json").labels) == 1
