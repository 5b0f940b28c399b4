"""What may be drawn: training tasks unless somebody says otherwise, and none that gives a test task away."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import pytest

from webgym.core.errors import ConfigError, NothingToDraw
from webgym.core.task import FactGroup, Rubric, Task
from webgym.offline.config import SitesConfig
from webgym.offline.web import OfflineWeb
from webgym.run.choice import choose_tasks
from webgym.run.config import RunConfig, TaskChoice
from webgym.tasks.files import write_lines
from webgym.tasks.formats import read_tasks, write_tasks
from webgym.tasks.sampling import Sampler, SamplerConfig
from webgym.tasks.selection import Selection, drawn_subdomains, select, splits_in
from webgym.tasks.split import SplitConfig, leaks, refuse_leaks, split
from webgym.tasks.taxonomy import DOMAIN_OF

RUBRIC = Rubric((FactGroup(1, "", ("it is found",)),))


def task(id: str, website: str, **more: Any) -> Task:
    told: dict[str, Any] = {
        "instruction": "Find it.",
        "domain": "Misc.",
        "subdomain": "News",
        "rubric": RUBRIC,
    }
    told |= more
    return Task(id, website=website, source="made-up", **told)


TEST = [task("test/amazon", "amazon.com", split="test"), task("test/small", "small.example", split="test")]
GOOD = [task(f"good/{number}", f"site{number}.example", split="train") for number in range(50)]
LEAKS = [
    task("leak/brand", "https://www.amazon.de/", split="train"),
    task("leak/host", "shop.small.example", split="train"),
    task("leak/child", "elsewhere.example", split="train", parent_id="test/small"),
]
SET = [*TEST, *GOOD, *LEAKS]


def test_training_draws_no_test_task_and_nothing_that_gives_one_away() -> None:
    drawn = Sampler(SET, SamplerConfig(seed=3)).draw(75)
    assert {each.id for each in drawn} == {each.id for each in GOOD}
    chosen = select(SET, Selection())
    assert (chosen.tasks, chosen.split, chosen.left_out.total()) == (GOOD, "train", 5)
    assert chosen.told() == "2 of the test split, 3 on a website or of a family of the test split"


@pytest.mark.parametrize(
    ("text", "leaks_it"),
    [
        ("Compare the price with that on www.Amazon.de.", True),
        ("Go to https://shop.small.example/x?y=z and look.", True),
        ("Is it cheaper at small.example?", True),
        ("Ask help@small.example for it.", False),
        ("Is it in amazon.gov or on notsmall.example or small.example.org", False),
        ("Read about the small.Example follows here", True),
        ("Find an Amazon parrot, e.g. a small one", False),
    ],
)
def test_a_training_task_that_names_a_test_website_is_not_drawn(text: str, leaks_it: bool) -> None:
    in_rubric = Rubric((FactGroup(1, "prices", ("The price is found", text)),))
    naming = [
        task("names/1", "other.example", split="train", instruction=text),
        task("names/2", "another.example", split="train", rubric=in_rubric),
    ]
    chosen = select([*TEST, *naming, *GOOD], Selection())
    if not leaks_it:
        assert chosen.tasks == [*naming, *GOOD]
        return
    assert chosen.tasks == GOOD
    assert chosen.told() == "2 of the test split, 2 that name a website of the test split"
    assert {each.id for each in Sampler([*TEST, *naming, *GOOD], SamplerConfig(seed=1)).draw(60)} == {
        each.id for each in GOOD
    }
    with pytest.raises(ConfigError, match="names/1 names the website of the test task test/"):
        refuse_leaks(naming, TEST)
    made = split([task("t", "small.example"), *naming, *GOOD], SplitConfig(test_tasks=1), TEST)
    assert {left.why for left in made.left_out if left.id.startswith("names")} == {"names a test website"}


def test_a_test_task_may_name_any_website() -> None:
    """What it names beside its own is not thereby for testing."""
    test = [*TEST, task("test/names", "third.example", split="test", instruction="As on site1.example?")]
    assert select([*test, *GOOD], Selection()).tasks == GOOD


def test_other_splits_are_an_explicit_choice() -> None:
    assert {each.id for each in Sampler(SET, SamplerConfig(split="test")).draw(4)} == {
        each.id for each in TEST
    }
    assert select(SET, Selection(split="all")).tasks == SET
    with pytest.raises(NothingToDraw, match="2 of the test split, 53 of another split"):
        Sampler(SET, SamplerConfig(split="unsplit"))


@pytest.mark.parametrize("split", ["train", "test", "unsplit"])
def test_tasks_of_ones_own_that_say_no_split_are_taken_and_told_as_such(split: Any) -> None:
    own = [task("own/1", "a.example"), task("own/2", "b.example")]
    chosen = select(own, Selection(split=split))
    assert (chosen.tasks, chosen.split, splits_in(own)) == (own, "unsplit", "unsplit")


def test_a_task_that_says_no_split_is_not_for_training_where_others_do() -> None:
    assert select([task("own/1", "a.example"), *GOOD], Selection()).tasks == GOOD


def test_a_run_on_all_tasks_holds_no_training_task_that_gives_a_test_task_away(tmp_path: Path) -> None:
    """It may hold it without the test task: an export of its training tasks could not tell."""
    write_tasks(tmp_path / "set", SET)
    chosen = choose_tasks(RunConfig(tasks=TaskChoice(file=tmp_path / "set", split="all", count="all")))
    assert {each.id for each in chosen.tasks if each.split == "train"} == {each.id for each in GOOD}
    assert {each.id for each in chosen.tasks} == {each.id for each in SET}


def test_a_run_trains_on_training_tasks_alone_and_says_so(tmp_path: Path) -> None:
    write_tasks(tmp_path / "set", SET)
    chosen = choose_tasks(RunConfig(tasks=TaskChoice(file=tmp_path / "set")))
    assert {each.id for each in chosen.tasks} == {each.id for each in GOOD}
    assert chosen.selected.split == "train"
    assert {each.split for each in choose_tasks(RunConfig(sites=SitesConfig(per_family=2))).tasks} == {
        "train"
    }
    with pytest.raises(ConfigError, match="no task to attempt for the split 'train': 2 of the test split"):
        choose_tasks(RunConfig(tasks=TaskChoice(file=tmp_path / "set" / "test.jsonl")))
    few = RunConfig(sites=SitesConfig(collection="small", per_family=3), tasks=TaskChoice(split="test"))
    with pytest.raises(ConfigError, match="split 'test': none of 3 websites per family is for it"):
        choose_tasks(few)


def test_the_name_of_a_file_tells_the_split_of_tasks_that_do_not(tmp_path: Path) -> None:
    with (tmp_path / "test.jsonl").open("wb") as file:
        write_lines(file, [task("own/1", "a.example")])
    assert [each.split for each in read_tasks(tmp_path / "test.jsonl").tasks] == ["test"]


def test_the_guard_of_a_trainer() -> None:
    refuse_leaks(GOOD, TEST)
    assert [leak.task.id for leak in leaks(LEAKS, TEST)] == [each.id for each in LEAKS]
    with pytest.raises(ConfigError) as refused:
        refuse_leaks([*GOOD, *LEAKS], TEST)
    assert str(refused.value).startswith(
        "3 of 53 tasks must not be trained on: leak/brand on amazon.de shares the website of the test task "
        "test/amazon"
    )
    with pytest.raises(ConfigError, match="test/small is a test task"):
        refuse_leaks([*GOOD, TEST[1]], [])  # whatever the test set is said to be


def test_families_of_a_test_websites_tasks_stay_out() -> None:
    """As the split has it: a child of a task on a test website leaks, wherever it is itself."""
    parent = task("parent", "amazon.fr", split="train")
    child = task("child", "elsewhere.example", split="train", parent_id="parent")
    assert [leak.why for leak in leaks([parent, child], TEST)] == ["test website", "test website"]


@pytest.mark.parametrize("root_split", ["train", "test", None])
def test_every_ancestor_counts_and_not_the_first_alone(root_split: Any) -> None:
    root = task("root", "first.example", split=root_split)
    parent = task("parent", "amazon.fr", split="train", parent_id="root")
    child = task("child", "elsewhere.example", split="train", parent_id="parent")
    for ancestors in ([parent], [parent, root]):
        assert select([child, *ancestors, *TEST, *GOOD], Selection()).tasks[:1] == [
            root if root_split == "train" and root in ancestors else GOOD[0]
        ]
    loop = [
        task("a", "a.example", parent_id="b"),
        task("b", "b.example", parent_id="a"),
        task("c", "c.example", parent_id="a"),
    ]
    assert leaks(loop, TEST) == []
    assert len(leaks([*loop[1:], task("a", "amazon.fr", parent_id="b")], TEST)) == 3


def test_the_split_leaves_out_a_grandchild_of_a_task_on_a_test_website() -> None:
    parent = task("parent", "a.example", parent_id="root")
    child = task("child", "b.example", parent_id="parent")
    chosen = split([task("test", "a.example"), parent, child], SplitConfig(test_tasks=1))
    assert [each.id for each in chosen.tasks] == ["test"]


def test_half_of_the_subdomains_by_seed() -> None:
    halves = [drawn_subdomains(Selection(without_share=0.5, without_seed=seed)) for seed in range(20)]
    assert all(len(half) == len(DOMAIN_OF) // 2 for half in halves)
    assert len(set(map(tuple, halves))) == 20
    assert halves[0] == drawn_subdomains(Selection(without_share=0.5))
    tasks = list(OfflineWeb(1, per_family=1).tasks())
    for seed in (0, 1):
        chosen = select(tasks, Selection(split="all", without_share=0.5, without_seed=seed))
        assert {each.subdomain for each in chosen.tasks}.isdisjoint(halves[seed])
        assert chosen.without == tuple(halves[seed])  # the record names them
        kept = [each for each in tasks if each.subdomain not in halves[seed]]
        assert chosen.tasks == kept
    # The same ones whatever the tasks, so that every iteration and every evaluation leave the same ones out.
    assert select(tasks[:1], Selection(split="all", without_share=0.5)).without == tuple(halves[0])


def test_what_is_blocked_is_left_out_of_training_until_it_expires_and_never_of_testing() -> None:
    blocked = {"site0.example": 1, "small.example": 1}
    sampler = Sampler(SET, SamplerConfig(), blocked=lambda: blocked)
    assert "good/0" not in {each.id for each in sampler.draw(98)}
    assert sampler.passed_over["site0.example"] >= 1
    blocked.clear()
    assert "good/0" in {each.id for each in sampler.draw(100)}
    assert not sampler.passed_over
    blocked["small.example"] = 1
    assert "test/small" in {
        each.id for each in Sampler(SET, SamplerConfig(split="test"), blocked=lambda: blocked).draw(2)
    }
    chosen = select(SET, Selection(split="all"), blocked={"small.example", "site1.example"})
    assert (len(chosen.tasks), chosen.told()) == (len(SET) - 1, "1 on blocked websites")
    assert TEST[1] in chosen.tasks


def test_a_set_without_splits_that_is_asked_for_as_test_is_the_same_set_whatever_is_blocked() -> None:
    tasks = [msgspec.structs.replace(each, split=None) for each in SET]
    blocked = {"site0.example", "site1.example"}
    assert select(tasks, Selection(split="test"), blocked).tasks == tasks
    assert len(select(tasks, Selection(split="train"), blocked).tasks) < len(tasks)
    drawn = Sampler(tasks, SamplerConfig(split="test"), blocked=lambda: blocked).draw(len(tasks))
    assert {each.id for each in drawn} == {each.id for each in tasks}


def test_a_run_may_draw_by_ratio(tmp_path: Path) -> None:
    write_tasks(tmp_path / "set", SET)
    choice = TaskChoice(file=tmp_path / "set", ratio={"easy": 1.0}, count=60)
    drawn = choose_tasks(RunConfig(tasks=choice)).tasks
    assert len(drawn) == 60
    assert {each.id for each in drawn} == {each.id for each in GOOD}  # some twice
    with pytest.raises(ValueError, match="a ratio needs a count"):
        TaskChoice(ratio={"easy": 1.0})
