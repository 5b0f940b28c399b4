"""Batches: the same requests as files that an endpoint answers within a day, often at half the price.

Run a job with a :class:`Collector` in place of the client: requests that are not in the cache are recorded.
Write the recorded requests to files, submit them, import the results into the cache, and run the job again;
it continues as far as the replies allow. Files follow the OpenAI batch API, which others have adopted.
"""

from __future__ import annotations

import asyncio
import hashlib
import os
import sqlite3
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, Final

import msgspec

from webgym.core.errors import LLMBadReply, NotCached, UsageError
from webgym.llm.cache import CachedReply, ReplyCache, insert
from webgym.llm.completion import Completion, NoCompletion, first_line, read_completion
from webgym.llm.config import ChatConfig, Sampling
from webgym.llm.prices import Prices
from webgym.llm.request import Formats, Labelled, Request
from webgym.llm.tokens import count_messages, count_text

_REQUESTS: Final = 50_000
_FILE_BYTES: Final = 200_000_000
"""Most requests in a file, and its largest size, in the OpenAI batch API."""
_URL: Final = "/v1/chat/completions"
_LINES_AT_ONCE: Final = 500
_KEY_DIGITS: Final = 64


# --- recording requests ---------------------------------------------------------------------------------


class Collector:
    """Answers requests from the cache, and records the others. It sends nothing.

    Args:
        config: as for the client that it replaces: URL, model and sampling are part of the requests.
        cache: an open cache.

    Attributes:
        config: as given.
        formats: formats that the endpoint is known to accept as ``response_format``. A batch does not find
            that out: send one request through a client first.
        noted: number of requests that were recorded, repeated ones counted every time.
    """

    def __init__(self, config: ChatConfig, cache: ReplyCache) -> None:
        self.config = config
        self.formats = Formats(config.base_url, config.model, cache)
        self.noted = 0
        self._cache = cache

    @property
    def sampling(self) -> Sampling:
        """Default sampling parameters of requests."""
        return self.config.sampling

    def labelled(self, purpose: str) -> Labelled:
        """This collector, its calls counted for a purpose."""
        return Labelled(self.complete, purpose, self.sampling, self.formats)

    async def complete(
        self, messages: Sequence[Mapping[str, Any]], sampling: Sampling | None = None, *, purpose: str = ""
    ) -> Completion:
        """The cached reply to these messages.

        Raises:
            NotCached: there is none; the request was recorded on disk.
            CacheError: the cache cannot be read or written.
        """
        model = self.config.model
        request = Request.of(self.config, messages, sampling)
        stored = await self._cache.get(request.key)
        if stored is None:
            body = {name: value for name, value in request.body.items() if name != "stream"}
            row = [request.key, purpose, model, msgspec.json.encode(body)]
            noting = "insert or ignore into noted (key, purpose, model, body) values (?, ?, ?, ?)"
            await self._cache.write(lambda connection: connection.execute(noting, row))
            self.noted += 1
            raise NotCached(f"the reply of {model} is not in the cache yet; the request was recorded")
        self._cache.hit(purpose, model)
        try:
            return read_completion(stored.body, model=model, seconds=stored.seconds, cached=True)
        except NoCompletion as error:
            raise LLMBadReply(f"the cached reply is {error}") from error


# --- writing --------------------------------------------------------------------------------------------


class BatchFile(msgspec.Struct, frozen=True):
    """A file of requests.

    Attributes:
        path: its path; the name contains a hash of its content.
        model: model of all of its requests: endpoints accept only one per file.
        requests: number of requests.
        bytes: size of the file.
        prompt_tokens: estimated tokens of all prompts together.
    """

    path: Path
    model: str
    requests: int
    bytes: int
    prompt_tokens: int

    def __str__(self) -> str:
        return f"{self.path}  {self.requests:,} requests, about {self.prompt_tokens:,} prompt tokens"


async def write_batches(cache: ReplyCache, folder: Path, *, again: bool = False) -> list[BatchFile]:
    """Write the recorded requests that are not answered yet to files.

    Args:
        cache: an open cache.
        folder: folder for the files; created if it does not exist.
        again: whether to include requests that were written to files before, for batches that were lost.

    Raises:
        UsageError: the folder cannot be written to.
        CacheError: the cache cannot be read or written.
    """

    def write(connection: sqlite3.Connection) -> tuple[list[BatchFile], list[bytes]]:
        folder.mkdir(parents=True, exist_ok=True)
        writer = _Writer(folder)
        rows = connection.execute(
            "select key, model, body from noted where written <= ?"
            " and not exists (select 1 from replies where replies.key = noted.key) order by model, rowid",
            [int(again)],
        )
        keys = []
        for key, model, body in rows:
            writer.add(key, model, body)
            keys.append(key)
        writer.finish()
        return writer.files, keys

    try:
        files, keys = await cache.read(write)
    except OSError as error:
        raise UsageError(f"batches cannot be written to {folder}: {error.strerror}") from error
    # If the process is killed before this, the next call writes the same files under the same names.
    await cache.write(
        lambda connection: (
            connection.executemany(
                "update noted set written = 1 where key = ?", ([key] for key in keys)
            ).rowcount
        )
    )
    return files


class _Writer:
    """Writes one file after the other. A file gets its name when it is complete."""

    def __init__(self, folder: Path) -> None:
        self.files: list[BatchFile] = []
        self._temporary = folder / "batch.part"
        self._file: BinaryIO | None = None
        self._model = ""
        self._begin()

    def _begin(self) -> None:
        self._hash = hashlib.sha256()
        self._requests = self._bytes = self._tokens = 0

    def add(self, key: bytes, model: str, body: bytes) -> None:
        """Write a request, to a new file if the current one is full or has another model."""
        head = {"custom_id": key.hex(), "method": "POST", "url": _URL}
        line = msgspec.json.encode(head | {"body": msgspec.Raw(body)}) + b"\n"
        if self._file is not None and (
            model != self._model or self._requests == _REQUESTS or self._bytes + len(line) > _FILE_BYTES
        ):
            self.finish()
        if self._file is None:
            self._file = self._temporary.open("wb")
            self._model = model
            self._begin()
        self._file.write(line)
        self._hash.update(line)
        self._requests += 1
        self._bytes += len(line)
        self._tokens += count_messages(msgspec.json.decode(body)["messages"])

    def finish(self) -> None:
        """Complete the current file, and give it its name."""
        if self._file is None:
            return
        with self._file as file:
            file.flush()
            os.fsync(file.fileno())
        self._file = None
        path = self._temporary.with_name(f"batch-{self._hash.hexdigest()[:16]}.jsonl")
        self._temporary.replace(path)
        self.files.append(BatchFile(path, self._model, self._requests, self._bytes, self._tokens))


# --- importing results ----------------------------------------------------------------------------------


class FailedLine(msgspec.Struct, frozen=True):
    """A line of a result file without a reply.

    Attributes:
        path: the file.
        line: number of the line, from 1.
        reason: why it contains no reply.
    """

    path: Path
    line: int
    reason: str

    def __str__(self) -> str:
        return f"{self.path}:{self.line}: {self.reason}"


class Imported(msgspec.Struct):
    """The result of importing result files.

    Attributes:
        stored: number of new replies.
        known: number of replies that were in the cache already.
        unanswered: all other lines. Recorded requests among them will be part of the next batch.
    """

    stored: int = 0
    known: int = 0
    unanswered: list[FailedLine] = []

    def __str__(self) -> str:
        unanswered = len(self.unanswered)
        return f"{self.stored} replies stored, {self.known} stored before, {unanswered} not answered"


class _Response(msgspec.Struct):
    status_code: int
    body: msgspec.Raw = msgspec.Raw(b"null")


class _Line(msgspec.Struct):
    custom_id: str
    id: str = ""
    response: _Response | None = None
    error: Any = None


async def import_results(cache: ReplyCache, paths: Iterable[Path], prices: Prices | None = None) -> Imported:
    """Import result files into the cache: of replies or of errors, in any order, complete or partial.

    A file may be imported twice: its calls are counted once.

    Args:
        cache: an open cache.
        paths: the files.
        prices: prices of tokens, reduced by their ``batch`` share.

    Raises:
        UsageError: a file cannot be read.
        CacheError: the cache cannot be written.
    """
    imported = Imported()
    for path in paths:
        try:
            with await asyncio.to_thread(path.open, "rb") as file:
                lines = enumerate(file, start=1)
                while chunk := await asyncio.to_thread(
                    lambda rest: list(islice(rest, _LINES_AT_ONCE)), lines
                ):
                    await _import_chunk(cache, path, chunk, prices or Prices(), imported)
        except OSError as error:
            raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    return imported


async def _import_chunk(
    cache: ReplyCache, path: Path, chunk: list[tuple[int, bytes]], prices: Prices, imported: Imported
) -> None:
    def job(connection: sqlite3.Connection) -> list[tuple[int, bool | str]]:
        return [
            (number, _import_line(connection, data, prices))
            for number, data in chunk
            if data.strip(b"\xef\xbb\xbf \t\r\n")
        ]

    for number, outcome in await cache.write(job):
        if isinstance(outcome, str):
            imported.unanswered.append(FailedLine(path, number, outcome))
        elif outcome:
            imported.stored += 1
        else:
            imported.known += 1


def _import_line(connection: sqlite3.Connection, data: bytes, prices: Prices) -> bool | str:
    """Whether the line's reply is new; or why it contains none."""
    try:
        line = msgspec.json.decode(data.removeprefix(b"\xef\xbb\xbf"), type=_Line)
        key = bytes.fromhex(line.custom_id) if len(line.custom_id) == _KEY_DIGITS else b""
    except (ValueError, RecursionError) as error:
        return f"not a result of a batch: {first_line(str(error))}"
    if not key:
        return f"no recorded request has the custom_id {line.custom_id[:80]!r}"
    row = connection.execute("select purpose, model, body from noted where key = ?", [key]).fetchone()
    body = b"" if line.response is None else bytes(line.response.body)
    try:
        if line.response is None or line.response.status_code != 200:
            raise NoCompletion(_why(line))
        completion = read_completion(body, model="", seconds=0.0)
    except (NoCompletion, ValueError, RecursionError) as error:
        connection.execute("update noted set written = 0 where key = ?", [key])
        return str(error)
    purpose, model, request_body = row or ("batch", completion.model, b"")
    call = prices.call(
        purpose, model, completion, lambda: count_text(request_body.decode()), batch=line.id or line.custom_id
    )
    is_new = insert(connection, key, CachedReply(body, 0.0), call)
    connection.execute("delete from noted where key = ?", [key])
    return is_new


def _why(line: _Line) -> str:
    """The endpoint's message about a request that it did not answer."""
    error = line.error
    if line.response is not None:
        body = msgspec.json.decode(line.response.body)
        error = (body.get("error") or body) if isinstance(body, dict) else body
    message = error.get("message") or error.get("code") if isinstance(error, dict) else error
    status = f" ({line.response.status_code})" if line.response is not None else ""
    return f"not answered{status}: {first_line(str(message))}"
