"""One attempt, with a browser session and a policy that do as the test says."""

from __future__ import annotations

import asyncio
import hashlib
import json
import random
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest
from tests.rollout.test_summary import task

from webgym.agent.agent import Agent, AgentTraits
from webgym.agent.config import AgentConfig
from webgym.agent.policy import BasePolicy, PolicyInput
from webgym.browser.config import Cookie
from webgym.core.action import BrowserAction
from webgym.core.errors import ConfigError, JudgeError, NavigationFailed, PolicyTimeout
from webgym.core.identity import Identity
from webgym.core.observation import Fault, Notice, Observation, Probed
from webgym.core.outcome import Ending, Outcome, outcome_of
from webgym.core.storage import StorageState, StoredCookie, write_storage
from webgym.core.trajectory import Episode, Reply, Trajectory
from webgym.core.truth import AnswerTruth, FactTruth, StateCheck, Truth
from webgym.rollout.attempt import Attempt, AttemptContext
from webgym.rollout.config import AttemptConfig
from webgym.rollout.driver import EpisodeContext, EpisodeDriver
from webgym.rollout.plan import Planned
from webgym.rollout.progress import Progress
from webgym.rollout.site_health import HealthConfig, SiteHealth
from webgym.server.messages import SessionOptions, View

CALL = '{"name": "computer_use", "arguments": {"action": "wait", "time": 1}}'
ACTS = f"Action: wait\n<tool_call>\n{CALL}\n</tool_call>"
TYPES = ACTS.replace('"wait", "time": 1', '"navigate", "url": "http://b.test/"')


def answers(text: str) -> str:
    call = json.dumps({"name": "computer_use", "arguments": {"action": "answer", "text": text}})
    return f"Action: answer\n<tool_call>\n{call}\n</tool_call>"


def connection(url: str, *, is_typed: bool = False) -> Fault:
    return Fault("connection", url, f"{url} is silent", is_typed)


class Pages:
    """A browser whose page is another at every look.

    Attributes:
        probes: what was probed.
        problem: what every probe finds.
    """

    id = "s"

    def __init__(self, failures: Mapping[int, str | Fault] | None = None, status: int = 200) -> None:
        self.looks = 0
        self.kept: set[str] = set()
        self.probes: list[str] = []
        self.problem = ""
        self._failures = failures or {}
        self._status = status

    async def open(self, options: SessionOptions | None = None) -> Pages:
        del options
        return self

    async def step(self, action: BrowserAction | None = None) -> View:
        del action
        self.looks += 1
        image = b"page %d" % self.looks
        name = hashlib.sha256(image).hexdigest()
        failed = self._failures.get(self.looks)
        faults = (failed,) if isinstance(failed, Fault) else ()
        notices = (Notice("navigation_failed", failed),) if isinstance(failed, str) else ()
        url = f"http://a.test/{self.looks}"
        status = None if failed else self._status
        return View(
            Observation(name, url, "A", (1280, 768), status=status, notices=notices, faults=faults), image
        )

    async def probe(self, url: str) -> Probed:
        self.probes.append(url)
        return Probed(self.problem, None if self.problem else 200)

    async def close(self) -> None:
        pass

    async def put_image(self, name: str, data: bytes) -> None:
        del data
        self.kept.add(name)


class Says(BasePolicy):
    """Replies one after the other; fails where there is none left."""

    name = "says"
    wants_elements = False

    def __init__(self, *replies: str) -> None:
        self._replies = list(replies)

    def begin(self, task: object, seed: int) -> Says:
        del task, seed
        return self

    async def reply(self, turn: PolicyInput) -> Reply:
        del turn
        if not self._replies:
            raise PolicyTimeout("no reply came in 60 s")
        return Reply(self._replies.pop(0), "says")


def context_of(
    policy: Says, client: Any, store: Any, budget: int, site_state: Any = None
) -> AttemptContext[Any]:
    return AttemptContext(
        client=client,
        agent=Agent(policy, AgentConfig(image_max_side=None)),
        store=store,
        config=AttemptConfig(budget_easy=budget),
        progress=Progress(total=1),
        site_state=site_state,
        seed=0,
    )


async def made(
    policy: Says,
    budget: int = 3,
    failures: Mapping[int, str | Fault] | None = None,
    pages: Pages | None = None,
) -> tuple[Episode, Pages, Progress]:
    pages = pages or Pages(failures)
    context = context_of(policy, pages, pages, budget)
    attempt = Attempt(context, Planned(task("t", 1), 0))
    await attempt.run(pages)
    return attempt.episode(), pages, context.progress


async def test_an_attempt_without_one_valid_reply_spends_its_budget() -> None:
    """Were it an error, an agent that is about to fail could have the attempt made again."""
    episode, _, progress = await made(Says("I would click", "", "<tool_call>{</tool_call>"))
    assert episode.ending is Ending.BUDGET_SPENT
    assert episode.failure is None
    assert (progress.invalid, progress.steps) == (3, 3)


async def test_a_start_page_that_the_egress_policy_refuses_names_the_setting() -> None:
    why = "http://a.test/: refused by the egress policy: 127.0.0.1 is a loopback address"
    episode, _, _ = await made(Says(), failures=dict.fromkeys(range(1, 9), why))
    assert episode.failure is not None
    assert f"{why}; browser.egress.allow, or webgym serve --allow-host, allows it" in episode.failure.message
    episode, _, _ = await made(Says(), failures=dict.fromkeys(range(1, 9), "http://a.test/: net::ERR_FAILED"))
    assert episode.failure is not None
    assert "browser.egress" not in episode.failure.message


@pytest.mark.parametrize("is_offline", [True, False])
async def test_an_offline_website_that_is_not_served_is_no_failure_of_the_agents(is_offline: bool) -> None:
    """Its server was started again with another seed. On the web, a start page may be gone for good."""
    pages = Pages({}, status=404)
    context = EpisodeContext(store=pages, config=AttemptConfig(), site_state=None, seed=0)
    truth = Truth("a.test", (FactTruth(1, 0),), AnswerTruth(), ()) if is_offline else None
    planned = Planned(msgspec.structs.replace(task("t", 1), truth=truth), 0)
    driver = EpisodeDriver(context, planned, AgentTraits("p", "marks"))
    if not is_offline:
        assert (await driver.start(pages)).observation.status == 404
        return
    with pytest.raises(NavigationFailed, match="not among the websites that are served"):
        await driver.start(pages)


class Lacking(Pages):
    """Something does not come at some looks."""

    def __init__(self, looks: int, **lacking: Any) -> None:
        super().__init__({})
        self._lacking = looks, lacking

    async def step(self, action: BrowserAction | None = None) -> View:
        view = await super().step(action)
        looks, lacking = self._lacking
        seen = (
            msgspec.structs.replace(view.observation, **lacking) if self.looks <= looks else view.observation
        )
        return View(seen, view.image)


A = "http://a.test/in/1"
B = "http://b.test/in/1"


@pytest.mark.parametrize(
    ("is_offline", "fault", "is_lost"),
    [
        (True, Fault("connection", A, "it broke off"), True),
        (False, Fault("connection", A, "it broke off"), True),
        (True, Fault("part", A, "reset"), True),
        (False, Fault("part", A, "reset"), False),  # parts of pages of the web may always be missing
        (True, Fault("status", A, "502"), True),
        (False, Fault("status", A, "502"), False),
        (True, Fault("status", B, "502"), False),
        (True, Fault("part", B, "reset"), False),
        (False, Fault("renderer", B, "killed"), True),
    ],
)
async def test_a_start_page_that_does_not_come_whole_is_opened_again(
    is_offline: bool, fault: Fault, is_lost: bool
) -> None:
    context = EpisodeContext(store=Pages({}), config=AttemptConfig(), site_state=None, seed=0)
    truth = Truth("a.test", (FactTruth(1, 0),), AnswerTruth(), ()) if is_offline else None
    known = msgspec.structs.replace(task("t", 1), truth=truth, website="http://a.test")
    pages = Lacking(1, faults=(fault,))
    driver = EpisodeDriver(context, Planned(known, 0), AgentTraits("p", "marks"))
    await driver.start(pages)
    assert pages.looks == 1 + is_lost
    driver = EpisodeDriver(context, Planned(known, 0), AgentTraits("p", "marks"))
    if is_lost:
        with pytest.raises(NavigationFailed, match="cannot be opened"):
            await driver.start(Lacking(9, faults=(fault,)))


@pytest.mark.parametrize(("statuses", "ending"), [([403, 403], "site_refused"), ([429, 200], "budget_spent")])
async def test_a_website_that_refuses_its_start_page_twice_is_blocked_before_a_step_is_paid(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, statuses: list[int], ending: str
) -> None:
    monkeypatch.setattr("webgym.rollout.driver.INSIST_SECONDS", 0)

    class Refusing(Pages):
        async def step(self, action: BrowserAction | None = None) -> View:
            self._status = statuses[self.looks] if self.looks < len(statuses) else 200
            return await super().step(action)

    episode, pages, _ = await made(Says(ACTS, ACTS, ACTS), pages=Refusing())
    assert episode.ending == ending
    if ending == "site_refused":
        assert (pages.looks, episode.steps) == (2, ())
        assert outcome_of(episode.ending, None) is Outcome.BLOCKED
        assert episode.failure is not None
        assert episode.failure.message.endswith("was refused twice: status 403")
        health = SiteHealth(HealthConfig(file=tmp_path / "sites.jsonl"), identity="desktop")
        health.note("http://a.test/", Trajectory(episode, Outcome.BLOCKED))
        assert list(health.blocked()) == ["a.test"]
    else:
        assert len(episode.steps) == 3


async def test_one_valid_reply_is_enough_to_be_judged() -> None:
    episode, _, progress = await made(Says("I would click", ACTS, ""))
    assert episode.ending is Ending.BUDGET_SPENT
    assert episode.failure is None
    assert progress.invalid == 2


@pytest.mark.parametrize("before", [0, 1])
async def test_a_turn_that_fails_is_kept_with_its_cause_and_the_page_that_was_open(before: int) -> None:
    episode, pages, _ = await made(Says(*[ACTS] * before))
    assert episode.ending is Ending.POLICY_FAILED
    assert episode.failure is not None
    assert episode.failure.message == "no reply came in 60 s"
    assert episode.final is not None
    assert episode.final.url == f"http://a.test/{before + 1}"
    assert episode.final.screenshot in pages.kept


class SiteState:
    """Never tells what state a website is in."""

    def __init__(self) -> None:
        self.asked = asyncio.Event()

    def cookies(self, visitor: str) -> tuple[Cookie, ...]:
        del visitor
        return ()

    async def state(self, visitor: str, host: str) -> dict[str, Any] | None:
        del visitor, host
        self.asked.set()
        await asyncio.Event().wait()
        raise AssertionError


async def test_an_attempt_that_is_made_again_is_another_visitor() -> None:
    """A killed attempt leaves a full cart at an offline web elsewhere, and has the same id again."""
    visitors = list[str]()

    class Visited(SiteState):
        def cookies(self, visitor: str) -> tuple[Cookie, ...]:
            visitors.append(visitor)
            return ()

    pages = Pages({})
    context = EpisodeContext(store=pages, config=AttemptConfig(), site_state=Visited(), seed=0)
    for _ in range(2):
        EpisodeDriver(context, Planned(task("t", 1), 0), AgentTraits("p", "marks")).options()
    assert len(set(visitors)) == 2


def test_the_attempts_at_one_task_share_parts_if_the_run_says_so() -> None:
    def group(config: AttemptConfig, name: str, sample: int) -> str:
        context = EpisodeContext(store=Pages({}), config=config, site_state=None, seed=0)
        return (
            EpisodeDriver(context, Planned(task(name, 1), sample), AgentTraits("p", "marks")).options().shared
        )

    assert group(AttemptConfig(), "t", 0) == ""
    sharing = AttemptConfig(share_parts=True)
    assert group(sharing, "t", 0) == group(sharing, "t", 1) != group(sharing, "u", 0) != ""


async def test_a_tasks_identity_and_log_in_go_before_its_runs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("LAB", "ann:pass")
    identity = Identity(
        time_zone="Asia/Tokyo", languages=("ja",), credentials={"https://lab.example": "$LAB"}
    )
    config = AttemptConfig(identity=identity)
    context = EpisodeContext(store=Pages({}), config=config, site_state=None, seed=0)
    planned = Planned(msgspec.structs.replace(task("t", 1), identity={"languages": ["de"]}), 0)
    options = EpisodeDriver(context, planned, AgentTraits("p", "marks")).options()
    assert options.identity == {"time_zone": "Asia/Tokyo", "languages": ["de"]}
    assert options.credentials == {"https://lab.example": "ann:pass"}
    login, own = tmp_path / "shop.json", tmp_path / "own.json"
    for path, value in ((login, "website"), (own, "task")):
        write_storage(path, StorageState((StoredCookie("sid", value, "a.example"),)))
    config = AttemptConfig(logins={"www.shop.example": login, "u": own})
    for name, website, values in (
        ("t", "https://www.shop.example/a", ["website"]),
        ("u", "https://www.shop.example/a", ["task"]),
        ("t", "https://other.example", []),
    ):
        known = msgspec.structs.replace(planned.task, id=name, website=website)
        assert [cookie.value for cookie in config.access.storage_of(known).cookies] == values
    with pytest.raises(ConfigError, match="cannot read"):
        _ = AttemptConfig(logins={"shop.example": tmp_path / "none"}).access
    with pytest.raises(ValueError, match=r"identity\.languages"):
        msgspec.structs.replace(planned.task, identity={"languages": ["?"]})


async def test_who_is_stopped_before_judges_have_the_state_to_look_at_is_not_theirs() -> None:
    pages, site_state = Pages({}), SiteState()
    context = context_of(Says(ACTS), pages, pages, 1, site_state)
    facts = (FactTruth(1, 0, state=(StateCheck(("cart",), 1),)),)
    known = msgspec.structs.replace(task("t", 1), truth=Truth("a.test", facts, AnswerTruth(), ()))
    attempt = Attempt(context, Planned(known, 0))
    running = asyncio.create_task(attempt.run(pages))
    await asyncio.wait_for(site_state.asked.wait(), 60)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    assert len(attempt.episode().steps) == 1
    assert attempt.episode().ending is Ending.CANCELLED


@pytest.mark.parametrize("problem", ["nothing answers", ""])
async def test_a_website_that_goes_away_under_an_attempt_is_no_failure_of_the_agents(problem: str) -> None:
    """Whether it has is what a probe of the start page says, from outside the session."""
    pages = Pages({2: connection("http://a.test/2")})
    pages.problem = problem
    episode, _, _ = await made(Says(ACTS, ACTS, ACTS), pages=pages)
    assert pages.probes == ["http://a.test/"]
    if not problem:
        assert episode.ending is Ending.BUDGET_SPENT
        return
    assert episode.ending is Ending.ENVIRONMENT_FAILED
    assert episode.failure is not None
    assert "http://a.test/2 is silent; probed: nothing answers" in episode.failure.message
    assert len(episode.steps) == 1


@pytest.mark.parametrize(
    ("fault", "is_up_later", "ending"),
    [
        (connection("http://a.test:81/", is_typed=True), True, Ending.BUDGET_SPENT),
        (connection("http://b.test/"), True, Ending.BUDGET_SPENT),
        (Fault("part", "http://a.test/x", "reset"), True, Ending.BUDGET_SPENT),  # of the web
        (Fault("renderer", "http://a.test/1", "killed"), True, Ending.ENVIRONMENT_FAILED),
        (Fault("renderer", "http://a.test/1", "killed", is_typed=True), True, Ending.BUDGET_SPENT),
        (
            Fault("renderer", "http://b.test/1", "killed"),
            True,
            Ending.BUDGET_SPENT,
        ),  # led on from a typed one
        # The agent went on without its website:
        (connection("http://a.test/", is_typed=True), False, Ending.ENVIRONMENT_FAILED),
    ],
)
async def test_who_asked_for_what_failed_decides_who_caused_the_end(
    fault: Fault, is_up_later: bool, ending: Ending
) -> None:
    typed = connection("http://b.test/?u=http://a.test/", is_typed=True)
    pages = Pages({2: typed, 3: fault} | ({} if is_up_later else {4: typed}))
    pages.problem = "nothing answers"  # which no choice of the agent's is confirmed by
    episode, _, _ = await made(Says(TYPES, ACTS if not fault.is_typed else TYPES, TYPES), pages=pages)
    assert episode.ending is ending
    assert len(pages.probes) == (not is_up_later)


async def test_answers_of_any_length_are_taken() -> None:
    said = "so it is " * 100_000
    episode, _, _ = await made(Says(answers(said)))
    assert (episode.ending, episode.answer) == (Ending.ANSWERED, said)


async def test_who_is_right_half_of_the_time_gains_nothing_by_addresses_that_fail() -> None:
    """Whoever is about to be wrong types an address instead of its answer; with two retries."""
    rng = random.Random(0)
    coins = [[rng.random() < 0.5 for _ in range(3)] for _ in range(40)]
    rewards = []
    for tries in coins:
        for is_right in tries:
            rewards.append(is_right)
            pages = Pages({2: connection("http://b.test/?u=http://a.test/", is_typed=True)})
            episode, _, _ = await made(Says(TYPES, answers("no")), pages=pages)
            if is_right or not outcome_of(episode.ending, JudgeError("not asked")).is_retried:
                break
            rewards.pop()
    assert sum(rewards) == sum(first for first, *_ in coins)


RELOADS = ACTS.replace('"wait", "time": 1', '"navigate", "url": "http://a.test/2"')


@pytest.mark.parametrize(
    ("replies", "host", "by_others", "is_lost"),
    [
        ([answers("price: unknown")], "api.a.test", True, False),  # before it
        ([ACTS, answers("price: unknown")], "api.a.test", True, True),
        ([ACTS, answers("price: unknown")], "api.a.test", False, False),  # an agent could bring that about
        ([ACTS, answers("$9")], "api.a.test", True, True),  # whether it is right or not: no second chance
        ([ACTS, ACTS, answers("price: unknown")], "api.a.test", True, True),  # the same page still
        ([ACTS, RELOADS, answers("$9")], "api.a.test", True, False),
        ([ACTS, ACTS, ACTS], "api.a.test", True, True),
        ([ACTS, answers("$9")], "adverts.test", True, False),
    ],
)
async def test_no_answer_counts_that_rests_on_a_page_that_other_sessions_cut(
    replies: list[str], host: str, by_others: bool, is_lost: bool
) -> None:
    class Limited(Pages):
        async def step(self, action: BrowserAction | None = None) -> View:
            view = await super().step(action)
            limited = {host: 2} if self.looks == 2 else {}
            own = {"limited": limited, "crowded": limited if by_others else {}}
            return View(msgspec.structs.replace(view.observation, url="http://a.test/2", **own), view.image)

    episode, _, _ = await made(Says(*replies), pages=Limited())
    assert (episode.ending is Ending.ENVIRONMENT_FAILED) == is_lost
    assert episode.steps[-1].reply.text == replies[-1]
    if is_lost:
        assert episode.failure is not None
        assert episode.failure.code == "egress_refused"
        assert "browser.egress.rate" in episode.failure.message
