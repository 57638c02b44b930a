"""Mutation testing: small faults, each of which a test must notice."""
