"""Ways through the authorities' websites, and the tasks that leave something on their servers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.families._asking import exactly, shown
from webgym.offline.families.government.catalog import Service
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.government import Government

NOTES = (
    "It has been like this since last week",
    "Somebody nearly got hurt here yesterday",
    "The neighbours have noticed it as well",
    "It gets worse whenever it rains",
)


def go(site: Government, service: Service) -> tuple[Move, ...]:
    """To a service, from anywhere."""
    return Fill(site.says["search"], service.name), Click(path=site.href(service))


class Deeds:
    """Things to do."""

    def __init__(self, site: Government) -> None:
        self.site = site

    def permit(self, turn: int) -> Part:
        """An application, and its number."""
        site = self.site
        rng = stream(site.seed, "permit", turn)
        what, office, name = rng.choice(site.body.permits), rng.choice(site.offices).name, person(rng)
        email = f"{name.lower().replace(' ', '.')}@{rng.choice(('letters', 'mailbox'))}.example"
        street = f"{rng.choice(site.rounds).street} {rng.randint(2, 60)}"
        number = site.receipt("P", what, office)
        here = exactly(site.path("/~permit/done"))
        return Part(
            f"apply for a permit of the kind {what} for {name} ({email}), about {street}, to be "
            "decided at the "
            f"{office}, and give the number of the application",
            f"Permit: {what}",
            (
                Fact(
                    f"A permit of the kind {what}, to be decided at the {office}, is applied for",
                    (shown(here, what, office),),
                    (StateCheck(("permit", "what"), what), StateCheck(("permit", "office"), office)),
                ),
                Fact(
                    f"The application is for {name} ({email}) and about {street}",
                    (shown(here, number, name, email, street),),
                    (
                        StateCheck(("permit", "name"), name),
                        StateCheck(("permit", "email"), email),
                        StateCheck(("permit", "street"), street),
                    ),
                ),
                Fact("The number of the application is found", (shown(here, number),), answer=(number,)),
            ),
            (
                Click(path=site.path("/~permit")),
                Choose("Permit for", what),
                Choose("Decide at", office),
                Fill("Your name", name),
                Fill("Your e-mail", email),
                Fill("Street it is about", street),
                Click(name="Send application", role="button"),
                See((what, office, name, email, street, number)),
            ),
            f"The number is {number}.",
        )

    def trouble(self, turn: int) -> Part:
        """A report, and its number."""
        site = self.site
        rng = stream(site.seed, "trouble", turn)
        what, urgency = rng.choice(site.body.troubles), rng.choice(("Within a week", "Dangerous", "Can wait"))
        street, note = rng.choice(site.rounds).street, rng.choice(NOTES)
        number = site.receipt("R", what, street)
        here = exactly(site.path("/~trouble/done"))
        return Part(
            f'report this problem in {street}: {what}; the urgency is "{urgency}" and the description '
            f'"{note}"; '
            "give the number of the report",
            f"Report: {what}",
            (
                Fact(
                    f"The problem {what} in {street} is reported",
                    (shown(here, number, what, street),),
                    (StateCheck(("trouble", "what"), what), StateCheck(("trouble", "street"), street)),
                ),
                Fact(
                    f'The report has the urgency "{urgency}" and says "{note}"',
                    (shown(here, urgency, note),),
                    (StateCheck(("trouble", "urgency"), urgency), StateCheck(("trouble", "text"), note)),
                ),
                Fact("The number of the report is found", (shown(here, number),), answer=(number,)),
            ),
            (
                Click(path=site.path("/~trouble")),
                Choose("What is it?", what),
                Choose("How urgent?", urgency),
                Fill("Street", street),
                Fill("Describe it", note),
                Click(name="Send report", role="button"),
                See((what, street, urgency, note, number)),
            ),
            f"The number is {number}.",
        )
