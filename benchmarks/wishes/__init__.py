"""Weighted objectives on the 24 cases, beside the best that a dense search finds.

`mixtures` says what is weighed, `comparison` searches and counts, `command` is
`python -m benchmarks wishes`.
"""
