"""Parts that change something on the website, and parts about the website itself."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline.families._phrases import listing, mail_address
from webgym.offline.families.encyclopedia import stock
from webgym.offline.families.encyclopedia.desk import Desk
from webgym.offline.parts import Fact, Part


class Acts(Desk):
    """Writes parts with a reading list, corrections and the newsletter."""

    def save(self, count: int) -> Part | None:
        """Articles put on the reading list."""
        chosen = [article for _ in range(count) if (article := self.fresh()) is not None]
        if len(chosen) < count:
            return None
        site, shelf = self.site, self.site.word("saved")
        moves: list[Move] = []
        facts = []
        for article in chosen:
            notice = f"{article.title} is on your list"
            moves += [*self.open(article), Click(name=site.word("save"), role="button"), See((notice,))]
            proof = (
                Evidence((notice,), self.on_article(article)),
                Evidence((shelf, article.title), self.on(site.path("/~saved"))),
            )
            check = StateCheck(("saved", article.title), value=True)
            facts.append(Fact(f"{article.title} is on the list “{shelf}”", proof, (check,)))
        titles = [article.title for article in chosen]
        return Part(
            ask=f"put the {site.entries} on {listing(titles)} on the list “{shelf}”",
            description=f"{site.entries.capitalize()} on the list “{shelf}”",
            facts=tuple(facts),
            moves=tuple(moves),
        )

    def correct(self) -> Part | None:
        """A correction sent."""
        article = self.fresh()
        if article is None:
            return None
        site = self.site
        measure = self.rng.choice(self.stock.measures)
        sent = {
            "kind": self.rng.choice(stock.KINDS),
            "mail": mail_address(self.rng),
            "text": self.rng.choice(
                (
                    f"Please check the row {measure.label}",
                    f"The source for {measure.label} is gone",
                    f"My own book says otherwise on {measure.label}",
                )
            ),
        }
        path = site.path("/~report/{slug}", slug=article.slug)
        pattern = self.on(f"{path}/thanks")
        what = {
            "kind": f"with “{sent['kind']}” as “{site.word('kind')}”",
            "mail": f"with the e-mail address {sent['mail']}",
            "text": f"with the text “{sent['text']}”",
        }
        entry = f"the {site.word('entry')} on {article.title}"
        thanks = f"Your report on {article.title} has been sent"
        return Part(
            ask=f"use “{site.word('report')}” on {entry}, {listing(list(what.values()))}",
            description=f"Report on {article.title}",
            facts=tuple(
                Fact(
                    f"a report on {entry} is sent {words}",
                    (Evidence((thanks, sent[key]), pattern),),
                    (StateCheck(("reports", article.title, key), sent[key]),),
                )
                for key, words in what.items()
            ),
            moves=(
                *self.open(article),
                Click(path=path),
                Choose(site.word("kind"), sent["kind"]),
                Fill(site.word("mail"), sent["mail"]),
                Fill(site.word("text"), sent["text"]),
                See((thanks, *sent.values())),
            ),
        )

    def subscribe(self) -> Part | None:
        """The newsletter."""
        site = self.site
        sent = {
            "often": self.rng.choice(stock.OFTEN),
            "topic": self.rng.choice(self.stock.groups),
            "mail": mail_address(self.rng),
        }
        what = {
            "often": f"with “{sent['often']}” as “{site.word('often')}”",
            "topic": f"with “{sent['topic']}” as “{site.word('topic')}”",
            "mail": f"for the e-mail address {sent['mail']}",
        }
        name, path = site.word("letter"), site.path("/~letter")
        return Part(
            ask=f"subscribe to the {name} {listing(list(what.values()))}",
            description=f"Subscription to the {name}",
            facts=tuple(
                Fact(
                    f"the {name} is subscribed to {words}",
                    (Evidence(("You are subscribed", sent[key]), self.on(f"{path}/done")),),
                    (StateCheck(("letter", key), sent[key]),),
                )
                for key, words in what.items()
            ),
            moves=(
                Click(path=path),
                Choose(site.word("often"), sent["often"]),
                Choose(site.word("topic"), sent["topic"]),
                Fill(site.word("mail"), sent["mail"]),
                See(("You are subscribed", *sent.values())),
            ),
        )

    def help_topic(self) -> Part | None:
        """A question that the help page answers."""
        topic = self.rng.choice(self.site.topics)
        path = self.site.path("/~help")
        return Part(
            ask=topic.ask,
            description=topic.question,
            facts=(Fact(topic.fact, (Evidence((topic.mark,), self.on(path)),), answer=topic.right),),
            moves=(Click(path=path), Click(name=topic.question), See((topic.mark,))),
            says=topic.answer,
        )
