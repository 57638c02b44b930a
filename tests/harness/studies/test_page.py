"""The page about tracking: its tables are those of the commands, and its words say what they show."""

import math
import re
from pathlib import Path

import pytest

from harness.replay.comparison import HELD
from harness.studies.page import PAGE, PICTURES, RESULTS, printed
from harness.studies.published import FUZZY, INERTIAL, NO_PITCH, PITCH
from harness.studies.study import Options, run_study
from models.sets import SETS

README = Path(__file__).parents[3] / "README.md"
OURS = "canine_tracker"
FENCE = "```"
HEADINGS = {  # what only this study's table has in its heading, and how many tables it has
    "leading": ("the estimator that leads", 1),
    "motion": ("swing of pitch", 1),
    "pitch": ("six states, no pitch, Q of B.12", 1),
    "outage": ("detection: 300 trials", len(SETS)),
    "outage along a path": ("recorded path: 17 trials", 1),
    "heading": ("heading error in the", 1),
    "tuning": ("below 2 m/s:", 1),
    "recording": ("moving at the end", 1),
    "consistency": ("world: the filter's own,", 1),
    "observability": ("least observable direction", 1),
    "steady": ("dlqe", 1),
    "limit_cycle": ("describing", 1),
}


@pytest.fixture(scope="module")
def page() -> str:
    return (RESULTS / PAGE).read_text()


def tables(page: str, heading: str) -> list[str]:
    """The fenced tables with these words."""
    return [table for table in page.split(FENCE)[1::2] if heading in table]


def rows(table: str) -> dict[str, list[float]]:
    """The numbers of each row by its first cell, without those in brackets; NaN for a dash."""
    cells = [re.split(r"\s{2,}", re.sub(r" \([^)]*\)", "", line)) for line in table.splitlines()]
    return {
        row[0]: [math.nan if cell == "-" else float(cell) for cell in row[1:]]
        for row in cells
        if len(row) > 2 and all(re.fullmatch(r"-|[-+]?[\d.]+(e[-+]\d+)?", cell) for cell in row[1:])
    }


def outage(page: str, set_name: str, gait: str) -> str:
    """The table of a set and a gait, with its tests."""
    (table,) = tables(page, f"set {set_name}, {gait}:")
    return re.split(r"(?m)^set ", table)[1 + (gait == "running")]


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


def test_the_committed_page_has_the_tables_and_pictures_of_each_study(page: str) -> None:
    shown = re.findall(r"\]\(tracking_(\w+)\.png\)", page)
    assert sorted(shown) == sorted(PICTURES)
    assert all((RESULTS / f"tracking_{name}.png").is_file() for name in shown)
    assert {name: len(tables(page, heading)) for name, (heading, _) in HEADINGS.items()} == {
        name: number for name, (_, number) in HEADINGS.items()
    }
    assert page.count(FENCE) == 2 * sum(number for _, number in HEADINGS.values())


@pytest.mark.parametrize("gait", ["detection", "running"])
@pytest.mark.parametrize("set_name", SETS)
def test_the_speed_held_and_our_own_lose_only_where_the_page_says_so(
    page: str, set_name: str, gait: str
) -> None:
    mean = {title: values[0] for title, values in rows(outage(page, set_name, gait)).items()}
    best = min(mean[title] for title in (NO_PITCH, PITCH, FUZZY))
    (row,) = re.findall(rf"\| `{set_name}`, {gait} \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|", page)
    assert tuple(map(float, row)) == (mean[HELD], best, mean[OURS])
    filters = [title for title in mean if title not in (INERTIAL, HELD, "mean speed of 3 s")]
    if set_name != "ideal":
        assert mean[HELD] == min(mean[HELD], best, mean[OURS])
        assert min(filters, key=mean.__getitem__) == OURS
    elif gait == "running":
        assert best < mean[HELD]
    if gait == "running":
        assert mean["two_bias"] <= mean[FUZZY]


def test_along_a_real_dog_s_path_the_speed_held_and_our_own_tie_where_the_page_says_so(page: str) -> None:
    (table,) = tables(page, HEADINGS["outage along a path"][0])
    parts = dict(zip(SETS, re.split(r"(?m)^set ", table)[1:], strict=True))
    for set_name, part in parts.items():
        mean = {title: values[0] for title, values in rows(part).items()}
        (row,) = re.findall(rf"\| `{set_name}` \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \| ([\d.e-]+) \|", page)
        held, best, ours, p = map(float, row)
        assert (held, ours) == (mean[HELD], mean[OURS])
        assert best == min(mean[title] for title in (NO_PITCH, PITCH, FUZZY))
        assert 1.75 < held / rows(outage(page, set_name, "detection"))[HELD][0] < 3.05
        assert (p < 0.05 and max(best, ours) < held) == (set_name == "ideal")


def test_choices_and_page_agree_about_the_position_of_seven_states(page: str) -> None:
    choices = (Path(__file__).parents[3] / "models" / "CHOICES.md").read_text()
    stated = re.search(
        r"off by (\d+) m after 10 s \(study `outage`, .*?; (\d+) m in `consistency`\)", choices
    )
    assert stated
    (consistency,) = tables(page, HEADINGS["consistency"][0])
    (ideal,) = (part for part in consistency.split("world: ") if part.startswith("ideal"))
    (line,) = (line for line in ideal.splitlines() if line.startswith("seven_state"))
    assert float(stated[1]) == round(rows(outage(page, "ideal", "detection"))["seven_state"][0])
    assert f" {stated[2]}." in line


def test_the_page_says_where_the_measured_set_and_the_stated_deviations_fall_short(page: str) -> None:
    # given the running rows of the set and of the dog
    (table,) = tables(page, HEADINGS["motion"][0])
    running = table.partition("running")[2]
    ours, dog = (
        re.findall(r"-?[\d.]+", line)
        for name in ("measured", "real dog")
        for line in running.splitlines()
        if line.startswith(name)
    )
    # then the words have their mean pitch, yaw rates and mean reading: columns 4, 8 and 9, and 10
    words = " ".join(page.split())
    assert f"its pitch is {ours[3]} deg on average against {dog[3]}" in words
    assert f"within {ours[7]} to {ours[8]} deg/s against {dog[7]} to {dog[8]}" in words
    assert f"its mean reading is {ours[9]} m/s2 against {dog[9]}" in words
    # and the shares of the stated deviations name a set for their least
    assert re.search(r"Too few are the positions within twice them in `built_up`", words)


def test_pitch_improves_the_text_s_set_and_fuzzy_is_not_shown_to(page: str) -> None:
    table = outage(page, "dissertation", "detection")
    mean = {title: values[0] for title, values in rows(table).items()}
    assert mean[INERTIAL] > mean[NO_PITCH] > mean[PITCH]
    (p,) = re.findall(rf"{PITCH} less {FUZZY}, paired: .*? p = ([\d.e-]+); ", table)
    assert float(p) > 0.05


def test_the_page_and_the_readme_state_the_shares_of_random_setups(page: str) -> None:
    (table,) = tables(page, HEADINGS["tuning"][0])
    (fuzzy,) = re.findall(r"fuzzy against pitch +(\d+) % .* (\d+) % +(\d+) % +(\d+) %", table)
    better, significantly, worse, slow = fuzzy
    words = " ".join(page.split())
    assert f"constant Q in {better} %, significantly in {significantly} %" in words
    assert f"significantly worse in {worse} %. Where the animal is slow" in words
    assert f"fuzzy is better in {slow} %" in words
    assert f"of 500 random set-ups it is better in {better} %" in README.read_text()


def test_page_and_readme_say_how_often_each_estimator_leads(page: str) -> None:
    # given the shares and intervals, with the simulated attitude and with ours
    (table,) = tables(page, HEADINGS["leading"][0])
    found = re.findall(r"(?m)^(\w+) +([\d.]+) % +\S+ +([\d.]+) % +\S+$", table)
    led = {title: (float(simulated), float(own)) for title, simulated, own in found}
    six, seven, four, ours = (led[title][0] for title in ("six_state", "seven_state", "four_state", OURS))
    # then both pages say that six and seven states lead badly, and what the AHRS does to our own
    readme = " ".join(README.read_text().split())
    assert f"`seven_state` succeed in {six:.0f} and {seven:.0f} %" in readme
    assert f"the others in {four:.0f} %" in readme
    assert f"{four:.0f}" == f"{ours:.0f}" == f"{led['two_bias'][0]:.0f}"
    assert f"with `--ahrs` it succeeds in {led[OURS][1]:.0f} % only" in readme
    assert f"leads {led[OURS][1]:.0f} % of the trials instead of {ours:.0f} %" in page
    assert f"leads {six:.0f} % of the trials, `four_state` {four:.0f} %" in page
    # and that it does nothing for six states
    assert led["six_state"][0] == led["six_state"][1]
    assert led["four_state"][1] >= led["four_state"][0]


def test_the_filter_in_its_own_world_is_as_good_as_it_says(page: str) -> None:
    (table,) = tables(page, HEADINGS["consistency"][0])
    (row,) = re.findall(
        r"four_state, sigma 0\.2 +([\d.]+) \S+ \S+ +\S+ +([\d.]+) ([\d.]+)\.\.([\d.]+)", table
    )
    nis, nees, low, high = map(float, row)
    assert nis == pytest.approx(1, abs=0.02)
    assert low < nees < high


def test_our_own_states_its_position_and_its_bias_no_better_than_they_are(page: str) -> None:
    (table,) = tables(page, HEADINGS["consistency"][0])
    worlds = re.split(r"(?m)^world: ", table)[2:]
    numbers = {
        world.partition(",")[0]: [float(n) for n in line.split()[1:] if ".." not in n and "±" not in n]
        for world in worlds
        for line in world.splitlines()
        if line.startswith(OURS)
    }
    assert numbers.keys() == {"shipped", *SETS}
    for world, (_, _, nees, bias, _, _, _, position, _, speed) in numbers.items():
        assert nees < (1 if world != "built_up" else 4)
        assert bias < 1.2
        assert min(position, speed) > 80  # % within twice the stated deviations, at the end of an outage


def test_on_the_walk_our_own_ties_with_the_speed_held_and_the_text_s_filters_lose(page: str) -> None:
    (table,) = tables(page, HEADINGS["recording"][0])
    moving, standing, *_ = re.split(r"\d+ outages, ", table)[1:]
    p = {title: values[8] for title, values in rows(moving).items() if len(values) > 8}
    assert p[OURS] > 0.05
    assert all(p[title] < 0.05 for title in (NO_PITCH, PITCH, FUZZY, "six_state"))
    assert rows(standing)[OURS][0] < 0.2 * rows(standing)[HELD][0]


def test_the_readme_s_errors_are_the_page_s(page: str) -> None:
    (recording,) = tables(page, HEADINGS["recording"][0])
    moving, standing, *_ = (rows(part) for part in re.split(r"\d+ outages, ", recording)[1:])
    dog = rows(outage(page, "dissertation", "detection"))
    titles = {
        "accelerometer and heading alone": INERTIAL,
        "`four_state`, no pitch": NO_PITCH,
        "`four_state`, pitch": PITCH,
        "`four_state`, pitch, fuzzy tuning": FUZZY,
        "speed held, no filter": HELD,
        "`canine_tracker`, our own": OURS,
    }
    lines = [re.split(r" *\| *", line)[1:-1] for line in README.read_text().splitlines()]
    stated = {line[0]: line for line in lines if line and line[0] in titles}
    assert stated.keys() == titles.keys()
    for label, title in titles.items():
        _, _, *cells = stated[label]
        for cell, table in zip(cells, (dog, moving, standing), strict=True):
            if cell:
                errors = [float(error) for error in cell.split(" / ")]
                # two digits of the page, then one: they differ by half a digit of each
                assert errors == pytest.approx([table[title][0], table[title][4]], abs=0.0551)
    for title in (INERTIAL, NO_PITCH, PITCH, FUZZY):  # which the page rounds as well
        (ours,) = re.findall(rf"\| {title} \| [\d./ ]+ \| ([\d./ ]+) \|", page)
        (label,) = (label for label, of in titles.items() if of == title)
        assert stated[label][2] == ours
