"""Every limit is read by something, and refuses what makes no sense."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer.main
from pydantic import BaseModel, ValidationError

import webgym.browser
import webgym.compat
import webgym.server
from webgym import cli
from webgym.browser.config import BrowserConfig
from webgym.browser.egress.config import EgressConfig
from webgym.cli import serve
from webgym.server.config import ClientLimits, GatewayConfig, RayConfig, ServerConfig
from webgym.server.operations import QUEUES

ROOT = Path(__file__).resolve().parents[2]
UNITS = {"KiB": 2**10, "MiB": 2**20, " h": 3600}
SOURCE = "".join(
    path.read_text()
    for room in (webgym.browser, webgym.compat, webgym.server)
    for path in Path(room.__path__[0]).rglob("*.py")
)


@pytest.mark.parametrize(
    "config",
    [BrowserConfig, EgressConfig, ServerConfig, GatewayConfig, RayConfig, ClientLimits],
)
def test_every_key_is_read(config: type[BaseModel]) -> None:
    for name in config.model_fields.keys() - set(QUEUES):  # those are read by their names
        assert re.search(rf"(config|limits|browser|cluster)\.{name}\b", SOURCE), f"{config.__name__}.{name}"


@pytest.mark.parametrize(
    "wrong",
    [
        {"port": 70_000},
        {"slots": 0},
        {"token": "short"},
        {"unknown": 1},
        {"browser": {"sandbox": "perhaps"}},
        {"browser": {"egress": {"allow": ["MAP * 127.0.0.1"]}}},
    ],
)
def test_what_makes_no_sense_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        ServerConfig.model_validate(wrong)


def test_the_door_is_shut_unless_it_is_opened() -> None:
    """Nothing but this machine, and no token that anybody knows."""
    group: Any = typer.main.get_command(cli.build("serve"))
    told = group.commands["serve"].make_context("serve", []).params
    server = ServerConfig.model_validate(serve.SERVER.given(told))
    gateway = GatewayConfig.model_validate(serve.GATEWAY.given(told))
    for host in (ServerConfig().host, GatewayConfig().worker_host, server.host, gateway.worker_host):
        assert host == "127.0.0.1"
    assert ServerConfig().token is None
    assert told["token_file"] is None


def test_the_document_names_the_settings_and_their_defaults() -> None:
    lines = (ROOT / "docs" / "safety.md").read_text().splitlines()
    named = [line for line in lines if re.search(r"\| `[a-z_.]+`(, `[a-z_.]+`)* \|$", line)]
    assert len(named) > 10
    for line in named:
        _, _, said, settings, _ = line.split("|")
        for setting, told in zip(re.findall(r"`(.+?)`", settings), said.split(", "), strict=False):
            value: Any = ServerConfig()
            for part in setting.split("."):
                value = getattr(value, part)
            numbers = re.findall(r"[\d,]+", told)
            unit = next((factor for word, factor in UNITS.items() if word in told), 1)
            if numbers and len(numbers) == 1:
                assert int(numbers[0].replace(",", "")) * unit == value, setting
