"""Parts that need an account, or that ask about the forum itself."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.families._phrases import figure, listing, mail_address
from webgym.offline.families.forum import stock
from webgym.offline.families.forum.desk import Desk
from webgym.offline.families.forum.schema import Post
from webgym.offline.parts import Fact, Part

REPLIES = (
    "That worked for me as well",
    "Thank you, I will try this tonight",
    "I did the opposite and it went fine",
    "Please keep us up to date on this",
    "Count me in for the next meeting",
)
REMARKS = (
    "This was copied from another site",
    "The link leads to a shop",
    "Nobody should follow this advice",
    "It was posted twice within an hour",
)
TITLES = (
    "Looking for company on Sundays",
    "Where do you store everything?",
    "What would you change if you began again?",
    "A question about the rules of the club",
)
TEXTS = (
    "I am new here and would like to hear from you",
    "There must be somebody who knows this better",
    "Any hint is welcome, also by private message",
)
SUBJECTS = ("Your last post", "A small favour", "Meeting in June", "The old handbook")


class Acts(Desk):
    """Writes parts with replies, likes, votes, messages and settings."""

    def reply(self) -> Part | None:
        """Follow a thread and reply in it."""
        thread = self.fresh(list(self.stock.threads))
        if thread is None:
            return None
        site, text = self.site, self.rng.choice(REPLIES)
        page, title = self.on_thread(thread), thread.title
        following = f"you follow “{title}”"
        return Part(
            ask=f"{self.signing_in()}, then choose “{site.word('follow')}” in {self.quoted(thread)} and post "
            f"the reply “{text}” there",
            description=f"Follow {self.quoted(thread)} and reply",
            facts=(
                self.signed_in(),
                Fact(
                    f"{self.quoted(thread)} is followed",
                    (
                        Evidence((following,), page),
                        Evidence(("You follow", title), self.on(site.path("/~me"))),
                        Evidence(("Following",), page),
                    ),
                    (StateCheck(("follows", title), value=True),),
                ),
                Fact(
                    f"the reply “{text}” is posted in {self.quoted(thread)}",
                    (Evidence(("just now", text), page),),
                    (StateCheck(("replies", title), text),),
                ),
            ),
            moves=(
                *self.sign_in(),
                *self.find(thread),
                Click(name=site.word("follow"), role="button"),
                See((following,)),
                Fill(site.word("answer"), text),
                See(("just now", text)),
            ),
        )

    def start(self) -> Part | None:
        """Start a thread."""
        site = self.site
        sent = {
            "board": self.rng.choice(self.stock.boards)[0],
            "title": self.rng.choice(TITLES),
            "text": self.rng.choice(TEXTS),
        }
        page = site.path("/~thread/mine-")
        labels = {"title": site.word("title"), "text": site.word("text")}
        what = {
            "board": f"on the board “{sent['board']}”",
            "text": f"with “{sent['text']}” as “{labels['text']}”",
        }
        title = sent["title"]
        return Part(
            ask=f"{self.signing_in()} and start a new {self.thread_word} with the title “{title}” "
            f"{listing(list(what.values()))}",
            description=f"New {self.thread_word} “{title}”",
            facts=(
                self.signed_in(),
                *(
                    Fact(
                        f"the {self.thread_word} “{title}” is started {words}",
                        (Evidence((title, "Started by you", sent[key]), page),),
                        (StateCheck(("threads", title, key), sent[key]),),
                    )
                    for key, words in what.items()
                ),
            ),
            moves=(
                *self.sign_in(),
                self.go("new"),
                Choose("Board", sent["board"]),
                Fill(labels["title"], title),
                Fill(labels["text"], sent["text"]),
                See(("Started by you", *sent.values())),
            ),
        )

    def like(self) -> Part | None:
        """Like two posts of a thread."""
        thread = self.fresh([thread for thread in self.stock.threads if len(thread.replies) > 1])
        if thread is None:
            return None
        posts = self.rng.sample(thread.replies[: self.site.per_page], 2)
        page, moves = self.on_thread(thread), [*self.sign_in(), *self.find(thread)]
        facts = [self.signed_in()]
        for post in posts:
            name = post.author.name
            said = f"You like what {name} wrote"
            moves += [Click(name=f"{self.site.word('like')} {name}", role="button"), See((said,))]
            facts.append(self._liked(thread.title, post, said, page))
        names = listing([post.author.name for post in posts])
        return Part(
            ask=f"{self.signing_in()} and choose “{self.site.word('like')}” for the replies by {names} in "
            f"{self.quoted(thread)}",
            description=f"Replies in {self.quoted(thread)} that are liked",
            facts=tuple(facts),
            moves=tuple(moves),
        )

    def _liked(self, title: str, post: Post, said: str, page: str) -> Fact:
        name = post.author.name
        return Fact(
            f"the reply by {name} in the {self.thread_word} “{title}” is liked",
            (Evidence((said,), page), Evidence((name, "Liked by you"), page)),
            (StateCheck(("likes", title, name), value=True),),
        )

    def flag(self) -> Part | None:
        """Report a thread to the moderators."""
        thread = self.fresh(list(self.stock.threads))
        if thread is None:
            return None
        site, page = self.site, self.on_thread(thread)
        sent = {"reason": self.rng.choice(stock.REASONS), "text": self.rng.choice(REMARKS)}
        name = site.word("report")
        button = Click(name=name, role="button") if site.modal else Click(
            path=site.thread_path(thread, "/report"))  # fmt: skip
        what = {
            "reason": f"with “{sent['reason']}” as “{site.word('reason')}”",
            "text": f"with “{sent['text']}” as “{site.word('remark')}”",
        }
        said = (f"Reported as {sent['reason']}", sent["text"])
        return Part(
            ask=f"{self.signing_in()} and use “{name}” on {self.quoted(thread)} "
            f"{listing(list(what.values()))}",
            description=f"Report of {self.quoted(thread)}",
            facts=(
                self.signed_in(),
                *(
                    Fact(
                        f"{self.quoted(thread)} is reported {words}",
                        (Evidence(said[:1] if key == "reason" else said, page),),
                        (StateCheck(("reports", thread.title, key), sent[key]),),
                    )
                    for key, words in what.items()
                ),
            ),
            moves=(
                *self.sign_in(),
                *self.find(thread),
                button,
                Choose(site.word("reason"), sent["reason"]),
                Fill(site.word("remark"), sent["text"]),
                See(said),
            ),
        )

    def vote(self) -> Part | None:
        """Vote in a poll."""
        thread = self.fresh([thread for thread in self.stock.threads if thread.poll])
        if thread is None or thread.poll is None:
            return None
        option = self.rng.choice(thread.poll.options)[0]
        said = f"You voted for “{option}”"
        return Part(
            ask=f"{self.signing_in()} and vote for “{option}” in the poll in {self.quoted(thread)}",
            description=f"Vote in {self.quoted(thread)}",
            facts=(
                self.signed_in(),
                Fact(
                    f"a vote for “{option}” in {self.quoted(thread)} is cast",
                    (Evidence((said,), self.on_thread(thread)),),
                    (StateCheck(("votes", thread.title), option),),
                ),
            ),
            moves=(
                *self.sign_in(),
                *self.find(thread),
                Click(name=option, role="radio"),
                Click(name=self.site.word("vote"), role="button"),
                See((said,)),
            ),
        )

    def letter(self) -> Part | None:
        """Read a private message."""
        place = self.rng.randrange(len(self.stock.messages))
        message = self.stock.messages[place]
        path = self.site.path("/~inbox")
        number = int("".join(char for char in message.mark if char.isdigit()))
        inbox = self.site.word("inbox")
        return Part(
            ask=f"{self.signing_in()} and find out in “{inbox}” which number {message.sender.name} mentions "
            f"in the message “{message.subject}”",
            description=f"Message from {message.sender.name}",
            facts=(
                self.signed_in(),
                Fact(
                    f"the number in the message “{message.subject}” from {message.sender.name} is found",
                    (Evidence((message.mark,), self.on(f"{path}/{place + 1}")),),
                    answer=figure(number),
                ),
            ),
            moves=(
                *self.sign_in(),
                Click(path=path),
                Click(path=f"{path}/{place + 1}"),
                See((message.mark,)),
            ),
            says=f"{message.sender.name} writes: {message.text}",
        )

    def write(self) -> Part | None:
        """Write a private message."""
        user = self.fresh_user()
        if user is None:
            return None
        site, page = self.site, self.on_user(user)
        sent = {"subject": self.rng.choice(SUBJECTS), "text": self.rng.choice(REPLIES)}
        said = f"Sent to {user.name}: “{sent['subject']}”"
        labels = {"subject": site.word("subject"), "text": site.word("text")}
        moves: list[Move] = [*self.sign_in(), *self.open_user(user)]
        moves += [Fill(label, sent[key]) for key, label in labels.items()]
        return Part(
            ask=f"{self.signing_in()} and send the member {user.name} a private message with "
            f"“{sent['subject']}” as “{labels['subject']}” and “{sent['text']}” as “{labels['text']}”",
            description=f"Private message to {user.name}",
            facts=(
                self.signed_in(),
                *(
                    Fact(
                        f"a message to {user.name} is sent with “{sent[key]}” as “{label}”",
                        (Evidence((said, sent[key]), page),),
                        (StateCheck(("messages", user.name, key), sent[key]),),
                    )
                    for key, label in labels.items()
                ),
            ),
            moves=(*moves, See((said, sent["text"]))),
        )

    def digest(self) -> Part | None:
        """Change a setting."""
        choice = self.rng.choice(stock.DIGESTS[1:])
        name = self.site.word("digest")
        said = f"Your choice was saved: {choice}"
        return Part(
            ask=f"{self.signing_in()} and set “{name}” to “{choice}” on the account's page",
            description=f"“{name}” of the account",
            facts=(
                self.signed_in(),
                Fact(
                    f"“{name}” is set to “{choice}”",
                    (Evidence((said,), self.on(self.site.path("/~me"))),),
                    (StateCheck(("digest",), choice),),
                ),
            ),
            moves=(
                *self.sign_in(),
                Choose(name, choice),
                Click(name="Save settings", role="button"),
                See((said,)),
            ),
        )

    def join(self) -> Part | None:
        """Register."""
        site = self.site
        name = self.rng.choice(("Quiet", "Early", "Merry", "Plain", "Brisk")) + self.rng.choice(names.SECOND)
        sent = {"home": self.rng.choice(self.stock.boards)[0], "name": name, "mail": mail_address(self.rng)}
        page = self.on(f"{site.path('/~join')}/done")
        labels = {"home": site.word("home"), "name": site.word("name"), "mail": site.word("mail")}
        return Part(
            ask=f"register a new account with “{sent['home']}” as “{labels['home']}”, the name {name} and "
            f"the e-mail address {sent['mail']}",
            description="New account",
            facts=tuple(
                Fact(
                    f"an account is registered with “{sent[key]}” as “{label}”",
                    (Evidence(("We have sent a link to your address", sent[key]), page),),
                    (StateCheck(("joined", key), sent[key]),),
                )
                for key, label in labels.items()
            ),
            moves=(
                self.go("join"),
                Choose(labels["home"], sent["home"]),
                Fill(labels["name"], name),
                Fill(labels["mail"], sent["mail"]),
                See(("We have sent a link to your address", name, sent["mail"], sent["home"])),
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
