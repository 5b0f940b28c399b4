"""The small websites and their engine: solvable by nothing less than a solution, split by design, and made
of one small vocabulary. All without a browser.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from pydantic import SecretStr
from tests.conftest import Calls

from webgym.core.errors import ConfigError, SitesError, WebGymError
from webgym.core.task import Task
from webgym.core.truth import AnswerTruth, Click, Done, Evidence, Give, Remember, StateCheck
from webgym.offline.app import serving
from webgym.offline.config import SitesConfig
from webgym.offline.data import load
from webgym.offline.parts import Assignment, Fact, Part, Place, write
from webgym.offline.seeds import stream
from webgym.offline.small import FAMILIES, WORDING, small_vocabulary
from webgym.offline.small.catalog import Board, Market
from webgym.offline.small.design import HELD_OUT, Sign, design, design_data, number_sign, side
from webgym.offline.small.questions import words_of
from webgym.offline.small.screen import COLUMNS, ROWS, Tile, bar_room, capacity, placed
from webgym.offline.small.site import Mix, compose
from webgym.offline.web import OfflineWeb
from webgym.offline.website import Split, Visit, Website
from webgym.rollout.config import AttemptConfig
from webgym.run.collect import collect, resume
from webgym.run.config import RunConfig, Secrets, ServerChoice, TaskChoice, resolved
from webgym.run.services import services
from webgym.server.config import ServerConfig
from webgym.store.runs import RunWriter
from webgym.study.static_pages import StaticBrowser, read_page
from webgym.tasks.formats import write_tasks
from webgym.testing import check_family, check_tasks, play

VIEWPORT = (192, 128)


@pytest.fixture(scope="module")
def web() -> OfflineWeb:
    return OfflineWeb(collection="small")


@pytest.fixture(scope="module")
def tasks() -> list[Task]:
    """Of two websites for training and one for testing in every family."""
    return list(OfflineWeb(5, per_family=3, collection="small").tasks())


# --- solvable, and by nothing less -----------------------------------------------------------------------


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.family)
async def test_solutions_pass_and_nothing_less_does(family: type[Website]) -> None:
    assert await check_family(family, websites=1, tasks_per_website=14) == []


class Mute(Market):
    """A shop that does not show its numbers."""

    def thing_blocks(self, record):  # type: ignore[no-untyped-def]
        return [block for block in super().thing_blocks(record) if not block[0].sign.text.isdecimal()]


class Hasty(Board):
    """A board whose front page counts as evidence for everything."""

    def parts(self) -> Iterator[Part]:
        for part in super().parts():
            facts = tuple(
                Fact(each.text, (Evidence((), "/"),), each.state, each.answer, wrong=each.wrong)
                for each in part.facts
            )
            yield Part(part.ask, part.description, facts, part.moves)


class Careless(Board):
    """A board whose solutions want something that is not there."""

    def parts(self) -> Iterator[Part]:
        for part in super().parts():
            yield Part(part.ask, part.description, part.facts, (*part.moves, Click("nothing")))


@pytest.mark.parametrize(
    ("family", "fault"),
    [(Mute, "no screenshot shows"), (Hasty, "at first sight passes"), (Careless, "I could not click")],
)
async def test_the_check_finds_what_is_wrong(family: type[Website], fault: str) -> None:
    faults = await check_family(family, websites=1, tasks_per_website=6)
    assert any(fault in line for line in faults)


async def test_the_order_of_an_answer_counts(tasks: list[Task], web: OfflineWeb) -> None:
    small = OfflineWeb(5, per_family=3, collection="small")
    both = next(
        task
        for task in tasks
        if task.truth
        and len(values := task.truth.answer.required) == 2
        and values[0] != values[1]
        and task.difficulty == 2
    )
    assert both.truth is not None
    first, second = (place[0] for place in both.truth.answer.required)
    site = small.website(both.truth.host)
    assert site is not None
    for answer, faults in (
        (f"{first}, {second}", 0),
        (f"{second}, {first}", 1),
        (f"{first}, {second}, {first}", 1),
    ):
        moves = (*both.truth.moves[:-1], Give(answer))
        told = msgspec.structs.replace(both, truth=msgspec.structs.replace(both.truth, moves=moves))
        found = await check_tasks(site, [told], VIEWPORT)
        assert len(found) == faults, found


async def test_a_cart_with_more_than_was_asked_for_fails(web: OfflineWeb) -> None:
    host, site = next(
        (host, site)
        for host, spec in web.specs.items()
        if spec.family is Market and isinstance(site := web.website(host), Market)
    )
    buys = [
        task
        for task in web.tasks_of(host)
        if task.difficulty == 1 and task.truth and task.truth.facts[0].state
    ]
    one, two = buys[:2]
    assert one.truth is not None
    assert two.truth is not None
    moves = (*two.truth.moves[:-2], *one.truth.moves)
    greedy = msgspec.structs.replace(one, truth=msgspec.structs.replace(one.truth, moves=moves))
    (fault,) = await check_tasks(site, [greedy], VIEWPORT)
    assert "the server holds cart" in fault


# --- the tasks -------------------------------------------------------------------------------------------


def test_the_mix_of_difficulties_and_the_split(web: OfflineWeb) -> None:
    assert Counter(spec.split for spec in web.specs.values()) == {"train": 300, "test": 60}
    hosts = [host for nth, host in enumerate(web.specs) if nth % 24 == 0]
    found = [task for host in hosts for task in web.tasks_of(host)]
    levels = Counter(task.level for task in found)
    assert levels["hard"] == len(hosts)
    assert levels["medium"] == pytest.approx(5 * len(hosts), rel=0.1)
    assert levels["easy"] == pytest.approx(25 * len(hosts), rel=0.15)
    assert len({task.id for task in found}) == len(found)
    for task in found:
        assert task.truth is not None
        assert task.id.startswith("small/")
        assert task.source == "small"
        assert task.split == web.specs[task.truth.host].split


def test_no_website_asks_the_same_twice(tasks: list[Task]) -> None:
    asked = Counter((task.website, task.instruction) for task in tasks)
    assert [key for key, count in asked.items() if count > 1] == []


def test_memory_says_one_thing_under_one_key_and_the_answer_is_what_it_says(tasks: list[Task]) -> None:
    for task in tasks:
        assert task.truth is not None
        memory: dict[str, str] = {}
        for move in task.truth.moves:
            if isinstance(move, Remember):
                assert memory.setdefault(move.key, move.value) == move.value, task.id
        parts = [move.part for move in task.truth.moves if isinstance(move, Done)]
        assert parts == [str(nth) for nth in range(1, len(task.rubric.groups) + 1)]
        last = task.truth.moves[-1]
        assert isinstance(last, Give)
        assert last.text == (", ".join(memory[part] for part in parts if part in memory) or "done")
        assert (task.reference_answer or "done") == last.text.replace(",", ";")


def test_everything_is_made_of_the_small_vocabulary(tasks: list[Task]) -> None:
    vocabulary = set(small_vocabulary())
    assert len(vocabulary) <= 160
    said: set[str] = set()
    for task in tasks:
        assert task.truth is not None
        said.update(words_of(task.instruction.partition(" (answer ")[0]))
        for move in task.truth.moves:
            if isinstance(move, Remember):
                said.update(words_of(f"{move.key} {move.value}"))
            elif isinstance(move, Click | Give):
                said.update(words_of(move.name or "" if isinstance(move, Click) else move.text))
    small = OfflineWeb(5, per_family=3, collection="small")
    for host in small.specs:
        for _, body in crawl(small, host):
            controls, text, _ = read_page(body)
            said.update(word for control in controls for word in words_of(control.name))
            said.update(words_of(text))
    assert said <= vocabulary
    assert said >= {"red", "star", "20", "home", "cart", ","}


# --- the pages -------------------------------------------------------------------------------------------


def crawl(web: OfflineWeb, host: str) -> list[tuple[str, bytes]]:
    """Every page of a website that links lead to."""
    site = web.website(host)
    assert site is not None
    seen, queue, found = {"/"}, ["/"], []
    while queue:
        path = queue.pop()
        answer = site.handle(Visit("GET", path, {}, {}, {}, {}))
        assert answer.status == 200, (host, path)
        found.append((path, answer.body))
        links = {control.href for control in read_page(answer.body)[0] if not control.is_post}
        queue += links - seen
        seen |= links
    return found


def test_pages_are_tiny_lead_home_and_have_names_that_are_unique() -> None:
    web, dead = OfflineWeb(9, per_family=2, collection="small"), 0
    for host in web.specs:
        for path, body in crawl(web, host):
            assert len(body) < 12_000
            assert b"<script" not in body
            controls = read_page(body).controls
            names = [control.name for control in controls]
            assert len(set(names)) == len(names), (host, path)
            assert path == "/" or "home" in names
            boxes = [control.box for control in controls]
            assert len(set(boxes)) == len(boxes)
            assert all(0 <= box[0] <= 160 and 0 <= box[1] <= 96 for box in boxes)
            dead += body.count(b'role="img"')
    assert dead > 100


def test_an_address_that_is_not_there_is_a_page_with_a_way_home(web: OfflineWeb) -> None:
    for family in FAMILIES:
        host = next(host for host, spec in web.specs.items() if spec.family is family)
        site = web.website(host)
        assert site is not None
        for path in ("/nowhere", "/list/x/1", "/table/x/1", "/form/x/0", "/sent/x", "/a/b/c/d"):
            answer = site.handle(Visit("GET", path, {}, {}, {}, {}))
            assert answer.status == 404
            assert [control.name for control in read_page(answer.body)[0]][:1] == ["home"]


@pytest.mark.parametrize("split", ["train", "test"])
def test_every_layout_places_all_that_fits_once(split: Split) -> None:
    for seed in range(40):
        layout = design(seed, split).layout
        for width in (1, 2):
            most = capacity(layout, width)
            for count in (1, most // 2, most):
                block = [Tile(number_sign(nth)) for nth in range(width)]
                bar = [Tile(Sign(control="home"))] * bar_room(layout)
                cells = [cell for cell, _ in placed(layout, bar, [block] * count)]
                assert len(set(cells)) == len(cells) == bar_room(layout) + count * width
                assert all(0 <= column < COLUMNS and 0 <= row < ROWS for column, row in cells)
            with pytest.raises(ValueError, match="room"):
                placed(layout, [], [block] * (most + 1))


# --- the split by design ---------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [7, 8])
def test_websites_for_testing_combine_what_none_for_training_does(seed: int) -> None:
    web = OfflineWeb(seed, collection="small")
    keys: dict[str, list[tuple[tuple[int, ...], ...]]] = {"train": [], "test": []}
    for spec in web.specs.values():
        keys[spec.split].append(design(spec.seed, spec.split).key)
    for pair in ((0, 1), (0, 2)):
        pairs = {split: {(key[pair[0]], key[pair[1]]) for key in some} for split, some in keys.items()}
        assert not pairs["train"] & pairs["test"]
    choices = design_data()
    for part, options in ((0, choices.theme), (1, choices.layout)):
        for place, (name, values) in enumerate(options.items()):
            for split, some in keys.items():
                assert {key[part][place] for key in some} == set(range(len(values))), (split, name)


def test_a_combination_is_for_training_for_testing_or_for_neither() -> None:
    rest = HELD_OUT - 1
    assert side((0, 0), (0,), (0,)) == "test"
    assert side((1, 0), (0,), (0,)) == "train"
    assert side((1, 0), (rest,), (0,)) is None
    assert side((1, 0), (rest,), (rest,)) == "test"


def test_a_color_is_the_same_color_on_every_website(web: OfflineWeb) -> None:
    shades: dict[str, list[tuple[int, ...]]] = {}
    for spec in list(web.specs.values())[::9]:
        for name, color in design(spec.seed, spec.split).theme.colors.items():
            shades.setdefault(name, []).append(tuple(int(color[at : at + 2], 16) for at in (1, 3, 5)))
    means = {name: [sum(c) / len(some) for c in zip(*some, strict=True)] for name, some in shades.items()}
    for name, some in shades.items():
        assert len(set(some)) > 5
        for shade in some:
            far = {
                other: sum((a - b) ** 2 for a, b in zip(shade, mean, strict=True))
                for other, mean in means.items()
            }
            assert min(far, key=far.__getitem__) == name


# --- the engine ------------------------------------------------------------------------------------------


class Shape(msgspec.Struct, forbid_unknown_fields=True):
    look_up: list[int]


def test_a_file_that_does_not_fit_is_named_with_its_key() -> None:
    with pytest.raises(SitesError, match=r"small/market\.toml: .*look_up"):
        load("webgym.offline.small", "market.toml", Shape)


@pytest.mark.parametrize("command", ["list", "check"])
def test_a_family_or_collection_that_is_not_there_is_refused(calls: Calls, command: str) -> None:
    code, said = calls.run("sites", command, "--collection", "small", "--family", "shop")
    hint = "webgym sites list --collection small shows the families"
    assert (code, said) == (2, f"webgym: unknown family 'shop' ({hint})\n")
    code, said = calls.run("sites", command, "--collection", "tiny")
    assert (code, said) == (2, "webgym: collection: Input should be 'large', 'small' or 'cross'\n")


def part(name: str, facts: int, **state: object) -> Part:
    checks = tuple(StateCheck((key,), value) for key, value in state.items())
    made = tuple(
        Fact(f"{name} {nth}", (Evidence((), f"/{name}{nth}"),), checks if nth == 0 else ())
        for nth in range(facts)
    )
    return Part(f"do {name}", name, made, (Remember("", name), Remember(" sign", "x"), Click(name)))


PLACE = Place(
    "fern", "Fern", "fern.webgym.test", "http://fern.webgym.test/", "Misc.", "News", wording=WORDING
)


def test_parts_are_told_apart_by_number_and_collections_add_up() -> None:
    parts = (part("a", 1, cart={"star": 1}), part("b", 1, cart={"moon": 1}), part("c", 1))
    (task,) = write(PLACE, Assignment("x", parts))
    assert task.instruction == "do a, then do b, and do c (answer with the word done alone)"
    assert task.truth is not None
    assert [move for move in task.truth.moves if isinstance(move, Remember | Done)] == [
        Remember("1", "a"), Remember("1 sign", "x"), Done("1"),
        Remember("2", "b"), Remember("2 sign", "x"), Done("2"),
        Remember("3", "c"), Remember("3 sign", "x"), Done("3"),
    ]  # fmt: skip
    held = {
        check.value["star"] + check.value["moon"]
        for fact in task.truth.facts
        for check in fact.state
        if check.value
    }
    assert held == {2}
    assert task.truth.moves[-1] == Give("done")
    assert task.truth.answer == AnswerTruth(by_comma=True)


def test_tasks_that_want_two_states_at_once_are_not_made() -> None:
    rng = stream("compose")
    parts = [
        part("a", 1, sent="x"),
        part("b", 1, sent="y"),
        part("c", 1, cart={"s": 1}),
        part("d", 1, cart={"s": 1}),
    ]
    made = compose(rng, parts, Mix(easy=50, medium=5, hard=1))
    names = {frozenset(each.description for each in assignment.parts) for assignment in made}
    assert len(names) == len(made) >= 7
    assert all(not {"a", "b"} <= some and not {"c", "d"} <= some for some in names)


def test_derived_tasks_count_in_the_mix() -> None:
    parts = [part(name, size) for name, size in zip("abcdefgh", (3, 3, 3, 1, 1, 2, 2, 1), strict=True)]
    for seed in range(5):
        made = compose(stream(seed), parts, Mix(easy=12, medium=5, hard=1))
        levels = Counter(task.level for assignment in made for task in write(PLACE, assignment))
        assert levels["hard"] == 1
        assert levels["medium"] <= 5
        assert levels["easy"] <= 12


def test_an_episode_without_a_browser_is_what_a_collector_records(web: OfflineWeb, tasks: list[Task]) -> None:
    small = OfflineWeb(5, per_family=3, collection="small")
    task = next(task for task in tasks if task.level == "hard")
    assert task.truth is not None
    site = small.website(task.truth.host)
    assert site is not None
    episode = play(site, task, VIEWPORT)
    assert episode.answer == task.truth.moves[-1].text  # type: ignore[union-attr]
    assert [step.index for step in episode.steps] == list(range(len(episode.steps)))
    assert all(step.changed for step in episode.steps[:-1])


def test_a_click_beside_everything_changes_nothing_and_back_goes_back(web: OfflineWeb) -> None:
    from webgym.core.action import GoBack, LeftClick, Target

    host = next(iter(web.specs))
    site = web.website(host)
    assert site is not None
    browser = StaticBrowser(site, VIEWPORT)
    before = browser.observe()
    covered = {(int(e.box[0]) // 32, int(e.box[1]) // 32) for e in before.elements or ()}
    free = next((c, r) for c in range(COLUMNS) for r in range(ROWS) if (c, r) not in covered)
    at = ((free[0] * 32 + 16) / 192 * 1000, (free[1] * 32 + 16) / 128 * 1000)
    browser.act(LeftClick(Target(coordinate=at)))
    assert browser.observe() == before
    first = (before.elements or ())[0]
    browser.act(LeftClick(Target(element=first.number)))
    assert browser.observe().url == first.href
    browser.act(GoBack())
    assert browser.observe() == before


async def test_tasks_whose_websites_are_not_served_are_refused(tasks: list[Task], tmp_path: Path) -> None:
    file = tmp_path / "tasks.jsonl"
    write_tasks(file, tasks[:1])
    config = RunConfig(tasks=TaskChoice(file=file), sites=SitesConfig(per_family=1, latency=0))
    with pytest.raises(ConfigError, match="not served"):
        await collect(config, tmp_path / "run")


@pytest.mark.parametrize(
    ("served", "expected"),
    [
        (SitesConfig(collection="small", seed=8), "not served"),
        (SitesConfig(collection="small", seed=5), "browser server"),  # the next thing that is looked for
        (SitesConfig(collection="large", seed=5), "not served"),
    ],
)
async def test_an_offline_web_elsewhere_must_serve_the_websites_of_the_tasks(
    tasks: list[Task], tmp_path: Path, served: SitesConfig, expected: str
) -> None:
    await _refused_there(served, SitesConfig(), tasks[:1], expected, tmp_path)


async def test_browsers_that_are_started_here_reach_an_offline_web_elsewhere(
    tasks: list[Task], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    allowed = []

    def start(config: ServerConfig) -> None:
        allowed.append(list(config.browser.egress.allow))
        raise ConfigError("that will do")

    monkeypatch.setattr("webgym.run.services.running_server", start)
    secrets = Secrets(sites_token=SecretStr("the-token-of-the-sites"))
    own = SitesConfig(collection="small", seed=5)
    async with serving(own.model_copy(update={"token": secrets.sites_token})) as sites:
        config = RunConfig(sites=own, server=ServerChoice(sites_url=sites.url))
        with pytest.raises(ConfigError, match="will do"):
            await collect(config, tmp_path / "run", tasks=tasks[:1], secrets=secrets)
        with pytest.raises(ConfigError, match="will do"):
            await services(config, secrets).__aenter__()
        assert allowed == [list(sites.allowed_hosts)] * 2


async def test_an_offline_web_elsewhere_must_not_serve_others_of_the_same_names(tmp_path: Path) -> None:
    served, own = (SitesConfig(collection="small", seed=seed) for seed in (0, 7))
    web = OfflineWeb(7, collection="small")
    host = next(host for host in web.specs if host in OfflineWeb(0, collection="small").specs)
    tasks = list(web.tasks_of(host))[:1]
    await _refused_there(served, own, tasks, f"{host} is another website .* than here", tmp_path)
    await _refused_there(own, own, tasks, "browser server", tmp_path)


async def test_tasks_that_say_otherwise_than_their_websites_are_refused(
    tasks: list[Task], tmp_path: Path
) -> None:
    own, token = SitesConfig(collection="small", seed=5), SecretStr("the-token-of-the-sites")
    truth, secrets = tasks[0].truth, Secrets(sites_token=token)
    assert truth is not None
    older = msgspec.structs.replace(
        tasks[0], truth=msgspec.structs.replace(truth, answer=AnswerTruth((("another",),)))
    )
    named, another = tmp_path / "tasks.jsonl", "was made for another .* than is served"
    async with serving(own.model_copy(update={"token": token})) as sites:
        where = ServerChoice(url="http://127.0.0.1:9", sites_url=sites.url)
        config = RunConfig(sites=own, server=where)
        from_file = config.model_copy(update={"tasks": TaskChoice(file=named, split="all")})
        for task, told in ((older, another), (msgspec.structs.replace(older, id="mine/1"), "browser server")):
            write_tasks(named, [task])
            with pytest.raises(WebGymError, match=told):
                await collect(from_file, tmp_path / "run", secrets=secrets)
        for task, told in ((older, another), (tasks[0], "browser server")):
            run = tmp_path / told[:3]
            async with await RunWriter.create(run, config.model_dump(mode="json"), [task]):
                pass
            with pytest.raises(WebGymError, match=told):
                await resume(run, secrets=secrets)


def test_websites_of_other_code_are_other_websites(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = next(iter(OfflineWeb(7, per_family=1, collection="small").specs.values()))
    ours = spec.digest
    assert spec.digest == ours
    monkeypatch.setattr("webgym.offline.web.digest_of_code", lambda: "other code")
    assert spec.digest != ours


async def _refused_there(
    served: SitesConfig, own: SitesConfig, tasks: list[Task], expected: str, path: Path
) -> None:
    token = SecretStr("the-token-of-the-sites")
    async with serving(served.model_copy(update={"token": token})) as sites:
        where = ServerChoice(url="http://127.0.0.1:9", sites_url=sites.url)
        config = RunConfig(tasks=TaskChoice(split="all"), sites=own, server=where)
        with pytest.raises(WebGymError, match=expected):
            await collect(config, path / "run", tasks=tasks, secrets=Secrets(sites_token=token))
    assert not (path / "run").exists()


def test_the_viewport_follows_the_collection_unless_it_is_set() -> None:
    small = SitesConfig(collection="small")
    assert resolved(RunConfig(), None, None).attempt.viewport == (1280, 768)
    assert resolved(RunConfig(sites=small), None, None).attempt.viewport == VIEWPORT
    wide = RunConfig(sites=small, attempt=AttemptConfig(viewport=(320, 192)))
    assert resolved(wide, None, None).attempt.viewport == (320, 192)
