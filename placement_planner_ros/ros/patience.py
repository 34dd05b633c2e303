"""Seconds for which the node waits, each for one kind of thing."""

LOOK_S = 0.1
"""Between looks at whether something has happened: a signal, a stop, something to say."""
CLOSING_S = 0.5
"""That closing waits for a thread, at most."""
STOP_PATIENCE_S = 1.0
"""That stop waits for the worker before it answers STOPPING."""
