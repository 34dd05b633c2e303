"""Explanation of a search that found nothing, or little: counts, cause and remedy."""
