"""Why a search found nothing, or little, in words, with what to try.

`search.explain` puts it together; `surfaces` looks at what V holds, `collisions` at what is met.
"""
