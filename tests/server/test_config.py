"""Every limit is read by something, and refuses what makes no sense."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from pydantic import BaseModel, ValidationError

import webgym.browser
import webgym.server
from webgym.browser import EgressConfig
from webgym.server import BrowserConfig, ClientLimits, GatewayConfig, ServerConfig
from webgym.server.compat import CompatConfig
from webgym.server.operations import QUEUES

SOURCE = "".join(
    path.read_text()
    for room in (webgym.browser, webgym.server)
    for path in Path(room.__path__[0]).rglob("*.py")
)


@pytest.mark.parametrize(
    "config", [BrowserConfig, EgressConfig, ServerConfig, GatewayConfig, ClientLimits, CompatConfig]
)
def test_every_key_is_read(config: type[BaseModel]) -> None:
    for name in config.model_fields.keys() - set(QUEUES):  # those are read by their names
        assert re.search(rf"(config|limits|browser)\.{name}\b", SOURCE), f"{config.__name__}.{name}"


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
