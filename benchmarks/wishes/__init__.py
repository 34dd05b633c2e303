"""Weighted objectives on the 24 cases, beside the best that a dense search finds.

`mixtures` says what is weighed, `comparison` searches, `report` counts, `command` is
`python -m benchmarks wishes`.
"""
