"""`placement_view`: what the node searches, finds and rejects, as a page in the browser.

A plain subscriber in a process of its own: what it costs the search is what its subscriptions cost
the node. `listening` hears the node, `record` remembers its run, `stage` draws the scene and
`panel` what is beside it; `page` brings them together, ten times a second.
"""
