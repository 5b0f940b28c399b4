"""Task sets by their names on the hub, and pushed to it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from huggingface_hub import constants
from msgspec.structs import replace
from tests.conftest import Calls, webgym
from tests.documented import documented
from tests.serving import beside
from tests.tasks.hub_server import Hub, serve_hub, use
from tests.tasks.making import task
from tests.tasks.sources import native

from webgym.core.errors import ConfigError, TaskFileError
from webgym.run.config import RunConfig, with_pinned_tasks
from webgym.tasks.benchmarks import read_benchmark
from webgym.tasks.formats import read_tasks, write_tasks
from webgym.tasks.hub import Address, address_of, pinned
from webgym.tasks.sources import ENCRYPTED_SOURCE, read_source

SET = "microsoft/webgym_tasks"


@pytest.fixture
def hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Hub]:
    with beside(serve_hub()) as served:
        use(served, tmp_path / "cache", monkeypatch)
        monkeypatch.delenv("HF_TOKEN", raising=False)
        yield served


def published(folder: Path, train: int = 2, test: int = 1) -> dict[str, bytes]:
    """The files of a published set."""
    tasks = [task(f"insta-v3/{number}", split="train") for number in range(train)]
    tasks += [
        task(f"insta-v3/{number}", f"https://test{number}.example/", split="test")
        for number in range(train, train + test)
    ]
    write_tasks(folder, tasks, format="published")
    return {path.name: path.read_bytes() for path in folder.iterdir()} | {"README.md": b"# Tasks"}


@pytest.mark.parametrize(
    ("where", "address"),
    [
        ("hub:a/b", Address("a/b")),
        ("hub:a/b-c.d_e:test", Address("a/b-c.d_e", None, "test")),
        ("hub:a/b@v1.0:data/x.jsonl", Address("a/b", "v1.0", "data/x.jsonl")),
        ("hf://datasets/a/b", Address("a/b")),
        ("hf://datasets/a/b@refs%2Fconvert/x/train", Address("a/b", "refs/convert", "x/train")),
        (Path("hf://datasets/a/b@main/test.jsonl"), Address("a/b", "main", "test.jsonl")),
        ("a/b", None),
        ("hubble.jsonl", None),
    ],
)
def test_addresses(where: str | Path, address: Address | None) -> None:
    assert address_of(where) == address
    if address is not None:
        assert address_of(str(address)) == address
        assert address_of(Path(str(address))) == address


@pytest.mark.parametrize("where", ["hub:", "hub:a", "hub:a/b/c", "hub:a/b@", "hf://models/a/b", "hub:/a/b"])
def test_what_is_no_address_is_said(where: str) -> None:
    with pytest.raises(ConfigError, match="no address of a data set"):
        address_of(where)


def test_a_set_by_its_name_a_split_of_it_and_an_earlier_commit(hub: Hub, tmp_path: Path) -> None:
    first = hub.commit(SET, published(tmp_path / "first"))
    assert [each.split for each in read_tasks(f"hub:{SET}:test").tasks] == ["test"]
    assert not any("train.jsonl" in request for request in hub.requests)  # of a set of half a gigabyte
    assert [each.split for each in read_tasks(f"hub:{SET}").tasks] == ["train", "train", "test"]
    second = hub.commit(SET, published(tmp_path / "second", train=5))
    assert len(read_tasks(f"hf://datasets/{SET}/train.jsonl").tasks) == 5
    assert len(read_tasks(f"hub:{SET}@{first}:train").tasks) == 2
    assert pinned(f"hub:{SET}:test") == f"hub:{SET}@{second}:test"
    assert pinned("tasks.jsonl") == "tasks.jsonl"
    config = with_pinned_tasks(RunConfig.model_validate({"tasks": {"file": f"hf://datasets/{SET}"}}))
    assert str(config.tasks.file) == f"hub:{SET}@{second}"


def test_what_was_downloaded_needs_no_hub(hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hub.commit(SET, published(tmp_path / "set"))
    address = pinned(f"hub:{SET}:test")
    read_tasks(address)
    asked = len(hub.requests)
    assert len(read_tasks(address).tasks) == 1
    assert len(hub.requests) == asked  # a commit never changes
    monkeypatch.setattr(constants, "HF_HUB_OFFLINE", True)
    assert len(read_tasks(f"hub:{SET}:test").tasks) == 1


def test_what_the_hub_does_not_have(hub: Hub, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hub.commit(SET, published(tmp_path / "set"))
    for where in (f"hub:{SET}@nowhere", "hub:nobody/nothing"):
        with pytest.raises(TaskFileError) as raised:
            read_tasks(where)
        assert where in raised.value.message
        assert "HF_TOKEN" in raised.value.hint
    with pytest.raises(TaskFileError, match="holds no file of tasks"):
        read_tasks(f"hub:{SET}:validation")
    hub.private.add(SET)
    with pytest.raises(TaskFileError):
        read_tasks(f"hub:{SET}")
    monkeypatch.setenv("HF_TOKEN", hub.token)
    assert len(read_tasks(f"hub:{SET}").tasks) == 3


def test_without_the_library_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(ConfigError) as raised:
        read_tasks(f"hub:{SET}")
    assert raised.value.hint == "pip install 'webgym-rl[hub]'"


def test_a_benchmark_and_its_companion_are_read_from_the_hub(hub: Hub) -> None:
    record = (
        b'{"web_name": "Maps", "id": "Maps--0", "ques": "Where is it?", "web": "https://maps.example/"}\n'
    )
    answers = b'{"Maps": {"notice": "", "answers": [{"id": 0, "type": "golden", "ans": "There"}]}}'
    hub.commit("some/webvoyager", {"data/tasks.jsonl": record, "data/reference_answer.json": answers})
    (only,) = read_benchmark("webvoyager", "hub:some/webvoyager").tasks
    assert (only.id, only.reference_answer) == ("pae-webvoyager/Maps--0", "There")
    assert len(read_source("pae-webvoyager", "hub:some/webvoyager:data").tasks) == 1


def test_a_source_one_of_its_splits_and_none(
    hub: Hub, calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("data/deepshop").mkdir(parents=True)
    Path("data/deepshop/tasks.jsonl").write_text(native.as_lines(native.DEEPSHOP))
    without = json.dumps(native.INSTA[0] | {"instruction": None}).encode()
    files = {"data/train-0.jsonl": native.as_lines(native.INSTA).encode(), "data/test-0.jsonl": without}
    hub.commit("data-for-agents/insta-150k-v3", files)
    said = calls.printed(
        *documented(
            "webgym tasks sources --read deepshop=data/deepshop "
            "--read insta-v3=hub:data-for-agents/insta-150k-v3:train"
        ),
        "--read=insta-v3=hub:data-for-agents/insta-150k-v3",
        "--read=insta-v3=hub:nobody/nothing:train",
        code=2,
    )
    assert "tasks      2 (the paper's 150)" in said
    assert said.count("records    2\n") == 3  # a file without a task is passed over
    assert "'instruction' is empty" in said
    assert "hub:nobody/nothing:train and the hub" in said
    assert "Traceback" not in said


def test_a_set_is_pushed_with_a_card_and_read_again(
    hub: Hub, tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    published(tmp_path / "set")
    push = ("tasks", "push", tmp_path / "set", "--to", "hub:me/mine", "--licence", "cc-by-4.0")
    calls.printed(*push, code=2)  # nobody is logged in
    monkeypatch.setenv("HF_TOKEN", hub.token)
    said = calls.printed(*push)
    assert f"pushed to hub:me/mine@{hub.branches['me/mine']['main']}" in said
    assert "me/mine" in hub.private
    card = hub.files("me/mine")["README.md"].decode()
    metadata = yaml.safe_load(card.split("---")[1])
    assert metadata["license"] == "cc-by-4.0"
    assert metadata["configs"][0]["data_files"] == [
        {"split": "test", "path": "test.jsonl"},
        {"split": "train", "path": "train.jsonl"},
    ]
    assert "webgym rollout --tasks hub:me/mine\n" in card
    assert read_tasks("hub:me/mine").tasks == read_tasks(tmp_path / "set").tasks
    # Again, on a branch, and without splits: what the new set does not have is gone.
    bare = [replace(each, split=None) for each in read_tasks(tmp_path / "set").tasks]
    write_tasks(tmp_path / "bare.jsonl", bare)
    calls.printed("tasks", "push", tmp_path / "bare.jsonl", "--to", "me/mine@next", "--public")
    assert {*hub.files("me/mine", "next")} == {".gitattributes", "README.md", "tasks.jsonl"}
    assert "train.jsonl" in hub.files("me/mine")
    assert [each.split for each in read_tasks("hub:me/mine@next").tasks] == [None] * 3


def test_what_is_published_encrypted_is_not_pushed(
    hub: Hub, tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HF_TOKEN", hub.token)
    write_tasks(tmp_path / "tasks.jsonl", [task("a/1"), task("a/2", flags=(ENCRYPTED_SOURCE,))])
    said = calls.printed("tasks", "push", tmp_path / "tasks.jsonl", "--to", "hub:me/mine", code=2)
    assert "1 of 2 tasks are of a source that is published encrypted" in said
    assert not hub.commits
    push = ("tasks", "push", tmp_path / "tasks.jsonl", "--to", "hub:me/mine:test")
    assert "is no data set on the hub" in calls.printed(*push, code=2)


def test_an_export_is_pushed(hub: Hub, tmp_path: Path, calls: Calls, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HF_TOKEN", hub.token)
    hub.commit(SET, published(tmp_path / "set"))
    export = ("export", f"hub:{SET}:test", "--split", "test", "--out", tmp_path / "out", "--push", "me/tests")
    calls.printed(*export)
    assert {*hub.files("me/tests")} == {".gitattributes", "README.md", "tasks.parquet"}
    assert len(read_tasks("hub:me/tests").tasks) == 1


def test_the_hubs_own_variables_say_where_it_is(hub: Hub, tmp_path: Path) -> None:
    hub.commit(SET, published(tmp_path / "set"))
    environment = {"HF_ENDPOINT": hub.url, "HF_HOME": str(tmp_path / "home"), "HF_HUB_OFFLINE": "0"}
    command = webgym("tasks", "show", f"hub:{SET}:test")
    done = subprocess.run(
        command, env=os.environ | environment, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 1
