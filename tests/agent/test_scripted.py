from __future__ import annotations

from typing import Any, get_args

import pytest
from tests.agent.conftest import Play
from tests.agent.shop import Shop, task

from webgym.agent.agent import Agent
from webgym.agent.config import AgentConfig, PromptFormat
from webgym.agent.formats import parse_reply
from webgym.agent.parser import ParsedReply
from webgym.agent.scripted import MISTAKES, Mistake, ScriptedPolicy, wrong_answer
from webgym.core.action import Action, Answer, GoBack, LeftClick, Mode, Scroll, Type, Wait
from webgym.core.errors import ConfigError, PolicyError
from webgym.core.trajectory import Step
from webgym.core.truth import AnswerTruth, Back, Choose, Click, Done, Fill, Give, Home, Remember, See, Truth

SEARCH = (Home(), Fill("Search mugs", "mug"))
GIVE = Give("It is £31.50.")


def answer_of(steps: list[Step]) -> str | None:
    last = steps[-1].action
    return last.text if isinstance(last, Answer) else None


def actions_of(steps: list[Step]) -> list[Action | None]:
    return [step.action for step in steps]


async def test_a_whole_solution_in_every_mode_and_format(play: Play) -> None:
    for mode in get_args(Mode):
        for prompt_format in get_args(PromptFormat):
            shop = Shop(banner=True, sticky=False, slow=1, native_select=False)
            plan = task(
                *SEARCH,
                Choose("Sort by", "Price: high to low"),
                Click("Mug 3"),
                See(("Mug 3 costs", "£3.50")),
                Click("Details", role="tab"),
                See(("300 g",)),
                Click("Add to cart"),
                Back(),
                Click(path="/mug/30"),
                Click("Add to cart", role="button"),
                Click("Cart"),
                See(("1 x Mug 3", "1 x Mug 30")),
                Click("Check out"),
                Fill("Name", "Ada"),
                Fill("Street", "1 Ada Road"),
                Fill("Town", "London"),
                See(("Thank you for your order!",)),
                Give("Done."),
            )
            agent = Agent(ScriptedPolicy(), AgentConfig(mode=mode, prompt_format=prompt_format))
            steps = await play(agent, shop, plan, budget=120)
            assert answer_of(steps) == "Done."
            assert shop.cart == ["3", "30"]
            assert shop.orders == [{"Name": "Ada", "Street": "1 Ada Road", "Town": "London"}]
            assert not shop.banner
            assert {step.parse_error for step in steps} == {""}
            assert steps[0].reply.sampling == {"mistake": None}


async def test_replies_say_what_was_seen_and_done(play: Play) -> None:
    steps = await play(Agent(ScriptedPolicy()), Shop(), task(*SEARCH, Click("Mug 5"), See(("£5.50",)), GIVE))
    parsed = parse_reply(steps[-1].reply.text, "coordinates", "memory")
    assert isinstance(parsed, ParsedReply)
    assert parsed.memory == {"seen 1": ["£5.50"]}
    assert parsed.progress is not None
    assert list(parsed.progress.values()) == ["finished"] * 4 + ["not finished"]
    assert parsed.intention == "5. give the answer"
    assert parsed.intention in parsed.progress


async def test_replies_hold_the_memory_and_the_parts_that_a_solution_names(play: Play) -> None:
    parts = [
        (*SEARCH, Remember("sign", "red star"), Click("Mug 5"), Remember("1", "5.50"), Done("1")),
        (Back(), Click("Mug 3"), See(("£3.50",)), Remember("2", "3.50"), Done("2")),
    ]
    steps = await play(Agent(ScriptedPolicy()), Shop(), task(*parts[0], *parts[1], GIVE))
    told = [parse_reply(step.reply.text, "coordinates", "memory") for step in steps]
    memory = [each.memory for each in told if isinstance(each, ParsedReply)]
    progress = [each.progress for each in told if isinstance(each, ParsedReply)]
    assert memory[0] == {}
    assert {"sign": "red star"} in memory  # written where it is in view, before the click that leaves it
    assert memory[-1] == {"sign": "red star", "1": "5.50", "2": "3.50"}
    assert progress[0] == {"1": "not finished", "2": "not finished"}
    assert {"1": "finished", "2": "not finished"} in progress
    assert progress[-1] == {"1": "finished", "2": "finished"}
    intentions = [each.intention for each in told if isinstance(each, ParsedReply)]
    assert intentions == sorted(intentions)
    assert set(intentions) == {"1", "2"}


async def test_nothing_is_done_that_is_done_already(play: Play) -> None:
    shop = Shop(url="http://mugs.webgym.test/")
    steps = await play(Agent(ScriptedPolicy()), shop, task(Home(), See(("Mugs for everybody",)), GIVE))
    assert len(steps) == 1
    shop = Shop(url="http://mugs.webgym.test/search?q=mug")
    moves = (Fill("Search mugs", "MUG "), Choose("Sort by", "relevance"), See(("Mug 1",)), GIVE)
    assert len(await play(Agent(ScriptedPolicy()), shop, task(*moves))) == 1


async def test_the_front_page_with_a_query_is_not_home(play: Play) -> None:
    shop = Shop(url="http://mugs.webgym.test/?from=mail")
    await play(Agent(ScriptedPolicy()), shop, task(Home(), GIVE))
    assert shop.url == "http://mugs.webgym.test/"


async def test_home_is_found_above(play: Play) -> None:
    shop = Shop(sticky=False, url="http://mugs.webgym.test/mug/7", offset=1200)
    steps = await play(Agent(ScriptedPolicy()), shop, task(Home(), GIVE))
    assert shop.url == "http://mugs.webgym.test/"
    assert answer_of(steps) == GIVE.text


async def test_a_native_list_is_opened_and_then_typed_into(play: Play) -> None:
    shop = Shop()
    steps = await play(
        Agent(ScriptedPolicy()), shop, task(*SEARCH, Choose("Sort by", "Price: high to low"), GIVE)
    )
    _, opened, typed, _ = actions_of(steps)
    assert isinstance(opened, LeftClick)
    assert isinstance(typed, Type)
    assert typed.text == "Price: high to low"
    assert "high" in shop.url


async def test_what_is_in_the_way_is_cleared_once_it_is(play: Play) -> None:
    shop = Shop(banner=True, modal_after=3)
    steps = await play(Agent(ScriptedPolicy()), shop, task(*SEARCH, Click("Mug 2"), See(("£2.50",)), GIVE))
    assert answer_of(steps) == GIVE.text
    assert (shop.banner, shop.is_modal) == (False, False)
    assert len(steps) == 5


async def test_a_button_that_is_wanted_is_not_taken_for_an_obstacle(play: Play) -> None:
    shop = Shop(banner=True)
    steps = await play(Agent(ScriptedPolicy()), shop, task(Click("Accept all"), GIVE))
    assert len(steps) == 2
    shop = Shop(banner=True)
    steps = await play(Agent(ScriptedPolicy()), shop, task(Click("Cart"), Click("Accept all"), GIVE))
    assert answer_of(steps) == GIVE.text


async def test_a_page_that_loads_is_waited_for(play: Play) -> None:
    shop = Shop(slow=2)
    steps = await play(Agent(ScriptedPolicy()), shop, task(*SEARCH, Click("Mug 2"), See(("£2.50",)), GIVE))
    assert answer_of(steps) == GIVE.text
    assert [type(action) for action in actions_of(steps)] == [Type, Wait, Wait, LeftClick, Wait, Wait, Answer]


async def test_a_click_without_effect_is_tried_once_more_elsewhere(play: Play) -> None:
    shop = Shop(deaf=1)
    steps = await play(Agent(ScriptedPolicy()), shop, task(Click("Cart"), GIVE))
    first, second, _ = actions_of(steps)
    assert first != second
    assert answer_of(steps) == GIVE.text
    steps = await play(Agent(ScriptedPolicy()), Shop(deaf=2), task(Click("Cart"), GIVE))
    assert answer_of(steps) == 'I could not click "Cart".'
    assert len(steps) == 3


async def test_a_tab_that_is_open_already_is_no_failure(play: Play) -> None:
    shop = Shop(url="http://mugs.webgym.test/mug/4")
    steps = await play(Agent(ScriptedPolicy()), shop, task(Click("About", role="tab"), See(("£4.50",)), GIVE))
    assert answer_of(steps) == GIVE.text


async def test_what_is_nowhere_is_given_up_honestly(play: Play) -> None:
    steps = await play(Agent(ScriptedPolicy()), Shop(), task(*SEARCH, Click("Teapot 3"), GIVE))
    assert answer_of(steps) == 'I could not click "Teapot 3".'
    offsets = [step.observation.scroll for step in steps]
    assert max(offset + 768 for offset, _ in offsets) >= max(extent for _, extent in offsets)
    last = actions_of(steps)[-2]
    assert isinstance(last, Wait)  # waited for what might be late, but did not look through it all again


async def test_what_comes_late_is_found(play: Play) -> None:
    class Late(Shop):
        def act(self, action: Action | None) -> None:
            super().act(action)
            if isinstance(action, Wait):
                self.tall = 40

    shop = Late(tall=3, url="http://mugs.webgym.test/search?q=mug")
    steps = await play(Agent(ScriptedPolicy()), shop, task(Click("Mug 12"), See(("£12.50",)), GIVE))
    assert answer_of(steps) == GIVE.text


async def test_a_page_that_never_stands_still_is_not_searched_for_ever(play: Play) -> None:
    shop = Shop(is_animated=True, tall=3, url="http://mugs.webgym.test/search?q=mug")
    steps = await play(Agent(ScriptedPolicy()), shop, task(See(("Teapot",)), GIVE), budget=40)
    assert answer_of(steps) == 'I could not see "Teapot".'


async def test_texts_that_never_stand_together_are_given_up(play: Play) -> None:
    steps = await play(Agent(ScriptedPolicy()), Shop(), task(*SEARCH, See(("Mug 0", "Mug 39")), GIVE))
    assert answer_of(steps) == 'I could not see "Mug 0" and "Mug 39".'


async def test_enter_that_sent_the_form_stands_for_its_button(play: Play) -> None:
    shop = Shop(url="http://mugs.webgym.test/order", typed={"Name": "Ada", "Street": "1 Ada Road"})
    moves = (Fill("Town", "London"), Click("Place order", role="button"), See(("Thank you for your order!",)))
    steps = await play(Agent(ScriptedPolicy()), shop, task(*moves, GIVE))
    assert len(shop.orders) == 1
    assert answer_of(steps) == GIVE.text


async def test_without_a_solution_or_without_elements(play: Play) -> None:
    with pytest.raises(PolicyError, match="without a solution"):
        await play(Agent(ScriptedPolicy()), Shop(), task())

    class Blind(Shop):
        def observe(self, mode: Mode = "coordinates") -> Any:
            from msgspec.structs import replace

            return replace(super().observe(mode), elements=None)

    with pytest.raises(PolicyError, match="cannot see"):
        await play(Agent(ScriptedPolicy()), Blind(), task(GIVE))


# --- mistakes -------------------------------------------------------------------------------------

LONG = (*SEARCH, Click("Mug 31"), See(("£31.50",)), Click("Details"), See(("3100 g",)), Click("Cart"))
TRUTH = AnswerTruth(required=(("£31.50",),), others=("£30.50",))


async def play_mistake(
    play: Play, kind: Mistake, *, seed: int = 0, answer: AnswerTruth = TRUTH
) -> list[Step]:
    policy = ScriptedPolicy(1.0, mistakes=[kind])
    return await play(Agent(policy), Shop(), task(*LONG, GIVE, answer=answer), seed=seed, budget=40)


async def test_wrong_answer(play: Play) -> None:
    steps = await play_mistake(play, "wrong_answer")
    assert answer_of(steps) == "£30.50"
    assert {step.reply.sampling["mistake"] for step in steps} == {"wrong_answer"}
    steps = await play_mistake(play, "wrong_answer", answer=AnswerTruth(required=(("£31.50",),)))
    answer = answer_of(steps)
    assert answer is not None
    assert "£31.50" not in answer


async def test_an_answer_that_cannot_be_wrong_is_an_early_end_instead(play: Play) -> None:
    steps = await play_mistake(play, "wrong_answer", answer=AnswerTruth())
    assert steps[0].reply.sampling == {"mistake": "gives_up"}
    assert answer_of(steps) == "I could not find what was asked for."


async def test_unseen_answer(play: Play) -> None:
    steps = await play_mistake(play, "unseen_answer")
    assert (len(steps), answer_of(steps)) == (1, GIVE.text)


async def test_skipped_move(play: Play) -> None:
    faultless = await play(Agent(ScriptedPolicy()), Shop(), task(*LONG, GIVE))
    for seed in range(6):
        steps = await play_mistake(play, "skipped_move", seed=seed)
        assert answer_of(steps) is not None
        assert actions_of(steps) != actions_of(faultless)


async def test_misclick_may_recover(play: Play) -> None:
    answers = []
    went_back = False
    for seed in range(6):
        steps = await play_mistake(play, "misclick", seed=seed)
        answers.append(answer_of(steps))
        went_back |= any(isinstance(action, GoBack) for action in actions_of(steps))
        assert "wrong link" not in (steps[0].reply.text)
    assert GIVE.text in answers
    assert went_back


async def test_unreadable(play: Play) -> None:
    for seed in range(6):
        steps = await play_mistake(play, "unreadable", seed=seed)
        unread = [step for step in steps if step.action is None]
        assert 1 <= len(unread) <= 2
        assert all(step.parse_error for step in unread)
        assert answer_of(steps) == GIVE.text


async def test_dawdle(play: Play) -> None:
    steps = await play_mistake(play, "dawdle")
    assert len(steps) == 40
    assert {type(action) for action in actions_of(steps)[5:]} == {Scroll}


async def test_gives_up(play: Play) -> None:
    steps = await play_mistake(play, "gives_up")
    assert answer_of(steps) == "I could not find what was asked for."


async def test_raises(play: Play) -> None:
    for seed in range(3):
        with pytest.raises(PolicyError, match="on purpose"):
            await play_mistake(play, "raises", seed=seed)


async def test_a_mistake_of_conduct_is_made_before_a_quick_answer(play: Play) -> None:
    quick = task(Home(), See(("Mugs for everybody",)), GIVE)
    for seed in range(5):
        policy = ScriptedPolicy(1.0, mistakes=["unreadable"])
        steps = await play(Agent(policy), Shop(), quick, seed=seed)
        assert steps[0].action is None
        assert answer_of(steps) == GIVE.text


async def test_the_same_seed_plays_the_same(play: Play) -> None:
    async def texts(seed: int) -> list[str]:
        policy = ScriptedPolicy(1.0, mistakes=["misclick", "skipped_move", "unreadable"])
        steps = await play(Agent(policy), Shop(), task(*LONG, GIVE), seed=seed)
        return [step.reply.text for step in steps]

    assert [await texts(seed) for seed in range(4)] == [await texts(seed) for seed in range(4)]
    assert len({str(await texts(seed)) for seed in range(8)}) > 1


def test_the_rate_of_mistakes_is_kept_and_all_kinds_occur() -> None:
    policy = ScriptedPolicy(0.25)
    plan = task(*LONG, GIVE, answer=TRUTH)
    made = [policy.begin(plan, seed).mistake for seed in range(2000)]
    assert 0.22 < sum(mistake is not None for mistake in made) / len(made) < 0.28
    assert set(made) == {None, *MISTAKES}
    assert {ScriptedPolicy(0).begin(plan, seed).mistake for seed in range(50)} == {None}


@pytest.mark.parametrize(
    ("right", "required"), [("£9", "£9"), ("09:30", "09:30"), ("Ada", "Ada"), ("10", "10")]
)
def test_wrong_answers_are_wrong(right: str, required: str) -> None:
    import random

    truth = Truth("h", (), AnswerTruth(required=((required,),)), (Give(right),))
    for seed in range(20):
        wrong = wrong_answer(truth, random.Random(seed))
        assert wrong is not None
        assert required not in wrong


@pytest.mark.parametrize("rate", [-0.1, 1.5, float("nan")])
def test_a_rate_is_a_share(rate: float) -> None:
    with pytest.raises(ConfigError):
        ScriptedPolicy(rate)
    with pytest.raises(ConfigError):
        ScriptedPolicy(0.5, mistakes=[])
