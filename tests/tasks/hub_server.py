"""A stand-in of the Hugging Face hub for data sets: commits, branches, files, over real HTTP."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
from huggingface_hub import constants
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from tests.serving import serving

Files = dict[str, bytes]


class Hub:
    """Data sets by name, and what was asked.

    Attributes:
        url: of the hub.
        commits: of every data set: files by commit, in order.
        branches: of every data set: the commit of each branch.
        private: names of data sets that only :attr:`token` opens.
        requests: method and path, with the token that came along.
    """

    token = "hf_secret"

    def __init__(self, port: int) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self.commits: dict[str, dict[str, Files]] = {}
        self.branches: dict[str, dict[str, str]] = {}
        self.private: set[str] = set()
        self.requests: list[str] = []

    def commit(self, name: str, files: Files, branch: str = "main") -> str:
        """Add a commit with all these files; its id."""
        commits = self.commits.setdefault(name, {})
        sha = hashlib.sha1(repr((len(commits), sorted(files.items()))).encode()).hexdigest()
        commits[sha] = files
        self.branches.setdefault(name, {})[branch] = sha
        return sha

    def files(self, name: str, branch: str = "main") -> Files:
        """The files of a branch."""
        return self.commits[name][self.branches[name][branch]]

    def app(self) -> Starlette:
        repo = "/api/datasets/{owner}/{name}"
        routes = [
            Route("/api/repos/create", self.create, methods=["POST"]),
            Route("/api/validate-yaml", self.validate, methods=["POST"]),
            Route(repo, self.info),
            Route(repo + "/revision/{revision}", self.info),
            Route(repo + "/tree/{revision}", self.tree),
            Route(repo + "/branch/{branch}", self.branch, methods=["POST"]),
            Route(repo + "/preupload/{revision}", self.preupload, methods=["POST"]),
            Route(repo + "/commit/{revision}", self.receive, methods=["POST"]),
            Route("/datasets/{owner}/{name}/resolve/{revision}/{path:path}", self.file),
        ]
        return Starlette(routes=routes)

    def _found(self, request: Request) -> tuple[str, str, Files] | Response:
        """Name, commit and files of what a request is about, or why it gets nothing."""
        name = "{owner}/{name}".format(**request.path_params)
        token = request.headers.get("authorization", "").removeprefix("Bearer ")
        self.requests.append(f"{request.method} {request.url.path} {token}".strip())
        if name not in self.commits or (name in self.private and token != self.token):
            return Response(status_code=401, headers={"X-Error-Code": "RepoNotFound"})
        revision = request.path_params.get("revision", "main")
        sha = self.branches[name].get(revision, revision)
        if sha not in self.commits[name]:
            return Response(status_code=404, headers={"X-Error-Code": "RevisionNotFound"})
        return name, sha, self.commits[name][sha]

    async def info(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        name, sha, files = found
        siblings = [{"rfilename": path} for path in files]
        return JSONResponse({"id": name, "sha": sha, "private": name in self.private, "siblings": siblings})

    async def tree(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        return JSONResponse(
            [
                {"type": "file", "path": path, "size": len(data), "oid": _oid(data)}
                for path, data in found[2].items()
            ]
        )

    async def file(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        _, sha, files = found
        data = files.get(request.path_params["path"])
        if data is None:
            return Response(status_code=404, headers={"X-Error-Code": "EntryNotFound"})
        return Response(data, headers={"X-Repo-Commit": sha, "ETag": f'"{_oid(data)}"'})

    async def create(self, request: Request) -> Response:
        asked: dict[str, Any] = await request.json()
        name = f"{asked.get('organization') or 'me'}/{asked['name']}"
        if request.headers.get("authorization") != f"Bearer {self.token}":
            return JSONResponse({"error": "log in"}, 401)
        if name in self.commits:
            return JSONResponse({"error": "it is there", "url": f"{self.url}/datasets/{name}"}, 409)
        assert asked["type"] == "dataset"
        if asked.get("private") or asked.get("visibility") == "private":
            self.private.add(name)
        self.commit(name, {".gitattributes": b""})
        return JSONResponse({"url": f"{self.url}/datasets/{name}", "name": name, "id": name})

    async def validate(self, request: Request) -> Response:
        """Of a card."""
        asked = await request.json()
        assert asked["repoType"] == "dataset"
        return JSONResponse({"errors": [], "warnings": []})

    async def branch(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        name, sha, _ = found
        branch = request.path_params["branch"]
        if branch in self.branches[name]:
            return JSONResponse({"error": "it is there"}, 409)
        self.branches[name][branch] = sha
        return JSONResponse({})

    async def preupload(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        asked = (await request.json())["files"]
        return JSONResponse(
            {
                "files": [
                    {"path": each["path"], "uploadMode": "regular", "shouldIgnore": False} for each in asked
                ]
            }
        )

    async def receive(self, request: Request) -> Response:
        found = self._found(request)
        if isinstance(found, Response):
            return found
        name, _, before = found
        files = dict(before)
        for line in (await request.body()).splitlines():
            operation = json.loads(line)
            value = operation["value"]
            if operation["key"] == "file":
                files[value["path"]] = base64.b64decode(value["content"])
            elif operation["key"] == "deletedFile":
                del files[value["path"]]
        sha = self.commit(name, files, request.path_params["revision"])
        return JSONResponse({"commitUrl": f"{self.url}/datasets/{name}/commit/{sha}", "commitOid": sha})


def _oid(data: bytes) -> str:
    return hashlib.sha1(b"blob %d\0" % len(data) + data).hexdigest()


def use(hub: Hub, cache: Path, patch: pytest.MonkeyPatch) -> None:
    """Have the hub's library in this process use this hub and this cache."""
    template = hub.url + "/{repo_id}/resolve/{revision}/{filename}"
    patch.setattr(constants, "ENDPOINT", hub.url)
    patch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
    patch.setattr(constants, "HF_HUB_OFFLINE", False)
    patch.setattr(constants, "HF_HUB_CACHE", str(cache))


@asynccontextmanager
async def serve_hub() -> AsyncIterator[Hub]:
    """A hub without data sets."""
    async with serving(Hub, Hub.app) as hub:
        yield hub
