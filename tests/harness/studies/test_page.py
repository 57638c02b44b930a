"""The page about tracking: its tables are those of the commands, and its pictures are there."""

import re

from harness.studies import STUDIES
from harness.studies.page import PAGE, PICTURES, RESULTS, printed
from harness.studies.study import Options, run_study


def test_a_table_of_the_page_is_what_the_command_prints() -> None:
    # when a study is printed for the page
    result = run_study("pitch", Options(seeds=2))
    lines = printed("pitch", result).splitlines()
    # then its rows have the result's numbers, and nothing but text
    assert len(lines) > len(result["configurations"])
    assert "\x1b" not in "".join(lines)
    assert lines == [line.rstrip() for line in lines]
    for title in result["configurations"]:
        assert any(line.startswith(title) for line in lines)


def test_the_committed_page_has_a_table_and_a_picture_of_each_study() -> None:
    page = (RESULTS / PAGE).read_text()
    shown = re.findall(r"\]\(tracking_(\w+)\.png\)", page)
    assert sorted(shown) == sorted(PICTURES)
    assert all((RESULTS / f"tracking_{name}.png").is_file() for name in shown)
    assert page.count("```") // 2 >= len(STUDIES)
