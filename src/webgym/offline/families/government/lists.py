"""Questions about lists of services and meetings of the authorities' websites."""

from __future__ import annotations

from typing import TYPE_CHECKING

from webgym.core.truth import Click, Move, See
from webgym.offline.families._asking import exactly, pages_at_most, shown
from webgym.offline.families._listed import at, how_many, last_page, unfold
from webgym.offline.families.government.catalog import Service
from webgym.offline.families.government.ways import date_of, fee_of, working_days
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream
from webgym.offline.website import slug

if TYPE_CHECKING:
    from webgym.offline.families.government import Government


class Lists:
    """Things to find by filters and orders."""

    def __init__(self, site: Government) -> None:
        self.site = site

    def extreme(self, sort: str, turn: int, *, deeper: bool = False) -> Part | None:
        """The cheapest that is not free, or the fastest, that one or two filters leave."""
        site = self.site
        groups, channels = (facet.options for facet in site.finder.facets[:2])
        options = [
            {"group": a} | ({"channel": b} if turn % 2 else {}) for a, _ in groups for b, _ in channels
        ]
        stream(site.seed, "extreme", sort, turn).shuffle(options)
        for chosen in options:
            found = site.find(**chosen, sort=sort)
            values = [service.fee if sort == "fee" else service.days for service in found]
            if len(found) >= 3 and values[0] != values[1] and values[0]:
                return self._extreme(found, chosen, sort, deeper=deeper)
        return None

    def _extreme(self, found: list[Service], chosen: dict[str, str], sort: str, *, deeper: bool) -> Part:
        site, best = self.site, found[0]
        kind = self._kind(chosen)
        lists, here = site.finder.regex(**chosen), at(site, best)
        if sort == "fee":
            rank, what, text, answer = "costs the least", "fee", site.fee(best), fee_of(site, best)
        else:
            rank, what, answer = "is done the fastest", "processing time in working days", working_days(best)
            text = answer[0]
        facts = [
            Fact(
                f"Of the services that {kind}, the one that {rank} is found",
                (shown(lists, best.name, text), shown(here, best.name, text)),
                answer=(best.name,),
                wrong=tuple(service.name for service in found[1:4]),
            ),
            Fact(
                f"Its {what} is found",
                (shown(lists, best.name, text), shown(here, best.name, text)),
                answer=answer,
            ),
        ]
        moves: list[Move] = [
            Click(path=site.finder.path),
            *site.finder.moves(**chosen, sort=sort),
            See((best.name, text)),
        ]
        says = f"It is {best.name}: {text}"
        if deeper:
            office = best.office.name
            facts.append(
                Fact(
                    "The office that is responsible for it is found", (shown(here, office),), answer=(office,)
                )
            )
            moves += [Click(path=site.href(best)), *unfold(site, "where"), See((office,))]
            says += f", at the {office}"
        asked = f"its {what} and the responsible office" if deeper else f"its {what}"
        return Part(
            f"find out which of the services that {kind} {rank}, and give its name, {asked}"
            if deeper
            else f"find out which of the services that {kind} {rank}, and give its name and {asked}",
            f"The service that {rank}",
            tuple(facts),
            tuple(moves),
            f"{says}.",
        )

    def _kind(self, chosen: dict[str, str]) -> str:
        texts = {
            facet.name: facet.text(chosen[facet.name])
            for facet in self.site.finder.facets
            if facet.name in chosen
        }
        words = {
            "group": f"belong to {texts.get('group')}",
            "channel": f"are applied for {texts.get('channel', '').lower()}",
            "top": f"cost at most {texts.get('top')}",
        }
        return " and ".join(words[name] for name in texts)

    def slowest(self) -> Part | None:
        """The last of an order, on the last page."""
        site = self.site
        found = site.find(sort="days")
        pages = -(-len(found) // site.page_size)
        if pages > pages_at_most(site.look) or found[-1].days == found[-2].days:
            return None
        slow = found[-1]
        answer = working_days(slow)
        here = exactly(site.finder.path)
        seen = (shown(here, slow.name, answer[0]), shown(at(site, slow), slow.name, answer[0]))
        return Part(
            "find out which of all services takes the longest to process, and how many working days",
            "The slowest service",
            (
                Fact(
                    "The service with the longest processing time is found",
                    seen,
                    answer=(slow.name,),
                    wrong=tuple(service.name for service in found[-3:-1]),
                ),
                Fact("Its processing time is found", seen, answer=answer),
            ),
            (
                Click(path=site.finder.path),
                *site.finder.moves(sort="days"),
                *last_page(site, pages),
                See((slow.name, answer[0])),
            ),
            f"It is {slow.name} with {answer[0]}.",
        )

    def count(self, turn: int) -> Part | None:
        """How many services two filters leave."""
        filters = [("group", "channel"), ("group", "top"), ("channel", "top")]
        return how_many(self.site, turn, filters, "services", self._kind)

    def either(self) -> Part | None:
        """Any service of a subject that is free OR fast will do."""
        site = self.site
        for group, text in site.finder.facets[0].options[::-1]:
            found = site.find(group=group, sort="days")
            if len(found) < 4:
                continue
            fast = found[1].days
            good = [service for service in found if service.fee == 0 or service.days <= fast]
            if len(good) == len(found):
                continue
            best, goal = found[0], f"has no fee OR takes at most {fast} working days"
            lists = site.finder.regex(group=group)
            seen = [shown(lists, one.name, site.fee(one), working_days(one)[0]) for one in good]
            seen += [shown(at(site, one), one.name, site.fee(one), working_days(one)[0]) for one in good]
            return Part(
                f"name one service in {text} that {goal}",
                f"A free or a fast service in {text}",
                (
                    Fact(
                        f"A service in {text} is found that {goal}",
                        tuple(seen),
                        answer=tuple(one.name for one in good),
                        wrong=tuple(one.name for one in found if one not in good)[:3],
                    ),
                ),
                (
                    Click(path=site.finder.path),
                    *site.finder.moves(group=group, sort="days"),
                    See((best.name, site.fee(best), working_days(best)[0])),
                ),
                f"{best.name}.",
            )
        return None

    def first_meeting(self) -> Part | None:
        """The oldest meeting of a body."""
        site = self.site
        for body in site.body.council:
            found = site.sittings(body=slug(body), sort="oldest")
            if len(found) < 2:
                continue
            first, here = found[0], site.minutes.regex(body=slug(body))
            path = site.path("/~minutes/{slug}", slug=first.slug)
            return Part(
                f"find out the date of the oldest meeting of the {body} on the website",
                f"Meetings of the {body}",
                (
                    Fact(
                        f"The date of the oldest meeting of the {body} is found",
                        (shown(here, first.title), shown(exactly(path), first.title)),
                        answer=date_of(first.day),
                        wrong=(f"{found[1].day.day} {found[1].day:%B %Y}",),
                    ),
                ),
                (
                    Click(path=site.minutes.path),
                    *site.minutes.moves(body=slug(body), sort="oldest"),
                    See((first.title,)),
                ),
                f"It was on {first.day.day} {first.day:%B %Y}.",
            )
        return None
