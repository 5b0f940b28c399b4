"""What several judges said, in a real browser."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path
from urllib.parse import quote

import pytest
from playwright.async_api import Browser, expect
from tests.report.test_pages import opened

from webgym.core.task import Task
from webgym.core.trajectory import Episode
from webgym.core.verdict import Cost, FactJudgement, Judgement, Verdict
from webgym.judge.base import Pictures
from webgym.report.config import ViewConfig
from webgym.report.live import serve_view
from webgym.report.write import write_report
from webgym.rollout.rejudge import judge_run
from webgym.store.runs import RunReader, recorded

pytestmark = [pytest.mark.browser, pytest.mark.asyncio(loop_scope="package")]

HOSTILE = '<img src=x onerror="window.pwned=1"></script><script>window.pwned=1</script>'


class Strict:
    """Holds the first fact for shown at step 1 and no other, and quotes pages in its reasons."""

    name = "strict/1"

    async def judge(self, task: Task, episode: Episode, pictures: Pictures) -> Verdict:
        facts = tuple(
            FactJudgement(
                group.id,
                index,
                text,
                Judgement(place == 0, f"Step 1 says {HOSTILE}", (0,) if place == 0 else ()),
            )
            for place, (group, index, text) in enumerate(task.rubric.facts())
        )
        return Verdict(
            self.name,
            0,
            facts,
            Judgement(False, "no"),
            score=1 / len(facts),
            confidence=2 / 3,
            cost=Cost(12, 3, 1, 4_000, 500, 0.0125),
        )


@pytest.fixture(scope="module")
def judged_run(run_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = shutil.copytree(run_folder, tmp_path_factory.mktemp("judged") / "run")
    asyncio.run(judge_run(run, Strict()))
    return run


def first_answered(run: Path) -> tuple[str, int]:
    """An attempt with an answer and how many facts its task has."""
    attempt_id, judged = next((key, each) for key, each in recorded(run).items() if each.verdict)
    assert judged.verdict is not None
    return attempt_id, RunReader(run).tasks[attempt_id.split("#")[0]].difficulty


async def look_at_both(page_address: str, browser: Browser, facts: int) -> None:
    async with opened(browser, page_address) as page:
        judges = page.locator("#judges .judge")
        await expect(judges).to_have_count(2)
        await expect(judges.nth(0)).to_have_attribute("aria-pressed", "true")
        await expect(page.locator("#rubric h2")).to_have_text(f"Facts: {facts} of {facts} confirmed")
        assert await page.locator(".film .proof:visible").count() >= 2
        await judges.nth(1).click()
        await expect(judges.nth(1)).to_have_attribute("aria-pressed", "true")
        await expect(page.locator("#rubric h2")).to_have_text(f"Facts: 1 of {facts} confirmed")
        await expect(page.locator(".film .proof:visible")).to_have_count(1)
        # The finding stands beneath the screenshot that it cites, as text.
        here = page.locator(".here .finding")
        await expect(here).to_have_count(1)
        await expect(here).to_contain_text(HOSTILE)
        await expect(page.locator("#confidence")).to_have_text("67% of the samples agree")
        await expect(page.locator(".about")).to_contain_text(
            "12 replies, 3 from the cache, 4500 tokens, $0.0125"
        )
        await page.keyboard.press("ArrowRight")
        await expect(here).to_have_count(0)
        await page.locator("#rubric .cite").first.click()
        await expect(here).to_have_count(1)
        await judges.nth(0).click()
        await expect(page.locator("#rubric h2")).to_have_text(f"Facts: {facts} of {facts} confirmed")


async def test_judges_stand_side_by_side_in_the_report(judged_run: Path, browser: Browser) -> None:
    report = await asyncio.to_thread(write_report, judged_run)
    attempt_id, facts = first_answered(judged_run)
    await look_at_both(f"{report.as_uri()}#/t/{quote(attempt_id, safe='')}/1", browser, facts)


async def test_judges_stand_side_by_side_in_the_viewer(judged_run: Path, browser: Browser) -> None:
    address: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    serving = asyncio.create_task(serve_view(judged_run, ViewConfig(), address.set_result))
    attempt_id, facts = first_answered(judged_run)
    try:
        await look_at_both(f"{await address}#/t/{quote(attempt_id, safe='')}/1", browser, facts)
    finally:
        serving.cancel()
        await asyncio.gather(serving, return_exceptions=True)
