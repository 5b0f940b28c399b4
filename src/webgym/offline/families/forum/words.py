"""What forums call things, and the answers on their help pages."""

from __future__ import annotations

from dataclasses import dataclass

from webgym.offline.seeds import stream

VOCABULARY: dict[str, tuple[str, ...]] = {
    "thread": ("thread", "topic", "discussion"),
    "reply": ("reply", "answer", "comment"),
    "likes": ("likes", "thanks", "thumbs up", "points"),
    "like": ("Like", "Thank", "Vote for", "Agree with"),
    "solved": ("Solved", "Answered", "Settled"),
    "open": ("Open", "Unsolved", "Still open"),
    "accepted": ("Accepted answer", "Best answer", "Solution"),
    "follow": ("Follow", "Watch", "Keep an eye on"),
    "report": ("Report", "Flag", "Tell the moderators"),
    "enter": ("Sign in", "Log in"),
    "name": ("User name", "Member name", "Nickname"),
    "password": ("Password", "Pass phrase"),
    "join": ("Register", "Join us", "Create an account"),
    "mail": ("E-mail", "E-mail address", "Your e-mail"),
    "home": ("Favourite board", "Home board", "I am here for"),
    "search": ("Search the forum", "Search", "Find a discussion", "What are you looking for?"),
    "new": ("New {thread}", "Start a {thread}", "Ask the forum"),
    "all": ("All {threads}", "Latest posts", "Everything new"),
    "members": ("Members", "Community", "Who is here"),
    "tags": ("Tags", "Labels", "Keywords"),
    "tag": ("Tag", "Label", "Keyword"),
    "help": ("Rules and help", "Questions and answers", "House rules"),
    "inbox": ("Messages", "Inbox", "Mailbox"),
    "digest": ("E-mail digest", "Summary by e-mail", "Write to me"),
    "sort": ("Sort by", "Order", "Show first"),
    "order": ("Sort replies", "Order of replies", "Show replies"),
    "apply": ("Apply", "Show", "Filter"),
    "state": ("State", "Status", "Solved?"),
    "title": ("Title", "Headline", "What is it about?"),
    "text": ("Text", "Your message", "Write here"),
    "answer": ("Write a reply", "Your answer", "Say something"),
    "post": ("Post", "Send", "Publish"),
    "reason": ("Reason", "Why?", "What is wrong?"),
    "remark": ("Remark", "Note for the moderators", "In your words"),
    "subject": ("Subject", "Heading"),
    "write": ("Write to", "Message", "Send a message to"),
    "setup": ("Set-up", "Gear", "My stuff"),
    "about": ("About", "Profile", "In short"),
    "active": ("Latest post", "Recently active", "Last activity"),
    "newest": ("Newest", "Newest first", "Just started"),
    "top": ("Most {likes}", "Top by {likes}"),
    "busy": ("Most {replies}", "Top by {replies}"),
    "seen": ("Most views", "Top by views"),
    "oldest": ("Oldest first", "In order", "From the start"),
    "vote": ("Vote", "Cast vote", "Count me in"),
}
PLURALS = {"reply": "replies", "answer": "answers", "comment": "comments"}


@dataclass(frozen=True)
class Topic:
    """A question on the help page.

    Attributes:
        ask: the clause of a task.
        fact: what is to be found, as a rubric says it.
        mark: the words in the answer that matter.
        right: spellings of them that a right answer may use.
    """

    question: str
    answer: str
    ask: str
    fact: str
    mark: str
    right: tuple[str, ...]


def topics(seed: int, host: str, thread: str) -> tuple[Topic, ...]:
    """The questions that belong to a seed, in their order."""
    rng = stream(seed, "help")
    box = f"{rng.choice(('team', 'hello', 'moderators', 'post'))}@{host}"
    edit, posts, size, warned = (
        rng.randint(12, 90),
        rng.randint(40, 900),
        rng.randint(120, 990),
        rng.randint(11, 60),
    )
    menu = rng.choice(("Close with thanks", "That was it", "No more answers", "Mark as settled"))
    made = [
        Topic(
            "How long can I edit a post?",
            f"You can change what you wrote for {edit} minutes. After that, ask a moderator.",
            "find out for how many minutes a post can be edited",
            "the time for which a post can be edited is found",
            f"{edit} minutes",
            (str(edit),),
        ),
        Topic(
            "How do I delete my account?",
            f"Write to {box} from the address that you registered with.",
            "find out how to delete an account",
            "the instructions for deleting an account are found",
            box,
            (box,),
        ),
        Topic(
            "How do I become a moderator?",
            f"We ask members with at least {posts} posts, never the other way round.",
            "find out how many posts one needs at least to become a moderator",
            "the number of posts needed to become a moderator is found",
            f"{posts} posts",
            (str(posts),),
        ),
        Topic(
            "How large may pictures be?",
            f"Up to {size} kB each. Larger ones are made smaller without asking.",
            "find out how many kB a picture may have",
            "the largest size of a picture is found",
            f"{size} kB",
            (str(size),),
        ),
        Topic(
            f"How do I end my {thread}?",
            f"Open the menu at its top and choose “{menu}”. Nobody can write in it from then on.",
            f"find out how to end one's own {thread}",
            f"the instructions for ending one's own {thread} are found",
            menu,
            (menu,),
        ),
        Topic(
            "How long does a warning count?",
            f"A warning is forgotten after {warned} days.",
            "find out after how many days a warning is forgotten",
            "the time after which a warning is forgotten is found",
            f"{warned} days",
            (str(warned),),
        ),
    ]
    rng.shuffle(made)
    return tuple(made)
