"""Who a browser says that it is: its user agent, languages, place and the like, as one whole.

A run's server has one (``browser.identity``); a session and a task may set single fields over it.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, TypeAlias
from urllib.parse import urlsplit
from zoneinfo import available_timezones

from pydantic import Field, ValidationError, field_validator

from webgym.core.errors import ConfigError
from webgym.core.settings import Settings, set_values

Degrees: TypeAlias = tuple[Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]]

_TAG = re.compile(r"[A-Za-z]{2,3}(-[A-Za-z0-9]{2,8})*")
"""A language tag, such as ``de-CH``."""
_HEADER = re.compile(r"[A-Za-z0-9!#$%&'*+.^_`|~-]+")
_LINE = re.compile(r"[\x20-\x7e]*")
_OWN_HEADERS = frozenset(
    {"user-agent", "accept-language", "host", "cookie", "content-length", "authorization", "connection"}
)
"""Headers that other settings make, or that go to one website alone."""


class Identity(Settings):
    """What websites are told about the browser, the same in pages, frames, workers and requests.

    Nothing here hides that a program visits them: ``navigator.webdriver`` says so unless that is set.
    """

    profile: Literal["desktop", "shell"] = "desktop"
    """``desktop``: the user agent and client hints of the installed Chromium's version and platform, as its
    headed browser sends them. ``shell``: as the executable itself says, with its name ``HeadlessChrome``."""

    user_agent: str | None = None
    """A user agent of one's own. Client hints have its Chromium version, if it names one."""

    contact: str = ""
    """Whom websites can ask about the visits, such as a URL or an e-mail address; added to the user agent."""

    languages: tuple[str, ...] = Field(default=("en-US", "en"), min_length=1)
    """Languages of the user, the preferred one first."""

    locale: str | None = None
    """How scripts write numbers and dates; by default, the preferred language."""

    time_zone: str | None = None
    """Such as ``Europe/Zurich``; by default, the machine's."""

    place: Degrees | None = None
    """Latitude and longitude that pages which ask are told; ``None`` refuses to tell them."""

    color_scheme: Literal["light", "dark"] = "light"
    """The scheme that the user prefers."""

    device_scale: float = Field(default=1.0, gt=0, le=4)
    """Pixels of the screen for each CSS pixel. Screenshots have the same size all the same."""

    headers: dict[str, str] = Field(default_factory=dict)
    """Further headers of every request, to any website."""

    credentials: dict[str, str] = Field(default_factory=dict)
    """HTTP credentials: an origin, such as ``https://staging.example.org``, and the environment variable,
    such as ``$STAGING``, that holds ``NAME:PASSWORD``. They are sent only where that origin asks for them."""

    ignore_tls_errors: tuple[str, ...] = ()
    """Host names, whose certificate may be anything; a leading dot includes subdomains."""

    webdriver: bool = True
    """Whether ``navigator.webdriver`` says that a program drives the browser."""

    @field_validator("user_agent", "contact")
    @classmethod
    def _is_a_line(cls, value: str | None) -> str | None:
        if value is not None and not _LINE.fullmatch(value):
            raise ValueError("only printable ASCII characters can be in a user agent")
        return value

    @field_validator("languages", "locale")
    @classmethod
    def _are_tags(cls, value: Any) -> Any:
        for tag in (value,) if isinstance(value, str) else value or ():
            if not _TAG.fullmatch(tag):
                raise ValueError(f"{tag!r} is no language tag, such as en-US")
        return value

    @field_validator("time_zone")
    @classmethod
    def _is_a_zone(cls, value: str | None) -> str | None:
        if value is not None and value not in available_timezones():
            raise ValueError(f"there is no time zone {value!r}, such as Europe/Zurich")
        return value

    @field_validator("headers")
    @classmethod
    def _are_headers(cls, value: dict[str, str]) -> dict[str, str]:
        for name, content in value.items():
            if not (_HEADER.fullmatch(name) and _LINE.fullmatch(content)):
                raise ValueError(f"{name!r} is no header")
            if name.lower() in _OWN_HEADERS or name.lower().startswith(("sec-", "proxy-")):
                raise ValueError(f"the header {name} cannot be set here")
        return value

    @field_validator("credentials")
    @classmethod
    def _are_variables(cls, value: dict[str, str]) -> dict[str, str]:
        for origin, variable in value.items():
            origin_of(origin)
            if not re.fullmatch(r"\$\w+", variable):
                raise ValueError("credentials name an environment variable, such as $STAGING")
        return {origin_of(origin): variable for origin, variable in value.items()}

    @property
    def label(self) -> str:
        """A short name of what websites are told: the profile, and a digest of what else is set."""
        own = self.model_dump(mode="json", exclude={"profile", "credentials"}, exclude_defaults=True)
        digest = hashlib.sha256(json.dumps(own, sort_keys=True).encode()).hexdigest()[:8]
        return f"{self.profile}-{digest}" if own else self.profile

    def over(self, fields: Mapping[str, Any]) -> Identity:
        """A copy with these fields.

        Raises:
            ValueError: one is not a field, or its value is not valid.
        """
        return Identity.model_validate(set_values(self) | dict(fields)) if fields else self


def credentials_of(identity: Identity) -> dict[str, str]:
    """``NAME:PASSWORD`` by origin, from the environment of this process.

    Raises:
        ConfigError: a variable is not set, or holds something else.
    """
    found = {}
    for origin, variable in identity.credentials.items():
        found[origin] = os.environ.get(variable[1:], "")
        if ":" not in found[origin]:
            raise ConfigError(
                f"the environment variable {variable[1:]} holds no NAME:PASSWORD for {origin}",
                hint=f"export {variable[1:]}=NAME:PASSWORD",
            )
    return found


def check_fields(fields: Mapping[str, Any]) -> None:
    """Check fields that a session or a task sets.

    Raises:
        ValueError: one is not a field, or its value is not valid. ``credentials`` is none: whoever wrote a
            task would get what any variable of this machine's environment holds.
    """
    if "credentials" in fields:
        raise ValueError("identity.credentials is a setting of a run or a server")
    try:
        Identity().over(fields)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        name = ".".join(str(part) for part in first["loc"])
        raise ValueError(f"invalid identity.{name}: {first['msg']}") from error


def origin_of(address: str) -> str:
    """The origin of an address: scheme, host, and the port unless it is the scheme's own.

    Raises:
        ValueError: it is no http or https address.
    """
    parts = urlsplit(address)
    if parts.scheme not in ("http", "https") or not parts.hostname:
        raise ValueError(f"{address!r} is no origin, such as https://example.org")
    host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
    is_default = parts.port in (None, {"http": 80, "https": 443}[parts.scheme])
    return f"{parts.scheme}://{host}" + ("" if is_default else f":{parts.port}")
