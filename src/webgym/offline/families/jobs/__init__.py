"""Job boards of one sector: adverts, employers, pay statistics, applications."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from webgym.offline import names
from webgym.offline.families._finder import STYLES, Facet, Finder
from webgym.offline.families._listed import Listed
from webgym.offline.families.jobs import tasks
from webgym.offline.families.jobs.catalog import (
    CONTRACTS,
    CURRENCIES,
    LEVELS,
    PLACES,
    SHIFTS,
    Account,
    Company,
    Guide,
    Job,
    PayRow,
    make_account,
    make_companies,
    make_guides,
    make_jobs,
    make_pay,
    sector_of,
)
from webgym.offline.families.jobs.words import WORDS, Sector
from webgym.offline.listing import paged
from webgym.offline.parts import Assignment
from webgym.offline.seeds import number, pick, stream
from webgym.offline.website import Response, State, Visit, page, redirect, slug

FREQUENCIES = ("At once", "Every day", "Every week")
EXPERIENCE = ("Less than 2 years", "2 to 5 years", "6 to 10 years", "More than 10 years")
NOTICE = ("Immediately", "In one month", "In three months")

_SAYS: dict[str, tuple[str, ...]] = {
    "search": ("Search jobs", "Job title or keyword", "What do you want to do?", "Find a job"),
    "all": ("Jobs", "All vacancies", "Find work", "Openings"),
    "companies": ("Employers", "Companies", "Who is hiring", "Organisations"),
    "pay": ("Salaries", "Pay check", "What people earn", "Salary table"),
    "advice": ("Advice", "Career guide", "Tips", "Know-how"),
    "alert": ("Job alerts", "Get jobs by e-mail", "Alerts", "Stay informed"),
    "saved": ("Saved jobs", "Shortlist", "My list", "Bookmarks"),
    "mine": ("My applications", "Applications", "Where I applied"),
    "signin": ("Sign in", "Log in", "My account"),
    "save": ("Save job", "Add to shortlist", "Remember this job", "Bookmark"),
    "apply": ("Apply now", "Apply for this job", "Start application", "Apply online"),
    "field": ("Field", "Area", "Department", "Category"),
    "town": ("Location", "Town", "Where", "Place"),
    "place": ("Work from", "Remote work", "Workplace"),
    "shifts": ("Shifts", "Working hours", "Shift pattern"),
    "contract": ("Contract", "Type of contract", "Employment type"),
    "level": ("Level", "Seniority", "Experience level"),
    "floor": ("Pay from", "Minimum salary", "Salary at least"),
    "sort": ("Sort by", "Order", "Sort jobs by"),
    "filter": ("Show jobs", "Apply filters", "Update", "Filter jobs"),
    "paid": ("Highest pay", "Salary, high to low", "Best paid first"),
    "closing": ("Closing soon", "Deadline first", "Ending soonest"),
    "description": ("The job", "Description", "What you will do"),
    "profile": ("Your profile", "Requirements", "What you bring"),
    "terms": ("Conditions", "What we offer", "Terms"),
    "how": ("How to apply", "Contact", "Application process"),
}
"""What websites call things; each takes one phrase of every row."""


@dataclass
class Jobs(Listed):
    """A job board."""

    family: ClassVar[str] = "jobs"
    first_section: ClassVar[str] = "description"
    words: ClassVar[dict[str, tuple[str, ...]]] = {
        "all": ("jobs", "vacancies", "openings", "work"),
        "one": ("job", "vacancy", "v", "posting"),
        "firms": ("companies", "employers", "organisations"),
        "pay": ("salaries", "pay", "earnings"),
        "advice": ("advice", "career-guide", "tips"),
        "alert": ("alerts", "job-alert", "subscribe"),
        "saved": ("saved", "shortlist", "bookmarks"),
        "mine": ("my-applications", "applications", "account"),
        "signin": ("sign-in", "login", "session"),
    }

    sector: str = field(init=False)
    currency: str = field(init=False)
    towns: list[str] = field(init=False)
    companies: tuple[Company, ...] = field(init=False)
    jobs: tuple[Job, ...] = field(init=False)
    pay: dict[str, tuple[PayRow, ...]] = field(init=False)
    guides: tuple[Guide, ...] = field(init=False)
    account: Account = field(init=False)
    guarded: bool = field(init=False)
    """Whether saving a job asks for signing in."""

    @classmethod
    def christen(cls, stem: str, seed: int) -> tuple[str, str]:
        """The second word fits the sector."""
        brand = f"{stem} {pick(WORDS.sectors[cls.sector_of(seed)].suffixes, seed, 'brand')}"
        return brand, slug(brand)

    @staticmethod
    def sector_of(seed: int) -> str:
        """The sector of a website."""
        return pick(sorted(WORDS.sectors), seed, "sector")

    def build(self) -> None:
        """Fill the catalogue."""
        self.domain, self.subdomain = "Career & Education", "Jobs & Career"
        self.sector = self.sector_of(self.seed)
        sector = sector_of(self.sector)
        self.tagline = pick(sector.taglines, self.seed, "tagline")
        self.says = {name: pick(texts, self.seed, "says", name) for name, texts in _SAYS.items()}
        self.currency = pick(CURRENCIES, self.seed, "currency")
        self.towns = sorted(names.towns(stream(self.seed, "towns"), 7))
        self.companies = make_companies(self.seed, sector, self.towns)
        self.jobs = make_jobs(self.seed, sector, self.towns, self.companies)
        self.pay, self.guides = make_pay(self.seed, sector), make_guides(self.seed)
        self.account = make_account(self.seed, self.jobs)
        self.guarded = stream(self.seed, "guarded").random() < 0.5
        self.page_size = pick((8, 10, 12), self.seed, "page size")
        self.finder = self._make_finder(sorted(sector.fields), sector)

    def _make_finder(self, fields: list[str], sector: Sector) -> Finder:
        say = self.says

        def options(texts: Iterable[str]) -> tuple[tuple[str, str], ...]:
            return tuple((slug(text), text) for text in texts)

        floors = [round(sector.pay * factor / 5) * 5000 for factor in (0.8, 1.0, 1.2, 1.4)]
        extra = (
            Facet("contract", say["contract"], options(CONTRACTS)),
            Facet("level", say["level"], options(LEVELS)),
        )
        return Finder(
            path=self.path("/~all"),
            facets=(
                Facet("field", say["field"], options(fields), "All"),
                Facet("town", say["town"], options(self.towns), "Anywhere"),
                Facet("place", say["shifts"], options(SHIFTS))
                if sector.shifts
                else Facet("place", say["place"], options(PLACES)),
                *(extra if pick((True, False), self.seed, "extra") else extra[:1]),
                Facet("floor", say["floor"], tuple((str(n), self.money(n)) for n in dict.fromkeys(floors))),
            ),
            sort=Facet(
                "sort",
                say["sort"],
                (
                    ("newest", "Newest"),
                    ("pay", say["paid"]),
                    ("closing", say["closing"]),
                    ("title", "A to Z"),
                ),
            ),
            style=pick(STYLES, self.seed, "finder"),
            apply=say["filter"],
        )

    def money(self, value: int) -> str:
        """An amount in the board's currency, without cents."""
        return f"{self.currency}{value:,}"

    def menu(self) -> list[tuple[str, str]]:
        """The main navigation."""
        names = {"all": "all", "companies": "firms", "pay": "pay", "advice": "advice"}
        return [(self.says[text], self.path(f"/~{word}")) for text, word in names.items()]

    def report(self, state: State) -> dict[str, Any]:
        """Saved jobs, applications and withdrawals by title; the alert; who is signed in."""
        titles = {job.slug: job.title for job in self.jobs}
        return {
            "saved": {titles[key]: True for key in state.get("saved", [])},
            "applied": {titles[key]: form for key, form in state.get("applied", {}).items()},
            "withdrawn": {titles[key]: True for key in state.get("withdrawn", [])},
            "alert": state.get("alert"),
            "signed in": state.get("account"),
        }

    def assignments(self) -> Iterable[Assignment]:
        """See ``tasks.py``."""
        return tasks.assignments(self)

    # --- finding ---------------------------------------------------------------------------------

    def find(self, **asked: str) -> list[Job]:
        """The jobs that a list with these choices shows, in its order."""
        words = asked.get("q", "").casefold().split()
        found = [
            job
            for job in self.jobs
            if all(word in f"{job.title} {job.company.name} {job.town}".casefold() for word in words)
            and asked.get("field") in (None, slug(job.field))
            and asked.get("town") in (None, slug(job.town))
            and asked.get("place") in (None, slug(job.place))
            and asked.get("contract") in (None, slug(job.contract))
            and asked.get("level") in (None, slug(job.level))
            and job.low >= int(asked.get("floor", "0"))
        ]
        orders: dict[str, Any] = {
            "pay": lambda job: (-job.high, job.title),
            "closing": lambda job: (job.closes, job.title),
            "title": lambda job: job.title,
        }
        newest = sorted(found, key=lambda job: (job.age, job.title))
        return sorted(newest, key=orders[asked["sort"]]) if asked.get("sort") in orders else newest

    def href(self, job: Job) -> str:
        """The address of an advert."""
        return self.path("/~one/{slug}", slug=job.slug)

    def range(self, job: Job) -> str:
        """What a job pays, as the pages write it."""
        return f"{self.money(job.low)} to {self.money(job.high)}"

    def receipt(self, job: Job) -> str:
        """The number that an application for a job gets."""
        return f"A{number(self.seed, 'receipt', job.slug) % 900000 + 100000}"

    def _job(self, key: str) -> Job | None:
        return next((job for job in self.jobs if job.slug == key), None)

    # --- reading ---------------------------------------------------------------------------------

    @page("/")
    def front(self, visit: Visit) -> Response:
        """Newest adverts and ways in."""
        return self.render(
            "jobs/front.html", visit, newest=self.find()[:6], fields=self.finder.facets[0].options
        )

    @page("/~all")
    def listing(self, visit: Visit) -> Response:
        """The filtered list."""
        asked = self.finder.asked(visit)
        return self.render(
            "jobs/listing.html", visit, asked=asked, found=paged(self.find(**asked), visit, self.page_size)
        )

    @page("/~one/{key}")
    def advert(self, visit: Visit, key: str) -> Response:
        """One advert."""
        job = self._job(key)
        if job is None:
            return self.missing(visit)
        return self.render("jobs/job.html", visit, job=job)

    @page("/~firms")
    def company_list(self, visit: Visit) -> Response:
        """All employers."""
        return self.render("jobs/companies.html", visit)

    @page("/~firms/{key}")
    def company(self, visit: Visit, key: str) -> Response:
        """One employer and its adverts."""
        found = next((one for one in self.companies if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        theirs = sorted((job for job in self.jobs if job.company == found), key=lambda job: job.title)
        return self.render("jobs/company.html", visit, company=found, theirs=theirs)

    @page("/~pay")
    def statistics(self, visit: Visit) -> Response:
        """Pay by field, for one level."""
        asked = visit.query.get("level", "")
        level = next((name for name in LEVELS if slug(name) == asked), LEVELS[0])
        options = [(slug(name), name) for name in LEVELS]
        return self.render("jobs/pay.html", visit, level=level, rows=self.pay[level], options=options)

    @page("/~advice")
    def advice(self, visit: Visit) -> Response:
        """All advice."""
        return self.render("jobs/guides.html", visit)

    @page("/~advice/{key}")
    def guide(self, visit: Visit, key: str) -> Response:
        """One piece of advice."""
        found = next((one for one in self.guides if one.slug == key), None)
        if found is None:
            return self.missing(visit)
        return self.render("jobs/guide.html", visit, guide=found)

    # --- the account -----------------------------------------------------------------------------

    @page("/~signin")
    def signin_form(self, visit: Visit) -> Response:
        """An empty form."""
        return self.render("jobs/signin.html", visit, email="", error=None)

    @page("/~signin", method="POST")
    def signin(self, visit: Visit) -> Response:
        """Sign in to the account that there is."""
        email, password = visit.form.get("email", "").strip(), visit.form.get("password", "").strip()
        if (email.casefold(), password) != (self.account.email, self.account.password):
            error = "The e-mail address or the password is wrong."
            return self.render("jobs/signin.html", visit, status=422, email=email, error=error)
        visit.state["account"] = self.account.email
        return redirect(self.path("/~mine"))

    @page("/~signin/out", method="POST")
    def sign_out(self, visit: Visit) -> Response:
        """Sign out."""
        visit.state.pop("account", None)
        return redirect("/")

    @page("/~mine")
    def mine(self, visit: Visit) -> Response:
        """Applications that are under way."""
        if "account" not in visit.state:
            return redirect(self.path("/~signin"))
        gone = visit.state.get("withdrawn", [])
        sent = [(self._job(key), form) for key, form in visit.state.get("applied", {}).items()]
        old = [one for one in self.account.applications if one.job.slug not in gone]
        withdrawn = self._job(visit.query.get("withdrawn", ""))
        return self.render("jobs/mine.html", visit, old=old, sent=sent, withdrawn=withdrawn)

    @page("/~mine", method="POST")
    def withdraw(self, visit: Visit) -> Response:
        """Take an application back."""
        key = visit.form.get("job", "")
        if "account" not in visit.state:
            return redirect(self.path("/~signin"))
        if key not in {one.job.slug for one in self.account.applications}:
            return self.missing(visit)
        gone = visit.state.setdefault("withdrawn", [])
        if key not in gone:
            gone.append(key)
        return redirect(f"{self.path('/~mine')}?withdrawn={key}")

    @page("/~saved")
    def saved(self, visit: Visit) -> Response:
        """Saved jobs."""
        if self.guarded and "account" not in visit.state:
            return redirect(self.path("/~signin"))
        return self.render(
            "jobs/saved.html", visit, found=[self._job(key) for key in visit.state.get("saved", [])]
        )

    @page("/~saved", method="POST")
    def change_saved(self, visit: Visit) -> Response:
        """Save a job, or forget it."""
        if self.guarded and "account" not in visit.state:
            return redirect(self.path("/~signin"))
        job = self._job(visit.form.get("job", ""))
        if job is None:
            return self.missing(visit)
        saved = visit.state.setdefault("saved", [])
        if visit.form.get("forget"):
            visit.state["saved"] = [key for key in saved if key != job.slug]
        elif job.slug not in saved:
            saved.append(job.slug)
        return redirect(self.path("/~saved"))

    # --- forms -----------------------------------------------------------------------------------

    @page("/~one/{key}/apply")
    def apply_form(self, visit: Visit, key: str) -> Response:
        """An empty application."""
        job = self._job(key)
        if job is None:
            return self.missing(visit)
        return self._application(visit, job, {}, {})

    def _application(
        self, visit: Visit, job: Job, values: dict[str, str], errors: dict[str, str], status: int = 200
    ) -> Response:
        lists = {"experience": ("", *EXPERIENCE), "notice": ("", *NOTICE)}
        choices = {name: [(text, text or "Choose…") for text in texts] for name, texts in lists.items()}
        return self.render(
            "jobs/apply.html", visit, status=status, job=job, values=values, errors=errors, choices=choices
        )

    @page("/~one/{key}/apply", method="POST")
    def apply(self, visit: Visit, key: str) -> Response:
        """Take an application, or say what is wrong with it."""
        job = self._job(key)
        if job is None:
            return self.missing(visit)
        names_of = ("experience", "notice", "name", "email", "phone", "reason")
        values = {name: visit.form.get(name, "").strip() for name in names_of}
        errors = {}
        if values["experience"] not in EXPERIENCE:
            errors["experience"] = "Please choose one."
        if values["notice"] not in NOTICE:
            errors["notice"] = "Please choose one."
        if " " not in values["name"]:
            errors["name"] = "Please enter your first and last name."
        if not _is_email(values["email"]):
            errors["email"] = "That does not look like an e-mail address."
        if not re.fullmatch(r"\+?[\d ]{7,16}", values["phone"]):
            errors["phone"] = "Digits and spaces only, at least seven."
        if len(values["reason"]) < 10:
            errors["reason"] = "A few more words, please: at least 10 characters."
        if errors:
            return self._application(visit, job, values, errors, 422)
        visit.state.setdefault("applied", {})[key] = values
        return redirect(self.path("/~one/{key}/sent", key=key))

    @page("/~one/{key}/sent")
    def sent(self, visit: Visit, key: str) -> Response:
        """What was sent."""
        job, values = self._job(key), visit.state.get("applied", {}).get(key)
        if job is None or values is None:
            return self.missing(visit)
        return self.render("jobs/sent.html", visit, job=job, values=values)

    @page("/~alert")
    def alert_form(self, visit: Visit) -> Response:
        """An empty alert."""
        return self._alert(visit, {}, {})

    def _alert(
        self, visit: Visit, values: dict[str, str], errors: dict[str, str], status: int = 200
    ) -> Response:
        fields = [text for _, text in self.finder.facets[0].options]
        lists = {"often": ("", *FREQUENCIES), "field": ("", *fields), "town": ("", *self.towns)}
        choices = {name: [(text, text or "Choose…") for text in texts] for name, texts in lists.items()}
        return self.render(
            "jobs/alert.html", visit, status=status, values=values, errors=errors, choices=choices
        )

    @page("/~alert", method="POST")
    def alert(self, visit: Visit) -> Response:
        """Take an alert, or say what is wrong with it."""
        values = {name: visit.form.get(name, "").strip() for name in ("often", "field", "town", "email")}
        errors = {name: "Please choose one." for name in ("often", "field", "town") if not values[name]}
        if not _is_email(values["email"]):
            errors["email"] = "That does not look like an e-mail address."
        if errors:
            return self._alert(visit, values, errors, 422)
        visit.state["alert"] = values
        return redirect(self.path("/~alert/done"))

    @page("/~alert/done")
    def alert_done(self, visit: Visit) -> Response:
        """What was signed up for."""
        if "alert" not in visit.state:
            return redirect(self.path("/~alert"))
        return self.render("jobs/alerted.html", visit, values=visit.state["alert"])


def _is_email(text: str) -> bool:
    return re.fullmatch(r"[^@\s]+@[^@\s]+\.[a-z]{2,}", text) is not None
