"""The kit: declaring blocks, tracing them, and the mathematics that they share."""
