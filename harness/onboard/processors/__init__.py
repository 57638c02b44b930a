"""The processors that run the onboard program: this machine's, and simulated ones."""

from harness.onboard.processors.processor import (
    Cost,
    Processor,
    ProcessorError,
    Received,
    Reply,
    Resettable,
    open_processor,
)

__all__ = ["Cost", "Processor", "ProcessorError", "Received", "Reply", "Resettable", "open_processor"]
