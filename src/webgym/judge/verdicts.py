"""Reads the verdict from a judge model's reply, strictly.

A reply ends in a fixed verdict line, ``VERDICT <code>: SUCCESS`` or ``VERDICT <code>: NOT SUCCESS`` (``YES``
and ``NO`` for a yes-or-no question). The code is derived from the content of the request
(:mod:`webgym.judge.untrusted`), so no text inside of the request can contain it: text that a model echoes
from a page or an answer is never a verdict.

A bare verdict line, without the word VERDICT or the code, counts only where the caller allows it (``bare``),
for models that omit them, and only if it stands alone: the line before must not continue into it, as in a
negation that is broken over two lines. Everything else is no verdict: a reply that the model did not end
itself, that is a refusal too, that ends differently, that has two different verdicts, that denies its verdict
in the line before, or that uses other words. Case, full-width letters, Markdown, closing punctuation,
invisible characters and a chat template's control tokens around the line are ignored.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Sequence
from typing import Final, Literal, TypeAlias

import msgspec

from webgym.core.text import THOUGHT, THOUGHT_END
from webgym.core.trajectory import ended_by, was_cut_off

Words: TypeAlias = Literal["criterion", "question"]

WORDS: Final[dict[Words, tuple[str, str]]] = {
    "criterion": ("success", "not success"),
    "question": ("yes", "no"),
}
"""The words of a positive and a negative verdict, by kind of question."""

_MARKUP: Final = "*_`#\"'“”‘’«»[](){}"
"""Markup that is ignored. ``>`` and ``|`` are not: a line that begins with them is a quotation."""
_CODE: Final = r"(?: (?P<code>[0-9a-z]{4,64}))?\s?[:=–—-]\s?"
_LINE: Final = re.compile(
    rf"(?:(?:final )?verdict{_CODE})?(?P<said>success|yes|no|not (?:success|confirmed)|fail(?:ure|ed)?)"
)
_WHOLE: Final = re.compile(r"(?<!\.)[.!?。！？]$")
"""The end of a sentence, without quotation marks and brackets. An ellipsis is not an end."""
_NO: Final = r"n['’ ]t|\b(?:no|not|never|cannot|nor|neither|none|nope|hardly|scarcely|barely)"
_NEGATING: Final = (
    rf"(?:{_NO}|\b(?:without|non|un|false|wrong|fails?|failed|lacks?|if|unless|were|would|could|should|had"
    r"|might|instead|rather|than))\b"
)
"""Words that negate what follows them, or make it conditional."""
_NEGATED: Final = re.compile(rf"(?:{_NO})\W*$")
_TURNED: Final = re.compile(rf"{_NEGATING}[^.!?]*(?:\.\.\.)?$")
_INTRODUCED: Final = re.compile(rf"{_NEGATING}[^.!?]*(?:[,;:–—-]|\.\.\.)$")
_UNFINISHED: Final = re.compile(rf"{_TURNED.pattern}|(?:[,;:–—-]|\.\.)$")
_DENIED: Final = re.compile(
    r"(?:(?:n['’ ]t|\b(?:not|never|cannot))(?: (?:be|been|yet|fully|really|clearly|at all|actually))* |\bun)"
    r"(?:confirmed|supported|shown|seen|visible|met|satisfied|successful|true|correct|there)\W*$"
)
"""The end of a sentence that denies a criterion."""
_CONTROL: Final = re.compile(
    r"\A(?:\s*<[|｜][^<>|｜]{1,60}[|｜]>)+|(?:\s*(?:<[|｜][^<>|｜]{1,60}[|｜]>|</?[a-z]+(?:_[a-z]+)+>|</s>))+\s*\Z"
)
"""Control tokens of any family, by their form: no tag of HTML has bars or underscores."""
_QUOTATION: Final = re.compile(r"[\s*_`#•-]*[\"'“”„‘’‚«»‹›＂＇>|]")
_SENTENCE: Final = 400
"""Number of characters at the end of a line that are examined."""
_IMAGE_LINE: Final = re.compile(
    rf"(?:screenshot|image|picture) (?P<number>[0-9]{{1,4}}){_CODE}(?P<said>yes|no)"
)


class Finding(msgspec.Struct, frozen=True):
    """A verdict that a reply states.

    Attributes:
        passed: whether the verdict is positive.
        reason: the rest of the reply.
    """

    passed: bool
    reason: str


class NoVerdict(msgspec.Struct, frozen=True):
    """A reply without a clear verdict.

    Attributes:
        why: in words that can be sent to the model.
        is_refused: whether the model, or the endpoint's filter, refused to answer.
    """

    why: str
    is_refused: bool = False


def trimmed(line: str) -> str:
    """A line without invisible characters, and without the control tokens that a chat template put around
    it."""
    return _CONTROL.sub("", _seen(line)).strip()


def _seen(text: str) -> str:
    return "".join(character for character in text if unicodedata.category(character) != "Cf")


def _unmarked(line: str) -> str:
    """A line without Markdown, quotes, case, compatibility forms and surplus space."""
    folded = unicodedata.normalize("NFKC", line.replace("…", "...")).casefold()
    folded = "".join(" " if character in _MARKUP else character for character in folded)
    return " ".join(folded.split())


def plain(line: str) -> str:
    """A line without Markdown, quotes, case, compatibility forms, surplus space and closing punctuation."""
    return _unmarked(line).rstrip(" .!。").lstrip(" -•").strip()


def stands_alone(line: str, before: str) -> bool:
    """Whether a line without a code stands alone: it is no quotation, and the line before is a whole
    sentence.

    "not a" and "cannot be called" continue into a SUCCESS on the next line, and "No." contradicts it.
    """
    words = _unmarked(before[-_SENTENCE:])
    is_whole = not words or (_WHOLE.search(words) is not None and not _NEGATED.search(words))
    return is_whole and not _QUOTATION.match(line)


def runs_on(line: str, before: str) -> bool:
    """Whether a line of a fixed form is a quotation, or continues a sentence that negates or introduces it.

    Less strict than :func:`stands_alone`, for lines with a label ("Status: success"): the line before them
    may lack its full stop.
    """
    words = _unmarked(before[-_SENTENCE:])
    return any(rule.search(words) for rule in (_NEGATED, _UNFINISHED)) or bool(_QUOTATION.match(line))


def _is_denied(verdict: bool, before: str) -> bool:
    """Whether the line before a verdict denies it or makes it conditional. A sentence with a negation may
    lack its full stop before a negative verdict, which it explains."""
    words = _unmarked(before[-_SENTENCE:])
    rules = (_NEGATED, _DENIED, _TURNED) if verdict else (_NEGATED, _INTRODUCED)
    return any(rule.search(words) for rule in rules)


def read_verdict(
    lines: Sequence[str], words: Words, code: str = "", *, bare: bool = True
) -> Finding | NoVerdict:
    """The verdict of a reply, or why it has none. Never raises.

    Args:
        lines: of the reply, as :func:`lines_of` gives them.
        words: which words state the two verdicts.
        code: signature code of the request; a verdict line with another code does not count.
        bare: whether a verdict line without the code counts.
    """
    line_verdicts = [_verdict_of(line, WORDS[words], code) for line in lines]
    # Other words contradict a verdict, too: NO or FAILURE within a reply to a criterion.
    stated = {found for line in lines if (found := _verdict_of(line, None, code))}
    last = line_verdicts[-1]
    positive, negative = (word.upper() for word in WORDS[words])
    if last is None:
        return NoVerdict(f"the last line is no verdict line; it must say {positive} or {negative}")
    verdict, is_signed = last
    if not is_signed and not bare:
        return NoVerdict("the verdict line does not carry the code of this request")
    before = "".join(lines[-2:-1])
    if _is_denied(verdict, before) or not (is_signed or stands_alone(lines[-1], before)):
        return NoVerdict("the verdict line may be quoted, or the end of the line before; say it for itself")
    # Lines without the code may be quotations, and contradict the last line unless it is signed.
    if any(other is not verdict for other, carries_code in stated if carries_code or not is_signed):
        return NoVerdict(f"the reply says both {positive} and {negative}")
    reason = "\n".join(
        line for line, line_verdict in zip(lines, line_verdicts, strict=True) if line_verdict is None
    )
    return Finding(verdict, reason)


def read_per_image(
    lines: Sequence[str], count: int, code: str = "", *, bare: bool = True
) -> tuple[bool, ...] | NoVerdict:
    """One yes or no for each of ``count`` screenshots, from lines ``SCREENSHOT <number> <code>: YES``.

    Every screenshot must have exactly one verdict, and there must be none for other numbers.
    """
    verdicts: dict[int, set[bool]] = {}
    for line in lines:
        match = _IMAGE_LINE.fullmatch(plain(line))
        if match is None or match["code"] not in (None, code or None):
            continue
        if match["code"] is None and not bare:
            continue
        verdicts.setdefault(int(match["number"]), set()).add(match["said"] == "yes")
    numbers = range(1, count + 1)
    if extra := sorted(verdicts.keys() - set(numbers)):
        return NoVerdict(f"there is no screenshot {extra[0]}")
    for number in numbers:
        if len(verdicts.get(number, ())) != 1:
            return NoVerdict(f"there must be exactly one verdict line for screenshot {number}")
    return tuple(verdicts[number].pop() for number in numbers)


def may_be_echoed(texts: Iterable[str | None], words: Words) -> bool:
    """Whether a bare verdict line in a reply could be an echo of these texts. One that is not known could be.

    The positive word anywhere in a text is enough. The negative "no" is too common for that: it must be a
    line of its own, or the text must contain the word "verdict".
    """
    for text in texts:
        if text is None:
            return True
        folded = unicodedata.normalize("NFKC", _seen(text)).casefold()
        if "verdict" in folded or WORDS[words][0] in folded:
            return True
        if words == "question" and any(
            match["said"] in ("yes", "no")
            for line in folded.splitlines()
            for match in (rule.fullmatch(plain(trimmed(line))) for rule in (_LINE, _IMAGE_LINE))
            if match
        ):
            return True
    return False


def lines_of(text: str, finish_reason: str, refusal: str) -> list[str] | NoVerdict:
    """The non-empty lines of a reply after the model's thinking, or why it has no verdict: only a reply that
    the model itself ended, and without a refusal of its own, has one."""
    ended = ended_by(finish_reason)
    if refusal.strip() or ended == "filter":
        who = "the endpoint's filter" if ended == "filter" else "the model"
        return NoVerdict(f"{who} refused to answer", is_refused=True)
    if ended == "unknown":
        return NoVerdict(f"the reply ended for a reason that is not known ({finish_reason[:40]!r})")
    if ended == "engine" or was_cut_off(finish_reason):
        return NoVerdict("the reply was cut off before its end")
    after_thinking = THOUGHT_END.split(text)[-1]
    if THOUGHT.search(after_thinking):
        return NoVerdict("the reply ended before the thinking did")
    lines = [line for line in map(trimmed, after_thinking.splitlines()) if plain(line)]
    return lines or NoVerdict("the reply is empty")


def _verdict_of(line: str, allowed: tuple[str, str] | None, code: str) -> tuple[bool, bool] | None:
    """The verdict that a line states, in the allowed or in any words, and whether it carries the code;
    ``None`` if it is no verdict line."""
    match = _LINE.fullmatch(plain(line))
    if match is None or (allowed and match["said"] not in allowed):
        return None
    given = match["code"]
    if given is not None and given != code:
        return None
    return match["said"] in ("success", "yes"), given is not None
