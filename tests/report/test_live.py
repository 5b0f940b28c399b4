"""What `webgym view` answers over HTTP."""

from __future__ import annotations

import asyncio
import re
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from tests.report.conftest import asking, ends_on_interrupt, view_command

from webgym.core.errors import ConfigError, RunFolderError
from webgym.report.config import ViewConfig
from webgym.report.live import serve_view, view_app
from webgym.store.runs import RunReader


@pytest.fixture
async def client(run_folder: Path) -> AsyncIterator[httpx.AsyncClient]:
    async with asking(view_app(run_folder)) as client:
        yield client


async def test_the_page_forbids_foreign_scripts(client: httpx.AsyncClient) -> None:
    reply = await client.get("/")
    assert reply.status_code == 200
    policy = reply.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'sha256-" in policy
    assert "frame-ancestors 'none'" in policy
    assert reply.headers["x-frame-options"] == "DENY"
    assert '{"count":12,' in reply.text


async def test_news_are_told_once(client: httpx.AsyncClient) -> None:
    news = (await client.get("/api/news", params={"known": 11})).json()
    assert news["count"] == 12
    assert news["options"]["level"] == ["easy", "medium", "hard"]
    assert "Success rate" in news["overview"]
    assert re.search(r"Websites that blocked the agent, by number of attempts: \S+ \(1\)\.", news["overview"])
    now = {"known": 12, "version": news["version"], "whole": "true"}
    nothing = (await client.get("/api/news", params=now)).json()
    assert (nothing["whole"], nothing["overview"]) == (True, "")
    for known in ("-1", "9" * 5_000):
        assert (await client.get("/api/news", params={"known": known})).status_code == 400


async def test_a_trajectory_by_its_id(client: httpx.AsyncClient, run_folder: Path) -> None:
    for attempt_id in RunReader(run_folder).attempts:
        reply = await client.get("/api/trajectory", params={"id": attempt_id})
        assert reply.json()["id"] == attempt_id
    assert (await client.get("/api/trajectory", params={"id": "none"})).status_code == 404


async def test_pictures_are_those_of_the_store_and_nothing_else(
    client: httpx.AsyncClient, run_folder: Path
) -> None:
    reader = RunReader(run_folder)
    name = next(reader.trajectories()).episode.steps[0].observation.screenshot
    reply = await client.get(f"/screenshots/{name[:2]}/{name}.png")
    assert reply.content == reader.image(name)
    assert reply.headers["content-type"] == "image/png"
    assert "immutable" in reply.headers["cache-control"]
    for other in ("0" * 64, "..%2f..%2fconfig", "%2e%2e%2fconfig", name.upper(), name + "0"):
        assert (await client.get(f"/screenshots/{name[:2]}/{other}.png")).status_code == 404
    for path in ("/config.yaml", "/tasks.jsonl", "/screenshots/../tasks.jsonl", "/%2e%2e/tasks.jsonl"):
        assert (await client.get(path)).status_code == 404


async def test_a_name_that_is_not_ours_is_refused(client: httpx.AsyncClient) -> None:
    assert (await client.get("/", headers={"host": "evil.example"})).status_code == 400
    assert (await client.get("/", headers={"host": "localhost:1234"})).status_code == 200


async def test_hidden_truth_is_not_served(client: httpx.AsyncClient) -> None:
    reply = await client.get("/api/rows")
    one = await client.get("/api/trajectory", params={"id": reply.json()["rows"][0]["id"]})
    assert "truth" not in one.json()["task"]


async def test_a_record_that_changed_is_an_error_not_a_page(run_folder: Path, tmp_path: Path) -> None:
    run = shutil.copytree(run_folder, tmp_path / "run")
    async with asking(view_app(run)) as client:
        row = (await client.get("/api/rows")).json()["rows"][0]
        shard = run / "trajectories/00000.jsonl"
        shard.write_bytes(shard.read_bytes().replace(b"Memory", b"memory", 1))
        reply = await client.get("/api/trajectory", params={"id": row["id"]})
        assert reply.status_code == 500
        assert "checksum" in reply.text


def test_a_folder_that_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(RunFolderError):
        view_app(tmp_path)


async def test_a_port_that_is_taken(run_folder: Path) -> None:
    taken = await asyncio.start_server(lambda *_: None, "127.0.0.1", 0)
    async with taken:
        port = taken.sockets[0].getsockname()[1]
        with pytest.raises(ConfigError, match=str(port)):
            await serve_view(run_folder, ViewConfig(port=port), lambda _: None)


async def test_the_command_prints_the_address_and_ends_on_interrupt(run_folder: Path) -> None:
    process, address = await view_command(run_folder)
    async with httpx.AsyncClient(timeout=60) as client:
        reply = await client.get(address)
    assert "2026-03-demo" in reply.text
    await ends_on_interrupt(process)
