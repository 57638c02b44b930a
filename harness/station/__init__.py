"""The operator's station: a laptop, a browser, and a vest at the end of a radio."""
