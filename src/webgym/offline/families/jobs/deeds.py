"""Ways through the job boards, and the tasks that leave something on their servers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from webgym.core.truth import Choose, Click, Fill, Move, See, StateCheck
from webgym.offline.families._asking import exactly, shown
from webgym.offline.families.jobs.catalog import Job
from webgym.offline.names import person
from webgym.offline.parts import Fact, Part
from webgym.offline.seeds import stream

if TYPE_CHECKING:
    from webgym.offline.families.jobs import Jobs

REASONS = (
    "I have done this work for years and still enjoy it",
    "Your team was recommended to me by a former colleague",
    "I live around the corner and know the town well",
    "I am looking for a place to stay and to grow",
)


def go(site: Jobs, job: Job) -> tuple[Move, ...]:
    """To an advert, from anywhere."""
    return Fill(site.says["search"], job.title), Click(path=site.href(job))


def named(job: Job) -> str:
    """How a task calls an advert."""
    return f"{job.title} at {job.company.name}"


class Deeds:
    """Things to do."""

    def __init__(self, site: Jobs) -> None:
        self.site = site
        self.rng = stream(site.seed, "deeds")

    def _signin(self) -> tuple[Move, ...]:
        account = self.site.account
        return (
            Click(path=self.site.path("/~signin")),
            Fill("E-mail", account.email),
            Fill("Password", account.password),
            Click(name="Continue", role="button"),
        )

    @property
    def _credentials(self) -> str:
        account = self.site.account
        return f"sign in as {account.email} with the password {account.password}"

    def apply(self, job: Job) -> Part:
        """An application, and the number of its receipt."""
        site, rng = self.site, self.rng
        name, reason = person(rng), rng.choice(REASONS)
        email = f"{name.lower().replace(' ', '.')}@{rng.choice(('letters', 'mailbox'))}.example"
        phone = f"0{rng.randint(200, 799)} {rng.randint(100000, 999999)}"
        experience = rng.choice(("2 to 5 years", "6 to 10 years", "More than 10 years"))
        notice = rng.choice(("Immediately", "In one month", "In three months"))
        here, key = exactly(site.path("/~one/{key}/sent", key=job.slug)), ("applied", job.title)
        receipt = site.receipt(job)
        return Part(
            f"apply for the job {named(job)} as {name} ({email}, telephone {phone}) with "
            f"{experience.lower()} "
            f'of experience, able to start {notice.lower()}, giving the reason "{reason}", and tell me the '
            "number of the receipt",
            f"Application for {job.title}",
            (
                Fact(
                    f"An application for {job.title} is sent for {name} at {email}",
                    (shown(here, "Application sent", job.title, name, email),),
                    (
                        StateCheck((*key, "name"), name),
                        StateCheck((*key, "email"), email),
                        StateCheck((*key, "phone"), phone),
                        StateCheck((*key, "reason"), reason),
                    ),
                ),
                Fact(
                    f"It states {experience.lower()} of experience and a start {notice.lower()}",
                    (shown(here, experience, notice),),
                    (StateCheck((*key, "experience"), experience), StateCheck((*key, "notice"), notice)),
                ),
                Fact("The number of the receipt is found", (shown(here, receipt),), answer=(receipt,)),
            ),
            (
                *go(site, job),
                Click(path=f"{site.href(job)}/apply"),
                Choose("Experience", experience),
                Choose("You can start", notice),
                Fill("Full name", name),
                Fill("E-mail address", email),
                Fill("Telephone", phone),
                Fill("Why you?", reason),
                Click(name="Send application", role="button"),
                See(("Application sent", job.title, name, email, experience, notice, receipt)),
            ),
            f"The receipt has the number {receipt}.",
        )

    def alert(self, turn: int) -> Part:
        """A job alert."""
        site = self.site
        rng = stream(site.seed, "alert", turn)
        field = rng.choice(site.finder.facets[0].options)[1]
        town, often = rng.choice(site.towns), rng.choice(("Every day", "Every week", "At once"))
        email = f"{person(rng).lower().replace(' ', '.')}@mailbox.example"
        here = exactly(site.path("/~alert/done"))
        return Part(
            f"set up a job alert for {email} that brings jobs in {field} near {town}, sent {often.lower()}",
            "Job alert",
            (
                Fact(
                    f"A job alert goes to {email}",
                    (shown(here, "Your alert is on", email),),
                    (StateCheck(("alert", "email"), email),),
                ),
                Fact(
                    f"The alert is for jobs in {field} near {town}",
                    (shown(here, field, town),),
                    (StateCheck(("alert", "field"), field), StateCheck(("alert", "town"), town)),
                ),
                Fact(
                    f"The alert is sent {often.lower()}",
                    (shown(here, often),),
                    (StateCheck(("alert", "often"), often),),
                ),
            ),
            (
                Click(path=site.path("/~alert")),
                Choose("Jobs in", field),
                Choose("Near", town),
                Choose("How often", often),
                Fill("Send to", email),
                Click(name="Start the alert", role="button"),
                See(("Your alert is on", email, field, town, often)),
            ),
        )

    def save(self, job: Job) -> Part:
        """A saved job; after signing in where the board asks for it."""
        site = self.site
        saved = Fact(
            f"{job.title} is saved",
            (shown(exactly(site.path("/~saved")), site.says["saved"], job.title),),
            (StateCheck(("saved", job.title), True),),
        )
        moves = (*go(site, job), Click(name=site.says["save"], role="button"), See((job.title,)))
        if not site.guarded:
            return Part(f"save the job {named(job)} for later", "Saved jobs", (saved,), moves)
        return Part(
            f"{self._credentials} and save the job {named(job)} for later",
            "Saved jobs",
            (self._signed_in(), saved),
            (*self._signin(), See((site.account.email,)), *moves),
        )

    def _signed_in(self) -> Fact:
        email = self.site.account.email
        return Fact(
            f"Someone is signed in as {email}",
            (shown(exactly(self.site.path("/~mine")), f"Signed in as {email}"),),
            (StateCheck(("signed in",), email),),
        )

    def status(self) -> Part:
        """How far an application has come."""
        site = self.site
        one = self.rng.choice(site.account.applications)
        day = f"{one.next_day.day} {one.next_day:%b %Y}"
        here = exactly(site.path("/~mine"))
        return Part(
            f"{self._credentials} and find out at which stage the application for {one.job.title} is "
            "and on what "
            "date it goes on",
            f"The application for {one.job.title}",
            (
                self._signed_in(),
                Fact(
                    f"The stage of the application for {one.job.title} is found",
                    (shown(here, one.job.title, one.stage),),
                    answer=(one.stage,),
                    wrong=tuple(other.stage for other in site.account.applications if other != one),
                ),
                Fact(
                    f"The next date of the application for {one.job.title} is found",
                    (shown(here, one.job.title, day),),
                    answer=(
                        day,
                        f"{one.next_day.day} {one.next_day:%B}",
                        f"{one.next_day:%B} {one.next_day.day}",
                    ),
                ),
            ),
            (*self._signin(), See((one.job.title, one.stage, day))),
            f"Its stage is: {one.stage}. It goes on on {day}.",
        )

    def withdraw(self) -> Part:
        """An application taken back."""
        site = self.site
        stages = {one.stage: one.job for one in site.account.applications}
        stage, job = sorted(stages.items())[0]
        here = exactly(site.path("/~mine"))
        return Part(
            f'{self._credentials} and withdraw the application that is at the stage "{stage}"',
            "Withdrawn application",
            (
                self._signed_in(),
                Fact(
                    f'The application at the stage "{stage}" is withdrawn',
                    (shown(here, f"Your application for {job.title} was withdrawn"),),
                    (StateCheck(("withdrawn", job.title), True),),
                ),
            ),
            (
                *self._signin(),
                See((job.title, stage, f"Signed in as {site.account.email}")),
                Click(name=f"Withdraw {job.title}", role="button"),
                See((f"Your application for {job.title} was withdrawn",)),
            ),
        )
