"""Answers that are sentences containing the reference answer: which parts are claims, and which are filler.

Used by :mod:`webgym.judge.reference`. "Excused" words are those that the answer may repeat from the task.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, pairwise, zip_longest
from typing import Final, NamedTuple, TypeAlias

import msgspec

from webgym.judge.value_comparison import Match, equal, equal_tokens, same, units_of
from webgym.judge.values import Text, Token

Spans: TypeAlias = dict[int, int]
"""Positions of items among tokens: index of the first token to the index after the last."""


class RuleFinding(msgspec.Struct, frozen=True):
    """The result of a rule, and the reason in words."""

    match: Match
    reason: str


TRUTHS: Final = {"yes": True, "true": True, "correct": True, "no": False, "false": False, "incorrect": False}
_AFTER_TRUTH: Final = frozenset("it they he she there you this that these those we i".split())
_NEGATIONS: Final = frozenset(
    "not no never neither nor isnt wasnt arent werent doesnt dont didnt cannot cant couldnt wouldnt havent "
    "hasnt hadnt wont without except than instead unlike rather wrong incorrect false excluding".split()
)
QUALIFIERS: Final = frozenset(
    "about approximately approx around roughly over under above below nearly almost least most more less "
    "fewer up between maximum minimum estimated circa ca only".split()
)
REFUSED: Final = _NEGATIONS | frozenset(
    "or either maybe perhaps possibly probably might could likely unsure unclear unknown guess assume "
    "alternatively but however unable failed fail fails failure nothing anything tried gave determine "
    "whether guessed guessing sorry apologies blocked captcha error previously formerly former".split()
)
"""Words that deny, hedge or give up. They are not excused if the task has them, too."""

_CHOICES: Final = frozenset("or besides except excluding versus vs than unlike instead neither not".split())
"""Words of a task that compares candidates."""

_COUNTING: Final = frozenset({"many", "number", "count"})
_COUNTED_WORDS: Final = 5
"""Number of words after "how many" in a task that may name what is counted."""
_COPULAS: Final = frozenset("is are was were its thats heres".split())
_CLAIMS: Final = _COPULAS | frozenset(
    "has have had costs cost equals called named titled found shows says states".split()
)
_ANSWERS: Final = frozenset("answer answers result results solution response".split())
_PREPOSITIONS: Final = frozenset("to of for in on at by with from".split())
_PLACE_PREPOSITIONS: Final = _PREPOSITIONS - {"to", "of"}
"""Prepositions of place: "on the page of X, it is Y" is one claim. "To X, it is Y" names two things."""
_PRONOUNS: Final = frozenset("it this that these those there here what which who i we my your".split())
_RESTATING: Final = _CLAIMS | _NEGATIONS | {"do", "does", "did"}
_JOINERS: Final = frozenset("with of to from".split())
"""Words that join what is before and after them to one name."""
_CONJUNCTIONS: Final = frozenset({"and", "then"})
_CONCLUDING: Final = frozenset("so thus therefore hence boxed".split())
_SEARCHES: Final = frozenset("searched looked checked opened visited navigated browsed".split())
_SHOWS: Final = frozenset({"says", "shows", "states"})
_SOURCING: Final = frozenset("according based".split())
_SITES: Final = frozenset("page pages website site webpage screen screenshot information".split())
_QUESTIONS: Final = frozenset("task question query".split())
_OTHER_FILLER: Final = frozenset("as follows following final do does did the".split())
_FILLER: Final = frozenset().union(
    *(
        _CLAIMS,
        _ANSWERS,
        _PREPOSITIONS,
        _PRONOUNS,
        _CONCLUDING,
        _SEARCHES,
        _SOURCING,
        _SITES,
        _QUESTIONS,
        _OTHER_FILLER,
    )
)
"""Words that introduce an answer. A reference answer of such words alone is left to a model."""
_POINTERS: Final = _ANSWERS | frozenset("final what as follows following my your".split())
"""Words that may follow "is" without being an answer: "this is what I found"."""


_FILLER_ONLY_BEFORE: Final = {"final": _ANSWERS, "i": _CLAIMS | _SEARCHES}
"""Filler words that could be an answer themselves, and the words that must follow them to be filler."""


class _Piece(NamedTuple):
    """A piece of an answer: index of its first token, index after its last, and the spans in it."""

    start: int
    end: int
    spans: list[tuple[int, int]]


_END: Final = Token("", gap="strong")


class SentenceAnswer:
    """An answer, read as a sentence that contains the items of the reference answer.

    Args:
        task: the task's instruction.
        wanted: the items of the reference answer, as tokens.
        given: the tokens of the answer.
    """

    def __init__(self, task: Text, wanted: Sequence[Sequence[Token]], given: Sequence[Token]) -> None:
        self._wanted = wanted
        self._given = given
        self._asked = units_of(task)
        words = {token.word for token in task.tokens if token.value is None}
        # A task that names the answer or weighs candidates excuses none of its words.
        is_named = bool(_CHOICES & words) or any(self._places(item, task.tokens) for item in wanted)
        self._compared = {
            kind for item in wanted for token in item if token.value for kind in token.value.kinds
        }
        self._filler = _FILLER - ((_SITES | _QUESTIONS) & words) if is_named else _FILLER
        plain = {word for word in words if not any(map(str.isdigit, word))}  # a code is a candidate
        forms = {form for word in plain for form in (word, f"{word}s", word.removesuffix("s"))}
        self._excused = frozenset() if is_named else frozenset(forms - _FILLER - REFUSED)
        task_words = [token.word for token in task.tokens]
        starts = [at + 1 for at, word in enumerate(task_words) if word in _COUNTING]
        self._counted = frozenset(chain.from_iterable(task_words[at : at + _COUNTED_WORDS] for at in starts))
        self._values = () if is_named else tuple(token.value for token in task.tokens if token.value)

    def is_all(self) -> bool:
        """Whether the answer claims every item of the reference answer, and nothing else."""
        spans: Spans = {}
        covered: set[int] = set()
        for item in sorted(self._wanted, key=len, reverse=True):
            if all(token.value is None and token.word in _FILLER for token in item):
                return False
            size = len(item)
            free = [
                at
                for at in self._places(item, self._given)
                if at not in covered and at + size - 1 not in covered
            ]
            if not free:
                return False
            for at in free[:1] if self._is_twice(item) else free:
                spans[at] = at + size
                covered.update(range(at, at + size))
        return self._claims_only(spans)

    def _is_twice(self, item: Sequence[Token]) -> bool:
        return sum(equal(item, other) for other in self._wanted) > 1

    def value(self, wanted: Token) -> RuleFinding:
        """Compare the only value of the answer with the reference answer's."""
        assert wanted.value is not None
        positions = [
            position
            for position, token in enumerate(self._given)
            if token.value and not any(same(known, token.value) is Match.SAME for known in self._values)
        ]
        if len(positions) != 1 or not self._claims_only({positions[0]: positions[0] + 1}):
            return RuleFinding(Match.UNSURE, "the answer does not plainly give one value")
        value = self._given[positions[0]].value
        assert value is not None
        match = same(wanted.value, value, self._asked)
        reasons = {
            Match.SAME: "the answer gives the same value",
            Match.DIFFERENT: "the answer gives another value",
            Match.UNSURE: "the answer gives a value that cannot be compared",
        }
        return RuleFinding(match, reasons[match])

    def truth(self, wanted: str) -> RuleFinding:
        """Compare a plain yes or no, which may repeat the question, with the reference answer's."""
        at = next((at for at, token in enumerate(self._given) if token.word in TRUTHS), None)
        if at is None:
            return RuleFinding(Match.UNSURE, "the answer is no plain yes or no")
        first, before, rest = self._given[at], self._given[:at], self._given[at + 1 :]
        is_yes, words = TRUTHS[first.word], {token.word for token in rest}
        is_restated, is_denied = bool(words & self._excused), bool(words & _NEGATIONS)
        allowed = self._filler | self._excused if is_yes else self._filler | self._excused | _NEGATIONS
        if (
            (before and not self._is_filler(before))
            or any(token.value or token.word not in allowed or token.word in TRUTHS for token in rest)
            or words & {"find", "found", "see", "know"}
            or (rest and rest[0].gap == "none" and rest[0].word not in _AFTER_TRUTH)
            or (is_restated and (is_denied == is_yes or not words & _RESTATING))
        ):
            return RuleFinding(Match.UNSURE, "the answer is no plain yes or no")
        if is_yes == TRUTHS[wanted]:
            return RuleFinding(Match.SAME, f"the answer says {first.word}")
        return RuleFinding(Match.DIFFERENT, f"the answer says {first.word}, not {wanted}")

    def _places(self, item: Sequence[Token], text: Sequence[Token]) -> list[int]:
        """Indices in the text at which the item occurs."""
        if len(item) == 1 and (value := item[0].value) is not None:
            return [
                at
                for at, token in enumerate(text)
                if token.value and same(value, token.value, self._asked) is Match.SAME
            ]
        starts = range(len(text) - len(item) + 1)
        return [at for at in starts if all(map(equal_tokens, item, text[at : at + len(item)]))]

    # --- pieces ---------------------------------------------------------------------------------------

    def _claims_only(self, spans: Spans) -> bool:
        """Whether the text in these spans is all that the answer claims."""
        pieces = self._pieces(spans)
        covered = {at for piece in pieces for start, end in piece.spans for at in range(start, end)}
        around = [token for at, token in enumerate(self._given) if at not in covered]
        if self._claims_twice(around, len(self._wanted)):
            return False
        if self._claims_twice(around, 1) and not all(map(self._names_its_subject, pieces)):
            return False
        for place, (piece, following) in enumerate(zip_longest(pieces, pieces[1:])):
            if piece.spans:
                is_fine = self._is_claim(piece)
            else:
                words = self._given[piece.start : piece.end]
                is_announced = place > 0 and self._announces(pieces[place - 1])
                leads = bool(following) and not is_announced and self._introduces(words, following)
                is_fine = leads or self._is_filler(words)
            if not is_fine:
                return False
        return True

    def _pieces(self, spans: Spans) -> list[_Piece]:
        """The answer, split at every gap that is not within a span."""
        pieces: list[_Piece] = []
        start = last = 0
        spans_in_piece: list[tuple[int, int]] = []
        for at, token in enumerate([*self._given, _END]):
            is_word = token.word in _CONJUNCTIONS and at >= last
            if is_word or (token.gap != "none" and (at >= last or at in spans)):
                if start < at:
                    pieces.append(_Piece(start, at, spans_in_piece))
                start, spans_in_piece = at + is_word, []
            if at in spans:
                last = spans[at]
                spans_in_piece.append((at, last))
        return pieces

    def _is_excused(self, token: Token) -> bool:
        """Whether the answer may repeat this token from the task."""
        if token.value:
            return any(same(known, token.value) is Match.SAME for known in self._values)
        return token.word in self._excused

    def _claims_twice(self, around: Sequence[Token], most: int) -> bool:
        """Whether there are words of the task together with more than ``most`` claiming words."""
        claims = sum(token.word in _CLAIMS for token in around)
        return claims > most and any(map(self._is_excused, around))

    def _is_excused_or_filler(self, piece: Sequence[Token]) -> bool:
        """Whether these tokens are all excused or filler, and the filler is used as such."""
        words = [token.word for token in piece]
        for place, token in enumerate(piece):
            after = words[place + 1] if place + 1 < len(words) else ""
            if token.value or token.word not in self._filler:
                if not self._is_excused(token):
                    return False
                is_rival = token.value and token.value.kinds & self._compared
                if is_rival and not (place and words[place - 1] in QUALIFIERS):  # "under $20"
                    return False
            elif after not in _FILLER_ONLY_BEFORE.get(token.word, (after,)):
                return False
        distinct = set(words)
        if _SITES & distinct and not (_SOURCING | _SEARCHES) & distinct:
            return any(a in _SITES and b in _SHOWS for a, b in pairwise(words))
        return not _QUESTIONS & distinct or bool(_ANSWERS & distinct)

    def _is_filler(self, piece: Sequence[Token]) -> bool:
        """Whether a piece claims nothing: it introduces the answer, or reports the search for it."""
        words = [token.word for token in piece]
        distinct = set(words)
        if not self._is_excused_or_filler(piece) or words[-1] in _PREPOSITIONS | _PRONOUNS:
            return False
        if any(self._is_excused(token) for token in piece):
            is_search = words[0] in _SEARCHES or (words[0] in ("i", "we") and bool(_SEARCHES & distinct))
            return is_search and not _CLAIMS & distinct
        if any(a in _COPULAS and b not in _POINTERS for a, b in pairwise(words)):
            return False  # "it is on"
        if any(a in _SHOWS and b not in _ANSWERS for a, b in pairwise(words)):
            return False
        return bool((_ANSWERS | _SEARCHES | _SOURCING | _CONCLUDING) & distinct) or (
            len(words) > 1 and bool(_CLAIMS & distinct)
        )

    def _names_its_subject(self, piece: _Piece) -> bool:
        """Whether words of the task precede the claim, if there is one: "the owner is Jo"."""
        tokens = self._given[piece.start : piece.end]
        if not piece.spans or not any(token.word in _CLAIMS for token in tokens):
            return True
        before = self._given[piece.start : piece.spans[0][0]]
        after = self._given[piece.spans[-1][1] : piece.end]
        return any(map(self._is_excused, before)) and not any(map(self._is_excused, after))

    def _announces(self, piece: _Piece) -> bool:
        """Whether this piece announces an answer: "Final answer: …"."""
        words_in_piece = {token.word for token in self._given[piece.start : piece.end]}
        return not piece.spans and bool((_ANSWERS | _CLAIMS) & words_in_piece)

    def _introduces(self, words: Sequence[Token], following: _Piece) -> bool:
        """Whether words of the task introduce the claim in the next piece: "On the page of X, it is …"."""
        leading = [token.word for token in words]
        if not following.spans or not self._is_excused_or_filler(words):
            return False
        gap = self._given[following.start].gap
        is_whole = following.spans == [(following.start, following.end)]
        if _CLAIMS & set(leading):  # "The capital of France is: …"
            return gap == "label" and is_whole and not _CLAIMS & set(leading[:-1])
        if leading[0] in _PLACE_PREPOSITIONS:
            claim = [token.word for token in self._given[following.start : following.end]]
            # "To X, named Y" says Y of X.
            return gap == "comma" and bool(_CLAIMS & set(claim)) and claim[0] not in _CLAIMS
        is_name = not any(token.value for token in words)
        return gap == "label" and is_whole and is_name and bool(self._kinds(*following.spans[0]))

    def _kinds(self, start: int, end: int) -> set[str]:
        """The kinds of the value in a span; empty if it is not a single value."""
        value = self._given[start].value
        return value.kinds if value and end == start + 1 else set()

    def _is_claim(self, piece: _Piece) -> bool:
        """Whether the piece claims the text of its spans, and nothing else."""
        edges = [piece.start, *chain.from_iterable(piece.spans), piece.end]
        parts = [self._given[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]
        around = list(chain.from_iterable(parts))
        words = [token.word for token in around]
        if not self._is_excused_or_filler(around) or _SEARCHES & set(words):
            return False
        if self._claims_twice(around, 1) or (_ANSWERS & set(words) and any(map(self._is_excused, around))):
            return False
        if parts[-1] and parts[-1][-1].word in _PREPOSITIONS:
            return False
        kinds = [self._kinds(*span) for span in piece.spans]
        return all(
            self._keeps_meaning(before[::-1], _is_word if kind else _is_never)
            and not any(map(self._is_excused, before[-1:]))
            and self._keeps_meaning(after, self._counts if kind == {"number"} else _is_never)
            and not self._starts_sentence(after)
            for before, after, kind in zip(parts, parts[1:], kinds, strict=False)
        )

    def _counts(self, token: Token) -> bool:
        """Whether the task asks for the number of these."""
        return _is_word(token) and token.word in self._counted

    def _starts_sentence(self, side: Sequence[Token]) -> bool:
        """Whether another sentence begins after a span without punctuation: "43 minutes It is 32 g"."""
        words = [token.word for token in side]
        starts = (at for at, (a, b) in enumerate(pairwise(words)) if a in _PRONOUNS and b in _CLAIMS)
        return any(any(map(self._is_excused, side[at:])) for at in starts)

    def _keeps_meaning(self, side: Sequence[Token], belongs: Callable[[Token], bool]) -> bool:
        """Whether the tokens on one side of a span, nearest first, do not change its meaning.

        A name stands alone: "capital of Paris" and "Paris Texas" are different names. Words of the task may
        precede a value ("opens on 3 May"), and follow a number if the task asks for the number of them.
        """
        words = [token.word for token in side]
        if set(words[:1]) & _JOINERS or set(words[:2]) & QUALIFIERS:
            return False
        claim = next((position for position, word in enumerate(words) if word in _CLAIMS), len(words))
        attached = [token for token in side[:claim] if not belongs(token)]
        return not any(map(self._is_excused, attached))


def _is_word(token: Token) -> bool:
    return token.value is None


def _is_never(_: Token) -> bool:
    return False
