"""The processors that the onboard program runs on here: this one, and simulated ones."""

from harness.onboard.processors.processor import (
    Cost,
    Processor,
    ProcessorError,
    Received,
    Reply,
    open_processor,
)

__all__ = ["Cost", "Processor", "ProcessorError", "Received", "Reply", "open_processor"]
