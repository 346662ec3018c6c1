"""A made-up judgement to draw reports of: agreeing, disagreeing or unchecked. Run by the other report tests."""

from made.reports import make_report


def test_the_example_is_what_it_says():
    assert [make_report(kind, 50).verdict for kind in ("agree", "disagree", "unchecked")] == [
        "agree", "disagree", "unchecked",
    ]  # fmt: skip
