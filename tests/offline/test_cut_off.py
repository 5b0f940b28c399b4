"""Evidence that a page cuts off: how it is found, and that the widest pages have none at 1280 pixels."""

from __future__ import annotations

import msgspec

from webgym.core.observation import Observation
from webgym.core.outcome import Ending, Outcome
from webgym.core.task import FactGroup, Rubric, Task
from webgym.core.trajectory import Episode, Reply, Step, Trajectory
from webgym.core.truth import AnswerTruth, Evidence, FactTruth, Give, Truth
from webgym.testing.solutions import cut_off

SITES = 6


TASK = Task(
    id="offline/fernhill/trip",
    instruction="Find the arrival time.",
    website="http://fernhill.webgym.test/",
    domain="Travel & Transportation",
    subdomain="Ground",
    rubric=Rubric((FactGroup(1, "The trip", ("the arrival time is found",)),)),
    source="offline",
    truth=Truth(
        host="fernhill.webgym.test",
        facts=(FactTruth(1, 0, evidence=(Evidence(("X 12", "15:45"), "/trip/"),)),),
        answer=AnswerTruth(),
        moves=(Give("15:45"),),
    ),
)
CUT = Observation(
    "a",
    "http://fernhill.webgym.test/trip/1",
    "",
    (1280, 768),
    text="X 12\n14:30 to …",
    cuts=(("14:30 to 15:45", "14:30 to …"),),
)


def looked(*seen: Observation) -> Trajectory:
    steps = tuple(Step(i, observation, (), Reply("…", "test")) for i, observation in enumerate(seen))
    ending = Ending.ANSWERED
    return Trajectory(Episode("x", TASK.id, 0, 0, 1, "test", 0.0, 1.0, steps, ending), Outcome.SUCCESS)


def test_evidence_in_a_line_that_does_not_show_it_is_found() -> None:
    change = msgspec.structs.replace
    shown = change(CUT, text="X 12\n14:30 to 15:45", cuts=())
    elsewhere = change(CUT, url="http://fernhill.webgym.test/")
    told = f'{TASK.id}: "15:45" is cut off on /trip/1, which shows "14:30 to …"'
    assert list(cut_off({TASK.id: TASK}, [looked(CUT)])) == [told]
    assert list(cut_off({TASK.id: TASK}, [looked(CUT, shown)])) == []
    assert list(cut_off({TASK.id: TASK}, [looked(elsewhere)])) == []
