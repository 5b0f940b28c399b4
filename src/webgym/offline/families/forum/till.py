"""What members do in a forum: the checks of its forms and what the server keeps."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from webgym.offline.families.forum import stock
from webgym.offline.families.forum.schema import Thread
from webgym.offline.website import State

if TYPE_CHECKING:
    from webgym.offline.families.forum import Forum

MAIL = re.compile(r"[^@\s]+@[^@\s]+\.[^@\s]+")
TITLE_AT_LEAST = 10
TEXT_AT_LEAST = 12
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{2,19}")

Errors = dict[str, str]


def report(site: Forum, state: State) -> dict[str, Any]:
    """What the server holds for a visitor, by titles and names."""

    def title(number: str) -> str:
        return site.stock.by_number[int(number)].title

    return {
        "user": state.get("user"),
        "follows": {title(number): True for number in state.get("follows", [])},
        "likes": {
            title(number): dict.fromkeys(them, True) for number, them in state.get("likes", {}).items()
        },
        "replies": {title(number): texts[-1] for number, texts in state.get("replies", {}).items()},
        "reports": {title(number): sent for number, sent in state.get("reports", {}).items()},
        "votes": {title(number): option for number, option in state.get("votes", {}).items()},
        "threads": {own["title"]: own for own in state.get("threads", [])},
        "messages": state.get("messages", {}),
        "digest": state.get("digest"),
        "joined": state.get("joined", {}),
    }


def sign_in(site: Forum, state: State, form: Mapping[str, str]) -> str | None:
    """Sign in; an error, if name and password do not belong together."""
    account = site.stock.account
    given = form.get("name", "").strip().casefold(), form.get("password", "")
    if given != (account.name.casefold(), account.password):
        return "This name and this password do not belong together."
    state["user"] = account.name
    return None


def check_reply(form: Mapping[str, str]) -> tuple[str, str | None]:
    """A reply's text, and what is wrong with it."""
    text = form.get("text", "").strip()
    return text, _short(text, TEXT_AT_LEAST)


def check_thread(site: Forum, form: Mapping[str, str]) -> tuple[dict[str, str], Errors]:
    """A new thread, and what is wrong with it."""
    sent = {key: form.get(key, "").strip() for key in ("board", "tag", "title", "text")}
    errors: Errors = {}
    if sent["board"] not in dict(site.stock.boards):
        errors["board"] = "Please choose a board."
    if sent["tag"] not in ("", *site.hobby.tags):
        errors["tag"] = "Please choose one."
    for key, least in (("title", TITLE_AT_LEAST), ("text", TEXT_AT_LEAST)):
        error = _short(sent[key], least)
        if error:
            errors[key] = error
    if any(sent["title"].casefold() == thread.title.casefold() for thread in site.stock.threads):
        errors["title"] = "This title is taken."
    return sent, errors


def check_report(form: Mapping[str, str]) -> tuple[dict[str, str], Errors]:
    """A report to the moderators, and what is wrong with it."""
    sent = {key: form.get(key, "").strip() for key in ("reason", "text")}
    errors: Errors = {}
    if sent["reason"] not in stock.REASONS:
        errors["reason"] = "Please choose one."
    if error := _short(sent["text"], TEXT_AT_LEAST):
        errors["text"] = error
    return sent, errors


def check_message(form: Mapping[str, str]) -> tuple[dict[str, str], Errors]:
    """A private message, and what is wrong with it."""
    sent = {key: form.get(key, "").strip() for key in ("subject", "text")}
    errors: Errors = {}
    if not sent["subject"]:
        errors["subject"] = "Please give a subject."
    if error := _short(sent["text"], TEXT_AT_LEAST):
        errors["text"] = error
    return sent, errors


def check_join(site: Forum, form: Mapping[str, str]) -> tuple[dict[str, str], Errors]:
    """A registration, and what is wrong with it."""
    sent = {key: form.get(key, "").strip() for key in ("home", "name", "mail")}
    errors: Errors = {}
    taken = {user.name.casefold() for user in site.stock.users} | {site.stock.account.name.casefold()}
    if not NAME.fullmatch(sent["name"]):
        errors["name"] = "Three to twenty letters and digits, please."
    elif sent["name"].casefold() in taken:
        errors["name"] = "This name is taken."
    if sent["home"] not in dict(site.stock.boards):
        errors["home"] = "Please choose a board."
    if not MAIL.fullmatch(sent["mail"]):
        errors["mail"] = "This is not an e-mail address."
    return sent, errors


def follow(state: State, thread: Thread) -> None:
    """Follow a thread."""
    follows: list[str] = state.setdefault("follows", [])
    if str(thread.number) not in follows:
        follows.append(str(thread.number))


def like(state: State, thread: Thread, name: str) -> None:
    """Like the post of a member in a thread."""
    liked: list[str] = state.setdefault("likes", {}).setdefault(str(thread.number), [])
    if name not in liked:
        liked.append(name)


def _short(text: str, least: int) -> str | None:
    return f"Please write at least {least} characters." if len(text) < least else None
