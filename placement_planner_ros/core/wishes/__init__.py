"""Rules and wishes: what users ask of a placement beside that it is possible.

`settings` holds what is asked, `checks` says what is no direction, pose or box, `turns` which turns
about the vertical keep a rule about how the object is turned.
"""
