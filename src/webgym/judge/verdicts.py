"""Reading a verdict from a judge model's reply: strict and total.

A reply ends in a fixed verdict line, ``VERDICT <code>: SUCCESS`` or ``VERDICT <code>: NOT SUCCESS`` (``YES``
and ``NO`` where the question is a plain one). The code belongs to the request and is derived from its
content (:mod:`webgym.judge.untrusted`), so that no text inside of the request can hold it: whatever a model
echoes of a page or of an answer, the echo is no verdict.

A bare verdict line, without the word or the code, counts only where the caller allows it (``bare``), for
models that drop them, and only if it stands alone: nothing before it runs on into it, as a negation does that
a reply breaks in two lines. Everything else is no verdict: a reply that was cut off, one that ends in
something else, one with two different verdicts, one that says it in other words. Case, full-width letters,
Markdown and closing punctuation do not count.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import Final, Literal, TypeAlias

import msgspec

Words: TypeAlias = Literal["criterion", "question"]

WORDS: Final[dict[Words, tuple[str, str]]] = {
    "criterion": ("success", "not success"),
    "question": ("yes", "no"),
}
"""What a positive and a negative verdict are called, by kind of request."""

_CUT_OFF: Final = frozenset({"length", "max_tokens", "content_filter", "error", "abort", "cancelled"})
_THOUGHT_END: Final = re.compile(r"</think(?:ing)?\s*>", re.IGNORECASE)
_THOUGHT: Final = re.compile(r"<think(?:ing)?\s*>", re.IGNORECASE)
_MARKUP: Final = "*_`#\"'“”‘’«»[](){}"
"""Emphasis, not quotation: a line that begins with ``>`` or ``|`` repeats what somebody else said."""
_CODE: Final = r"(?: (?P<code>[0-9a-z]{4,64}))?\s?[:=–—-]\s?"
_LINE: Final = re.compile(rf"(?:(?:final )?verdict{_CODE})?(?P<said>not success|success|yes|no)")
_WHOLE: Final = re.compile(r"(?<!\.)[.!?。！？]$")
"""How a sentence ends, its quotation marks and brackets left out. An ellipsis ends none."""
_NO: Final = r"n['’ ]t|\b(?:no|not|never|cannot|nor|neither|none|nope|hardly|scarcely|barely)"
_TURNS: Final = (
    rf"(?:{_NO}|\b(?:without|non|un|false|wrong|fails?|failed|lacks?|if|unless|were|would|could|should|had"
    r"|might|instead|rather|than))\b"
)
"""Words that turn what follows them, or make it depend on something."""
_TURNED: Final = re.compile(rf"(?:{_NO})\W*$")
_UNFINISHED: Final = re.compile(rf"{_TURNS}[^.!?]*$|(?:[,;:–—-]|\.\.)$")
_QUOTATION: Final = re.compile(r"[\s*_`#•-]*[\"'“”„‘’‚«»‹›＂＇>|]")
_SENTENCE: Final = 400
"""Characters of a line that are looked at for how it ends."""
_IMAGE_LINE: Final = re.compile(
    rf"(?:screenshot|image|picture) (?P<number>[0-9]{{1,4}}){_CODE}(?P<said>yes|no)"
)


class Finding(msgspec.Struct, frozen=True):
    """A verdict that was read.

    Attributes:
        passed: the verdict.
        reason: what the reply says before it.
    """

    passed: bool
    reason: str


class NoVerdict(msgspec.Struct, frozen=True):
    """Why a reply holds no clear verdict, in words that the model can be told."""

    why: str


def _unmarked(line: str) -> str:
    """A line without Markdown, quotes, case, compatibility forms and surplus space."""
    folded = unicodedata.normalize("NFKC", line.replace("…", "...")).casefold()
    folded = "".join(" " if character in _MARKUP else character for character in folded)
    return " ".join(folded.split())


def plain(line: str) -> str:
    """A line without Markdown, quotes, case, compatibility forms, surplus space and closing punctuation."""
    return _unmarked(line).rstrip(" .!。").lstrip(" -•").strip()


def stands_alone(line: str, before: str) -> bool:
    """Whether a line without a code is said for itself: it is no quotation, and what is before it is whole.

    "not a" and "cannot be called" run on into a SUCCESS on the next line, and "No." contradicts it.
    """
    words = _unmarked(before[-_SENTENCE:])
    is_whole = not words or (_WHOLE.search(words) is not None and not _TURNED.search(words))
    return is_whole and not _QUOTATION.match(line)


def runs_on(line: str, before: str) -> bool:
    """Whether a line of a fixed form is a quotation, or the end of a sentence that turns or introduces it.

    Less strict than :func:`stands_alone`, for lines that say what they are ("Status: success"): what is
    before them may lack its full stop.
    """
    words = _unmarked(before[-_SENTENCE:])
    return any(rule.search(words) for rule in (_TURNED, _UNFINISHED)) or bool(_QUOTATION.match(line))


def read_verdict(
    text: str, words: Words, code: str = "", *, bare: bool = True, finish_reason: str = ""
) -> Finding | NoVerdict:
    """The verdict of a reply, or why it holds none. Never raises, whatever the text.

    Args:
        text: the reply.
        words: how the two verdicts are called.
        code: of the request; a verdict line that carries another one does not count.
        bare: whether a verdict line without the code counts.
        finish_reason: as the endpoint gave it. A reply that was cut off holds no verdict.
    """
    lines = _lines(text, finish_reason)
    if isinstance(lines, NoVerdict):
        return lines
    said = [_said(line, words, code) for line in lines]
    signed = {verdict for verdict, is_signed in filter(None, said) if is_signed}
    # A reply that answers YES or NO on its way says something, too.
    everything = {found[0] for kind in WORDS for line in lines if (found := _said(line, kind, code))}
    last = said[-1]
    positive, negative = (word.upper() for word in WORDS[words])
    if last is None:
        return NoVerdict(f"the last line is no verdict line; it must say {positive} or {negative}")
    verdict, is_signed = last
    if not is_signed and not bare:
        return NoVerdict("the verdict line does not carry the code of this request")
    if not is_signed and not stands_alone(lines[-1], "".join(lines[-2:-1])):
        return NoVerdict("the verdict line may be quoted, or the end of the line before; say it for itself")
    # What stands in the reply without the code may be quoted; only a signed line outweighs it.
    if len(signed if is_signed else everything) > 1:
        return NoVerdict(f"the reply says both {positive} and {negative}")
    reason = "\n".join(line for line, meant in zip(lines, said, strict=True) if meant is None)
    return Finding(verdict, reason)


def read_per_image(
    text: str, count: int, code: str = "", *, bare: bool = True, finish_reason: str = ""
) -> tuple[bool, ...] | NoVerdict:
    """One yes or no for each of ``count`` pictures, from lines ``SCREENSHOT <number> <code>: YES``.

    Every picture must have a verdict and no other may; two different ones for the same are none.
    """
    lines = _lines(text, finish_reason)
    if isinstance(lines, NoVerdict):
        return lines
    found: dict[int, set[bool]] = {}
    for line in lines:
        match = _IMAGE_LINE.fullmatch(plain(line))
        if match is None or match["code"] not in (None, code or None):
            continue
        if match["code"] is None and not bare:
            continue
        found.setdefault(int(match["number"]), set()).add(match["said"] == "yes")
    wanted = range(1, count + 1)
    if extra := sorted(found.keys() - set(wanted)):
        return NoVerdict(f"there is no screenshot {extra[0]}")
    for number in wanted:
        if len(found.get(number, ())) != 1:
            return NoVerdict(f"there must be exactly one verdict line for screenshot {number}")
    return tuple(found[number].pop() for number in wanted)


def may_be_echoed(texts: Iterable[str], words: Words) -> bool:
    """Whether a bare verdict line in a reply could be a piece of these texts.

    The word of a positive verdict alone is enough, wherever it stands. "No" is too common for that: a whole
    line of it counts, or a mention of a verdict.
    """
    for text in texts:
        folded = unicodedata.normalize("NFKC", text).casefold()
        if "verdict" in folded or WORDS[words][0] in folded:
            return True
        if words == "question" and any(
            match["said"] in ("yes", "no")
            for line in folded.splitlines()
            for match in (_LINE.fullmatch(plain(line)), _IMAGE_LINE.fullmatch(plain(line)))
            if match
        ):
            return True
    return False


def _lines(text: str, finish_reason: str) -> list[str] | NoVerdict:
    """The lines of a reply that are not empty, thoughts left out."""
    if finish_reason.casefold() in _CUT_OFF:
        return NoVerdict("the reply was cut off before its end")
    said = _THOUGHT_END.split(text)[-1]
    if _THOUGHT.search(said):
        return NoVerdict("the reply ended before the thinking did")
    lines = [line.strip() for line in said.splitlines() if plain(line)]
    return lines or NoVerdict("the reply is empty")


def _said(line: str, words: Words, code: str) -> tuple[bool, bool] | None:
    """The verdict that a line states and whether it carries the code; ``None`` if it is no verdict line."""
    match = _LINE.fullmatch(plain(line))
    if match is None or match["said"] not in WORDS[words]:
        return None
    given = match["code"]
    if given is not None and given != code:
        return None
    return match["said"] == WORDS[words][0], given is not None
