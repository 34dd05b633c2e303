"""Seconds for which the node waits, each for one kind of thing."""

LOOK_S = 0.1
"""Between looks at whether something has happened: a signal, a stop, something to say."""
REST_S = 0.01
"""From handing out a callback until it is looked what else is ready; and between looks whether a
run is to end that waits for what another thread makes."""
STOP_PATIENCE_S = 1.0
"""That stop waits for the worker before it answers STOPPING, and closing for each thread."""
PREPARING_S = 60.0
"""That reading a mesh may take, and making a run's environment and planner; what compiling takes
does not count."""
