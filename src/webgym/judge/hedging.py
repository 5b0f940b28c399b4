"""Hedged answers: does an answer name candidates besides the right one? By rules, for the offline judge.

A list that contains the right answer is a guess. The answer is split into pieces at full stops, commas, line
ends, "or" and the like. A piece names another candidate if, apart from words that also occur in the task, in
a right answer or in the pieces that contain it, it holds only a value written like the right one: a number
of the same format, or words with the same capitalisation. Next to a price, "Rated 4.7" is a remark; "$13.50"
and "It costs $13.50" are other candidates. In a piece with the right answer every other number of its format
needs a word of its own beside it, which does not stand beside the right one, too: "12 rated 3 stars" names
one number, "12 next 13" and "12 else 13 else 14" name several.

A page that is copied into the answer is a list of all that it shows, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from functools import lru_cache
from itertools import pairwise
from typing import Final

from webgym.core.text import fold, says
from webgym.judge.claims import day_of, numeral, respelled, without_reported
from webgym.judge.units import CURRENCY_WORDS, MONTHS, NUMBER_WORDS, ORDINAL_WORDS

_SEPARATORS: Final = re.compile(
    r"\b[a-z]\)|[;\n\r()\[\]{}|/•*!?\"“”„«»=→]|[.,:](?!\d)|(?<!\d)[.,:]|\s[-–—]+\s|^[-–—]"
    r"|\b(?:or|and|vs|versus|also|maybe|perhaps|possibly)\b",
    re.IGNORECASE | re.MULTILINE,
)
_TOKEN: Final = re.compile(r"\d+(?:[.,:]\d+)*|[^\W\d_]+")
_PLACEHOLDER: Final = "\x00"
"""Replaces every right answer in the text before it is split."""

_MARKED: Final = re.compile(f"{_PLACEHOLDER}|{_TOKEN.pattern}")

_ADJACENT_NUMBER: Final = re.compile(
    rf"{_PLACEHOLDER}\W{{0,3}}(\d[\d.,:]*)|(\d[\d.,:]*)\W{{0,3}}{_PLACEHOLDER}"
)
_HEADING: Final = re.compile(
    rf"(?:^|(?<=[.;!?]))(?:[^\S\n]|[*•-])*[^\W\d_]{{2,20}}(?: [a-z]{{2,20}})?[ *]*:[\s*]*(?={_PLACEHOLDER})",
    re.MULTILINE,
)
_COUNTS: Final = {word: str(number) for word, number in NUMBER_WORDS.items() if number != 1}
_COUNT: Final = re.compile(rf"\b(?:{'|'.join(sorted(_COUNTS, key=len, reverse=True))})\b", re.IGNORECASE)
"""Numbers in words, but "one", which may be a pronoun."""
_LONE_ONE: Final = re.compile(r"(?:(?:there|it) (?:is|was) )?(?:only |just |exactly )?one", re.IGNORECASE)
"""A piece that claims the number "one"."""
_WORD_BEFORE: Final = re.compile(r"([^\W\d_]{1,40})[ -]$")
_WORD_AFTER: Final = re.compile(r"[ -]([^\W\d_]+)")
_MOST_WORDS: Final = 5
"""Most words of a candidate; a longer piece is a remark."""

_MOST_QUOTED: Final = 8
"""Most words in a row that an answer may have in common with a page, beside those that it needs."""

_FUNCTION_WORDS: Final = ("a", "an", "the", "of", "in", "on", "for", "with", "that", "was", "it")
_STOP_WORDS: Final = frozenset(
    "a an the it its is are was were be this that there here i my we our you your he she they of in on at to "
    "for from by with as than then so if not no yes has have had will would can could may might all each am "
    "pm other s boxed great okay task complete completed finished success successful successfully mission "
    "accomplished requested retrieved extracted obtained information info data output details key findings "
    "confidence status step steps search searched show item summarize summarise answer answers final result "
    "results respectively found find done note based page pages website site according shown however thus "
    "therefore which what who when where how ok sure thanks thank hope helps name source verified conclusion "
    "summary confirmed altogether overall but yet wait actually alternatively alternative otherwise else "
    "instead either rather likely probably presumably apparently certainly surely definitely although though "
    "unless whether again even still too correction corrected guess think believe suppose".split()
).union(ORDINAL_WORDS)
"""Words that are never part of a candidate."""

_REMARKS: Final = frozenset(
    "about above additionally after another any afterwards alright among because before below between both "
    "currently during every everything exactly excellent finally first furthermore given good hello hi "
    "indeed just last lastly let like moreover more most namely next nothing now once only over per perfect "
    "please regarding same since some specifically such through these those they them their today too under "
    "until up down using via well while within action applied applying booked checked checking chose chosen "
    "choosing clicked clicking compared comparing counted counting dismissed entered entering explanation "
    "filtered filtering finding having hovering loaded loading located locating logged logging looked "
    "looking navigated navigating observation observed opened opening read reading reasoning response saved "
    "saw scrolled scrolling searching seeing seen selected selecting sent signed signing sorted sorting "
    "submitted thought thoughts typed typing viewed viewing visited visiting went button chart column "
    "details entry filter form list load map menu panel row screen screenshot section tab table tooltip "
    "value values anything ask count double else feel free question reference unclear "
    "absolutely best cheers end got memory regards stop terminate field property attribute metric parameter "
    "criterion item confident easy easily right high low moving".split()
).union(CURRENCY_WORDS)
"""Words of remarks: no name consists of them, but a number may have one of them as its label."""

_NO_NAMES: Final = _STOP_WORDS.union(NUMBER_WORDS, "or and vs versus also maybe perhaps possibly".split())
_DENIALS: Final = frozenset("not never except excluding than instead unlike neither nor without t".split())


def other_candidate(
    answer: str, required: Sequence[Sequence[str]], known_texts: Sequence[str], wrong: Sequence[str] = ()
) -> str:
    """The first piece of an answer that names a candidate other than the right one; empty if none does.

    Args:
        answer: the agent's answer.
        required: for each value that a right answer must state, the accepted spellings.
        known_texts: texts whose words are not candidates: the task, and answers that are known to be right.
        wrong: wrong candidates that the caller looks for itself. A part of one that the first of the known
            texts, the task, names is one, too. Values in small letters are options of a list: if some are
            here, all are, and other words in small letters are remarks.
    """
    task, *_ = known_texts
    named = [candidate for candidate in wrong if says(fold(task), candidate)]
    answer = respelled(answer)
    options, right, known = _right_and_known(tuple(map(tuple, required)), tuple(known_texts))
    marked = _in_digits(_HEADING.sub("", right.sub(_PLACEHOLDER, answer)))
    marked = without_reported(marked, fold(" ".join(known_texts)))
    pieces = [piece.strip() for piece in _SEPARATORS.split(marked) if piece.strip()]
    shapes = {_shape(value) for option in options for value in _TOKEN.findall(option) if value[0].isdigit()}
    names = [
        respelled(option)
        for spellings in required
        if not re.search(r"\d", "".join(spellings))
        for option in spellings
    ]
    folded = set(map(fold, names))
    cases = {match[0][0].isupper() for match in right.finditer(answer) if fold(match[0]) in folded}
    if any(candidate[:1].islower() for candidate in wrong):
        cases.discard(False)
    context = set[str]().union(*(_words(piece) for piece in pieces if _PLACEHOLDER in piece))
    all_right = _words(" ".join(options))
    for piece in pieces:
        has_answer = _PLACEHOLDER in piece
        excused = known if has_answer else known | context
        unexplained = [token for token in _TOKEN.findall(piece) if fold(token) not in excused]
        values = [token for token in unexplained if token[0].isdigit()]
        is_value = all(token[0].isdigit() or token.isupper() for token in unexplained)  # a number, or a code
        claimed = values if is_value else _unlabelled(piece, known) if has_answer else []
        if any(_shape(value) in shapes for value in claimed) or (
            "9" in shapes and _LONE_ONE.fullmatch(piece)
        ):
            return piece.replace(_PLACEHOLDER, "…")
        words = [token for token in unexplained if fold(token) not in _REMARKS]
        if words and not values and not has_answer and _is_name(piece, words, names, cases, context):
            return piece
        rest = set() if has_answer or _words(piece) & _DENIALS else _words(piece) - _STOP_WORDS - _REMARKS
        if rest - all_right and any(rest <= _words(name) for name in named):
            return piece
    return ""


def copied(
    answer: str, pages: Iterable[str], required: Sequence[Sequence[str]], known_texts: Iterable[str]
) -> str:
    """Words that follow each other in the answer and on a page, too many for a quotation; empty if none do.

    Words that only the answer has do not break the copy, nor do those of the task and of the right answer;
    right answers do. The arguments but ``pages`` are those of :func:`other_candidate`.
    """
    if len(_TOKEN.findall(answer)) <= _MOST_QUOTED:
        return ""
    _, right, known = _right_and_known(tuple(map(tuple, required)), tuple(known_texts))

    def words(text: str) -> list[str]:
        found = map(fold, _MARKED.findall(right.sub(_PLACEHOLDER, respelled(text))))
        return [word for word in found if word not in known]

    said = words(answer)
    for page in pages if len(said) > _MOST_QUOTED else ():
        shown = words(page)
        visible = set(shown)
        for run in _runs([word for word in said if word in visible]) & _runs(shown):
            return " ".join(run)
    return ""


def _runs(words: Sequence[str]) -> set[tuple[str, ...]]:
    """All runs of words that are too long for a quotation, but those with a right answer in them."""
    length = _MOST_QUOTED + 1
    runs = (tuple(words[at : at + length]) for at in range(len(words) - length + 1))
    return {run for run in runs if _PLACEHOLDER not in run}


@lru_cache(maxsize=64)
def _right_and_known(
    required: tuple[tuple[str, ...], ...], known_texts: tuple[str, ...]
) -> tuple[list[str], re.Pattern[str], AbstractSet[str]]:
    """The right answers, longest first, a pattern of them, and the words that are no candidates."""
    options = sorted(
        {respelled(each) for spellings in required for option in spellings for each in numeral(option)},
        key=len,
        reverse=True,
    )
    any_of = "|".join(map(re.escape, options))
    right = re.compile(rf"(?<!\w)(?<!\w['’])(?<!\d[.,:])(?:{any_of})(?!\w)(?![.,:]\d)", re.IGNORECASE)
    days = [day for option in options if (day := day_of(option))]
    texts = (*known_texts, *options, *(f"{day:%A %a}" for day in days))
    return options, right, _STOP_WORDS.union(MONTHS, *(_words(_in_digits(text)) for text in texts))


def _unlabelled(piece: str, known: AbstractSet[str]) -> Iterator[str]:
    """The numbers in a piece with a right answer that touch it, or have no word of their own beside them."""
    yield from (after or before for after, before in _ADJACENT_NUMBER.findall(piece))
    tokens = [token for token in ("", *_MARKED.findall(piece), "") if fold(token) not in known]
    beside = {fold(word) for pair in pairwise(tokens) if _PLACEHOLDER in pair for word in pair}
    free = {at for at, word in enumerate(tokens) if word.isalpha() and fold(word) not in beside}
    for at, token in enumerate(tokens):
        if not token[:1].isdigit():
            continue
        if label := free & {at - 1, at + 1}:
            free.remove(min(label))
        else:
            yield token


def _is_name(
    piece: str, words: Sequence[str], names: Sequence[str], cases: set[bool], context: set[str]
) -> bool:
    """Whether the words that only this piece has may be a name: capitalised like the right one, or standing
    alone. A name that the answer writes in small letters stands alone among remarks, too."""
    capitalised = {word[0].isupper() for word in words}
    if (
        len(words) > max(_MOST_WORDS, *(len(name.split()) for name in names), 0)
        or words[0][0].isupper() not in cases
    ):
        return False
    is_mixed = any(word[0].islower() and word not in _STOP_WORDS for name in names for word in name.split())
    is_small = any(name[0].islower() for name in names)
    others = _FUNCTION_WORDS if is_small else _STOP_WORDS | _REMARKS
    is_alone = _words(piece) <= {*map(fold, words), *context, *others}
    return capitalised == {True} or (is_alone and (len(capitalised) == 1 or is_mixed))


def _words(text: str) -> set[str]:
    return {fold(token) for token in _TOKEN.findall(text)}


def _in_digits(text: str) -> str:
    """The text with numbers in words as digits, but those that are a part of a name: "Forum Nine"."""

    def digits(match: re.Match[str]) -> str:
        beside = (
            _WORD_BEFORE.search(text, max(0, match.start() - 42), match.start()),
            _WORD_AFTER.match(text, match.end()),
        )
        names = (word[1] for word in beside if word and word[1][0].isupper())
        is_name = match[0][0].isupper() and any(fold(name) not in _NO_NAMES for name in names)
        return match[0] if is_name else _COUNTS[match[0].casefold()]

    return _COUNT.sub(digits, text)


def _shape(value: str) -> str:
    return re.sub(r"\d+", "9", value)
