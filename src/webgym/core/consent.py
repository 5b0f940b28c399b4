"""Asks once per folder before settings of others name code, start a program or send a key somewhere.

A configuration or a run folder may come from a stranger. What it would have this machine do beyond WebGym's
own work is shown and confirmed when a folder's settings are first read, and remembered by a digest of the
folder and of these values. Nothing is asked about the settings that come with WebGym, nor about a folder that
WebGym wrote for this user with these values.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from webgym.core.errors import ConfigError

ALLOW: Final = "WEBGYM_TRUST_SETTINGS"
"""Environment variable; ``1`` confirms all settings that this process reads."""

_NAMES_CODE: Final = ("judge", "name", "objective")
"""The settings that may name an object to import, as ``module:object``."""
_HARMLESS: Final = "webgym.study.controls:"
"""The study's own objectives: every name in that module may be called with anything."""
_STARTS: Final = ("executable", "extra_args", "env")
_KEYS_OF: Final = {
    "base_url": ("WEBGYM_API_KEY", "WEBGYM_JUDGE_API_KEY"),
    "url": ("WEBGYM_TOKEN",),
    "sites_url": ("WEBGYM_SITES_TOKEN",),
}
"""The settings that hold an address, and the variables that may go there unless ``api_key_env`` names one."""


def confirm(settings: Mapping[str, Any], file: Path) -> None:
    """Ask whether settings that were read from a file may be used, unless that is known already.

    Raises:
        ConfigError: the user says no, or there is no terminal to ask in.
    """
    found = sorted(set(_claims(settings)))
    if not found or os.environ.get(ALLOW) == "1" or _digest(found, file) in _confirmed():
        return
    said = f"{file} {'; '.join(found)}"
    if not (sys.stdin.isatty() and sys.stderr.isatty()):
        raise ConfigError(
            f"nobody has confirmed these settings yet: {said}", hint=f"{ALLOW}=1 confirms what you have read"
        )
    sys.stderr.write(f"{said}\nDo you know who wrote this, and go on? [y/N] ")
    sys.stderr.flush()
    if sys.stdin.readline().strip().lower() not in ("y", "yes"):
        raise ConfigError(f"the settings in {file} were not confirmed")
    remember(settings, file)


def remember(settings: Mapping[str, Any], file: Path) -> None:
    """Count settings in a file as confirmed, such as those that this user's own command has written there."""
    if found := sorted(set(_claims(settings))):
        place = _place()
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            with place.open("a") as known:
                known.write(f"{_digest(found, file)}\n")
        except OSError:  # a home that cannot be written to: the next command asks again
            return


def _claims(settings: Any, key: str = "") -> Iterator[str]:
    """What settings would have this machine do, in words."""
    if key in _STARTS and settings and settings != "full":
        yield f"starts a program with {key} {settings}"
    elif isinstance(settings, Mapping):
        for name, value in settings.items():
            if name in _KEYS_OF and isinstance(value, str):
                given = settings.get("api_key_env")
                keys = (str(given),) if given else _KEYS_OF[name]
                yield from (f"sends {variable} to {value}" for variable in keys if os.environ.get(variable))
            if name == "credentials" and value:
                yield f"sends the credentials in {value}"
            yield from _claims(value, str(name))
    elif isinstance(settings, list | tuple):
        for each in settings:
            yield from _claims(each, key)
    elif key in _NAMES_CODE and isinstance(settings, str) and ":" in settings.removeprefix(_HARMLESS):
        yield f"runs the code {settings}"


def _digest(found: list[str], file: Path) -> str:
    return hashlib.sha256("\0".join((str(file.resolve().parent), *found)).encode()).hexdigest()


def _place() -> Path:
    state = os.environ.get("XDG_STATE_HOME") or Path.home() / ".local/state"
    return Path(state) / "webgym" / "confirmed"


def _confirmed() -> list[str]:
    try:
        return _place().read_text().split()
    except OSError:
        return []
