"""Sources through the library ``datasets``, over a dataset in a folder: the hub itself is out of reach."""

from __future__ import annotations

import json
import sys
from datetime import date
from pathlib import Path

import pytest
from tests.conftest import Calls
from tests.documented import documented
from tests.tasks.sources import native

from webgym.core.errors import ConfigError
from webgym.tasks.sources import read_source

TODAY = date(2026, 1, 15)


def test_without_the_library_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "datasets", None)
    with pytest.raises(ConfigError) as raised:
        read_source("insta-v3", "hub:data-for-agents/insta-150k-v3:train", today=TODAY)
    assert raised.value.hint == "pip install 'webgym-rl[hub]'"


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dataset")
    (folder / "train.jsonl").write_text(native.as_lines(native.INSTA))
    (folder / "test.jsonl").write_text(json.dumps(native.INSTA[0] | {"instruction": None}) + "\n")
    return folder


def test_a_dataset_one_of_its_splits_and_none(
    dataset: Path, calls: Calls, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("data/deepshop").mkdir(parents=True)
    Path("data/deepshop/tasks.jsonl").write_text(native.as_lines(native.DEEPSHOP))
    Path("data-for-agents").mkdir()
    Path("data-for-agents/insta-150k-v3").symlink_to(dataset)  # as if it were the hub's
    code, said = calls.run(
        *documented(
            "webgym tasks sources --read deepshop=data/deepshop "
            "--read insta-v3=hub:data-for-agents/insta-150k-v3:train"
        ),
        f"--read=insta-v3=hub:{dataset}",
        "--read=insta-v3=hub:nobody/nothing:train",
        HF_HOME=str(tmp_path / "cache"),
        HF_HUB_OFFLINE="1",
    )
    assert "tasks      2 (the paper's 150)" in said
    assert "records    3" in said
    assert f"hub:{dataset}:test, row 1: 'instruction' is empty" in said
    assert "records    2" in said
    assert code == 2
    assert "the data set 'nobody/nothing' cannot be loaded from the hub" in said
    assert "give a downloaded folder" in said
    assert "Traceback" not in said
