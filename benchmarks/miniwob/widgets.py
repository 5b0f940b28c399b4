"""Tasks with whole small applications: mail, a shop, a calendar, an editor, sliders, date pickers."""

from __future__ import annotations

import re

from benchmarks.miniwob.hand import At, Hand, Point, Unsolved, middle
from benchmarks.miniwob.registry import solves


async def bring_into_view(hand: Hand, box: str, at: At) -> None:
    """Scroll a box until an element in it can be seen whole."""
    for _ in range(25):
        _, top, _, height = await hand.box(box)
        _, y, _, tall = await hand.box(at)
        if y >= top - 1 and y + tall <= top + height + 1:
            return
        await hand.scroll("up" if y < top else "down", middle(await hand.box(box)))
    raise Unsolved(f"{at} does not come into view")


@solves("choose-date", "choose-date-easy", "choose-date-medium", "choose-date-nodelay")
async def choose_date(hand: Hand) -> None:
    month, day, year = hand.asked(r"(\d+)/(\d+)/(\d+)")
    await pick_date(hand, int(month), int(day), int(year))
    await hand.submit()


async def pick_date(hand: Hand, month: int, day: int, year: int) -> None:
    """Open the date picker, leaf to the month, choose the day."""
    await hand.click("#datepicker")
    names = "January February March April May June July August September October November December".split()
    for _ in range(40):
        shown = (await hand.texts(".ui-datepicker-title"))[0].split()
        months = (int(shown[1]) - year) * 12 + names.index(shown[0]) + 1 - month
        if not months:
            break
        await hand.click(".ui-datepicker-prev" if months > 0 else ".ui-datepicker-next")
    await hand.click(At(".ui-datepicker-calendar a", str(day)))


@solves("book-flight", "book-flight-nodelay")
async def book_flight(hand: Hand) -> None:
    wish, start, end, month, day, year = hand.asked(
        r"the (cheapest|shortest) one-way flight from: (.*) to: (.*) on (\d+)/(\d+)/(\d+)"
    )
    for css, place in (("#flight-from", start), ("#flight-to", end)):
        await hand.type(css, place)
        listed = ".ui-autocomplete .ui-menu-item"
        names = [text for text in await hand.texts(listed) if place in text]
        if not names:
            raise Unsolved(f"no suggestions for {place!r}")
        await hand.click(At(listed, names[0]))
    await pick_date(hand, int(month), int(day), int(year))
    await hand.click("#search")
    css, attribute = {
        "cheapest": (".flight-price", "data-price"),
        "shortest": (".time-duration", "data-duration"),
    }[wish]
    values = await hand.js(
        f"[...document.querySelectorAll('{css}')].map(one => +one.getAttribute('{attribute}'))"
    )
    flight = At(".flight-price", index=values.index(min(values)))
    await bring_into_view(hand, "#area", flight)
    await hand.click(flight)


@solves("use-autocomplete", "use-autocomplete-nodelay")
async def use_autocomplete(hand: Hand) -> None:
    start, *end = hand.quoted()
    await hand.type("#tags", start)
    fitting = [
        text
        for text in await hand.texts(".ui-autocomplete .ui-menu-item")
        if text.endswith(end[0] if end else "")
    ]
    if not fitting:
        raise Unsolved("no suggestion fits")
    item = At(".ui-autocomplete .ui-menu-item", fitting[0])
    await bring_into_view(hand, ".ui-autocomplete", item)
    await hand.click(item)
    await hand.submit()


@solves("use-spinner")
async def use_spinner(hand: Hand) -> None:
    number = int(hand.asked(r"Select (-?\d+)")[0])
    for _ in range(abs(number)):
        await hand.click(".ui-spinner-up" if number > 0 else ".ui-spinner-down")
    await hand.submit()


async def _slide(hand: Hand, css: str, number: int) -> None:
    """Drag the handle near its place, then take single steps by keys; in the paper's space click there."""
    low, high, is_upright = await hand.js(
        f"(s => [s('min'), s('max'), s('orientation') === 'vertical'])"
        f"(name => $('{css}').slider('option', name))"
    )
    x, y, width, height = await hand.box(css)
    share = (number - low) / (high - low)
    point: Point = (
        (x + width / 2, y + height * (1 - share)) if is_upright else (x + width * share, y + height / 2)
    )
    if hand.space == "paper":
        await hand.click(point)
        return
    await hand.drag(At(f"{css} .ui-slider-handle"), point)
    off = number - await hand.js(f"$('{css}').slider('value')")
    if off and not await hand.js(f"document.activeElement.closest('{css}') !== null"):
        raise Unsolved("the slider's handle has not got the focus")
    for _ in range(abs(off)):
        await hand.press("ArrowRight" if off > 0 else "ArrowLeft")


@solves("use-slider")
async def use_slider(hand: Hand) -> None:
    await _slide(hand, "#slider", int(hand.asked(r"Select (-?\d+)")[0]))
    await hand.submit()


@solves("use-slider-2")
async def use_slider_2(hand: Hand) -> None:
    for index, number in enumerate(re.findall(r"\d+", hand.query), start=1):
        await _slide(hand, f"#slider-{index}", int(number))
    await hand.submit()


@solves("form-sequence")
async def form_sequence(hand: Hand) -> None:
    number, box = hand.asked(r"Select (-?\d+) with the slider, click the (\d)")
    await _slide(hand, "#slider", int(number))
    await hand.click(f"#checkbox-{box}")
    await hand.submit()


@solves("form-sequence-3")
async def form_sequence_3(hand: Hand) -> None:
    (size,) = hand.asked(r"Choose (.*) from")
    await hand.click(".selectric")
    item = At(".selectric-items li", size)
    await bring_into_view(hand, ".selectric-scroll", item)
    await hand.click(item)
    await hand.click(At("#buttons button", hand.quoted()[0]))


@solves("use-colorwheel", "use-colorwheel-2")
async def use_colorwheel(hand: Hand) -> None:
    wish = await hand.js(
        "(q => q ? '#' + getComputedStyle(q).backgroundColor.match(/\\d+/g)"
        ".map(n => (+n).toString(16).padStart(2, '0')).join('') : null)(document.querySelector('#query .cc'))"
    )
    if wish is None:
        (name,) = hand.asked(r"Select (\w+) with")
        wish = await hand.js(f"ui_utils.colorNameToHex('{name}')")
    await hand.type("#col", wish.lstrip("#").upper())
    await hand.click(middle(await hand.box("#query")))  # the picker closes
    await hand.submit()


@solves("scroll-text-2")
async def scroll_text_2(hand: Hand) -> None:
    side = "down" if "to the bottom" in hand.query else "up"
    for _ in range(30):
        top, whole, shown = await hand.js(
            "(one => [one.scrollTop, one.scrollHeight, one.clientHeight])"
            "(document.querySelector('#text-area'))"
        )
        if top + shown >= whole - 1 if side == "down" else top <= 0:
            break
        await hand.scroll(side, "#text-area")  # type: ignore[arg-type]
    await hand.submit()


@solves("sign-agreement")
async def sign_agreement(hand: Hand) -> None:
    if "cancel button" in hand.query:
        for _ in range(30):
            if not await hand.js("document.querySelector('#cancel').disabled"):
                break
            await hand.scroll("down", "#text-area")
        await hand.click("#cancel")
    name, button = hand.quoted()
    for _ in range(30):
        if not await hand.js("document.querySelector('#name').disabled"):
            break
        await hand.scroll("down", "#text-area")
    await hand.type("#name", name)
    await hand.click(f"#{button.lower()}")


@solves("simon-says")
async def simon_says(hand: Hand) -> None:
    """What lit up is read from what was watched from the beginning, and is waited for like a person does."""
    await hand.wait(4.0)
    for number in await hand.js("__pushed"):
        await hand.click(f"#button-{number}")


@solves("social-media")
async def social_media(hand: Hand) -> None:
    user, action = hand.asked(r'For the user (\S+), click on the "(.*)" button')
    kinds = await hand.js("ACTIONS")
    kind = next(key for key, name in kinds.items() if name == action)
    index = (await hand.texts("#area .username")).index(user)
    post = f"#area .media[data-result='{index}']"
    await bring_into_view(hand, "#area", At(f"{post} .controls > span"))
    if kind in {"reply", "retweet", "like"}:
        await hand.click(f"{post} .{kind}")
    item = At(f"{post} li.{kind}")
    for _ in range(3):  # its picture changes under the mouse: a press beside it opens nothing
        if not await hand.shows(item.css):
            await hand.click(f"{post} .more")
    await bring_into_view(hand, "#area", item)
    await hand.click(item)


@solves("social-media-all", "social-media-some")
async def social_media_all(hand: Hand) -> None:
    (user,) = hand.asked(r"by (@\S+) and")
    kinds = await hand.js("ACTIONS")
    kind = next(key for key, name in kinds.items() if name == hand.quoted()[0])
    count = re.search(r"on (\d+) post", hand.query)
    posts = [index for index, name in enumerate(await hand.texts("#area .username")) if name == user]
    for index in posts[: int(count[1])] if count else posts:
        button = At(f"#area .media[data-result='{index}'] .{kind}")
        await bring_into_view(hand, "#area", button)
        await hand.click(button)
    await bring_into_view(hand, "#area", At("#submitRow button"))
    await hand.submit()


@solves("stock-market")
async def stock_market(hand: Hand) -> None:
    limit = float(hand.asked(r"less than \$(\d+\.\d+)")[0])
    for turn in range(150):
        price = (await hand.texts("#stock-price"))[0].lstrip("$")
        # it goes on until the click: a margin, as long as there is time for one
        if price and float(price) <= limit - (1 if turn < 40 else 0):
            await hand.click("#buy")
        await hand.look()


@solves("search-engine")
async def search_engine(hand: Hand) -> None:
    name, place = hand.asked(r'enter "(.*)" and press "Search", then find and click the (\d+)')
    await hand.type("#search-text", name)
    await hand.click("#search")
    page, index = divmod(int(place) - 1, 3)
    if page:
        await hand.click(At("#pagination a", str(page + 1)))
    await hand.click(At("#page-content .search-title", index=index))


@solves("terminal")
async def terminal(hand: Hand) -> None:
    wish = re.search(r"the extension \.(\S+?)\.?$", hand.query)
    await hand.type("#terminal", "ls", enter=True)
    files = (await hand.texts(".terminal-output"))[-1].split()
    name = next(name for name in files if (name.endswith("." + wish[1]) if wish else "." not in name))
    await hand.type("#terminal", f"rm {name}", enter=True)


@solves("order-food")
async def order_food(hand: Hand) -> None:
    kind = re.search(r"Order (\d) items that are (\S+)", hand.query)
    if kind:
        fitting = await hand.js(f"MENU.filter(item => item.types.includes('{kind[2]}')).map(item => item.id)")
        ids = [fitting[0]] * int(kind[1])
    else:
        (names,) = hand.asked(r"each item: (.*)")
        wanted = [name.strip() for name in names.split(",")]
        ids = await hand.js(f"MENU.filter(item => {wanted}.includes(item.name.trim())).map(item => item.id)")
    for number in ids:
        button = At(f".food-item[data-id='{number}'] .add")
        await bring_into_view(hand, "#area", button)
        await hand.click(button)
    await bring_into_view(hand, "#area", At("#submit-order button"))
    await hand.click("#submit-order button")


MAIL = (
    "email-inbox email-inbox-delete email-inbox-forward email-inbox-forward-nl email-inbox-forward-nl-turk "
    "email-inbox-important email-inbox-nl-turk email-inbox-noscroll email-inbox-reply email-inbox-star-reply"
).split()


@solves(*MAIL)
async def email_inbox(hand: Hand) -> None:
    fields = {"task": "forward", **hand.fields} if hand.fields else _wish(hand)
    names = await hand.texts("#main .email-sender")
    thread = f"#main .email-thread[data-index='{names.index(fields['by'])}']"
    if fields["task"] in {"delete", "star"}:
        button = At(f"{thread} .{'trash' if fields['task'] == 'delete' else 'star'}")
        await bring_into_view(hand, "#area", button)
        await hand.click(button)
    await bring_into_view(hand, "#area", At(f"{thread} .email-sender"))
    await hand.click(f"{thread} .email-sender")
    kind = fields["task"]
    await bring_into_view(hand, "#area", At(f".email-{kind}"))
    await hand.click(f".email-{kind}")
    if kind == "reply":
        await hand.type("#reply-text", fields["message"])
    else:
        await hand.type(".forward-sender", fields["to"])
    await hand.click(f"#send-{kind}")


def _wish(hand: Hand) -> dict[str, str]:
    """What to do with which mail, read from the instruction."""
    for task, pattern in {
        "reply": r'email by (?P<by>\S+) and reply to them with the text "(?P<message>.*)"',
        "forward": r"email by (?P<by>\S+) and forward that email to (?P<to>\S+?)\.?$",
        "delete": r"email by (?P<by>\S+) and click the trash",
        "star": r"email by (?P<by>\S+) and click the star",
    }.items():
        found = re.search(pattern, hand.query)
        if found:
            return {"task": task, **found.groupdict()}
    raise Unsolved(f"the instruction is {hand.query!r}")


@solves("tic-tac-toe")
async def tic_tac_toe(hand: Hand) -> None:
    lines = [(0, 1, 2), (3, 4, 5), (6, 7, 8), (0, 3, 6), (1, 4, 7), (2, 5, 8), (0, 4, 8), (2, 4, 6)]
    while True:
        state = await hand.js(
            "[...document.querySelectorAll('.ttt-row span')]"
            ".map(one => one.className === 'mark-x' ? 1 : one.className ? -1 : 0)"
        )
        wins = [
            [place for place in line if not state[place]]
            for line in lines
            if sum(state[p] for p in line) == 2
        ]
        threats = [[p for p in line if not state[p]] for line in lines if sum(state[p] for p in line) == -2]
        free = [place for place in (4, 0, 2, 6, 8, 1, 3, 5, 7) if not state[place]]
        choice = next((places[0] for places in wins + threats if places), free[0])
        await hand.click(f"#ttt-{choice}")


@solves("text-editor")
async def text_editor(hand: Hand) -> None:
    word = re.search(r"give the text (\S+) the", hand.query)
    text = word[1] if word else None
    ends = await hand.js(
        """(text => {
            const root = document.querySelector('#editor p'), range = document.createRange();
            range.selectNodeContents(root);
            if (text) {
                const node = root.firstChild, at = node.data.indexOf(text);
                range.setStart(node, at);
                range.setEnd(node, at + text.length);
            }
            const lines = [...range.getClientRects()].filter(line => line.width > 1);
            const first = lines[0], last = lines[lines.length - 1];
            return [first.left, first.top + first.height / 2, last.right, last.top + last.height / 2];
        })("""
        + (f"'{text}'" if text else "null")
        + ")"
    )
    await hand.drag((ends[0] + 0.3, ends[1]), (ends[2] - 0.3 if text else ends[2] + 2, ends[3]))
    style = re.search(r"(?:style|color) (bold|italics|underlined|\w+)", hand.query)
    name = style[1] if style else ""
    if name in {"bold", "italics", "underlined"}:
        css = {"bold": "bold", "italics": "italic", "underlined": "underline"}[name]
        await hand.click(f".ql-toolbar button.ql-{css}")
    else:
        await hand.click(".ql-color .ql-picker-label")
        color = (await hand.js("COLOR_MAP"))[name][0]
        await hand.click(f".ql-picker-item[data-value='{color}']")
    await hand.submit()


@solves("daily-calendar")
async def daily_calendar(hand: Hand) -> None:
    length, unit, name, start, end = hand.asked(
        r'Create an? ([\d.]+) (\w+) event named "(.*)", between (\w+) and (\w+)'
    )
    halves = round(float(length) * (2 if unit.startswith("hour") else 1 / 30))
    first, last = (_half_hour(time) for time in (start, end))
    taken = await hand.js(
        "[...document.querySelectorAll('.event')].map(one => one.getBoundingClientRect())"
        ".map(box => [box.top, box.bottom])"
    )
    for half in range(first, last - halves + 1):
        top = (await hand.box(f"#hh-{half}"))[1]
        bottom = sum((await hand.box(f"#hh-{half + halves - 1}"))[1::2])
        if all(bottom < above - 2 or top > below + 2 for above, below in taken):
            break
    else:
        raise Unsolved("no time is free")
    await bring_into_view(hand, "#area", At(f"#hh-{half}"))
    await bring_into_view(hand, "#area", At(f"#hh-{half + halves - 1}"))
    x, y, width, height = await hand.box(f"#hh-{half}")
    end_box = await hand.box(f"#hh-{half + halves - 1}")
    await hand.drag((x + width / 2, y + height * 0.3), (x + width / 2, end_box[1] + end_box[3] * 0.7))
    await hand.type("#event-name", name)
    await hand.click("button.create")


def _half_hour(time: str) -> int:
    number, half = re.fullmatch(r"(\d+)(AM|PM)", time).groups()  # type: ignore[union-attr]
    return (int(number) % 12 + 12 * (half == "PM")) * 2


@solves("click-pie", "click-pie-nodelay")
async def click_pie(hand: Hand) -> None:
    wish = hand.quoted()[0]
    await hand.click("#divWheel text:not([fill-opacity='0'])")
    await hand.look()
    await hand.click(At("#divWheel text", wish))
