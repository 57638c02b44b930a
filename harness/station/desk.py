"""Who commands: one operator, whose browser lives; all others watch."""

from __future__ import annotations

from models.errors import CanineError

ALIVE_S = 1.0  # s without a sign of life after which nobody commands


class OrderError(CanineError):
    """An order that cannot be carried out now."""


class Desk:
    """The operators at their browsers, by number, and which of them commands.

    Attributes:
        operators: all that are connected.
        commander: who commands; None for nobody.
        offered: the commander hands over: whoever takes has the command; until then the commander keeps it.
    """

    def __init__(self) -> None:
        self.operators: set[int] = set()
        self.commander: int | None = None
        self.offered = False
        self._heard = 0.0  # s, when the commander last showed that it lives

    def join(self, operator: int) -> None:
        """An operator is there, and watches."""
        self.operators.add(operator)

    def leave(self, operator: int) -> None:
        """An operator is gone; if it commanded, nobody does."""
        self.operators.discard(operator)
        if operator == self.commander:
            self.commander, self.offered = None, False

    def lives(self, now: float) -> bool:
        """Does anybody command, and has shown within ALIVE_S that the browser lives?"""
        return self.commander is not None and now - self._heard <= ALIVE_S

    def hear(self, operator: int, now: float) -> None:
        """A sign of life."""
        if operator == self.commander:
            self._heard = now

    def take(self, operator: int, now: float) -> None:
        """An operator takes the command; the commander itself withdraws its offer.

        Raises:
            OrderError: another commands, lives, and has not handed over.
        """
        if operator != self.commander and self.lives(now) and not self.offered:
            raise OrderError(
                f"take: operator {self.commander} commands; expected that it hands over, or that its "
                f"browser has been silent for {ALIVE_S:g} s"
            )
        self.commander, self.offered, self._heard = operator, False, now

    def hand_over(self, operator: int) -> None:
        """The commander offers the command.

        Raises:
            OrderError: it is another operator.
        """
        self.require(operator, "hand_over")
        self.offered = True

    def require(self, operator: int, order: str) -> None:
        """Let the commander alone pass.

        Raises:
            OrderError: it is another operator.
        """
        if operator != self.commander:
            who = "nobody" if self.commander is None else f"operator {self.commander}"
            raise OrderError(f"{order}: {who} commands, operator {operator} watches; take the command first")
