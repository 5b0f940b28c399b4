"""What a website keeps in a browser: cookies, local storage, IndexedDB, in Playwright's format for them.

Such a file is a log-in: treat it like a password. No record, prompt or log holds any of it.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Literal

import msgspec

from webgym.core.errors import ConfigError
from webgym.core.identity import origin_of

SameSite = Literal["Strict", "Lax", "None"]


class StoredCookie(msgspec.Struct, frozen=True, rename="camel", omit_defaults=True):
    """A cookie with all of its attributes.

    Attributes:
        name, value: what is sent.
        domain: host that it is sent to; a leading dot includes subdomains.
        path: prefix of the URL paths that it is sent to.
        expires: seconds since 1970; -1 until the browser is closed.
        http_only: whether scripts cannot read it.
        secure: whether it is only sent by https.
        same_site: to which websites' requests it is added.
        partition_key: the website in whose pages alone it exists.
    """

    name: str
    value: str
    domain: str
    path: str = "/"
    expires: float = -1
    http_only: bool = False
    secure: bool = False
    same_site: SameSite = "Lax"
    partition_key: str | None = None

    @property
    def params(self) -> dict[str, Any]:
        """The cookie as ``Network.setCookies`` takes it."""
        given: dict[str, Any] = msgspec.to_builtins(self)
        given |= {"path": self.path, "secure": self.secure, "sameSite": self.same_site}
        if self.partition_key is not None:
            given["partitionKey"] = {"topLevelSite": self.partition_key, "hasCrossSiteAncestor": False}
        if self.name.lower().startswith("__host-"):  # which no domain may be set for
            given["url"] = f"https://{given.pop('domain').lstrip('.')}/"
        return given


class StoredItem(msgspec.Struct, frozen=True):
    """An entry of local storage."""

    name: str
    value: str


class StoredOrigin(
    msgspec.Struct, frozen=True, rename={"local_storage": "localStorage", "databases": "indexedDB"}
):
    """What an origin keeps.

    Attributes:
        origin: scheme, host and port.
        local_storage: its local storage.
        databases: its databases: name, version and stores, with records whose keys and values are JSON.

    Raises:
        ValueError: the origin is none.
    """

    origin: str
    local_storage: tuple[StoredItem, ...] = ()
    databases: tuple[dict[str, Any], ...] = ()

    def __post_init__(self) -> None:
        origin_of(self.origin)


class StorageState(msgspec.Struct, frozen=True):
    """The state of a browser context. As text it is its size alone: what it holds is secret."""

    cookies: tuple[StoredCookie, ...] = ()
    origins: tuple[StoredOrigin, ...] = ()

    def __str__(self) -> str:
        return f"{len(self.cookies)} cookies, storage of {len(self.origins)} origins"


def read_storage(path: Path) -> StorageState:
    """A file of Playwright's ``storageState``, or of ``webgym login``.

    Raises:
        ConfigError: it cannot be read. What it holds is not quoted.
    """
    try:
        return msgspec.json.decode(path.read_bytes(), type=StorageState)
    except OSError as error:
        raise ConfigError(f"cannot read {path}: {error.strerror}") from error
    except msgspec.ValidationError as error:  # says where, and which type was expected
        raise ConfigError(f"{path} is no storage state: {error}", hint="webgym login saves one") from error
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is no storage state", hint="webgym login saves one") from error


def write_storage(path: Path, state: StorageState) -> None:
    """Write a state to a file that only its owner can read, whole or not at all.

    Raises:
        ConfigError: it cannot be written.
    """
    part = path.with_name(f".{path.name}.part")
    try:
        part.unlink(missing_ok=True)
        with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(state)) + b"\n")
        part.replace(path)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error
