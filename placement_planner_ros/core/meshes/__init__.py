"""Mesh files of links and objects: what their headers show, and their triangles."""
