"""Answers that are sentences around reference answers: which parts are claims, and which are filler."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, pairwise, zip_longest
from typing import Final, NamedTuple, TypeAlias

import msgspec

from webgym.judge.value_comparison import Match, equal, one_equal, same, units_of
from webgym.judge.values import Text, Token

Spans: TypeAlias = dict[int, int]
"""Where items stand among tokens: the first token to the one behind the last."""


class RuleFinding(msgspec.Struct, frozen=True):
    """The result of a rule, and the reason."""

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
"""Words that deny, hedge or give up; that the task has one, too, is no excuse."""

_CHOICES: Final = frozenset("or besides except excluding versus vs than unlike instead neither not".split())
"""Words of a task that weighs candidates."""

_COUNTING: Final = frozenset({"many", "number", "count"})
_COUNTED_WORDS: Final = 5
"""Words of a task behind "how many" that may name what is counted."""
_COPULAS: Final = frozenset("is are was were its thats heres".split())
_CLAIMS: Final = _COPULAS | frozenset(
    "has have had costs cost equals called named titled found shows says states".split()
)
_ANSWERS: Final = frozenset("answer answers result results solution response".split())
_PREPOSITIONS: Final = frozenset("to of for in on at by with from".split())
_PLACING: Final = _PREPOSITIONS - {"to", "of"}
"""They say where a claim holds: "on the page of X, it is Y". "To X, it is Y" names two things."""
_PRONOUNS: Final = frozenset("it this that these those there here what which who i we my your".split())
_SAID_AGAIN: Final = _CLAIMS | _NEGATIONS | {"do", "does", "did"}
_JOINERS: Final = frozenset("with of to from".split())
"""Words that make one thing of what stands on both sides."""
_CUTS: Final = frozenset({"and", "then"})
_SO: Final = frozenset("so thus therefore hence boxed".split())
_SEARCHES: Final = frozenset("searched looked checked opened visited navigated browsed".split())
_SHOWS: Final = frozenset({"says", "shows", "states"})
_GROUNDS: Final = frozenset("according based".split())
_SITES: Final = frozenset("page pages website site webpage screen screenshot information".split())
_QUESTIONS: Final = frozenset("task question query".split())
_LOOSE: Final = frozenset("as follows following final do does did the".split())
_TALK: Final = frozenset().union(
    *(_CLAIMS, _ANSWERS, _PREPOSITIONS, _PRONOUNS, _SO, _SEARCHES, _GROUNDS, _SITES, _QUESTIONS, _LOOSE)
)
"""Words with which an answer is given. A reference of such words alone is left to a model."""
_POINTERS: Final = _ANSWERS | frozenset("final what as follows following my your".split())
"""What may follow "is" where no answer does: "this is what I found"."""


_ONLY_BEFORE: Final = {"final": _ANSWERS, "i": _CLAIMS | _SEARCHES}
"""What else may be an answer: a state, a numeral."""


class _Piece(NamedTuple):
    """A piece of an answer: first token, the one behind the last, and the spans in it."""

    start: int
    end: int
    spans: list[tuple[int, int]]


_END: Final = Token("", gap="strong")


class SentenceAnswer:
    """An answer, read as a sentence around reference answers.

    Args:
        task: what was asked.
        wanted: what must be found in the answer, all of it.
        given: the answer.
    """

    def __init__(self, task: Text, wanted: Sequence[Sequence[Token]], given: Sequence[Token]) -> None:
        self._wanted = wanted
        self._given = given
        self._asked = units_of(task)
        words = {token.word for token in task.tokens if token.value is None}
        # A task that names the answer, or what is not it, names candidates: no word of it is an excuse.
        is_named = bool(_CHOICES & words) or any(self._places(item, task.tokens) for item in wanted)
        self._compared = {
            kind for item in wanted for token in item if token.value for kind in token.value.kinds
        }
        self._talk = _TALK - ((_SITES | _QUESTIONS) & words) if is_named else _TALK
        plain = {word for word in words if not any(map(str.isdigit, word))}  # a code is a candidate
        forms = {form for word in plain for form in (word, f"{word}s", word.removesuffix("s"))}
        self._excused = frozenset() if is_named else frozenset(forms - _TALK - REFUSED)
        said = [token.word for token in task.tokens]
        starts = [at + 1 for at, word in enumerate(said) if word in _COUNTING]
        self._counted = frozenset(chain.from_iterable(said[at : at + _COUNTED_WORDS] for at in starts))
        self._values = () if is_named else tuple(token.value for token in task.tokens if token.value)

    def is_all(self) -> bool:
        """Whether the answer claims everything that is wanted, and nothing else."""
        spans: Spans = {}
        covered: set[int] = set()
        for item in sorted(self._wanted, key=len, reverse=True):
            if all(token.value is None and token.word in _TALK for token in item):
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
        """Whether the answer's only value is another."""
        assert wanted.value is not None
        found = [
            place
            for place, token in enumerate(self._given)
            if token.value and not any(same(known, token.value) is Match.SAME for known in self._values)
        ]
        if len(found) != 1 or not self._claims_only({found[0]: found[0] + 1}):
            return RuleFinding(Match.UNSURE, "the answer does not plainly give one value")
        value = self._given[found[0]].value
        assert value is not None
        match = same(wanted.value, value, self._asked)
        said = {
            Match.SAME: "the answer gives the same value",
            Match.DIFFERENT: "the answer gives another value",
            Match.UNSURE: "the answer gives a value that cannot be compared",
        }
        return RuleFinding(match, said[match])

    def truth(self, wanted: str) -> RuleFinding:
        """A yes or a no, if nothing around it can be anything else; the question may be said again."""
        at = next((at for at, token in enumerate(self._given) if token.word in TRUTHS), None)
        if at is None:
            return RuleFinding(Match.UNSURE, "the answer is no plain yes or no")
        first, before, rest = self._given[at], self._given[:at], self._given[at + 1 :]
        is_yes, words = TRUTHS[first.word], {token.word for token in rest}
        is_restated, is_denied = bool(words & self._excused), bool(words & _NEGATIONS)
        allowed = self._talk | self._excused if is_yes else self._talk | self._excused | _NEGATIONS
        if (
            (before and not self._is_talk(before))
            or any(token.value or token.word not in allowed or token.word in TRUTHS for token in rest)
            or words & {"find", "found", "see", "know"}
            or (rest and rest[0].gap == "none" and rest[0].word not in _AFTER_TRUTH)
            or (is_restated and (is_denied == is_yes or not words & _SAID_AGAIN))
        ):
            return RuleFinding(Match.UNSURE, "the answer is no plain yes or no")
        if is_yes == TRUTHS[wanted]:
            return RuleFinding(Match.SAME, f"the answer says {first.word}")
        return RuleFinding(Match.DIFFERENT, f"the answer says {first.word}, not {wanted}")

    def _places(self, item: Sequence[Token], text: Sequence[Token]) -> list[int]:
        """Where the item stands."""
        if len(item) == 1 and (value := item[0].value) is not None:
            return [
                at
                for at, token in enumerate(text)
                if token.value and same(value, token.value, self._asked) is Match.SAME
            ]
        starts = range(len(text) - len(item) + 1)
        return [at for at in starts if all(map(one_equal, item, text[at : at + len(item)]))]

    # --- pieces ---------------------------------------------------------------------------------------

    def _claims_only(self, spans: Spans) -> bool:
        """Whether what stands at these spans is all that is claimed."""
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
                leads = bool(following) and not is_announced and self._leads(words, following)
                is_fine = leads or self._is_talk(words)
            if not is_fine:
                return False
        return True

    def _pieces(self, spans: Spans) -> list[_Piece]:
        """The answer, cut at every gap that is not within a span."""
        pieces: list[_Piece] = []
        start = last = 0
        held: list[tuple[int, int]] = []
        for at, token in enumerate([*self._given, _END]):
            is_word = token.word in _CUTS and at >= last
            if is_word or (token.gap != "none" and (at >= last or at in spans)):
                if start < at:
                    pieces.append(_Piece(start, at, held))
                start, held = at + is_word, []
            if at in spans:
                last = spans[at]
                held.append((at, last))
        return pieces

    def _is_excused(self, token: Token) -> bool:
        """Whether the task says it, and it is not the answer."""
        if token.value:
            return any(same(known, token.value) is Match.SAME for known in self._values)
        return token.word in self._excused

    def _claims_twice(self, around: Sequence[Token], most: int) -> bool:
        """Whether words of the task stand with more claims than may be made."""
        claims = sum(token.word in _CLAIMS for token in around)
        return claims > most and any(map(self._is_excused, around))

    def _is_ours(self, piece: Sequence[Token]) -> bool:
        """Whether these tokens are all the task's or talk, and talk that is used as such."""
        words = [token.word for token in piece]
        for place, token in enumerate(piece):
            after = words[place + 1] if place + 1 < len(words) else ""
            if token.value or token.word not in self._talk:
                if not self._is_excused(token):
                    return False
                is_rival = token.value and token.value.kinds & self._compared
                if is_rival and not (place and words[place - 1] in QUALIFIERS):  # "under $20"
                    return False
            elif after not in _ONLY_BEFORE.get(token.word, (after,)):
                return False
        said = set(words)
        if _SITES & said and not (_GROUNDS | _SEARCHES) & said:
            return any(a in _SITES and b in _SHOWS for a, b in pairwise(words))
        return not _QUESTIONS & said or bool(_ANSWERS & said)

    def _is_talk(self, piece: Sequence[Token]) -> bool:
        """Whether a piece claims nothing: it speaks of the answer, or of the search for it."""
        words = [token.word for token in piece]
        said = set(words)
        if not self._is_ours(piece) or words[-1] in _PREPOSITIONS | _PRONOUNS:
            return False
        if any(self._is_excused(token) for token in piece):
            is_search = words[0] in _SEARCHES or (words[0] in ("i", "we") and bool(_SEARCHES & said))
            return is_search and not _CLAIMS & said
        if any(a in _COPULAS and b not in _POINTERS for a, b in pairwise(words)):
            return False  # "it is on"
        if any(a in _SHOWS and b not in _ANSWERS for a, b in pairwise(words)):
            return False
        return bool((_ANSWERS | _SEARCHES | _GROUNDS | _SO) & said) or (
            len(words) > 1 and bool(_CLAIMS & said)
        )

    def _names_its_subject(self, piece: _Piece) -> bool:
        """Whether words of the task stand in front of the claim, if there is one: "the owner is Jo"."""
        said = self._given[piece.start : piece.end]
        if not piece.spans or not any(token.word in _CLAIMS for token in said):
            return True
        before = self._given[piece.start : piece.spans[0][0]]
        after = self._given[piece.spans[-1][1] : piece.end]
        return any(map(self._is_excused, before)) and not any(map(self._is_excused, after))

    def _announces(self, piece: _Piece) -> bool:
        """Whether an answer is due behind this piece: "Final answer: …"."""
        said = {token.word for token in self._given[piece.start : piece.end]}
        return not piece.spans and bool((_ANSWERS | _CLAIMS) & said)

    def _leads(self, words: Sequence[Token], following: _Piece) -> bool:
        """Whether words of the task lead to the claim in the next piece: "On the page of X, it is …"."""
        said = [token.word for token in words]
        if not following.spans or not self._is_ours(words):
            return False
        gap = self._given[following.start].gap
        is_whole = following.spans == [(following.start, following.end)]
        if _CLAIMS & set(said):  # "The capital of France is: …"
            return gap == "label" and is_whole and not _CLAIMS & set(said[:-1])
        if said[0] in _PLACING:
            claim = [token.word for token in self._given[following.start : following.end]]
            # "To X, named Y" says Y of X.
            return gap == "comma" and bool(_CLAIMS & set(claim)) and claim[0] not in _CLAIMS
        is_name = not any(token.value for token in words)
        return gap == "label" and is_whole and is_name and bool(self._kinds(*following.spans[0]))

    def _kinds(self, start: int, end: int) -> set[str]:
        """What a span may be an amount of; nothing where it is no value."""
        value = self._given[start].value
        return value.kinds if value and end == start + 1 else set()

    def _is_claim(self, piece: _Piece) -> bool:
        """Whether the piece claims what its spans say, and nothing of it is a second claim."""
        edges = [piece.start, *chain.from_iterable(piece.spans), piece.end]
        parts = [self._given[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True)]
        around = list(chain.from_iterable(parts))
        words = [token.word for token in around]
        if not self._is_ours(around) or _SEARCHES & set(words):
            return False
        if self._claims_twice(around, 1) or (_ANSWERS & set(words) and any(map(self._is_excused, around))):
            return False
        if parts[-1] and parts[-1][-1].word in _PREPOSITIONS:
            return False
        kinds = [self._kinds(*span) for span in piece.spans]
        return all(
            self._is_apart(before[::-1], _is_word if kind else _is_never)
            and not any(map(self._is_excused, before[-1:]))
            and self._is_apart(after, self._counts if kind == {"number"} else _is_never)
            and not self._begins_anew(after)
            for before, after, kind in zip(parts, parts[1:], kinds, strict=False)
        )

    def _counts(self, token: Token) -> bool:
        """Whether the task asks how many of these there are."""
        return _is_word(token) and token.word in self._counted

    def _begins_anew(self, side: Sequence[Token]) -> bool:
        """Whether another sentence follows a span without a gap: "43 minutes It is 32 g"."""
        words = [token.word for token in side]
        starts = (at for at, (a, b) in enumerate(pairwise(words)) if a in _PRONOUNS and b in _CLAIMS)
        return any(any(map(self._is_excused, side[at:])) for at in starts)

    def _is_apart(self, side: Sequence[Token], belongs: Callable[[Token], bool]) -> bool:
        """Whether what stands on one side of a span, the nearest first, leaves it as it is.

        A name stands alone: "capital of Paris" and "Paris Texas" are others. A value may be led to by words
        of the task ("opens on 3 May"), and a number may count what the task asks the number of.
        """
        words = [token.word for token in side]
        if set(words[:1]) & _JOINERS or set(words[:2]) & QUALIFIERS:
            return False
        claim = next((place for place, word in enumerate(words) if word in _CLAIMS), len(words))
        beside = [token for token in side[:claim] if not belongs(token)]
        return not any(map(self._is_excused, beside))


def _is_word(token: Token) -> bool:
    return token.value is None


def _is_never(_: Token) -> bool:
    return False
