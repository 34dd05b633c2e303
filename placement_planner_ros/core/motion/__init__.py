"""Paths through any space; it knows nothing of robots, only whether an edge is free.

`birrt` is the bidirectional RRT towards a growing set of goals, `shortcut` shortens what it finds.
"""
