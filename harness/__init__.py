"""Running FMUs: trials, swaps, sweeps, replays, logs, reports, and the `canine` command."""
