"""A hub that does not answer costs one short wait, and what was downloaded before is loaded."""

from __future__ import annotations

import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("torch")

from huggingface_hub import constants
from tests.inference.tiny import write_tiny_model

from webgym.core.errors import ConfigError
from webgym.inference import model
from webgym.inference.model import load_model, load_renderer


@pytest.fixture
def silent_hub(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[socket.socket]:
    """Takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"http://127.0.0.1:{server.getsockname()[1]}"
        monkeypatch.setattr(constants, "ENDPOINT", address)
        monkeypatch.setattr(
            constants, "HUGGINGFACE_CO_URL_TEMPLATE", address + "/{repo_id}/resolve/{revision}/{filename}"
        )
        monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
        monkeypatch.setattr(constants, "HF_HUB_CACHE", str(tmp_path / "cache"))
        monkeypatch.setattr(constants, "HF_HUB_ETAG_TIMEOUT", 1)
        monkeypatch.setattr(model, "HUB_SECONDS", 0.2)
        yield server


def connections(server: socket.socket) -> int:
    server.setblocking(False)
    found = 0
    while True:
        try:
            server.accept()[0].close()
        except BlockingIOError:
            return found
        found += 1


def test_a_model_that_is_not_there_is_told_after_one_question(silent_hub: socket.socket) -> None:
    with pytest.raises(
        ConfigError, match=r"was never downloaded, and http://127.0.0.1:\d+ cannot be reached"
    ):
        load_renderer("nobody/nothing")
    assert connections(silent_hub) == 1


def test_a_model_that_was_downloaded_is_loaded_all_the_same(
    silent_hub: socket.socket, tmp_path: Path
) -> None:
    held, revision = tmp_path / "cache" / "models--some--tiny", "0" * 40
    shutil.copytree(write_tiny_model(tmp_path / "made"), held / "snapshots" / revision)
    (held / "refs").mkdir()
    (held / "refs" / "main").write_text(revision)
    assert load_model("some/tiny").tokenizer.chat_template
    assert connections(silent_hub) == 2  # for the tokenizer and for the weights
