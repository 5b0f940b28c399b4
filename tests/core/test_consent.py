"""What settings of others would have this machine do is confirmed once per folder."""

import io
import sys
from pathlib import Path

import pytest
import yaml

import webgym
from webgym.core.consent import ALLOW, confirm, remember
from webgym.core.errors import ConfigError
from webgym.core.settings import presets, read_yaml
from webgym.store.runs import RunReader, RunWriter

CODE = {"judge": {"name": "mine:judge"}}
CLAIMS = {
    "runs the code mine:judge": CODE,
    "runs the code ours.loss:mean": {"learn": {"objective": "ours.loss:mean"}},
    "runs the code my-file:Judge.strict": {"judge": ["rubric", "my-file:Judge.strict"]},
    "runs the code webgym.study.model:x": {"learn": {"objective": {"name": "webgym.study.model:x"}}},
    "starts a program with executable /opt/chrome": {"browser": {"executable": "/opt/chrome"}},
    "starts a program with env {'LD_PRELOAD': 'x.so'}": {"vllm": {"env": {"LD_PRELOAD": "x.so"}}},
    "sends SECRET to http://far.example/v1": {
        "policy": {"chat": {"base_url": "http://far.example/v1", "api_key_env": "SECRET"}}
    },
    "sends the credentials in $SECRET": {
        "upstream": {"far": {"address": "http://far.example:1", "credentials": "$SECRET"}}
    },
    "sends WEBGYM_API_KEY to http://far.example/v1": {"models": [{"base_url": "http://far.example/v1"}]},
}


@pytest.fixture(autouse=True)
def _stranger(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(ALLOW, raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    for name in ("SECRET", "WEBGYM_API_KEY"):
        monkeypatch.setenv(name, "a key")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def answering(monkeypatch: pytest.MonkeyPatch, answer: str) -> Terminal:
    said = Terminal()
    monkeypatch.setattr(sys, "stdin", Terminal(answer))
    monkeypatch.setattr(sys, "stderr", said)
    return said


@pytest.mark.parametrize(("claim", "settings"), CLAIMS.items())
def test_what_a_file_of_others_does_is_refused_without_a_terminal(
    tmp_path: Path, claim: str, settings: dict[str, object]
) -> None:
    file = tmp_path / "theirs.yaml"
    file.write_text(yaml.safe_dump(settings))
    with pytest.raises(ConfigError) as refused:
        read_yaml(file, hint="")
    assert claim in refused.value.message
    assert ALLOW in refused.value.hint


def test_it_is_asked_once_per_folder_and_value(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = answering(monkeypatch, "yes\n")
    confirm(CODE, tmp_path / "a" / "config.yaml")
    assert "runs the code mine:judge" in said.getvalue()
    said = answering(monkeypatch, "")
    confirm(CODE, tmp_path / "a" / "config.yaml")
    assert not said.getvalue(), "it is known"
    for settings, folder in ((CODE, "b"), ({"judge": {"name": "other:judge"}}, "a")):
        with pytest.raises(ConfigError, match="not confirmed"):
            confirm(settings, tmp_path / folder / "config.yaml")


@pytest.mark.parametrize(
    "settings",
    [
        {"judge": {"name": "rubric"}, "server": {"url": "http://localhost:8080"}},
        {"policy": {"chat": {"base_url": "http://far.example", "api_key_env": "NOT_SET", "model": "a:b"}}},
        {"browser": {"executable": None}, "vllm": {"env": {}, "extra_args": []}},
    ],
)
def test_nothing_is_asked_about_settings_that_only_set(tmp_path: Path, settings: dict[str, object]) -> None:
    confirm(settings, tmp_path / "config.yaml")


def test_settings_of_the_package_and_those_that_one_has_read_are_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = Path(webgym.__file__).parent / "study" / "study.yaml"  # whose controls are code of the package
    for path in {study, *presets().values()}:
        read_yaml(path, hint="")
    monkeypatch.setenv(ALLOW, "1")
    confirm(CODE, tmp_path / "config.yaml")


async def test_a_run_that_was_written_here_needs_no_confirmation(tmp_path: Path) -> None:
    run = tmp_path / "run"
    async with await RunWriter.create(run, CODE, []):
        pass
    confirm(RunReader(run).config, run / "config.yaml")
    with pytest.raises(ConfigError):
        confirm(RunReader(run).config, tmp_path / "copied" / "config.yaml")


def test_a_home_that_cannot_be_written_to_asks_again(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file in the way")
    remember(CODE, tmp_path / "config.yaml")
    with pytest.raises(ConfigError):
        confirm(CODE, tmp_path / "config.yaml")
