"""The page about the models is what the declarations give."""

from models.document import README, readme


def test_the_page_is_up_to_date():
    assert README.read_text() == readme(), "declarations have changed: run `python -m models.document`"
