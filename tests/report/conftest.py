"""A run that looks like one: a dozen trajectories with all eight outcomes, real pictures, hostile text."""

from __future__ import annotations

import asyncio
import functools
import hashlib
import io
import os
import random
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import httpx
import pytest_asyncio
from PIL import Image, ImageDraw, ImageFont
from playwright.async_api import Browser, async_playwright, expect
from starlette.applications import Starlette

from webgym.browser.find import find_browser
from webgym.core.action import Action, Answer, GoBack, LeftClick, Navigate, Scroll, Target, Type, Wait
from webgym.core.observation import Element, Notice, Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Failure, ImageRef, Message, Reply, Step, TextPart, Trajectory
from webgym.core.verdict import FactJudgement, Judgement, Verdict
from webgym.judge.offline import OfflineJudge
from webgym.results.summary import summarise
from webgym.store.runs import RunReader, RunWriter

expect.set_options(timeout=30_000)  # a busy machine is no reason to fail

HOST = "http://127.0.0.1:1234"
VIEW = (1280, 768)
HOSTILE = '</script><script>window.pwned=1</script><img src=x onerror="window.pwned=1"><!--<b>&amp;\'\u2028'
Box: TypeAlias = tuple[float, float, float, float]
SEARCH_BOX: Box = (420, 16, 440, 34)
CARDS: list[Box] = [
    (300 + column * 320, 110 + line * 320, 296, 296) for line in range(2) for column in range(3)
]
BUTTON: Box = (820, 420, 220, 52)
SITES = {
    "fernhill-books": ("Shopping", "Books", (46, 92, 78)),
    "harbour-line": ("Travel", "Trains", (38, 70, 120)),
    "slow-kitchen": ("Lifestyle", "Recipes", (150, 78, 44)),
    "open-desk": ("Work", "Jobs", (84, 66, 128)),
}
NAMES = (
    "Tide Tables",
    "The Copper Hen",
    "Salt Roads",
    "Low Winter Sun",
    "A Field Guide to Rain",
    "Northbound",
)


@functools.cache
def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


@functools.cache
def draw(site: str, kind: str, number: int) -> bytes:
    """A page of an imaginary website as PNG; another number, another page."""
    colour = SITES[site][2]
    rng = random.Random(f"{site}/{number}")
    picture = Image.new("RGB", VIEW, (250, 249, 246))
    pen = ImageDraw.Draw(picture)
    pen.rectangle((0, 0, VIEW[0], 64), fill=colour)
    pen.text((28, 18), site.replace("-", " ").title(), font=_font(24), fill="white")
    x, y, w, h = SEARCH_BOX
    pen.rounded_rectangle((x, y, x + w, y + h), 6, fill="white")
    pen.text((x + 12, y + 8), "Search the catalogue", font=_font(15), fill=(150, 150, 150))
    for index, word in enumerate(("All", "Fiction", "Nature", "Maps", "Children", "Second hand")):
        pen.text((36, 120 + index * 34), word, font=_font(16), fill=(70, 70, 70))
    if kind == "blocked":
        pen.rectangle((0, 65, *VIEW), fill=(250, 249, 246))
        pen.text((420, 300), "Checking that you are a person", font=_font(28), fill=(40, 40, 40))
    elif kind == "list":
        for index, (x, y, w, h) in enumerate(CARDS):
            shade = tuple(rng.randrange(120, 230) for _ in range(3))
            pen.rounded_rectangle((x, y, x + w, y + h), 10, fill="white", outline=(225, 222, 216))
            gradient = (
                Image.linear_gradient("L").resize((272, 190)).rotate(rng.choice((0, 90, 180)), expand=False)
            )
            tile = Image.composite(
                Image.new("RGB", (272, 190), shade), Image.new("RGB", (272, 190), colour), gradient
            )
            picture.paste(tile, (int(x) + 12, int(y) + 12))
            pen.text((x + 16, y + 216), NAMES[index], font=_font(18), fill=(30, 30, 30))
            pen.text(
                (x + 16, y + 246),
                f"EUR {rng.randrange(4, 40)}.{number % 90:02d}",
                font=_font(17),
                fill=colour,
            )
    else:
        shade = tuple(rng.randrange(120, 230) for _ in range(3))
        gradient = Image.linear_gradient("L").resize((460, 560))
        tile = Image.composite(
            Image.new("RGB", (460, 560), shade), Image.new("RGB", (460, 560), colour), gradient
        )
        picture.paste(tile, (300, 110))
        pen.text((820, 130), NAMES[number % len(NAMES)], font=_font(34), fill=(30, 30, 30))
        pen.text((820, 190), f"Edition {number}", font=_font(18), fill=(110, 110, 110))
        pen.text((820, 240), f"EUR {rng.randrange(4, 40)}.50", font=_font(30), fill=colour)
        for line in range(4):
            pen.text(
                (820, 296 + line * 26),
                "A quiet book about weather and patience.",
                font=_font(17),
                fill=(80, 80, 80),
            )
        x, y, w, h = BUTTON
        pen.rounded_rectangle((x, y, x + w, y + h), 8, fill=colour)
        pen.text((x + 56, y + 15), "Add to basket", font=_font(18), fill="white")
    buffer = io.BytesIO()
    picture.save(buffer, "PNG", compress_level=1)
    return buffer.getvalue()


def elements() -> tuple[Element, ...]:
    cards = [Element(10 + i, "link", NAMES[i], box) for i, box in enumerate(CARDS)]
    return (
        Element(1, "searchbox", "Search the catalogue", SEARCH_BOX),
        Element(2, "button", "Add to basket", BUTTON),
        *cards,
    )


def centre(box: Box) -> Target:
    x, y, w, h = box
    return Target(coordinate=(round((x + w / 2) * 1000 / VIEW[0], 1), round((y + h / 2) * 1000 / VIEW[1], 1)))


def task(number: int, facts: int, *, hostile: bool = False) -> Task:
    site = list(SITES)[number % len(SITES)]
    domain, subdomain, _ = SITES[site]
    half = max(1, facts // 2)
    texts = [
        f"The {word} of the cheapest edition is shown"
        for word in ("title", "author", "price", "format", "stock", "year", "shelf", "weight")
    ]
    groups = [FactGroup(1, "The right page", tuple(texts[:half]))]
    if facts > half:
        groups.append(FactGroup(2, "What it says", tuple(texts[half:facts])))
    wanted = f"Find the cheapest edition of “{NAMES[number % 6]}” on {site}"
    text = f"{wanted}, put it into the basket and say what it costs."
    return Task(
        id=f"offline/{site}/cheapest-{number}",
        instruction=HOSTILE if hostile else text,
        website=f"http://{site}.webgym.test/",
        domain=domain,
        subdomain=subdomain,
        rubric=Rubric(tuple(groups)),
        source="offline",
        reference_answer="£12.50",
        split="test",
    )


@dataclass
class Scene:
    """What is made up about one attempt."""

    task: Task
    outcome: Outcome
    number: int
    retry: int = 0
    mode: str = "coordinates"
    length: int = 5


class Maker:
    """Makes trajectories, and keeps their pictures."""

    def __init__(self, distinct: int) -> None:
        self.pictures: dict[str, bytes] = {}
        self._distinct = distinct
        self._drawn: dict[tuple[str, str, int], str] = {}
        self._next = 0

    def _shot(self, site: str, kind: str) -> str:
        self._next += 1
        key = (site, kind, self._next % self._distinct)
        if key not in self._drawn:
            data = draw(*key)
            self._drawn[key] = hashlib.sha256(data).hexdigest()
            self.pictures[self._drawn[key]] = data
        return self._drawn[key]

    def look(self, scene: Scene, index: int) -> Observation:
        site = scene.task.website.split("/")[2].split(".")[0]
        kind = "blocked" if scene.outcome is Outcome.BLOCKED else "list" if index < 2 else "page"
        rng = random.Random(f"{scene.number}/{index}")
        notices = [Notice("dialog", "“Subscribe to our letter?” was dismissed")] if index == 3 else []
        return Observation(
            screenshot=self._shot(site, kind),
            url=f"http://{site}.webgym.test/" + ("" if index == 0 else f"p/{index}?from=search&q=cheapest"),
            title=f"{site.replace('-', ' ').title()}: page {index}",
            viewport=VIEW,
            status=403 if kind == "blocked" else 200,
            mode="marks" if scene.mode == "marks" else "coordinates",
            settled="quiet",
            notices=tuple(notices),
            elements=elements(),
            milliseconds={
                "navigate" if index == 0 else "execute": rng.lognormvariate(4.0, 0.7),
                "settle": rng.lognormvariate(4.6, 0.6),
                "screenshot": rng.lognormvariate(3.6, 0.3),
                "metadata": rng.lognormvariate(1.5, 0.4),
            },
        )

    def _actions(self, scene: Scene) -> list[Action | None]:
        point = Target(element=10) if scene.mode == "marks" else centre(CARDS[0])
        box = Target(element=1) if scene.mode == "marks" else centre(SEARCH_BOX)
        button = Target(element=2) if scene.mode == "marks" else centre(BUTTON)
        opening: list[Action | None] = [Type(box, "cheapest edition"), LeftClick(point), LeftClick(button)]
        rest: list[Action | None] = [
            Scroll("down"),
            GoBack(),
            None,
            Wait(1.5),
            Navigate("http://fernhill-books.webgym.test/"),
        ]
        answer = (
            [Answer("It costs £12.50.")]
            if scene.outcome.value in ("success", "failure", "judge_error")
            else []
        )
        many = [rest[i % len(rest)] for i in range(max(0, scene.length - len(opening) - len(answer)))]
        return [*opening[: max(0, scene.length - len(answer))], *many, *answer]

    def make(self, scene: Scene) -> Trajectory:
        steps, at = [], 0.4
        rng = random.Random(scene.number)
        for index, action in enumerate(self._actions(scene)):
            seen = self.look(scene, index)
            reply = (
                'Memory: {"cheapest": "£12.50"}\nProgress: {"open the page": "finished"}\nIntention: look\n'
                f"Action: step {index}\n<tool_call>{{...}}</tool_call>"
            )
            steps.append(
                Step(
                    index=index,
                    observation=seen,
                    messages=(Message("user", (TextPart("What next?"), ImageRef(seen.screenshot, *VIEW))),),
                    reply=Reply(
                        HOSTILE if scene.number == 1 else reply, "scripted", "stop", {}, 1800, 90, 0.04
                    ),
                    action=action,
                    parse_error="" if action else "no tool call in the reply",
                    changed=None if isinstance(action, Answer) else index % 4 != 3,
                    at=at,
                )
            )
            at += rng.lognormvariate(-0.9, 0.6) + 0.04
        return self._ended(scene, tuple(steps), at)

    def _ended(self, scene: Scene, steps: tuple[Step, ...], at: float) -> Trajectory:
        outcome = scene.outcome
        ending, failure, judge_failure, verdict = Ending.ANSWERED, None, None, None
        if outcome is Outcome.ENVIRONMENT_ERROR:
            ending, failure = Ending.ENVIRONMENT_FAILED, Failure("browser_crashed", "the renderer is gone")
        elif outcome is Outcome.POLICY_ERROR:
            ending, failure = Ending.POLICY_FAILED, Failure("policy_timeout", "no complete reply within 60 s")
        elif outcome is Outcome.CANCELLED:
            ending = Ending.CANCELLED
        elif outcome is Outcome.JUDGE_ERROR:
            judge_failure = Failure("judge_error", "three replies without a verdict line")
        else:
            verdict = self._verdict(scene, len(steps))
            ending = Ending.ANSWERED if outcome in (Outcome.SUCCESS, Outcome.FAILURE) else Ending.BUDGET_SPENT
        answered = bool(steps) and isinstance(steps[-1].action, Answer)
        episode = Episode(
            attempt_id=f"{scene.task.id}#{scene.number}.{scene.retry}",
            task_id=scene.task.id,
            sample=scene.number,
            retry=scene.retry,
            seed=2**60 + scene.number,
            policy="scripted",
            started_at=1_760_000_000.0 + scene.number * 0.7,
            seconds=at,
            steps=steps,
            ending=ending,
            final=None if answered or not steps else self.look(scene, len(steps)),
            answer="It costs £12.50." if answered else None,
            failure=failure,
            session="s-1",
        )
        return Trajectory(episode, outcome, verdict, judge_failure, judge_seconds=0.003 if verdict else 0.0)

    @staticmethod
    def _verdict(scene: Scene, length: int) -> Verdict:
        success = scene.outcome is Outcome.SUCCESS
        blocked = scene.outcome is Outcome.BLOCKED
        facts = []
        for place, (group, index, text) in enumerate(scene.task.rubric.facts()):
            passed = success or (not blocked and place % 2 == 0)
            step = min(2 + place, max(0, length - 1))
            reason = f"shown at step {step + 1}" if passed else "no screenshot shows “£12.50”"
            facts.append(
                FactJudgement(group.id, index, text, Judgement(passed, reason, (step,) if passed else ()))
            )
        said = Judgement(success, "every number in the answer was visible", (2,))
        return Verdict(
            judge=OfflineJudge.name,
            reward=None if blocked else int(success),
            facts=tuple(facts),
            blocked=Judgement(blocked, "a challenge page that stays" if blocked else "no challenge page"),
            response=None if blocked else said,
            reference=None if blocked else Judgement(success, "the answer says £12.50"),
        )


def scenes(count: int) -> list[Scene]:
    """The eight outcomes in turn for a dozen; for more, in the shares that a run has."""
    rng = random.Random(5)
    dozen = [*Outcome, Outcome.SUCCESS, Outcome.SUCCESS, Outcome.FAILURE, Outcome.SUCCESS]
    shares = {
        "success": 70,
        "failure": 13,
        "truncated": 8,
        "blocked": 3,
        "environment_error": 3,
        "policy_error": 1,
        "judge_error": 1,
        "cancelled": 1,
    }
    found = []
    for number in range(count):
        outcome = (
            dozen[number]
            if count <= len(dozen)
            else Outcome(rng.choices(list(shares), list(shares.values()))[0])
        )
        facts = (
            (2, 5, 8)[number % 3]
            if count <= len(dozen)
            else rng.choices((1, 2, 3, 4, 5, 6, 7, 8), (9, 9, 8, 6, 5, 4, 3, 2))[0]
        )
        length = 2 + facts + rng.randrange(0, 4)
        if outcome is Outcome.TRUNCATED:
            length = (10, 20, 30)[0 if facts <= 3 else 1 if facts <= 6 else 2]
        made = Scene(
            task(number, facts, hostile=number == 1),
            outcome,
            number,
            mode="marks" if number == 8 else "coordinates",
            length=length,
        )
        if outcome is Outcome.CANCELLED:
            made.length = 0
        found.append(made)
    return found


async def build_run(path: Path, count: int = 12, distinct: int = 5, *, finished: bool = True) -> Path:
    """Write the run of so many trajectories."""
    maker = Maker(distinct)
    played = scenes(count)
    async with await RunWriter.create(
        path, {"seed": 7, "policy": "scripted"}, [one.task for one in played]
    ) as writer:
        for scene in played:
            made = maker.make(scene)
            for name, data in maker.pictures.items():
                await writer.put_image(name, data)
            maker.pictures.clear()
            await writer.append(made)
        if finished:
            reader = RunReader(path)
            await writer.write_summary(summarise(reader.trajectories(), reader.drawn, seed=7))
    return path


@pytest_asyncio.fixture(scope="package", loop_scope="package")
async def browser() -> AsyncIterator[Browser]:
    """A real Chromium."""
    found = await asyncio.to_thread(find_browser)
    async with async_playwright() as playwright:
        started = await playwright.chromium.launch(executable_path=str(found.path), args=["--no-sandbox"])
        yield started
        await started.close()


def asking(app: Starlette) -> httpx.AsyncClient:
    """A client of an application, without a server in between."""
    return httpx.AsyncClient(transport=httpx.ASGITransport(app=app), base_url=HOST)


async def view_command(run: Path) -> tuple[Process, str]:
    """`webgym view` of a run in a process of its own, and its address."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-c", "from webgym.cli import main; main()", "view", str(run), "--no-open"),
        stdout=PIPE,
        stderr=PIPE,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stdout is not None
    return process, (await process.stdout.readline()).decode().strip()


async def ends_on_interrupt(process: Process) -> None:
    process.send_signal(signal.SIGINT)
    async with asyncio.timeout(60):
        _, said = await process.communicate()
    assert b"Traceback" not in said
    assert process.returncode == 0
