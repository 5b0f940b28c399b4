"""Tasks of a shop that choose among products, count them or compare them."""

from __future__ import annotations

from collections.abc import Sequence

from webgym.core.truth import Click, Evidence, Move, See
from webgym.offline.families.shop.catalogue import Product
from webgym.offline.families.shop.guide import counted, said
from webgym.offline.families.shop.schema import Figure
from webgym.offline.families.shop.shelf import Order, price_steps
from webgym.offline.families.shop.writer import Writer
from webgym.offline.parts import Fact, Part

HUNDRED = 100


class Choices(Writer):
    """Questions about several products."""

    def _named(self, product: Product, text: str, evidence: tuple[Evidence, ...],
               rivals: Sequence[Product]) -> Fact:  # fmt: skip
        wrong = tuple(rival.name for rival in rivals if rival != product)[:2]
        return Fact(text, evidence, answer=(product.name,), wrong=wrong)

    def extreme(self) -> Part | None:
        """The cheapest or dearest product of a category, and its price."""
        name = self.category(lambda members: len(members) > 2)
        if name is None:
            return None
        order: Order = self.rng.choice(("cheap", "cheap", "dear"))
        word = "cheapest" if order == "cheap" else "most expensive"
        best, *rivals = self.guide.first(self.guide.members(name), order, 3)
        money = self.shop.money(best.cents)
        texts = (best.name, money)
        sorted_either_way = self.guide.shelves(None, order="cheap|dear")
        proof = (Evidence(texts, sorted_either_way), *self.guide.whole(name, texts))
        return Part(
            ask=f"find the {word} product in the category {name} and report its name and price",
            description=f"The {word} product in {name}",
            facts=(
                self._named(best, f"the {word} product in {name} is found", proof, rivals),
                Fact(f"the price of the {word} product in {name} is found", self.guide.priced(best),
                     answer=said(self.shop, best.cents)),
            ),
            moves=(self.guide.shelf(name), self.guide.sort(order), See(texts)),
            says=f"The {word} product in {name} is {best.called}, at {money}.",
        )  # fmt: skip

    def best_rated(self) -> Part | None:
        """The product with the best rating in a category."""

        def clear(members: list[Product]) -> bool:
            ratings = sorted((p.rating or 0 for p in members), reverse=True)
            return len(ratings) > 2 and ratings[0] > ratings[1]

        name = self.category(clear)
        if name is None:
            return None
        best, *rivals = self.guide.first(self.guide.members(name), "best", 3)
        texts = (best.name, str(best.rating))
        proof = (Evidence(texts, self.guide.shelves(None, order="best")), *self.guide.whole(name, texts))
        return Part(
            ask=f"find the product in the category {name} with the best customer rating",
            description=f"The best rated product in {name}",
            facts=(self._named(best, f"the best rated product in {name} is found", proof, rivals),),
            moves=(self.guide.shelf(name), self.guide.sort("best"), See(texts)),
            says=f"The best rated product in {name} is {best.called}.",
        )

    def by_maker(self) -> Part | None:
        """Filter a category by maker, sort, and look at the cheapest: name, price and a figure."""
        pairs = [
            (c.name, maker)
            for c in self.shop.categories
            for maker in sorted({p.maker for p in self.guide.members(c.name)})
            if 2
            <= sum(p.maker == maker for p in self.guide.members(c.name))
            < len(self.guide.members(c.name))
        ]
        if not pairs:
            return None
        name, maker = self.rng.choice(pairs)
        members = [p for p in self.guide.members(name) if p.maker == maker]
        best, *rivals = self.guide.first(members, "cheap", 3)
        label = self.rng.choice(list(best.figures))
        value, money = dict(best.facts)[label], self.shop.money(best.cents)
        texts = (best.name, money)
        proof = (
            Evidence(texts, self.guide.filtered(name, "maker", maker)),
            Evidence(texts, self.guide.shelves(None, order="cheap|dear")),
            *self.guide.whole(name, texts),
        )
        which = f"the cheapest product by {maker} in {name}"
        return Part(
            ask=f"among the products by {maker} in the category {name}, find the cheapest one and report its "
            f"name, its price and its {self.label(label)}",
            description=f"The cheapest product by {maker} in {name}",
            facts=(
                self._named(best, f"{which} is found", proof, rivals),
                Fact(f"the price of {which} is found", self.guide.priced(best),
                     answer=said(self.shop, best.cents)),
                Fact(f"the {self.label(label)} of {which} is found", self.guide.specified(best, label),
                     answer=(value, value.replace(" ", ""))),
            ),
            moves=(
                self.guide.shelf(name),
                *self.guide.filter(("maker", maker)),
                self.guide.sort("cheap"),
                See(texts),
                Click(path=self.shop.address(best)),
                *self.guide.section("facts"),
                See((label, value)),
            ),
            says=f"It is {best.called}, at {money}; its {self.label(label)} is {value}.",
        )  # fmt: skip

    def count(self) -> Part | None:
        """How many products of a category a filter leaves."""
        name = self.category(lambda members: len(members) > 4)
        if name is None:
            return None
        members = self.guide.members(name)
        kinds = [
            kind for kind in sorted({p.facet for p in members}) if sum(p.facet == kind for p in members) > 1
        ]
        if not kinds:
            return None
        kind = self.rng.choice(kinds)
        label = self.label(self.shop.sector.facet[0])
        number = sum(p.facet == kind for p in members)
        shown = self.shop.counted(number)
        return Part(
            ask=f"count the products in the category {name} with {label} “{kind}”",
            description=f"Number of products in {name} with {label} “{kind}”",
            facts=(
                Fact(f"the number of products in {name} with {label} “{kind}” is found",
                     (Evidence((shown,), self.guide.filtered(name, "facet", kind)),), answer=counted(number)),
            ),
            moves=(self.guide.shelf(name), *self.guide.filter(("facet", kind)), See((shown,))),
            says=f"There are {number} such products.",
        )  # fmt: skip

    def count_cheap(self) -> Part | None:
        """How many products of a category are in stock in the lowest price range."""
        low = price_steps(self.shop.products)[0]

        def cheap(members: list[Product]) -> list[Product]:
            return [p for p in members if p.cents < low * HUNDRED]

        name = self.category(lambda members: 2 <= len(cheap(members)) < len(members))
        if name is None:
            return None
        number = len(cheap(self.guide.members(name)))
        shown, limit = self.shop.counted(number), self.shop.whole(low * HUNDRED)
        return Part(
            ask=f"find out how many products in the category {name} cost less than {limit}",
            description=f"Number of products in {name} under {limit}",
            facts=(
                Fact(f"the number of products in {name} that cost less than {limit} is found",
                     (Evidence((shown,), self.guide.shelves(name, price=f"0-{low}")),
                      *(Evidence(tuple(self.shop.money(p.cents) for p in cheap(self.guide.members(name))),
                                 self.guide.shelves(name, order="cheap|dear")),)),
                     answer=counted(number)),
            ),
            moves=(self.guide.shelf(name), *self.guide.filter(("price", f"Under {limit}")), See((shown,))),
            says=f"{number} products in {name} cost less than {limit}.",
        )  # fmt: skip

    def sold_out(self) -> Part | None:
        """The one product of a category that cannot be had."""
        name = self.category(lambda members: sum(p.stock == 0 for p in members) == 1)
        if name is None:
            return None
        members = self.guide.members(name)
        gone = next(p for p in members if not p.stock)
        texts = (gone.name, "Sold out")
        proof = (Evidence(texts, self.guide.shelves(name)), Evidence(texts, self.guide.detail(gone)))
        return Part(
            ask=f"find the product in the category {name} that is not in stock",
            description=f"The product in {name} that is not in stock",
            facts=(
                self._named(gone, f"the product in {name} that is not in stock is found", proof,
                            [p for p in members if p.stock]),
            ),
            moves=(self.guide.shelf(name), *self.guide.turn_to(members.index(gone)), See(texts)),
            says=f"In {name}, {gone.called} is sold out.",
        )  # fmt: skip

    def either(self) -> Part | None:
        """The one product of a category that meets this OR that."""
        choices: list[tuple[str, Product, str, Order, str]] = []
        for category in self.shop.categories:
            members = self.guide.members(category.name)
            cheapest, second = self.guide.first(members, "cheap", 2)
            best, next_best = self.guide.first(members, "best", 2)
            limit = (cheapest.cents // HUNDRED + 1) * HUNDRED
            if limit <= second.cents and (best is cheapest or (best.rating or 0) < 5.0):
                stars = next_best.rating if best is cheapest else best.rating
                text = f"costs less than {self.shop.whole(limit)} OR is rated higher than {stars}"
                choices.append((category.name, cheapest, text, "cheap", self.shop.money(cheapest.cents)))
            if (best.rating or 0) > (next_best.rating or 0):
                floor = max(1, (cheapest.cents if best is not cheapest else second.cents) // HUNDRED)
                limit = floor * HUNDRED
                text = f"is rated higher than {next_best.rating} OR costs less than {self.shop.whole(limit)}"
                choices.append((category.name, best, text, "best", str(best.rating)))
        if not choices:
            return None
        name, target, text, order, shown = self.rng.choice(choices)
        texts = (target.name, shown)
        proof = (
            Evidence(texts, self.guide.shelves(None, order=order)),
            Evidence(texts, self.guide.detail(target)),
            *self.guide.whole(name, texts),
        )
        rivals = [p for p in self.guide.members(name) if p is not target]
        return Part(
            ask=f"find the product in the category {name} that {text}",
            description=f"The product in {name} that {text}",
            facts=(self._named(target, f"the product in {name} that {text} is found", proof, rivals),),
            moves=(self.guide.shelf(name), self.guide.sort(order), See(texts)),
            says=f"That is {target.called}.",
        )

    def difference(self) -> Part | None:
        """The prices of two products and how far apart they are."""
        first, second = self.take(), self.take()
        if first is None or second is None:
            return None
        gap = abs(first.cents - second.cents)
        moves: list[Move] = []
        for product in (first, second):
            moves += [*self.guide.search(product), See((product.name, self.shop.money(product.cents)))]
        either = (*self.guide.priced(first), *self.guide.priced(second))
        prices = [
            Fact(f"the price of {p.called} is found", self.guide.priced(p), answer=said(self.shop, p.cents))
            for p in (first, second)
        ]
        told = [f"{p.name}: {self.shop.money(p.cents)}." for p in (first, second)]
        return Part(
            ask=f"report the prices of {first.called} and {second.called} and how much more the dearer costs",
            description=f"Prices of {first.called} and {second.called}",
            facts=(
                *prices,
                Fact(
                    "the difference between the two prices is worked out",
                    either,
                    answer=said(self.shop, gap),
                ),
            ),
            moves=tuple(moves),
            says=" ".join((*told, f"The dearer one costs {self.shop.money(gap)} more.")),
        )

    def total(self) -> Part | None:
        """What several pieces of two products cost together: a computation."""
        first, second = self.take(), self.take()
        if first is None or second is None:
            return None
        many, few = self.rng.randint(2, 4), self.rng.randint(1, 3)
        together = first.cents * many + second.cents * few
        what = f"{many} × {first.called} and {few} × {second.called}"
        moves: list[Move] = []
        for product in (first, second):
            moves += [*self.guide.search(product), See((product.name, self.shop.money(product.cents)))]
        return Part(
            ask=f"work out what {what} cost together, without delivery",
            description="The price of several pieces together",
            facts=(
                Fact(
                    f"the price of {what} together is worked out",
                    (*self.guide.priced(first), *self.guide.priced(second)),
                    answer=said(self.shop, together),
                ),
            ),
            moves=tuple(moves),
            says=f"Together they cost {self.shop.money(together)}.",
        )

    def _visit_both(self, first: Product, second: Product, label: str) -> tuple[Move, ...]:
        moves: list[Move] = []
        for product in (first, second):
            moves += [*self.guide.open(product), *self.guide.section("facts")]
            moves += [See((label, dict(product.facts)[label]))]
        return tuple(moves)

    def _pair(self) -> tuple[Product, Product, Figure] | None:
        """Two products of a category and a figure in which they differ."""
        name = self.category(lambda members: len(members) > 2)
        if name is None:
            return None
        first, second = self.rng.sample(self.guide.members(name), 2)
        category = next(c for c in self.shop.categories if c.name == name)
        figure = self.rng.choice(category.figures)
        if first.figures[figure.name] == second.figures[figure.name]:
            return None
        return first, second, figure

    def gap(self) -> Part | None:
        """A figure of two products of a category, and how far apart they are."""
        pair = self._pair()
        if pair is None:
            return None
        first, second, figure = pair
        what = self.label(figure.name)
        gap = figure.written(abs(first.figures[figure.name] - second.figures[figure.name]))
        value = {p.code: dict(p.facts)[figure.name] for p in (first, second)}
        proof = {p.code: self.guide.specified(p, figure.name) for p in (first, second)}
        return Part(
            ask=f"report the {what} of {first.called} and of {second.called}, and the difference",
            description=f"{figure.name} of two products",
            facts=(
                *(
                    Fact(
                        f"the {what} of {p.called} is found",
                        proof[p.code],
                        answer=(value[p.code], value[p.code].replace(" ", "")),
                    )
                    for p in (first, second)
                ),
                Fact(
                    "the difference between the two figures is worked out",
                    (*proof[first.code], *proof[second.code]),
                    answer=tuple(dict.fromkeys((gap, gap.replace(" ", ""), gap.split(" ")[0]))),
                ),
            ),
            moves=self._visit_both(first, second, figure.name),
            says=f"{first.name}: {value[first.code]}. {second.name}: {value[second.code]}. "
            f"The difference is {gap}.",
        )

    def larger(self) -> Part | None:
        """Which of two products has more of a figure, from the page that compares them."""
        pair = self._pair()
        if pair is None:
            return None
        first, second, figure = pair
        what = self.label(figure.name)
        winner, loser = sorted((first, second), key=lambda p: -p.figures[figure.name])
        value = {p.code: dict(p.facts)[figure.name] for p in (first, second)}
        moves: list[Move] = []
        for product in (first, second):
            moves += [*self.guide.open(product), Click(name="Add to comparison", role="button")]
        together = (first.name, second.name, value[first.code], value[second.code])
        return Part(
            ask=f"compare {first.called} with {second.called} and name only the one with the larger {what}",
            description=f"The larger {what} of two products",
            facts=(
                Fact(
                    f"it is found which of {first.called} and {second.called} has the larger {what}",
                    (
                        Evidence(together, self.guide.at("/~compare")),
                        *self.guide.specified(winner, figure.name),
                        *self.guide.specified(loser, figure.name),
                    ),
                    answer=(winner.name,),
                    wrong=(loser.name,),
                ),
            ),
            moves=(*moves, Click(path=self.shop.path("/~compare")), See(together)),
            says=f"It is {winner.called}.",
        )
