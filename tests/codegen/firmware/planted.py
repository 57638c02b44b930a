"""Faults planted in the C that ships, each with a proof that must fail with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from models.errors import CanineError


@dataclass(frozen=True)
class Fault:
    """A text of a file, what takes its place, and the proof that must fail."""

    file: str
    old: str
    new: str
    proof: str

    @property
    def name(self) -> str:
        return f"{self.proof}-{self.old.strip()[:40]}"


class FaultError(CanineError):
    """The C does not have the text that a fault replaces, or has it more than once."""


def plant(fault: Fault, folder: Path) -> str:
    """Plant a fault in the C in a folder; the file's text before.

    Raises:
        FaultError: see there.
    """
    path = folder / fault.file
    text = path.read_text()
    if (count := text.count(fault.old)) != 1:
        raise FaultError(
            f"{fault.file} has {fault.old!r} {count} times, expected once: mend the fault of {fault.proof}"
        )
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
    Fault("link.c", "&positions[POSITION * (i + 1U)]", "&positions[POSITION]", "link.message"),
    # a START of another mission, or of one that is not ready
    Fault("onboard.c", "(m->radio.asked != m->radio.mission.id)", "false", "onboard.begin"),
    Fault("onboard.c", "if (m->watchdog.out.estimate_ok) {", "{", "onboard.begin"),
    # fixes out of range
    Fault("four_state.c", "(m->in.gps_speed <= 50.0f)", "(m->in.gps_speed <= 5000.0f)", "four_state.judge"),
    Fault("four_state.c", "(fabsf(m->in.gps_east) <= 100000.0f)", "true", "four_state.judge"),
    Fault("four_state.c", "(m->in.gps_s_acc <= 100.0f)", "(m->in.gps_s_acc <= 1e9f)", "four_state.judge"),
    Fault("four_state.c", "(m->in.gps_h_acc <= 1000.0f)", "true", "four_state.judge"),
    Fault("four_state.c", "t13 && m->state.started", "m->state.started", "four_state.judge"),
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
)
# by default: one of each kind
FEW = ("watchdog.step", "link.message", "mt.sample", "ubx.good", "command_module.step")
