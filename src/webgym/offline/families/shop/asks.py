"""Tasks of a shop that look up one product: its price, figures, reviews, stock."""

from __future__ import annotations

from webgym.core.truth import Click, Evidence, See
from webgym.offline.families.shop.catalogue import Product
from webgym.offline.families.shop.guide import BEYOND_FRONT, counted, dated, said
from webgym.offline.families.shop.writer import Writer
from webgym.offline.parts import Fact, Part


class Asks(Writer):
    """Questions about one product."""

    def price(self) -> Part | None:
        """What one product costs."""
        product = self.take()
        if product is None:
            return None
        money = self.shop.money(product.cents)
        ask = self.rng.choice(("find out what {} costs", "look up the price of {}", "report the price of {}"))
        return Part(
            ask=ask.format(product.called),
            description=f"Price of {product.called}",
            facts=(
                Fact(
                    f"the price of {product.called} is found",
                    self.guide.priced(product),
                    answer=said(self.shop, product.cents),
                ),
            ),
            moves=(*self.guide.search(product), See((product.name, money))),
            says=f"The price of {product.called} is {money}.",
        )

    def saving(self) -> Part | None:
        """By how much a product is reduced: a computation."""
        product = self.take(lambda p: p.was is not None)
        if product is None or product.was is None:
            return None
        now, was, saved = (
            self.shop.money(c) for c in (product.cents, product.was, product.was - product.cents)
        )
        return Part(
            ask=f"work out by how much {product.called} is reduced",
            description=f"Reduction of {product.called}",
            facts=(
                Fact(
                    f"the difference between the old and the new price of {product.called} is worked out",
                    (Evidence((product.name, now, was), BEYOND_FRONT),),
                    answer=said(self.shop, product.was - product.cents),
                ),
            ),
            moves=(*self.guide.search(product), See((product.name, now, was))),
            says=f"{product.called[0].upper()}{product.called[1:]} is reduced by {saved}.",
        )

    def figures(self, count: int = 1) -> Part | None:
        """One line or several of a product's specifications."""
        product = self.take()
        if product is None:
            return None
        labels = self.rng.sample(list(product.figures), count)
        values = dict(product.facts)
        named = [self.label(label) for label in labels]
        what = " and ".join(filter(None, [", ".join(named[:-1]), named[-1]]))
        seen = tuple(text for label in labels for text in (label, values[label]))
        return Part(
            ask=f"open the page of {product.called} and report from its specifications: {what}",
            description=f"Specifications of {product.called}",
            facts=tuple(
                Fact(
                    f"the {name} of {product.called} is found",
                    self.guide.specified(product, label),
                    answer=(values[label], values[label].replace(" ", "")),
                )
                for label, name in zip(labels, named, strict=True)
            ),
            moves=(
                *self.guide.open(product, browse=self.rng.random() < 0.4),
                *self.guide.section("facts"),
                See(seen),
            ),
            says=" ".join(
                f"The {name} is {values[label]}." for label, name in zip(labels, named, strict=True)
            ),
        )

    def origin(self) -> Part | None:
        """Where a product is made, and what its article number is."""
        product = self.take()
        if product is None:
            return None
        made = dict(product.facts)["Made in"]
        return Part(
            ask=f"find out in which country {product.called} is made, and its article number",
            description=f"Origin of {product.called}",
            facts=(
                Fact(f"the country in which {product.called} is made is found",
                     self.guide.specified(product, "Made in"), answer=(made,)),
                Fact(f"the article number of {product.called} is found",
                     self.guide.specified(product, "Article number"), answer=(str(product.code),)),
            ),
            moves=(*self.guide.open(product), *self.guide.section("facts"), See(("Made in", made))),
            says=f"It is made in {made}; the article number is {product.code}.",
        )  # fmt: skip

    def review(self) -> Part | None:
        """Who wrote the most critical review of a product, and when."""

        def one_worst(product: Product) -> bool:
            stars = sorted(review.stars for review in product.reviews)
            return len(stars) > 2 and stars[0] < stars[1]

        product = self.take(one_worst)
        if product is None:
            return None
        worst = min(product.reviews, key=lambda review: review.stars)
        day = dated(worst.day)[0]
        return Part(
            ask=f"read the reviews of {product.called} and report who gave the fewest stars and on what day",
            description=f"The most critical review of {product.called}",
            facts=(
                Fact(f"the author of the review of {product.called} with the fewest stars is found",
                     (Evidence((worst.author, worst.title), self.guide.detail(product)),),
                     answer=(worst.author,),
                     wrong=tuple(r.author for r in product.reviews if r is not worst)[:3]),
                Fact(f"the date of the review of {product.called} with the fewest stars is found",
                     (Evidence((worst.author, day), self.guide.detail(product)),), answer=dated(worst.day)),
            ),
            moves=(*self.guide.open(product), *self.guide.section("opinions"),
                   See((worst.title, worst.author, day))),
            says=f"{worst.author} gave the fewest stars, on {day}.",
        )  # fmt: skip

    def latest_review(self) -> Part | None:
        """The title of the newest review."""
        product = self.take(lambda p: len(p.reviews) > 2)
        if product is None:
            return None
        newest = product.reviews[0]
        return Part(
            ask=f"find the title of the most recent review of {product.called}",
            description=f"The newest review of {product.called}",
            facts=(
                Fact(f"the title of the most recent review of {product.called} is found",
                     (Evidence((newest.title, newest.author), self.guide.detail(product)),),
                     answer=(newest.title,), wrong=tuple(r.title for r in product.reviews[1:3])),
            ),
            moves=(*self.guide.open(product), *self.guide.section("opinions"),
                   See((newest.title, newest.author))),
            says=f"The most recent review is titled “{newest.title}”.",
        )  # fmt: skip

    def nearby(self) -> Part | None:
        """How many pieces of a product a store has, from the dialog on its page."""
        product = self.take()
        if product is None:
            return None
        store = self.rng.choice(self.shop.stores)
        pieces = self.shop.stock_in(store, product)
        shown = f"{store.town}: {pieces} in stock"
        return Part(
            ask=f"check how many pieces of {product.called} the store in {store.town} has in stock",
            description=f"Stock of {product.called} in {store.town}",
            facts=(
                Fact(f"the number of pieces of {product.called} in the store in {store.town} is found",
                     (Evidence((shown,), self.guide.detail(product)),), answer=counted(pieces)),
            ),
            moves=(*self.guide.open(product), Click(name=self.shop.say["nearby"]), See((shown,))),
            says=f"The store in {store.town} has {pieces} in stock.",
        )  # fmt: skip
