"""Parts that are solved by reading threads and profiles."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Move, See
from webgym.offline.families._phrases import day_texts, figure, listing
from webgym.offline.families.forum.desk import Desk
from webgym.offline.families.forum.schema import Post, Thread, User
from webgym.offline.parts import Fact, Part


class Reads(Desk):
    """Writes parts about known threads and members."""

    # --- a thread ---------------------------------------------------------------------------------------

    def about_thread(self, count: int) -> Part | None:
        """What the head of a thread says."""
        thread = self.fresh(list(self.stock.threads))
        if thread is None:
            return None
        page, lists = self.on_thread(thread), self.on_lists()
        what = self.quoted(thread)
        day = day_texts(thread.opening.when.date())
        readable = [
            ("who started it", "the member who started {}", (thread.author.name,),
             ((f"Started by {thread.author.name}",), (thread.title, thread.author.name))),
            ("on which day it was started", "the day on which {} was started", day,
             ((f"on {day[0]}",), (thread.title, day[0]))),
            ("how many views it has", "the number of views of {}", figure(thread.views),
             ((f"{thread.views:,} views",), (thread.title, f"{thread.views:,}"))),
            ("on which board it stands", "the board of {}", (thread.board,),
             ((thread.title, thread.board), (thread.title, thread.board))),
            (f"which {self.site.word('tag').lower()} it carries", "the tag of {}", (thread.tag,),
             ((f"{self.site.word('tag')}: {thread.tag}",),
              (thread.title, f"by {thread.author.name}", thread.tag))),
        ]  # fmt: skip
        chosen = [readable[row] for row in sorted(self.rng.sample(range(len(readable)), count))]
        return Part(
            ask=f"open {what} and find out {listing([words for words, *_ in chosen])}",
            description=f"Head of {what}",
            facts=tuple(
                Fact(
                    f"{fact.format(what)} is found",
                    (Evidence(inside, page), Evidence(outside, lists)),
                    answer=answer,
                )
                for _, fact, answer, (inside, outside) in chosen
            ),
            moves=(*self.open(thread), *(See(proof[0]) for *_, proof in chosen)),
            says=f"“{thread.title}”: {', '.join(answer[0] for _, _, answer, _ in chosen)}.",
        )

    def _asked(self) -> list[Thread]:
        return [thread for thread in self.stock.threads if thread.question and thread.replies]

    def _said(self, thread: Thread, reply: Post) -> tuple[Evidence, ...]:
        return (Evidence((reply.author.name, reply.mark), self.on_thread(thread)),)

    def says(self, *, later: bool = False) -> Part | None:
        """The number that a member recommends; on a later page, if asked for."""
        found = [
            (thread, reply)
            for thread in self._asked()
            for reply in thread.replies
            if reply.mark and (self.site.page_of(thread, reply) > 1) == later
        ]
        thread = self.fresh([thread for thread, _ in found])
        if thread is None or thread.question is None:
            return None
        reply = self.rng.choice([reply for other, reply in found if other is thread])
        name = reply.author.name
        return Part(
            ask=f"find out {thread.question.ask} {name} says in {self.quoted(thread)}",
            description=f"What {name} says in {self.quoted(thread)}",
            facts=(
                Fact(
                    f"the number that {name} gives in {self.quoted(thread)} is found",
                    self._said(thread, reply),
                    answer=_number(reply),
                ),
            ),
            moves=(*self.open(thread), *self.turn_to(thread, reply), See((name, reply.mark))),
            says=f"{name} says {reply.mark}.",
        )

    def _solved(self) -> list[tuple[Thread, Post]]:
        return [(thread, thread.solution) for thread in self._asked() if thread.solution is not None]

    def solution(self) -> Part | None:
        """The accepted answer."""
        thread = self.fresh([thread for thread, _ in self._solved()])
        if thread is None or thread.solution is None:
            return None
        reply, best = thread.solution, self.site.word("accepted")
        proof = (Evidence((best, reply.author.name, reply.mark), self.on_thread(thread)),)
        return Part(
            ask=f"find out who wrote the reply marked as “{best}” in {self.quoted(thread)}, and which "
            "number it gives",
            description=f"“{best}” in {self.quoted(thread)}",
            facts=(
                Fact(f"the author of the “{best}” in {self.quoted(thread)} is found", proof,
                     answer=(reply.author.name,)),
                Fact(f"the number given in the “{best}” is found", proof, answer=_number(reply)),
            ),
            moves=(*self.open(thread), *self.turn_to(thread, reply), See(proof[0].texts)),
            says=f"{reply.author.name}: {reply.mark}.",
        )  # fmt: skip

    def expert(self) -> Part | None:
        """The author of the accepted answer, and two rows of their profile."""
        thread = self.fresh([thread for thread, _ in self._solved()])
        if thread is None or thread.solution is None:
            return None
        reply, best = thread.solution, self.site.word("accepted")
        user, day = reply.author, day_texts(reply.author.joined)
        if user.name in self.taken:
            return None
        self.taken.add(user.name)
        members = self.on(self.site.path("/~members"))
        return Part(
            ask=f"find out who wrote the reply marked as “{best}” in {self.quoted(thread)}, and from that "
            "member's profile where they live and when they joined",
            description=f"Author of the “{best}” in {self.quoted(thread)}",
            facts=(
                Fact(
                    f"the author of the “{best}” in {self.quoted(thread)} is found",
                    (Evidence((best, user.name), self.on_thread(thread)),),
                    answer=(user.name,),
                ),
                Fact(
                    "the place where that member lives is found",
                    (Evidence(("Lives in", user.town), self.on_user(user)),),
                    answer=(user.town,),
                ),
                Fact(
                    "the day on which that member joined is found",
                    (
                        Evidence(("Joined", day[0]), self.on_user(user)),
                        Evidence((user.name, day[0]), members),
                    ),
                    answer=day,
                ),
            ),
            moves=(
                *self.open(thread),
                *self.turn_to(thread, reply),
                See((best, user.name)),
                Click(path=self.site.user_path(user)),
                See((day[0], user.town)),
            ),
            says=f"{user.name}, {user.town}, joined on {day[0]}.",
        )

    def favourite(self) -> Part | None:
        """The reply with the most likes."""
        threads = [t for t in self.stock.threads if len(t.replies) > 3]
        thread = self.fresh(threads)
        if thread is None:
            return None
        reply = max(thread.replies, key=lambda one: one.likes)
        likes = self.site.word("likes")
        said = f"{reply.likes} {likes}"
        proof = (Evidence((reply.author.name, said), self.on_thread(thread)),)
        return Part(
            ask=f"find out whose reply in {self.quoted(thread)} has the most {likes}, and how many",
            description=f"Reply with the most {likes} in {self.quoted(thread)}",
            facts=(
                Fact(f"the author of the reply with the most {likes} is found", proof,
                     answer=(reply.author.name,)),
                Fact(f"the number of {likes} of that reply is found", proof, answer=figure(reply.likes)),
            ),
            moves=(
                *self.open(thread),
                Choose(self.site.word("order"), self.site.word("top")),
                See((reply.author.name, said)),
            ),
            says=f"{reply.author.name} with {said}.",
        )  # fmt: skip

    def latest(self) -> Part | None:
        """The last reply of a thread."""
        thread = self.fresh([t for t in self.stock.threads if len(t.replies) > self.site.per_page])
        if thread is None:
            return None
        reply = thread.latest
        day = day_texts(reply.when.date())
        proof = (
            Evidence((reply.author.name, day[0]), self.on_thread(thread)),
            Evidence((thread.title, f"by {reply.author.name}", day[0]), self.on_lists()),
        )
        return Part(
            ask=f"find out who wrote the latest reply in {self.quoted(thread)}, and on which day",
            description=f"Latest reply in {self.quoted(thread)}",
            facts=(
                Fact("the author of the latest reply is found", proof, answer=(reply.author.name,)),
                Fact("the day of the latest reply is found", proof, answer=day),
            ),
            moves=(
                *self.open(thread),
                Choose(self.site.word("order"), self.site.word("newest")),
                See((reply.author.name, day[0])),
            ),
            says=f"{reply.author.name} on {day[0]}.",
        )

    def highest(self) -> Part | None:
        """The member who gives the largest number, on a thread of one page."""
        found = []
        for thread in self._asked():
            marked = [reply for reply in thread.replies if reply.mark]
            if len(marked) > 2 and len(thread.replies) <= self.site.per_page:
                found.append(thread)
        chosen = self.fresh(found)
        if chosen is None:
            return None
        marked = sorted((r for r in chosen.replies if r.mark), key=_amount, reverse=True)
        reply = marked[0]
        return Part(
            ask=f"find out which member gives the largest number in {self.quoted(chosen)}, and what number",
            description=f"Largest number in {self.quoted(chosen)}",
            facts=(
                Fact(
                    f"the member with the largest number in {self.quoted(chosen)} is found",
                    self._said(chosen, reply),
                    answer=(reply.author.name,),
                    wrong=tuple(other.author.name for other in marked[1:4]),
                ),
                Fact("that number is found", self._said(chosen, reply), answer=_number(reply)),
            ),
            moves=(*self.open(chosen), See((reply.author.name, reply.mark))),
            says=f"{reply.author.name} says {reply.mark}.",
        )

    def price(self) -> Part | None:
        """What something for sale is to cost."""
        thread = self.fresh([thread for thread in self.stock.threads if thread.price])
        if thread is None:
            return None
        said = f"{thread.price} dollars"
        return Part(
            ask=f"find out how many dollars are asked for in {self.quoted(thread)}, and who is selling",
            description=f"Offer in {self.quoted(thread)}",
            facts=(
                Fact("the price is found", (Evidence((said,), self.on_thread(thread)),),
                     answer=figure(thread.price)),
                Fact(
                    "the seller is found",
                    (
                        Evidence((f"Started by {thread.author.name}",), self.on_thread(thread)),
                        Evidence((said, thread.author.name), self.on_thread(thread)),
                        Evidence((thread.title, thread.author.name), self.on_lists()),
                    ),
                    answer=(thread.author.name,),
                ),
            ),
            moves=(*self.open(thread), See((said, thread.author.name))),
            says=f"{thread.author.name} asks for {said}.",
        )  # fmt: skip

    def poll(self) -> Part | None:
        """The option that leads a poll."""
        thread = self.fresh([thread for thread in self.stock.threads if thread.poll])
        if thread is None or thread.poll is None:
            return None
        # The other options are no wrong answers: what they name may stand in the titles of threads.
        option, votes = max(thread.poll.options, key=lambda one: one[1])
        said = f"{votes} votes"
        proof = (Evidence((option, said), self.on_thread(thread)),)
        return Part(
            ask=f"find out which option leads the poll in {self.quoted(thread)}, and with how many votes",
            description=f"Poll in {self.quoted(thread)}",
            facts=(
                Fact("the option with the most votes is found", proof, answer=(option,)),
                Fact("its number of votes is found", proof, answer=figure(votes)),
            ),
            moves=(*self.open(thread), See((option, said))),
            says=f"{option} with {said}.",
        )  # fmt: skip

    # --- members ----------------------------------------------------------------------------------------

    def _rows(self, user: User) -> list[tuple[str, str, str, tuple[str, ...], bool]]:
        """(what, label, value, answers, whether the list of members shows it) of a profile."""
        likes = self.site.word("likes")
        day = day_texts(user.joined)
        return [
            ("the day of joining", "Joined", day[0], day, True),
            ("the number of posts", "Posts", f"{user.posts:,}", figure(user.posts), True),
            (f"the number of {likes}", likes, f"{user.thanks:,}", figure(user.thanks), True),
            ("the place where the member lives", "Lives in", user.town, (user.town,), False),
        ]

    def _row_proof(self, user: User, label: str, value: str, *, listed: bool) -> tuple[Evidence, ...]:
        proof: tuple[Evidence, ...] = (Evidence((label, value), self.on_user(user)),)
        if listed:
            proof += (Evidence((user.name, value), self.on(self.site.path("/~members"))),)
        return proof

    def profile(self, count: int) -> Part | None:
        """Some rows of a profile."""
        user = self.fresh_user()
        if user is None:
            return None
        rows = self._rows(user)
        chosen = [rows[row] for row in sorted(self.rng.sample(range(len(rows)), count))]
        return Part(
            ask=f"open the profile of the member {user.name} and give "
            f"{listing([what for what, *_ in chosen])}",
            description=f"Profile of {user.name}",
            facts=tuple(
                Fact(
                    f"{what} of {user.name} is found",
                    self._row_proof(user, label, value, listed=listed),
                    answer=answer,
                )
                for what, label, value, answer, listed in chosen
            ),
            moves=(*self.open_user(user), See(tuple(value for _, _, value, _, _ in chosen))),
            says=f"{user.name}: {', '.join(value for _, _, value, _, _ in chosen)}.",
        )

    def setup(self) -> Part | None:
        """What stands in another section of a profile."""
        user = self.fresh_user()
        if user is None:
            return None
        name = self.site.word("setup")
        moves: list[Move] = self.open_user(user)
        if self.site.look.detail == "tabs":
            moves.append(Click(name=name, role="tab"))
        elif self.site.look.detail == "accordion":
            moves.append(Click(name=name))
        proof = (Evidence((f"{user.favourite} since {user.since}",), self.on_user(user)),)
        return Part(
            ask=f"find out what the favourite of {user.name} is according to “{name}” in the profile, and "
            "since which year",
            description=f"“{name}” of {user.name}",
            facts=(
                Fact(f"the favourite of {user.name} is found", proof, answer=(user.favourite,)),
                Fact("the year since when is found", proof, answer=(str(user.since),)),
            ),
            moves=(*moves, See(proof[0].texts)),
            says=f"{user.name}: {user.favourite} since {user.since}.",
        )

    def gap(self) -> Part | None:
        """The posts of two members, and what lies between."""
        first, second = self.fresh_user(), self.fresh_user()
        if first is None or second is None:
            return None
        pair = (first, second)
        between = abs(first.posts - second.posts)
        proofs = [self._row_proof(user, "Posts", f"{user.posts:,}", listed=True) for user in pair]
        facts = [
            Fact(f"the number of posts of {user.name} is found", proof, answer=figure(user.posts))
            for user, proof in zip(pair, proofs, strict=True)
        ]
        computed = Fact(
            "the difference between the two is given", proofs[0] + proofs[1], answer=figure(between)
        )
        moves: list[Move] = []
        for user in pair:
            moves += [*self.open_user(user), See(("Posts", f"{user.posts:,}"))]
        return Part(
            ask=f"give the number of posts of {first.name} and of {second.name}, and the difference between "
            "the two",
            description=f"Posts of {first.name} and {second.name}",
            facts=(*facts, computed),
            moves=tuple(moves),
            says=f"{first.name}: {first.posts:,}, {second.name}: {second.posts:,}, difference: {between:,}.",
        )


def _amount(reply: Post) -> int:
    digits = "".join(char for char in reply.mark if char.isdigit())
    return int(digits)


def _number(reply: Post) -> tuple[str, ...]:
    return figure(_amount(reply))
