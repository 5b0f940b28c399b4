"""Tasks of a shop about its service: delivery, returns, stores."""

from __future__ import annotations

from webgym.core.truth import Click, Evidence, See
from webgym.offline.families.shop.guide import said
from webgym.offline.families.shop.writer import Writer
from webgym.offline.parts import Fact, Part


class Service(Writer):
    """Questions about terms and stores."""

    def _told(self, what: str, shown: str, answer: tuple[str, ...]) -> Fact:
        here = (Evidence((shown,), self.guide.at("/~help")),)
        return Fact(f"{what} is found", here, answer=answer)

    def _terms(self) -> list[tuple[str, str, str, tuple[str, ...], str]]:
        """(what, section of the help page, visible text, answers, sentence)."""
        shop, terms = self.shop, self.shop.terms
        _, second, third = terms.methods
        free, wrapping = shop.whole(terms.free_from), shop.money(terms.wrapping)
        return [
            (
                "the order value from which delivery is free",
                "Delivery",
                f"delivery is free from {free}",
                said(shop, terms.free_from),
                f"Delivery is free from {free}.",
            ),
            (
                f"the price of {second[0]} delivery",
                "Delivery",
                f"{shop.money(second[1])}, {second[2]}",
                said(shop, second[1]),
                f"{second[0]} delivery costs {shop.money(second[1])}.",
            ),
            (
                f"the number of working days that {third[0]} delivery takes",
                "Delivery",
                f"{shop.money(third[1])}, {third[2]}",
                (third[2].split()[0],),
                f"{third[0]} takes {third[2]}.",
            ),
            (
                "the number of days within which goods can be sent back",
                "Sending back",
                f"within {terms.return_days} days",
                (str(terms.return_days),),
                f"Goods can be sent back within {terms.return_days} days.",
            ),
            (
                "the price of gift wrapping",
                "Gift cards and wrapping",
                f"Gift wrapping costs {wrapping}",
                said(shop, terms.wrapping),
                f"Gift wrapping costs {wrapping}.",
            ),
            (
                "the telephone number of customer service",
                "Talk to us",
                f"Telephone: {terms.phone}",
                (terms.phone, terms.phone.replace(" ", "")),
                f"The number is {terms.phone}.",
            ),
        ]

    def term(self) -> Part | None:
        """One of the shop's terms."""
        what, section, shown, answer, says = self.rng.choice(self._terms())
        return Part(
            ask=f"find out {what}",
            description=what[0].upper() + what[1:],
            facts=(self._told(what, shown, answer),),
            moves=(*self.guide.help_section(section), See((shown,))),
            says=says,
        )

    def delivery(self) -> Part | None:
        """Three terms about delivery."""
        chosen = [term for term in self._terms() if term[1] == "Delivery"]
        seen = tuple(shown for _, _, shown, _, _ in chosen)
        whats = [what for what, *_ in chosen]
        return Part(
            ask=f"find out {whats[0]}, {whats[1]} and {whats[2]}",
            description="Terms of delivery",
            facts=tuple(self._told(what, shown, answer) for what, section, shown, answer, _ in chosen),
            moves=(*self.guide.help_section("Delivery"), See(seen)),
            says=" ".join(says for *_, says in chosen),
        )

    def how_to(self) -> Part | None:
        """How to send something back, or how to use a gift card: instructions, so one fact."""
        terms = self.shop.terms
        if self.rng.random() < 0.5:
            what, section, (text, words) = "how to send something back", "Sending back", terms.returns
        else:
            what, section, (text, words) = (
                "how to pay with a gift card",
                "Gift cards and wrapping",
                terms.gift_cards,
            )
        sentence = text.split(". ")[0].removesuffix(".")
        return Part(
            ask=f"find the instructions on {what} and sum them up",
            description=f"Instructions on {what}",
            facts=(
                Fact(
                    f"the instructions on {what} are found",
                    (Evidence((sentence,), self.guide.at("/~help")),),
                    answer=words,
                ),
            ),
            moves=(*self.guide.help_section(section), See((sentence,))),
            says=text,
        )

    # --- stores ---------------------------------------------------------------------------------------

    def sunday(self) -> Part | None:
        """The one store that opens on Sundays."""
        store = next(store for store in self.shop.stores if store.sunday)
        texts = (store.town, "11:00 – 16:00")
        return Part(
            ask="find out which store is open on Sundays",
            description="The store that is open on Sundays",
            facts=(
                Fact(
                    "the store that is open on Sundays is found",
                    (Evidence(texts, self.guide.at("/~stores")),),
                    answer=(store.town,),
                    wrong=tuple(s.town for s in self.shop.stores if s is not store),
                ),
            ),
            moves=(Click(path=self.shop.path("/~stores")), See(texts)),
            says=f"The store in {store.town} is open on Sundays.",
        )

    def early_or_late(self) -> Part | None:
        """The one store that opens early OR closes late."""
        stores = self.shop.stores
        found = []
        for store in stores:
            for early in range(8 * 60, 11 * 60, 30):
                for late in range(17 * 60 + 30, 21 * 60, 30):
                    fits = [s for s in stores if s.opens < early or s.closes > late]
                    if fits == [store] and early <= 9 * 60 + 30 and late >= 18 * 60:
                        found.append((store, early, late))
        if not found:
            return None
        store, early, late = self.rng.choice(found)
        when = f"opens before {self.shop.clock(early)} OR closes after {self.shop.clock(late)} on weekdays"
        hours = f"{self.shop.clock(store.opens)} – {self.shop.clock(store.closes)}"
        return Part(
            ask=f"find the store that {when}",
            description=f"The store that {when}",
            facts=(
                Fact(
                    f"the store that {when} is found",
                    (Evidence((store.town, hours), self.guide.at("/~stores")),),
                    answer=(store.town,),
                    wrong=tuple(s.town for s in stores if s is not store),
                ),
            ),
            moves=(Click(path=self.shop.path("/~stores")), See((store.town, hours))),
            says=f"That is the store in {store.town}.",
        )

    def store(self) -> Part | None:
        """Address, telephone number and Saturday hours of a store."""
        store = self.rng.choice(self.shop.stores)
        here = self.guide.at("/~stores")
        closing = self.shop.clock(store.saturday_closes)
        saturday = f"{self.shop.clock(store.opens)} – {closing}"
        hour = store.saturday_closes // 60
        return Part(
            ask="report the street address, the telephone number and the Saturday closing time of the store "
            f"in {store.town}",
            description=f"The store in {store.town}",
            facts=(
                Fact(
                    f"the street address of the store in {store.town} is found",
                    (Evidence((store.town, store.street), here),),
                    answer=(store.street,),
                ),
                Fact(
                    f"the telephone number of the store in {store.town} is found",
                    (Evidence((store.town, store.phone), here),),
                    answer=(store.phone, store.phone.replace(" ", ""), store.phone.replace(" ", "-")),
                ),
                Fact(
                    f"the Saturday closing time of the store in {store.town} is found",
                    (Evidence((store.town, saturday), here),),
                    answer=(closing, f"{hour - 12} pm", f"{hour - 12}pm", f"{hour - 12} p.m"),
                ),
            ),
            moves=(Click(path=self.shop.path("/~stores")), See((store.town, store.street, store.phone))),
            says=f"{store.street}; telephone {store.phone}; on Saturdays it closes at {closing}.",
        )
