"""A made-up task that calls every kernel."""
