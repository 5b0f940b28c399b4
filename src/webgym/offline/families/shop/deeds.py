"""Tasks of a shop that change something on its server, or need its service pages."""

from __future__ import annotations

from webgym.core.truth import Choose, Click, Evidence, Fill, Move, See, StateCheck
from webgym.offline import names
from webgym.offline.families.shop import till
from webgym.offline.families.shop.catalogue import Product
from webgym.offline.families.shop.guide import said
from webgym.offline.families.shop.words import WORDS
from webgym.offline.families.shop.writer import Writer
from webgym.offline.parts import Fact, Part

STREETS = ("Mill Lane", "Castle Road", "Elm Street", "Quay Street")
MESSAGES = (
    "Can I still change the colour?",
    "Please send me the invoice once more.",
    "Is there a spare part for it?",
    "When will it be back in stock?",
)


class Deeds(Writer):
    """Things to do: fill a cart, order, save, subscribe, write."""

    # --- the cart -------------------------------------------------------------------------------------

    def _choose(self, product: Product) -> tuple[dict[str, str], str]:
        """A variant, and how a task says it: ``" (Colour: red, Size: M)"``."""
        options = {label: self.rng.choice(values) for label, values in product.options}
        words = ", ".join(f"{label}: {value}" for label, value in options.items())
        return options, f" ({words})" if words else ""

    def _put(self, product: Product, options: dict[str, str], count: int) -> tuple[Move, ...]:
        """Put a product in the cart, and go to the cart."""
        shop = self.shop
        moves: list[Move] = [*self.guide.open(product, browse=self.rng.random() < 0.3)]
        moves += [Choose(label, value) for label, value in options.items()]
        if shop.counts and count > 1:
            moves += [Fill(shop.say["quantity"], str(count))]  # Enter sends the form
        else:
            moves += [Choose(shop.say["quantity"], str(count))] if count > 1 else []
            moves += [Click(name=shop.say["add"], role="button")]
        if shop.stays:
            moves.append(Click(path=shop.path("/~cart")))
        return tuple(moves)

    def _held(self, product: Product, options: dict[str, str], count: int) -> list[Fact]:
        """Facts about a line of the cart."""
        shop, cart = self.shop, self.guide.at("/~cart")
        shown = f"{count} × {shop.money(product.cents)}"
        word = shop.say["cart"]
        facts = [
            Fact(
                f"{product.called} is in the {word} with {label} {value}",
                (Evidence((product.name, f"{label}: {value}"), cart),),
                (StateCheck(("cart", product.name, label), value),),
            )
            for label, value in options.items()
        ]
        if count > 1 or not facts:
            pieces = f"{count} pieces" if count > 1 else "one piece"
            facts.append(
                Fact(
                    f"the {word} holds {pieces} of {product.called}",
                    (Evidence((product.name, shown), cart),),
                    (StateCheck(("cart", product.name, "quantity"), count),),
                )
            )
        return facts

    def put(self) -> Part | None:
        """Put several pieces of a product in the cart."""
        product = self.take(lambda p: p.stock > 0)
        if product is None:
            return None
        options, variant = self._choose(product)
        count = self.rng.randint(2, 5)
        word = self.shop.say["cart"]
        shown = f"{count} × {self.shop.money(product.cents)}"
        return Part(
            ask=f"put {count} pieces of {product.called}{variant} in the {word}",
            description=f"{product.called} in the {word}",
            facts=tuple(self._held(product, options, count)),
            moves=(*self._put(product, options, count), See((product.name, shown))),
            says=f"{product.name} is in the {word}.",
        )

    def put_and_total(self) -> Part | None:
        """Put a product in the cart and read what it costs with delivery."""
        product = self.take(lambda p: p.stock > 0 and len(p.options) < 2)
        if product is None:
            return None
        options, variant = self._choose(product)
        count = self.rng.randint(2, 4)
        made = till.bill_for(self.shop, [till.Line(0, product, options, count)])
        total = self.shop.money(made.total)
        word = self.shop.say["cart"]
        return Part(
            ask=f"put {count} pieces of {product.called}{variant} in the {word} and report the total "
            "including delivery",
            description=f"{product.called} in the {word}, with the total",
            facts=(
                *self._held(product, options, count),
                Fact(
                    f"the total with delivery that the {word} shows is reported",
                    (Evidence(("Total", total), self.guide.at("/~cart")),),
                    answer=said(self.shop, made.total),
                ),
            ),
            moves=(*self._put(product, options, count), See((product.name, "Total", total))),
            says=f"The total is {total}.",
        )

    def redeem(self) -> Part | None:
        """Use the front page's discount code."""
        product = self.take(lambda p: p.stock > 0 and len(p.options) < 2)
        if product is None:
            return None
        shop, word = self.shop, self.shop.say["cart"]
        options, variant = self._choose(product)
        made = till.bill_for(shop, [till.Line(0, product, options, 1)], code=True)
        total, discount = shop.money(made.total), shop.money(-made.discount)
        cart = self.guide.at("/~cart")
        return Part(
            ask=f"put one piece of {product.called}{variant} in the {word}, apply the discount code that the "
            "front page advertises and report the new total",
            description=f"{product.called} in the {word} with the discount code",
            facts=(
                *self._held(product, options, 1),
                Fact(
                    "the discount code from the front page is applied",
                    (Evidence(("Total", discount), cart),),
                    (StateCheck(("code",), shop.terms.code),),
                ),
                Fact(
                    "the total after the discount is reported",
                    (Evidence(("Total", total), cart),),
                    answer=said(shop, made.total),
                ),
            ),
            moves=(
                See((shop.terms.code,)),
                *self._put(product, options, 1),
                Fill(shop.say["code"], shop.terms.code),
                See((product.name, discount, total)),
            ),
            says=f"With the code the total is {total}.",
        )

    def _address(self) -> dict[str, str]:
        """Somebody's address, as the checkout asks for it."""
        rng, person = self.rng, names.person(self.rng)
        given = {
            "person": person,
            "street": f"{rng.randint(2, 89)} {rng.choice(STREETS)}",
            "town": names.towns(rng, 1)[0],
            "postcode": f"{rng.randint(10_000, 99_999)}",
            "email": f"{person.split()[0].lower()}@post.test",
        }
        return {name: given[name] for name in till.address_fields(self.shop)}

    def order(self) -> Part | None:
        """Order something and report the order's number."""
        product = self.take(lambda p: p.stock > 0 and len(p.options) < 2)
        if product is None:
            return None
        shop, given = self.shop, self._address()
        options, variant = self._choose(product)
        count = self.rng.randint(1, 2)
        number = till.order_number(shop, [till.Line(0, product, options, count)])
        method, payment = self.rng.choice(shop.terms.methods)[0], self.rng.choice(till.PAYMENTS)
        to = "{person}, {street}, {postcode} {town}".format(**given)
        mail = f", e-mail {given['email']}" if "email" in given else ""
        goods = f"{count} × {product.name}"
        steps: list[Move] = [Click(path=shop.path("/~checkout"))]
        steps += [Choose(shop.say["delivery"], method), Choose(shop.say["payment"], payment)]
        steps += [Fill(shop.say[name], text) for name, text in given.items()]
        steps += [Click(name=shop.say["order"], role="button")] if shop.reviews_order else []
        done = self.guide.at("/~checkout/done/{number}", number=number)
        key = ("orders", number)

        def shown(text: str, seen: tuple[str, ...], *held: StateCheck, answer: tuple[str, ...] = ()) -> Fact:
            return Fact(text, (Evidence(seen, done),), held, answer)

        return Part(
            ask=f"order {count} × {product.called}{variant} without an account, to be delivered to "
            f"{to}{mail}, choose “{method}” as the delivery method and “{payment}” as the way to pay, "
            "and report the order number",
            description=f"An order of {product.called}",
            facts=(
                shown(
                    f"{count} × {product.called}{variant} is ordered",
                    (goods, *(f"{label}: {value}" for label, value in options.items())),
                    StateCheck((*key, "items", product.name), count),
                ),
                shown(
                    f"the order goes to {to}{mail}",
                    (f"It goes to {given['person']}", given["street"], given["town"]),
                    *(StateCheck((*key, name), text) for name, text in given.items()),
                ),
                shown(
                    f"the delivery method is “{method}”",
                    (f"Delivery ({method})",),
                    StateCheck((*key, "delivery"), method),
                ),
                shown(
                    f"the way to pay is “{payment}”",
                    (f"{shop.say['payment']}: {payment}",),
                    StateCheck((*key, "payment"), payment),
                ),
                shown("the order number is reported", (number,), answer=(number,)),
            ),
            moves=(
                *self._put(product, options, count),
                *steps,
                See((number, goods, given["person"], payment)),
            ),
            says=f"The order number is {number}.",
        )

    # --- the account ----------------------------------------------------------------------------------

    def _credentials(self) -> str:
        account = self.shop.account
        return f"the e-mail address {account.email} and the password {account.password}"

    def _enter(self) -> tuple[Move, ...]:
        say, account = self.shop.say, self.shop.account
        return (
            Click(path=self.shop.path("/~account/login")),
            Fill(say["email"], account.email),
            Fill(say["password"], account.password),
        )

    def _signed_in(self) -> Fact:
        account = self.shop.account
        at = f"(?:{self.guide.at('/~account')}|{self.guide.at('/~wish')})"
        return Fact(
            f"the visitor is signed in as {account.email}",
            (
                Evidence((f"({account.email})", "Signed in as"), self.guide.at("/~account")),
                Evidence((self.shop.say["account"], self.shop.say["wish"]), at),
            ),
            (StateCheck(("user",), account.email),),
        )

    def wish(self) -> Part | None:
        """Save a product for later."""
        product = self.take()
        if product is None:
            return None
        listed = self.shop.say["wish"]
        return Part(
            ask=f"sign in with {self._credentials()} and put {product.called} on the list “{listed}”",
            description=f"{product.called} on the list “{listed}”",
            facts=(
                self._signed_in(),
                Fact(
                    f"{product.called} is on the list “{listed}”",
                    (Evidence((listed, product.name), self.guide.at("/~wish")),),
                    (StateCheck(("wish", product.name), True),),
                ),
            ),
            moves=(
                *self._enter(),
                *self.guide.open(product),
                Click(name=self.shop.say["save"], role="button"),
                See((product.name,)),
            ),
            says=f"{product.name} is on the list.",
        )

    def past_order(self, count: int = 2) -> Part | None:
        """Look into the account's past orders: the status, and the total if ``count`` is 3."""
        order = self.rng.choice(self.shop.account.orders)
        row, own = self.guide.at("/~account"), self.guide.at("/~account/orders/{number}", number=order.number)
        day, total = f"{order.day.day} {order.day:%b %Y}", self.shop.money(order.total)
        asked = [("status", order.status, (order.status,)), ("total", total, said(self.shop, order.total))]
        asked = asked[: count - 1]
        facts = [self._signed_in()]
        for name, shown, answer in asked:
            facts.append(
                Fact(
                    f"the {name} of order {order.number} is found",
                    (
                        Evidence((f"Order {order.number}", day, shown), row),
                        Evidence((order.number, shown), own),
                    ),
                    answer=answer,
                )
            )
        what = " and the ".join(name for name, _, _ in asked)
        told = {"status": order.status, "total": total}
        return Part(
            ask=f"sign in with {self._credentials()} and report the {what} of order {order.number}",
            description=f"Order {order.number} in the account",
            facts=tuple(facts),
            moves=(*self._enter(), See((f"Order {order.number}", order.status, total))),
            says=" ".join(f"The {name} is {told[name]}." for name, _, _ in asked),
        )

    def register(self) -> Part | None:
        """Open an account."""
        say, person = self.shop.say, names.person(self.rng)
        email = f"{person.split()[1].lower()}.{self.rng.randint(10, 99)}@post.test"
        password = f"{self.rng.choice(('maple', 'cobalt', 'harbor', 'linen'))}-{self.rng.randint(1000, 9999)}"
        account = self.guide.at("/~account")
        return Part(
            ask=f"create an account for {person} with the e-mail address {email} and the password {password}",
            description=f"An account for {email}",
            facts=(
                Fact(
                    f"an account for {email} exists in the name of {person}",
                    (Evidence((f"Signed in as {person}", email), account),),
                    (StateCheck(("people", email), person),),
                ),
            ),
            moves=(
                Click(path=self.shop.path("/~account/login")),
                Click(path=self.shop.path("/~account/register")),
                Fill(say["person"], person),
                Fill(say["email"], email),
                Fill(say["password"], password),
                See((email,)),
            ),
            says=f"The account for {email} was created.",
        )

    # --- letters --------------------------------------------------------------------------------------

    def subscribe(self) -> Part | None:
        """Subscribe to the newsletter at the foot of the front page."""
        email = f"{names.person(self.rng).split()[0].lower()}{self.rng.randint(10, 99)}@post.test"
        return Part(
            ask=f"subscribe {email} to the newsletter",
            description="Newsletter",
            facts=(
                Fact(
                    f"{email} is subscribed to the newsletter",
                    (Evidence((f"The next letter goes to {email}",), self.guide.at("/~news")),),
                    (StateCheck(("newsletter",), email),),
                ),
            ),
            moves=(Fill("E-mail for the newsletter", email), See((email,))),
            says=f"{email} is subscribed.",
        )

    def message(self) -> Part | None:
        """Write to the shop."""
        say, topic, text = self.shop.say, self.rng.choice(WORDS.topics), self.rng.choice(MESSAGES)
        person = names.person(self.rng)
        email = f"{person.split()[1].lower()}@post.test"
        sent = self.guide.at("/~contact/sent")
        return Part(
            ask=f"send the shop a message with the contact form: topic “{topic}”, from {person}, {email}, "
            f"with the text “{text}”",
            description="A message to the shop",
            facts=(
                Fact(
                    f"a message with the topic “{topic}” is sent",
                    (Evidence((f"Topic: {topic}",), sent),),
                    (StateCheck(("message", "topic"), topic),),
                ),
                Fact(
                    f"the message comes from {person}, {email}",
                    (Evidence((f"We answer {email}",), sent),),
                    (StateCheck(("message", "person"), person), StateCheck(("message", "email"), email)),
                ),
                Fact(
                    f"the message says “{text}”",
                    (Evidence(("Your message has reached us",), sent),),
                    (StateCheck(("message", "text"), text),),
                ),
            ),
            moves=(
                Click(path=self.shop.path("/~contact")),
                Choose("Topic", topic),
                Fill(say["person"], person),
                Fill(say["email"], email),
                Fill("Message", text),
                Click(name=say["send"], role="button"),
                See((f"Topic: {topic}", email)),
            ),
            says="The message was sent.",
        )
