"""Faults planted in the C that ships, each with a proof that must fail with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.errors import CanineError


@dataclass(frozen=True)
class Fault:
    """A text of a file, what takes its place wherever it stands, and the proof that must fail."""

    file: str
    old: str
    new: str
    proof: str

    @property
    def name(self) -> str:
        return f"{self.proof}-{self.old.strip()[:40]}"


# a turn to the left ends early, since the animal will turn on
CARRIED = "(t0 <= 0.0f) && (t2 < m->par.moving_deviation)) {\n            m->state.now = CMEC_MODE_"


class FaultError(CanineError):
    """The C does not have the text that a fault replaces."""


def plant(fault: Fault, folder: Path) -> str:
    """Plant a fault in the C in a folder; the file's text before.

    Raises:
        FaultError: see there.
    """
    path = folder / fault.file
    text = path.read_text()
    if fault.old not in text:
        raise FaultError(f"{fault.file} has no {fault.old!r}: mend the fault planted for {fault.proof}")
    path.write_text(text.replace(fault.old, fault.new))
    return text


FAULTS = (
    # ages that do not count
    Fault("watchdog.c", "(int16_t)(m->state.imu_age + 1)", "m->state.imu_age", "watchdog.step"),
    Fault("watchdog.c", "(int16_t)(m->state.link_age + 1)", "m->state.link_age", "watchdog.step"),
    Fault("watchdog.c", "(int16_t)(m->state.override_age + 1)", "m->state.override_age", "watchdog.step"),
    Fault("watchdog.c", "(int16_t)(m->state.report_age + 1)", "m->state.report_age", "watchdog.step"),
    Fault("watchdog.c", "next_link_age <= m->", "next_link_age < m->", "watchdog.step"),
    # a message that changes what it is not for
    Fault(
        "link.c",
        "message = (length == 0U) ? LINK_ABORT : LINK_NOTHING;",
        "message = (length == 0U) ? LINK_ABORT : LINK_NOTHING; m->mission.count = 0U;",
        "link.message",
    ),
    Fault(
        "link.c",
        "message = (length == 0U) ? LINK_ABORT : LINK_NOTHING;",
        "message = (length == 0U) ? LINK_ABORT : LINK_NOTHING; m->mission.home.latitude++;",
        "link.message",
    ),
    Fault("link.c", "m->asked = big_u16(payload);", "m->asked = m->mission.id;", "link.message"),
    Fault("link.c", "bool valid = !m->locked && ", "bool valid = ", "link.message"),
    Fault("link.c", "(payload[0] <= MAX_COMMAND)", "(payload[0] <= 6U)", "link.message"),
    Fault("link.c", "&bytes[POSITION * i]", "&bytes[0]", "link.message"),
    Fault("link.c", "(corners >= MIN_CORNERS)", "true", "link.message"),
    Fault("link.c", "(corners <= LINK_MAX_CORNERS)", "true", "link.message"),
    Fault("link.c", "corners = payload[ID];", "corners = 0U;", "link.message"),
    # rule 11: a tag that is not judged, in part or at all; a counter or an age that does not matter
    Fault("link.c", "return different == 0U;", "return true;", "link.accept"),
    Fault("link.c", "different |= (uint8_t)(got[i]", "different = (uint8_t)(got[i]", "link.accept"),
    Fault("link.c", "i < SIPHASH_TAG; i++", "i < 6U; i++", "link.accept"),
    Fault("link.c", "&frame[HEADER + length];", "&frame[HEADER];", "link.accept"),
    Fault("link.c", "(uint8_t)(HEADER - TYPE + length)", "(uint8_t)(HEADER - TYPE)", "link.accept"),
    Fault("link.c", "counter <= m->received", "counter < m->received", "link.accept"),
    Fault("link.c", "        m->received = counter;\n", "", "link.accept"),
    Fault("link.c", "(age > oldest)", "false", "link.accept"),
    Fault("link.c", "? m->told : LINK_FRESH", "? UINT32_MAX : LINK_FRESH", "link.accept"),
    Fault("link.c", "scanner_count(&m->forged, 1U);", "m->override = 0U;", "link.accept"),
    Fault("link.c", "    m->told++;\n", "", "link.telemetry"),
    # a START of another mission, or of one that is not ready
    Fault("onboard.c", "(m->radio.asked != m->radio.mission.id)", "false", "onboard.begin"),
    Fault("onboard.c", "if (m->watchdog.out.estimate_ok) {", "{", "onboard.begin"),
    Fault("onboard.c", "if (m->estimator.out.heading_ok) {", "{", "onboard.begin"),
    Fault(
        "onboard.c", "if ((float)m->gps.fix.h_acc <= (1000.0f * CMEC_CAPTURE_RADIUS)) {", "{", "onboard.begin"
    ),
    Fault("onboard.c", "leaves(m, VIBRATION, CMEC_WINDOW_VIBRATION) &&", "", "onboard.begin"),
    Fault("onboard.c", " && leaves(m, TONE, CMEC_WINDOW_TONE)", "", "onboard.begin"),
    Fault("onboard.c", "< CMEC_WINDOW_ISSUES)", "<= CMEC_WINDOW_ISSUES)", "onboard.begin"),
    Fault(
        "onboard.c",
        "m->planned = m->place == (corners + 1U + held->count);",
        "m->planned = true;",
        "onboard.begin",
    ),
    Fault("onboard.c", "    if (m->planned) {\n        ready", "    {\n        ready", "onboard.begin"),
    Fault("onboard.c", "(m->battery_mv >= ONBOARD_LEAST_BATTERY_MV)", "true", "onboard.begin"),
    Fault("onboard.c", " && (m->temperature <= ONBOARD_MOST_TEMPERATURE)", "", "onboard.begin"),
    Fault(
        "onboard.c",
        "(m->estimator.state.rejected == 0)",
        "(m->estimator.state.rejected <= 1)",
        "onboard.begin",
    ),
    Fault(
        "onboard.c", "is_inside(m, m->estimator.out.north, m->estimator.out.east)", "true", "onboard.begin"
    ),
    # fixes out of range
    Fault("four_state.c", "(m->in.gps_speed <= 50.0f)", "(m->in.gps_speed <= 5000.0f)", "four_state.judge"),
    Fault("four_state.c", "(fabsf(m->in.gps_east) <= 100000.0f)", "true", "four_state.judge"),
    Fault("four_state.c", "(m->in.gps_s_acc <= 100.0f)", "(m->in.gps_s_acc <= 1e9f)", "four_state.judge"),
    Fault("four_state.c", "(m->in.gps_h_acc <= 1000.0f)", "true", "four_state.judge"),
    Fault("four_state.c", "t14 && m->state.started", "m->state.started", "four_state.judge"),
    Fault("four_state.c", "(next_east_sd <= m->par.max_position_sd)", "true", "four_state.output"),
    Fault("four_state.c", "(next_speed_sd <= m->par.max_speed_sd)", "true", "four_state.output"),
    Fault(
        "four_state.c", "m->state.started && next_heading_ok &&", "m->state.started &&", "four_state.output"
    ),
    Fault("four_state.c", "(m->state.silence <= m->par.frozen_samples)", "true", "four_state.output"),
    Fault("four_state.c", "(next_silence <= m->par.frozen_samples)", "true", "four_state.silent"),
    Fault("four_state.c", "(next_sample_sum == m->state.sample_sum)", "false", "four_state.silent"),
    Fault(
        "four_state.c",
        "next_heading_ok = !m->state.contradicted",
        "next_heading_ok = true",
        "four_state.output",
    ),
    Fault(
        "four_state.c",
        "(m->state.contradicted && (next_contradiction > 0.0f))",
        "m->state.contradicted",
        "four_state.confront",
    ),
    Fault("four_state.c", "(next_contradiction >= m->par.heading_time) ||", "", "four_state.confront"),
    Fault(
        "four_state.c", "> m->par.heading_limit) ? t1 : (-t1)", "> 3.0f) ? t1 : (-t1)", "four_state.confront"
    ),
    Fault("four_state.c", "m->state.rejections + (int16_t)", "0 + (int16_t)", "four_state.judge"),
    Fault("four_state.c", "((0.04f * (float)m->state.age) <= m->par.max_age)", "true", "four_state.output"),
    # a counter that is stuck, a flag that is not looked at
    Fault("mt.c", "m->counter = counter;", "", "mt.sample"),
    Fault("mt.c", "(counter != m->counter)", "true", "mt.sample"),
    Fault("mt.c", "scanner_count(&m->lost, gap);", "scanner_count(&m->lost, 1U);", "mt.sample"),
    Fault("ubx.c", "m->good = sol_is_fix(payload);", "m->good = true;", "ubx.good"),
    Fault("ubx.c", "if (m->good) {", "if (true) {", "ubx.receive"),
    Fault("ubx.c", "if (pvt_is_fix(payload, length)) {", "{", "ubx.receive"),
    Fault("ubx.c", "if (!known) {", "{", "ubx.receive"),
    # cues
    Fault(
        "command_module.c",
        "m->out.vibrate_left = m->in.command == COMMAND_MODULE_COMMAND_LEFT;",
        "m->out.vibrate_left = (m->in.command % 4) == 0;",
        "command_module.step",
    ),
    Fault(
        "command_module.c",
        "(m->in.command == COMMAND_MODULE_COMMAND_RECALL) ? m->par.recall_tone\n",
        "(m->in.command >= COMMAND_MODULE_COMMAND_RECALL) ? m->par.recall_tone\n",
        "command_module.step",
    ),
    # precedence
    Fault("cmec.c", "m->in.link_ok ? t2 : CMEC_ANOMALY_LOST_LINK", "t2", "cmec.precedence"),
    # the safety rules
    Fault(
        "cmec.c",
        " && (m->state.overruled == CMEC_ANOMALY_NONE)) ? m->in.override",
        ") ? m->in.override",
        "rule_1.precedence",
    ),
    Fault(
        "cmec.c",
        "(m->state.now == CMEC_MODE_RECALL) ? CMEC_COMMAND_RECALL",
        "(m->state.now == CMEC_MODE_RECALL) ? CMEC_COMMAND_FORWARD",
        "rule_1.mode",
    ),
    Fault("cmec.c", "m->state.reached = next_reached;", "m->state.reached = 17;", "controller.tick"),
    Fault("cmec.c", "(fabsf(m->in.speed) < m->par.stopped_speed) && ", "", "rule_2.rest"),
    Fault("cmec.c", "(fabsf(m->in.speed) < m->par", "(m->in.speed < m->par", "rule_2.rest"),
    Fault("cmec.c", "(m->in.speed_sd <= m->par.rest_speed_sd)", "true", "rule_2.rest"),
    Fault(
        "cmec.c",
        "(0.04f * (float)m->state.ticks) > (m->par.turn_timeout - 0.004f)",
        "m->state.ticks > 76",
        "rule_2.rest",
    ),
    Fault(
        "cmec.c",
        "m->state.now = CMEC_MODE_DEAD;\n            m->state.ticks = 0;\n"
        "            m->state.planned = CMEC_COMMAND_LEFT;\n            m->state.uncounted = false;",
        "m->state.now = CMEC_MODE_LEFT;",
        "rule_2.switch",
    ),
    Fault(
        "cmec.c",
        f"{CARRIED}FORWARD;",
        f"{CARRIED}RIGHT;",
        "rule_2.switch",
    ),
    Fault(
        "cmec.c", "m->state.turns >= m->par.max_turns", "m->state.turns > m->par.max_turns", "rule_2.turns"
    ),
    Fault(
        "cmec.c",
        "m->state.now = CMEC_MODE_FAILED;",
        "m->state.now = CMEC_MODE_STOP_TO_TURN;",
        "rule_2.failed",
    ),
    Fault(
        "cmec.c",
        "? CMEC_MODE_STOPPED : CMEC_MODE_IDLE;",
        "? CMEC_MODE_FORWARD : CMEC_MODE_IDLE;",
        "rule_2.end",
    ),
    Fault(
        "cmec.c",
        "(t3 && (m->state.allowance[1] <= m->state.spent[1]))",
        "(t3 && (m->state.allowance[1] < m->state.spent[1]))",
        "rule_3.budget",
    ),
    Fault(
        "cmec.c",
        "(t4 && (m->state.allowance[0] <= m->state.spent[0]))",
        "(t4 && (m->state.allowance[0] < m->state.spent[0]))",
        "rule_3.budget",
    ),
    Fault(
        "cmec.c",
        "(m->state.allowance[2] <= m->state.spent[2])",
        "(m->state.allowance[2] < m->state.spent[2])",
        "rule_3.budget",
    ),
    Fault("cmec.c", "const float t6 = (t4 < t5) ? t4 : t5;", "const float t6 = t5;", "rule_3.budget"),
    Fault(
        "cmec.c",
        "next_led && (m->state.now <= CMEC_MODE_STOP_AT_WAYPOINT) && !m->state.led",
        "(m->state.now == CMEC_MODE_FORWARD) && !m->state.led",
        "rule_3.budget",
    ),
    Fault(
        "cmec.c",
        "m->state.earlier_spent[1] = m->state.block_spent[1];",
        "m->state.earlier_spent[1] = m->state.spent[1];",
        "rule_3.window",
    ),
    Fault(
        "cmec.c",
        "((m->in.override == CMEC_COMMAND_STOP) || t0)",
        "true",
        "rule_3.refused",
    ),
    Fault(
        "cmec.c",
        "(next_exhausted && t6) ? CMEC_COMMAND_STOP",
        "(t7 && t6) ? CMEC_COMMAND_STOP",
        "rule_3.budget",
    ),
    Fault("cmec.c", "m->state.cue_ticks = next_cue_ticks;", "m->state.cue_ticks = 0;", "rule_3.longest"),
    Fault("cmec.c", "m->out.command = CMEC_COMMAND_STOP;", "", "rule_4.breach"),
    Fault("cmec.c", "= m->state.led ? CMEC_MODE_STOPPED : m->state.now;", "= m->state.now;", "rule_4.breach"),
    Fault(
        "cmec.c", "((0.2f * (float)next_surveys) > (m->par.mission_time - 0.02f))", "false", "rule_4.times"
    ),
    Fault("cmec.c", "(0.04f * (float)next_leg_ticks)", "(0.02f * (float)next_leg_ticks)", "rule_4.times"),
    Fault("cmec.c", "(t6 ? 0.0f : (0.04f * (float)t1))", "(t6 ? 0.0f : (0.02f * (float)t1))", "rule_4.still"),
    Fault("cmec.c", "((m->state.cue == CMEC_COMMAND_FORWARD)", "((m->out.command == 1)", "rule_4.still"),
    Fault(
        "cmec.c",
        "((next_closest + m->par.departing_distance) < m->out.distance)",
        "(m->par.departing_distance > 1e9f)",
        "rule_4.departing",
    ),
    Fault("cmec.c", "(m->state.survey_ticks < 4)", "(m->state.survey_ticks < 9)", "rule_4.survey"),
    Fault("cmec.c", "> (m->par.fence_radius * m->par.fence_radius)", "> 2e6f", "rule_7.radius"),
    Fault("cmec.c", "(m->state.overruled == CMEC_ANOMALY_LOST_LINK) && m->state.led", "false", "rule_9.link"),
    Fault("cmec.c", "m->in.start && (m->state.now == CMEC_MODE_IDLE)", "m->in.start", "rule_9.begin"),
    Fault("cmec.c", "if (m->state.recalling && (m->state.now", "if ((m->state.now", "rule_9.begin"),
    Fault(
        "cmec.c",
        "(m->state.led ? m->par.longest_stop : m->par.stop_hold)",
        "m->par.longest_stop",
        "rule_12.silence",
    ),
)
# by default: one of each kind
FEW = (
    "watchdog.step",
    "link.message",
    "mt.sample",
    "ubx.good",
    "command_module.step",
    "rule_3.refused",
    "rule_9.link",
)
