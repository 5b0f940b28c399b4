"""Questions about the calendar, the fee calculator, cases and minutes of the authorities' websites."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Fill, Move, See
from webgym.offline.families._asking import exactly, shown
from webgym.offline.families.government.catalog import MONTHS, Decision, Meeting
from webgym.offline.families.government.ways import date_of, paid
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.government import Government


class Papers:
    """Things to look up in what the authority does."""

    def __init__(self, site: Government) -> None:
        self.site = site
        self.rng = stream(site.seed, "papers")
        self._rounds = iter(self.rng.sample(site.rounds, len(site.rounds)))
        self._cases = iter(self.rng.sample(site.cases, len(site.cases)))

    def next_dates(self, how_many: int) -> Part:
        """When something comes by in a street."""
        site = self.site
        found = next(self._rounds)
        path = site.path("/~rounds")
        pairs = list(zip(site.body.rounds[1], found.days, strict=True))
        pairs = pairs if how_many > 1 else [self.rng.choice(pairs)]
        pairs = pairs[:how_many]
        here = rf"{re.escape(path)}\?(?:.*&)?street="
        heading = f"Next dates in {found.street}"
        texts = [f"{day.day} {day:%B %Y}" for _, day in pairs]
        names = [kind.lower() for kind, _ in pairs]
        listed = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        look_up: Move = (
            Fill("Your street", found.street) if site.typed else Choose("Your street", found.street)
        )
        return Part(
            f"find out from the calendar by street the next date in {found.street} for {listed}"
            if len(names) == 1
            else f"find out from the calendar by street the next dates in {found.street} for {listed}",
            f"Dates in {found.street}",
            tuple(
                Fact(
                    f"The next date for {kind.lower()} in {found.street} is found",
                    (shown(here, heading, kind, text),),
                    answer=date_of(day),
                )
                for (kind, day), text in zip(pairs, texts, strict=True)
            ),
            (Click(path=path), look_up, See((heading, *(kind for kind, _ in pairs), *texts))),
            f"{'; '.join(f'{kind}: {text}' for (kind, _), text in zip(pairs, texts, strict=True))}.",
        )

    def _calculated(self, place: str, kind: str, months: int) -> tuple[int, str, tuple[Move, ...], str]:
        """Fee, pattern of the result's address, moves, and what is shown."""
        site = self.site
        fee = site.tariff[place, kind, months]
        path = site.path("/~price")
        asked = {"place": slug(place), "kind": slug(kind), "months": str(months)}
        wanted = "".join(rf"(?=(?:.*&)?{name}={value}(?:&|$))" for name, value in asked.items())
        here = rf"{re.escape(path)}\?{wanted}"
        moves = (
            Choose("Where", place),
            Choose("What", kind),
            Choose("For how long", f"{months} months"),
            Click(name="Calculate", role="button"),
        )
        return fee, here, moves, f"{site.money(fee)} in all"

    def price(self) -> Part:
        site, rng = self.site, self.rng
        name, places, kinds = site.body.price
        place, kind, months = rng.choice(places), rng.choice(kinds), rng.choice(MONTHS)
        fee, here, moves, text = self._calculated(place, kind, months)
        return Part(
            f"work out with the fee calculator what this costs for {months} months: {name.lower()}, "
            f"{place}, {kind}",
            "Fee calculator",
            (
                Fact(
                    f"The fee for {place}, {kind}, {months} months is calculated",
                    (shown(here, text),),
                    answer=paid(site, fee),
                ),
            ),
            (Click(path=site.path("/~price")), *moves, See((text,))),
            f"It costs {site.money(fee)}.",
        )

    def prices(self) -> Part:
        """Two fees and their difference."""
        site, rng = self.site, self.rng
        name, places, kinds = site.body.price
        place, months = rng.choice(places), rng.choice(MONTHS)
        low, high = kinds[0], kinds[-1]
        less, less_at, first, less_text = self._calculated(place, low, months)
        more, more_at, second, more_text = self._calculated(place, high, months)
        seen = (shown(less_at, less_text), shown(more_at, more_text))
        return Part(
            f"work out with the fee calculator ({name.lower()}, {place}, {months} months) the fees "
            f"for {low} and for "
            f"{high}, and their difference",
            "Fees compared",
            (
                Fact(f"The fee for {low} is calculated", seen[:1], answer=paid(site, less)),
                Fact(f"The fee for {high} is calculated", seen[1:], answer=paid(site, more)),
                Fact("The difference is worked out", seen, answer=paid(site, more - less)),
            ),
            (
                Click(path=site.path("/~price")),
                *first,
                See((less_text,)),
                Choose("What", high),
                second[-1],
                See((more_text,)),
            ),
            f"{low}: {site.money(less)}, {high}: {site.money(more)}, difference {site.money(more - less)}.",
        )

    def case(self) -> Part:
        """Stage and officer of a case."""
        site = self.site
        case = next(self._cases)
        path = site.path("/~track")
        here = rf"{re.escape(path)}\?(?:.*&)?number=(?i:{re.escape(case.number)})"
        return Part(
            f"look up the case {case.number} and give its stage and the name of the case officer",
            f"Case {case.number}",
            (
                Fact(
                    f"The stage of the case {case.number} is found",
                    (shown(here, case.stage),),
                    answer=(case.stage,),
                ),
                Fact(
                    f"The officer of the case {case.number} is found",
                    (shown(here, case.officer),),
                    answer=(case.officer,),
                ),
            ),
            (Click(path=path), Fill("Case number", case.number), See((case.stage, case.officer))),
            f"Its stage is: {case.stage}. The case officer is {case.officer}.",
        )

    # --- minutes ---------------------------------------------------------------------------------

    def _sitting(self, meeting: Meeting) -> tuple[str, tuple[Move, ...]]:
        """A meeting among the newest of its body, so that it is on the first page."""
        site = self.site
        path = site.path("/~minutes/{slug}", slug=meeting.slug)
        return exactly(path), (
            Click(path=site.minutes.path),
            *site.minutes.moves(body=slug(meeting.body)),
            Click(path=path),
        )

    def _meetings(self) -> list[Meeting]:
        found = []
        for body in self.site.body.council:
            found += self.site.sittings(body=slug(body))[:6]
        self.rng.shuffle(found)
        return found

    def vote(self) -> Part:
        """The votes on a matter."""
        meeting = self._meetings()[0]
        item = self.rng.choice(meeting.decisions)
        here, moves = self._sitting(meeting)
        ayes, noes = f"{item.ayes} for", f"{item.noes} against"
        when = f"{meeting.day.day} {meeting.day:%B %Y}"
        return Part(
            f"find out from the minutes of the {meeting.body} of {when} how many voted for and how "
            "many against the "
            f'matter "{item.matter}"',
            f"Vote on {item.matter}",
            (
                Fact(
                    f'The number of votes for "{item.matter}" is found',
                    (shown(here, item.matter, ayes),),
                    answer=_votes(item.ayes, "for", "in favour", "votes for"),
                ),
                Fact(
                    f'The number of votes against "{item.matter}" is found',
                    (shown(here, item.matter, noes),),
                    answer=_votes(item.noes, "against", "opposed", "votes against"),
                ),
            ),
            (*moves, See((item.matter, ayes, noes))),
            f"{item.ayes} for, {item.noes} against.",
        )

    def rejected(self) -> Part | None:
        """The one matter of a meeting that went differently from the others."""
        for meeting in self._meetings():
            odd = self._odd(meeting)
            if odd is None:
                continue
            result = "carried" if odd.carried else "rejected"
            here, moves = self._sitting(meeting)
            when = f"{meeting.day.day} {meeting.day:%B %Y}"
            return Part(
                f"find out from the minutes of the {meeting.body} of {when} which matter was "
                f"{'not rejected' if odd.carried else 'not carried'}",
                f"Decisions of {when}",
                (
                    Fact(
                        f"The matter that was {'not rejected' if odd.carried else 'not carried'} is found",
                        (shown(here, odd.matter, result),),
                        answer=(odd.matter,),
                        wrong=tuple(one.matter for one in meeting.decisions if one != odd),
                    ),
                ),
                (*moves, See((odd.matter, result))),
                f"{odd.matter}.",
            )
        return None

    @staticmethod
    def _odd(meeting: Meeting) -> Decision | None:
        for result in (False, True):
            found = [one for one in meeting.decisions if one.carried is result]
            if len(found) == 1 and len(meeting.decisions) > 2:
                return found[0]
        return None

    def minutes(self) -> Part:
        """Chair, presence and a proposer."""
        meeting = self._meetings()[0]
        item = self.rng.choice(meeting.decisions)
        here, moves = self._sitting(meeting)
        when, present = f"{meeting.day.day} {meeting.day:%B %Y}", f"{meeting.present} members present"
        return Part(
            f"look up in the minutes of the {meeting.body} of {when} who was in the chair, how many "
            "members were "
            f'present and who proposed the matter "{item.matter}"',
            f"Minutes of {when}",
            (
                Fact(
                    "Who was in the chair is found",
                    (shown(here, "Chair", meeting.chair),),
                    answer=(meeting.chair,),
                ),
                Fact(
                    "How many members were present is found",
                    (shown(here, present),),
                    answer=(str(meeting.present),),
                ),
                Fact(
                    f'Who proposed "{item.matter}" is found',
                    (shown(here, item.matter, item.proposer),),
                    answer=(item.proposer,),
                ),
            ),
            (*moves, See((meeting.chair, present, item.matter, item.proposer))),
            f"{meeting.chair} was in the chair, {meeting.present} members were present, "
            f"{item.proposer} proposed it.",
        )


def _votes(value: int, *words: str) -> tuple[str, ...]:
    return (
        tuple(f"{value} {word}" for word in words)
        + tuple(f"{word}: {value}" for word in words)
        + (str(value),)
    )
